"""The sheared contact of a block that relaxes, against closed forms and another way of integration,
and its traction got back from what is seen.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from analysis.mechanics.interface import Interface
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from analysis.mechanics.relaxation import Relaxation, RelaxationCorrection

G, TAU, SPEED = 0.3, 0.7, 5e-6
BLOCK = Relaxation(G, TAU)
CONTACT = SphereContact(P=0.1, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.9, L=0.8e-6, relaxation=BLOCK)


def ramp(contact: SphereContact, step: float, until: float, hold: float = 0.0) -> LoadingState:
    """The contact after a steady drive of the block, then a hold, in steps of so many seconds."""
    loading = AxisymmetricLoading(contact, 16)
    state = loading.rest
    for k in range(1, round((until + hold) / step) + 1):
        state = loading.advance(state, SPEED * min(k * step, until), duration=step)
    return state


@pytest.mark.parametrize("hold", [0.0, 0.4, 3.0])
def test_full_stick_is_the_hereditary_integral_of_mindlins_stiffness(hold: float) -> None:
    """Of a face that gives way by 1e-4 of the block: K (D + g/(1 - g) times what D rose by, each
    part fading with tau).
    """
    stuck = replace(CONTACT, mu=1e4, L=1e-9)
    until = 1.0
    D, end = SPEED * until, until + hold
    fading = SPEED * TAU * (np.exp(-hold / TAU) - np.exp(-end / TAU))
    K = 8 * stuck.G * stuck.a / (2 - stuck.nu)
    Q = ramp(stuck, 0.02, until, hold).Q
    assert pytest.approx(K * (D + G / (1 - G) * fading), rel=2e-3) == Q


def test_partial_slip_is_that_of_another_integration() -> None:
    """The same block in terms of its strain, by an adaptive integration: ``(1 - g) G sigma = u -
    v`` with ``dv/dt = (g u - v)/tau``, and the law of a first loading in place of the memory.
    """
    loading, until = AxisymmetricLoading(CONTACT, 16), 2.0
    soft = CONTACT.mu * CONTACT.L

    def slip(t: float, v: np.ndarray) -> np.ndarray:
        def off(s: np.ndarray) -> np.ndarray:
            sigma = -CONTACT.mu * loading.p * np.expm1(-s / soft)
            return SPEED * t - s - v - (1 - G) * loading._green @ sigma

        found = root(off, np.full(v.shape, SPEED * t / 3), tol=1e-14)
        return np.asarray(found.x)

    def rate(t: float, v: np.ndarray) -> np.ndarray:
        return (G * (SPEED * t - slip(t, v)) - v) / TAU

    course = solve_ivp(rate, (0.0, until), np.zeros(16), rtol=1e-7, atol=1e-12)
    s = slip(until, course.y[:, -1])
    Q = float(loading._weight @ (-CONTACT.mu * loading.p * np.expm1(-s / soft)))
    assert pytest.approx(Q, rel=2e-5) == ramp(CONTACT, 0.01, until).Q
    assert pytest.approx(loading.at_block(SPEED * until).Q, rel=2e-2) != Q


def test_the_surface_seen_and_the_traction_follow_the_law_at_every_radius() -> None:
    state = ramp(CONTACT, 0.1, 1.5)
    r = np.linspace(0, 0.999, 40) * CONTACT.a
    law = Interface(CONTACT.mu, CONTACT.L)
    p0 = CONTACT.peak_pressure
    expected = law.traction(state.D - state.displacement(r)[0], CONTACT.pressure(r))
    np.testing.assert_allclose(state.traction(r), expected, atol=1e-4 * p0)


def test_the_error_falls_with_the_square_of_the_step() -> None:
    coarse, middle, fine = (ramp(CONTACT, step, 1.6, 0.4).Q for step in (0.2, 0.1, 0.05))
    assert (coarse - middle) / (middle - fine) == pytest.approx(4.0, rel=0.15)


def test_a_fast_step_meets_the_modulus_at_once_and_a_slow_one_the_relaxed_one() -> None:
    """Of a stiffer block on a lens as much flatter, the area and the pressure are the same."""
    loading = AxisymmetricLoading(CONTACT, 32)
    stiff = replace(CONTACT, E=CONTACT.E / (1 - G), R=CONTACT.R / (1 - G), relaxation=Relaxation())
    assert stiff.a == pytest.approx(CONTACT.a, rel=1e-12)
    r = np.linspace(0, 2 * CONTACT.a, 7)
    for duration, elastic in ((0.0, stiff), (np.inf, replace(CONTACT, relaxation=Relaxation()))):
        state = loading.advance(loading.rest, 4e-6, duration=duration)
        expected = AxisymmetricLoading(elastic, 32).at_block(4e-6)
        assert pytest.approx(expected.Q, rel=1e-9) == state.Q
        np.testing.assert_allclose(
            state.displacement(r), expected.displacement(r), rtol=1e-8, atol=1e-18
        )


def test_a_load_that_changes_is_refused() -> None:
    loading = AxisymmetricLoading(CONTACT, 16)
    with pytest.raises(ValueError, match="block that relaxes, whose contact has one area; keep P"):
        loading.advance(loading.rest, 1e-6, P=0.2)


@pytest.mark.parametrize(("share", "time"), [(1.0, 1.0), (-0.1, 1.0), (0.1, 0.0), (0.1, np.inf)])
def test_what_is_no_relaxation_is_refused(share: float, time: float) -> None:
    with pytest.raises(ValueError, match="give a share from 0 to below 1 and a positive time"):
        Relaxation(share, time)


def test_the_traction_is_got_back_from_what_an_elastic_block_would_show() -> None:
    """At uneven times: of a traction that is linear between them, to the last digits."""
    times = np.array([0.1, 0.15, 0.4, 1.3, 1.31, 4.0])
    shape = np.array([1.0, -2.0, 0.5])
    sigma = np.outer([3.0, 3.5, 3.2, 6.0, 6.1, 1.0], shape)
    knots = np.concatenate([[0.0], times])
    traction = np.concatenate([[0.0], sigma[:, 0]])
    fine = np.unique(np.concatenate([np.linspace(0, 4, 400_001), times]))
    # sigma minus what it has not yielded to yet: g times the integral of its rate, fading
    slopes = np.diff(traction) / np.diff(knots)
    at = (fine[1:] + fine[:-1]) / 2
    rate = slopes[np.searchsorted(knots, at) - 1] * np.diff(fine)
    fading = TAU / (1 - G)
    correction = RelaxationCorrection(BLOCK)
    for t, true in zip(times, sigma, strict=True):
        before = at < t
        late = float(rate[before] @ np.exp(-(t - at[before]) / fading))
        seen = shape * (traction[np.searchsorted(knots, t)] - G * late)
        np.testing.assert_allclose(correction.at(t, seen), true, rtol=1e-6)
