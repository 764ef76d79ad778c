"""The surface operator: against quadrature, direct sums, closed forms of sphere contacts and the
layer's equations of equilibrium.
"""

from __future__ import annotations

import math
import tracemalloc
from functools import cache

import numpy as np
import pytest
from scipy import integrate
from scipy.linalg import expm
from scipy.special import jv

from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.half_space import SurfaceGreen, layer_correction

E, NU, P, R = 3.43e6, 0.5, 0.5, 128.8e-3
RNG = np.random.default_rng(4)


def integrated(x, y, nu, pitch):
    """G_xx and G_xy of a cell of unit traction and unit modulus, by adaptive quadrature."""
    G = 1 / (2 * (1 + nu))

    def along(b, a):
        r = math.hypot(x - a, y - b)
        return ((1 - nu) / r + nu * (x - a) ** 2 / r**3) / (2 * math.pi * G)

    def across(b, a):
        return nu * (x - a) * (y - b) / math.hypot(x - a, y - b) ** 3 / (2 * math.pi * G)

    half = pitch[0] / 2, pitch[1] / 2
    return [
        integrate.dblquad(f, -half[0], half[0], -half[1], half[1], epsabs=1e-13)[0]
        for f in (along, across)
    ]


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_single_cell_acts_as_quadrature_says(nu: float) -> None:
    pitch = (1.0, 1.5)
    operator = SurfaceGreen((6, 8), pitch, 1.0, nu, coupled=True)
    one = np.zeros((2, 6, 8))
    one[0, 2, 3] = 1
    u = operator.apply(one)
    for row, column in ((0, 0), (5, 7), (3, 1), (1, 6)):
        xx, xy = integrated((column - 3) * pitch[0], (row - 2) * pitch[1], nu, pitch)
        assert u[0, row, column] == pytest.approx(xx, rel=1e-9)
        assert u[1, row, column] == pytest.approx(xy, rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("thickness", [math.inf, 8e-3])
def test_both_axes_are_alike(thickness: float) -> None:
    """The surface that is mirrored in the line x = y, and its tractions with it, moves alike."""
    operator = SurfaceGreen((9, 9), 1e-3, E, 0.4, thickness=thickness, coupled=True)
    sigma = RNG.normal(size=(2, 9, 9))
    mirrored = operator.apply(sigma[::-1].transpose(0, 2, 1))
    expected = operator.apply(sigma)[::-1].transpose(0, 2, 1)
    np.testing.assert_allclose(mirrored, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("coupled", [False, True])
def test_no_periodic_image_acts_and_the_operator_is_its_own_transpose(coupled: bool) -> None:
    shape = (2, 9, 7) if coupled else (9, 7)
    large = (2, 27, 27) if coupled else (27, 27)
    operator = SurfaceGreen(shape[-2:], 1e-4, E, 0.4, coupled=coupled)
    wide = SurfaceGreen(large[-2:], 1e-4, E, 0.4, coupled=coupled)
    sigma, other = RNG.normal(size=(2, *shape))
    inside = np.zeros(large)
    inside[..., 9:18, 10:17] = sigma
    u = operator.apply(sigma)
    assert np.abs(u - wide.apply(inside)[..., 9:18, 10:17]).max() < 1e-12 * np.abs(u).max()
    assert np.sum(u * other) == pytest.approx(np.sum(sigma * operator.apply(other)), rel=1e-12)


@pytest.mark.parametrize("coupled", [False, True])
def test_the_norm_is_the_largest_eigenvalue_between_the_points_of_the_mask(coupled: bool) -> None:
    operator = SurfaceGreen((8, 10), (1e-4, 2e-4), E, 0.5, coupled=coupled)
    mask = RNG.random((8, 10)) < 0.6
    points = np.broadcast_to(mask, (2, 8, 10)) if coupled else mask
    columns = []
    for flat in np.flatnonzero(points):
        unit = np.zeros(points.size)
        unit[flat] = 1
        columns.append(operator.apply(unit.reshape(points.shape))[points])
    values = np.linalg.eigvalsh(np.array(columns))
    assert operator.norm(mask) == pytest.approx(values[-1], rel=1e-4)
    assert operator.norm(mask) >= values[-1]
    assert values[0] > 0


def test_a_sheared_sphere_contact_converges_to_its_closed_form() -> None:
    a = hertz.contact_radius(P, E, NU, R)
    errors = []
    for n in (32, 96):
        pitch = 2.6 * a / n
        x, y = np.meshgrid(*2 * [(np.arange(n) - (n - 1) / 2) * pitch])
        parts = [(k - 1.5) / 4 * pitch for k in range(4)]
        sigma = np.mean(
            [
                cattaneo_mindlin.traction(np.hypot(x + dx, y + dy), 0.25, 0.93, P, a)
                for dx in parts
                for dy in parts
            ],
            axis=0,
        )
        u = SurfaceGreen((n, n), pitch, E, NU, coupled=True).apply(
            np.stack([sigma, np.zeros_like(sigma)])
        )
        truth = np.stack(cattaneo_mindlin.displacement(x, y, 0.25, 0.93, P, a, E, NU))
        errors.append(np.sqrt(np.mean((u - truth) ** 2)) / truth.max())
    assert errors[1] < 5e-4
    assert errors[1] < errors[0] / 4


def test_the_box_average_is_the_mean_over_the_box() -> None:
    pitch, box = 1e-4, 2.4e-4
    averaged = SurfaceGreen((24, 24), pitch, E, 0.3, box=box)
    one = np.zeros((24, 24))
    one[2, 2] = 1
    u = averaged.apply(one)
    t, w = np.polynomial.legendre.leggauss(40)
    for row, column in ((2, 2), (2, 3), (4, 3), (20, 17)):
        x, y = (column - 2) * pitch + t * box / 2, (row - 2) * pitch + t * box / 2
        values = [[kernel_xx(a, b, pitch, 0.3) for a in x] for b in y]
        assert u[row, column] == pytest.approx(float(w @ np.array(values) @ w) / 4, rel=2e-4)


def kernel_xx(x, y, pitch, nu):
    """G_xx of one cell at any place, in Love's logarithms."""
    total = 0.0
    for i in (-0.5, 0.5):
        for j in (-0.5, 0.5):
            a, b = x + i * pitch, y + j * pitch
            r = math.hypot(a, b)
            total += (
                4
                * i
                * j
                * (
                    (1 - nu) * (a * math.log(b + r) + b * math.log(a + r))
                    + nu * b * math.log(a + r)
                )
            )
    return total * (1 + nu) / (math.pi * E)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_layer_moves_as_its_equations_of_equilibrium_say(nu: float) -> None:
    """Displacement under a sinusoidal traction, by the matrix exponential of the plane-strain
    equations, back by Bessel functions.
    """
    G, H = 1.0, 1.0
    lam = 2 * G * nu / (1 - 2 * nu)

    @cache
    def compliance(q):
        k = lam / (lam + 2 * G)
        step = np.array(
            [
                [0, -q, 1 / G, 0],
                [k * q, 0, 0, 1 / (lam + 2 * G)],
                [q * q * (lam + 2 * G) - q * q * lam * k, 0, 0, -q * k],
                [0, 0, q, 0],
            ]
        )
        across = expm(step * H)[:, 2:]  # from the stresses on the plate; no displacement there
        stress = np.linalg.solve(across[2:], [1.0, 0.0])
        return float((across @ stress)[0])

    def of_bessel(order, r, sign):
        def integrand(q):
            return (q * compliance(q) - (1 - nu) / G + sign * (np.tanh(q * H) - 1) / G) * jv(
                order, q * r
            )

        return sign * integrate.quad(integrand, 1e-9, 12, limit=200, epsabs=1e-9)[0] / (4 * math.pi)

    r = np.array([0.0, 0.3, 1.0, 2.5])
    even, double = layer_correction(r, 2 * (1 + nu) * G, nu, H)
    assert even == pytest.approx([of_bessel(0, x, 1) for x in r], rel=1e-6)
    assert double == pytest.approx([of_bessel(2, x, -1) for x in r], rel=1e-5, abs=1e-9)


def test_a_thick_layer_moves_less_by_nearly_the_same_everywhere_and_tends_to_the_half_space() -> (
    None
):
    near, _ = layer_correction(np.array([0.0, 2e-3]), E, NU, 15e-3)
    assert near[0] == pytest.approx(-4.82e-6, rel=2e-3)
    assert near[1] == pytest.approx(near[0], rel=6e-3)
    shape = (20, 24)
    sigma = np.ones(shape)
    deep = SurfaceGreen(shape, 1e-4, E, NU, thickness=100.0).apply(sigma)
    assert np.allclose(deep, SurfaceGreen(shape, 1e-4, E, NU).apply(sigma), rtol=1e-4)


def test_a_wide_load_on_a_thin_layer_shears_it_like_a_slab() -> None:
    """Far from the edges of a load much wider than the layer the surface moves by sigma H / G."""
    n, H = 101, 4e-4
    u = SurfaceGreen((n, n), 1e-4, E, NU, thickness=H).apply(np.ones((n, n)))
    assert u[50, 50] == pytest.approx(H / (E / 3), rel=0.02)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"shape": (1, 1)}, "grid"),
        ({"pitch": 0.0}, "pitch"),
        ({"pitch": (1e-4, math.nan)}, "pitch"),
        ({"E": -1.0}, "E = -1"),
        ({"E": 0.0}, "E = 0"),
        ({"nu": 0.51}, "Poisson"),
        ({"nu": -0.01}, "Poisson"),
        ({"thickness": 1e-4}, "thick"),
        ({"box": -1.0}, "box"),
    ],
)
def test_what_can_not_be_is_refused_in_a_sentence(change: dict, word: str) -> None:
    asked = {"shape": (4, 4), "pitch": 1e-4, "E": E, "nu": NU} | change
    with pytest.raises(ValueError, match=word):
        SurfaceGreen(**asked)


def test_masks_and_fields_of_another_shape_are_refused() -> None:
    operator = SurfaceGreen((4, 5), 1e-4, E, NU)
    with pytest.raises(ValueError, match="mask"):
        operator.norm(np.zeros((4, 5)))
    with pytest.raises(ValueError, match="shape"):
        operator.apply(np.zeros((5, 4)))


def test_a_wide_box_takes_no_more_room_than_the_grid_needs() -> None:
    """85 MB were taken, by all nodes of all points at once."""
    tracemalloc.start()
    SurfaceGreen((33, 33), 1e-4, 3e6, 0.5, box=7e-4)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 30e6
