"""Volts to newtons: hand-computed numbers, the inverse, and constants that give no forces."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from analysis.calibration.forces import SensorChain

CHAIN = SensorChain(
    sensitivity_m_per_v=(300e-6, 22e-6),
    stiffness_n_per_m=(689.0, 9579.0),
    zero_v=(0.1, -0.2),
    coupling=((1.0, 0.004), (0.008, 1.0)),
)


def test_without_coupling_a_force_is_stiffness_times_deflection():
    chain = SensorChain((300e-6, 22e-6), (689.0, 9579.0), zero_v=(0.1, -0.2))
    forces = chain.forces([[2.1, 1.8], [0.1, -0.2]])
    np.testing.assert_allclose(
        forces, [[2.0 * 300e-6 * 689, 2.0 * 22e-6 * 9579], [0, 0]], rtol=1e-12
    )


def test_coupling_is_undone():
    # the normal cantilever reads P + 0.004 Q, the shear cantilever 0.008 P + Q
    normal, shear = 0.5, 0.4
    volts = [
        [
            (normal + 0.004 * shear) / (689 * 300e-6) + 0.1,
            (0.008 * normal + shear) / (9579 * 22e-6) - 0.2,
        ]
    ]
    np.testing.assert_allclose(CHAIN.forces(volts), [[normal, shear]], rtol=1e-12)
    np.testing.assert_allclose(CHAIN.volts([[normal, shear]]), volts, rtol=1e-12)


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_volts_is_the_inverse_of_forces(normal, shear):
    np.testing.assert_allclose(
        CHAIN.forces(CHAIN.volts([[normal, shear]])), [[normal, shear]], atol=1e-12
    )


def test_no_samples_give_no_forces_and_nan_stays_in_its_row():
    assert CHAIN.forces(np.empty((0, 2))).shape == (0, 2)
    forces = CHAIN.forces([[np.nan, 1.0], [1.0, 1.0]])
    assert np.isnan(forces[0]).any()
    assert np.isfinite(forces[1]).all()


@pytest.mark.parametrize(
    ("constants", "word"),
    [
        ({"sensitivity_m_per_v": (0.0, 1.0)}, "zero"),
        ({"stiffness_n_per_m": (1.0, np.nan)}, "stiffness_n_per_m"),
        ({"zero_v": (1.0, 2.0, 3.0)}, "zero_v"),
        ({"coupling": ((1.0, 1.0), (1.0, 1.0))}, "coupling"),
    ],
)
def test_constants_that_give_no_forces_are_refused_by_name(constants, word):
    good = {"sensitivity_m_per_v": (1.0, 1.0), "stiffness_n_per_m": (1.0, 1.0)}
    with pytest.raises(ValueError, match=word):
        SensorChain(**{**good, **constants})


def test_the_uncertainty_of_the_stiffness_is_that_of_many_calibrations():
    """Draws k_N = 689 +- 5 and K_T = 9579 +- 25 N/m (paper, Fig. 1) many times and looks at the
    forces that one reading means.
    """
    chain = SensorChain(
        (3e-4, -2.2e-5),
        (689.0, 9579.0),
        coupling=((1, 0.004), (0.008, 1)),
        stiffness_std_n_per_m=(5.0, 25.0),
    )
    volts = chain.volts([[0.5, 0.45]])
    drawn = np.random.default_rng(1).normal(
        chain.stiffness_n_per_m, chain.stiffness_std_n_per_m, (4000, 2)
    )
    forces = np.array([replace(chain, stiffness_n_per_m=tuple(k)).forces(volts)[0] for k in drawn])
    normal, shear = chain.relative_uncertainty()
    np.testing.assert_allclose(forces.std(axis=0) / [0.5, 0.45], [normal, shear], rtol=0.05)
    ratio = forces[:, 1] / forces[:, 0]
    assert np.hypot(normal, shear) == pytest.approx(ratio.std() / ratio.mean(), rel=0.05)
