"""The half-space and the sheared contact against Tamaas (Frérot et al. 2020), an independent
boundary-element code.
"""

import numpy as np
import pytest

from analysis.mechanics import cattaneo_mindlin
from analysis.mechanics.half_space import SurfaceGreen

tm = pytest.importorskip("tamaas")
tm.set_log_level(tm.LogLevel.error)

STICK = 0.7  # c/a; all with a, mu, P and E of 1
SHEAR = 1 - STICK**3


def middles(box, n):
    return (np.arange(n) + 0.5) * box / n - box / 2


def cell_means(x, pitch, parts=8):
    """Cattaneo and Mindlin's traction averaged over cells."""
    offsets = ((np.arange(parts) + 0.5) / parts - 0.5) * pitch
    radii = np.hypot(
        *np.meshgrid(np.add.outer(x, offsets), np.add.outer(x, offsets), indexing="ij")
    )
    sigma = cattaneo_mindlin.traction(radii, SHEAR, 1.0, 1.0, 1.0)
    return sigma.reshape(len(x), parts, len(x), parts).mean(axis=(1, 3))


def by_tamaas(box, n, nu, half=2.0):
    """Displacement (ux, uy) of a periodic half-space under that traction, within `half` of the
    centre; the first index goes along x.
    """
    model = tm.ModelFactory.createModel(tm.model_type.surface_2d, [box, box], [n, n])
    model.E, model.nu = 1.0, nu
    x = middles(box, n)
    pressed = np.flatnonzero(np.abs(x) < 1 + box / n)
    model.traction[...] = 0
    model.traction[pressed[0] : pressed[-1] + 1, pressed[0] : pressed[-1] + 1, 0] = cell_means(
        x[pressed], box / n
    )
    model.solveNeumann()
    near = np.abs(x) < half
    return x[near], np.array(model.displacement[..., :2])[np.ix_(near, near)]


def free_of_images(n, nu):
    """The same for one contact: what its images do falls as the cube of the box.

    Rigid displacements are not told.
    """
    x, small = by_tamaas(12.0, n, nu)
    u = (8 * by_tamaas(24.0, 2 * n, nu)[1] - small) / 7
    return x, u - u.mean(axis=(0, 1))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_the_sheared_contact_converges_to_the_closed_form(nu):
    worst, typical = [], []
    for n in (256, 512):
        x, u = free_of_images(n, nu)
        exact = np.stack(
            cattaneo_mindlin.displacement(x[:, None], x, SHEAR, 1.0, 1.0, 1.0, 1.0, nu), axis=-1
        )
        error = (u - exact + exact.mean(axis=(0, 1))) / np.ptp(exact)
        worst.append(np.abs(error).max())
        typical.append(np.sqrt(np.mean(error**2)))
    assert worst[1] < 1e-3
    assert typical[1] < 1e-4
    assert worst[1] < 0.5 * worst[0]
    assert typical[1] < 0.5 * typical[0]


def test_the_operator_of_both_components_agrees():
    n, box, nu = 512, 12.0, 0.5
    x, u = free_of_images(n, nu)
    sigma = np.zeros((2, len(x), len(x)))
    sigma[0] = cell_means(x, box / n).T
    found = np.moveaxis(
        SurfaceGreen((len(x), len(x)), box / n, 1.0, nu, coupled=True).apply(sigma), 0, -1
    ).swapaxes(0, 1)
    error = (found - found.mean(axis=(0, 1)) - u) / np.ptp(found)
    assert np.abs(error).max() < 2e-3
    assert np.sqrt(np.mean(error**2)) < 2e-4


def test_without_poissons_ratio_the_operator_is_that_of_a_pressure_cell_by_cell():
    shape, pitch, E = (24, 40), 0.1, 3.0
    model = tm.ModelFactory.createModel(
        tm.model_type.basic_2d, [shape[0] * pitch, shape[1] * pitch], list(shape)
    )
    model.E, model.nu = E, 0.0
    tm.ModelFactory.registerNonPeriodic(model, "dcfft")
    p, u = np.random.default_rng(2).random(shape), np.zeros(shape)
    model.operators["dcfft"](p, u)
    np.testing.assert_allclose(SurfaceGreen(shape, pitch, E, 0.0).apply(p), u, rtol=1e-12)
