"""The interface law against a crowd of springs that are moved one by one, and against what the law
must satisfy.
"""

import numpy as np
import pytest

from analysis.mechanics.interface import Interface, Memory, elastic_length

MU, L = 0.93, 0.8e-6
LAW = Interface(MU, L)
SPRINGS = 200_000


class Crowd:
    """Springs by the pressure at which they touch; slow, and nothing else than Coulomb's law for
    each.
    """

    def __init__(self, highest: float) -> None:
        self.touch = (np.arange(SPRINGS) + 0.5) * highest / SPRINGS
        self.width = highest / SPRINGS
        self.deflection = np.zeros(SPRINGS)

    def follow(self, p: float, move: float) -> float:
        holds = np.maximum(MU * L * np.log(np.maximum(p / self.touch, 1.0)), 0.0)
        self.deflection = np.clip(self.deflection + move, -holds, holds)
        return float(self.deflection.sum() * self.width / L)


def test_any_history_is_that_of_a_crowd_of_springs():
    rng = np.random.default_rng(5)
    for _ in range(8):
        p = np.array([30e3])
        crowd, memory = Crowd(80e3), Memory.fresh(1)
        for move in rng.normal(size=(14, 1)) * rng.choice([0.2, 1, 4], (14, 1)) * MU * L:
            before, p = p, np.clip(p * rng.choice([1, 1, 0.7, 1.3]), 1e3, 79e3)
            crowd.follow(p[0], 0.0)
            memory = LAW.under(memory, before, p)
            sigma, _, front = LAW.respond(memory, p, move)
            memory = LAW.remember(memory, p, move, front)
            assert sigma[0] == pytest.approx(crowd.follow(p[0], move[0]), abs=1e-4 * MU * p[0])


def test_points_that_move_apart_keep_their_own_memory():
    rng = np.random.default_rng(6)
    p = rng.uniform(1e3, 50e3, 40)
    moves = rng.normal(size=(9, 40)) * MU * L
    together, alone = Memory.fresh(40), [Memory.fresh(1)] * 40
    for move in moves:
        sigma, _, front = LAW.respond(together, p, move)
        together = LAW.remember(together, p, move, front)
        for i in range(40):
            one = slice(i, i + 1)
            own, _, front = LAW.respond(alone[i], p[one], move[one])
            alone[i] = LAW.remember(alone[i], p[one], move[one], front)
            assert own[0] == pytest.approx(sigma[i], rel=1e-12, abs=1e-9)
    assert max(len(m.slopes) for m in alone) <= len(together.slopes) <= 2 * len(moves)


def test_a_reversal_repeats_the_first_loading_at_twice_its_size():
    p, s = np.full(5, 20e3), np.linspace(0.1, 5, 5) * MU * L
    up, _, front = LAW.respond(Memory.fresh(5), p, s)
    memory = LAW.remember(Memory.fresh(5), p, s, front)
    np.testing.assert_allclose(up, LAW.traction(s, p), rtol=1e-13)
    down, stiffness, _ = LAW.respond(memory, p, -0.7 * s)
    np.testing.assert_allclose(down, up - 2 * LAW.traction(0.35 * s, p), rtol=1e-12)
    np.testing.assert_allclose(stiffness, LAW.stiffness(0.35 * s, p), rtol=1e-12)


def test_a_point_that_comes_into_contact_starts_unstressed():
    memory = LAW.under(Memory(np.zeros((1, 2)), np.ones(1)), np.zeros(2), np.array([10e3, 0.0]))
    sigma, stiffness, _ = LAW.respond(memory, np.array([10e3, 0.0]), np.full(2, 0.3e-6))
    np.testing.assert_allclose(sigma, [LAW.traction(0.3e-6, 10e3), 0], rtol=1e-13)
    np.testing.assert_allclose(stiffness, [LAW.stiffness(0.3e-6, 10e3), 0], rtol=1e-13)


def test_stiffness_is_the_slope_and_displacement_the_inverse():
    s, p = np.linspace(-4e-6, 4e-6, 41), 25e3
    step = 1e-11
    slope = (LAW.traction(s + step, p) - LAW.traction(s - step, p)) / (2 * step)
    apart = np.abs(s) > step
    np.testing.assert_allclose(LAW.stiffness(s, p)[apart], slope[apart], rtol=1e-5)
    assert LAW.stiffness(0.0, p) == pytest.approx(p / L)
    np.testing.assert_allclose(LAW.displacement(LAW.traction(s, p), p), s, rtol=1e-10, atol=1e-20)
    np.testing.assert_array_equal(
        LAW.displacement([MU * p, -MU * p, 1.01 * MU * p, 0], [p, p, p, 0]),
        [np.inf, -np.inf, np.nan, 0],
    )


def test_a_rigid_interface_is_coulombs():
    rigid = Interface(MU, 0.0)
    np.testing.assert_array_equal(rigid.traction([-1e-9, 0, 1e-9], 1e3), [-MU * 1e3, 0, MU * 1e3])
    np.testing.assert_array_equal(rigid.stiffness([0, 1e-9], 1e3), [np.inf, 0])
    np.testing.assert_array_equal(rigid.displacement([0, 0.9 * MU, MU], 1.0), [0, 0, np.inf])
    with pytest.raises(ValueError, match="rigid interface"):
        rigid.respond(Memory.fresh(1), np.ones(1), np.ones(1))


def test_elastic_length_of_the_papers_surface():
    assert elastic_length(0.595e-6, 0.5) == pytest.approx(0.89e-6, rel=5e-3)


@pytest.mark.parametrize(
    ("mu", "length"), [(0.0, L), (-1.0, L), (np.nan, L), (MU, -1e-9), (MU, np.inf)]
)
def test_bad_interfaces_are_refused(mu, length):
    with pytest.raises(ValueError, match=r"^interface: "):
        Interface(mu, length)
