"""Hysteresis loops against closed forms: Mindlin and Deresiewicz, Masing, and the energy that the
solver's springs lose.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.friction.cycles import (
    branches,
    interface_stiffness,
    local_work,
    loop_work,
    masing_deviation,
    precursor_slip,
)
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

P, E, NU, R, MU = 0.5, 3.43e6, 0.5, 128.8e-3, 0.93
A = hertz.contact_radius(P, E, NU, R)
LIMIT = MU * P


def mindlin_deresiewicz(peak: float, points: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Shift and force of a cycle between -peak and peak: the first loading at twice its size."""
    whole = cattaneo_mindlin.full_shift(MU, P, A, E, NU)

    def shift(q: np.ndarray) -> np.ndarray:
        return whole * (1 - (1 - q / LIMIT) ** (2 / 3))

    down = np.linspace(peak, -peak, points)
    x = shift(np.array(peak)) - 2 * shift((peak - down) / 2)
    return np.concatenate([x, -x]), np.concatenate([down, -down])


def test_the_area_of_a_loop_is_mindlin_s() -> None:
    """The energy lost in a cycle of amplitude Q (Mindlin and Deresiewicz 1953): the loop of their
    law and Masing's rule, integrated.
    """
    peak = 0.7 * LIMIT
    G = hertz.shear_modulus(E, NU)
    t = 1 - peak / LIMIT
    lost = (
        9
        * LIMIT**2
        / (10 * A)
        * (2 - NU)
        / G
        * ((1 - t ** (5 / 3)) - 5 / 6 * (1 - t) * (1 + t ** (2 / 3)))
    )
    x, q = mindlin_deresiewicz(peak)
    assert loop_work(x, q) == pytest.approx(lost, rel=2e-3)


def cycle(amplitude: float, steps: int = 60) -> list:
    """States of a first loading and of the cycle after it."""
    contact = SphereContact(P, E, NU, R, MU, 0.8e-6)
    loading = AxisymmetricLoading(contact)
    states = [loading.rest]
    for D in np.concatenate(
        [
            np.linspace(0, amplitude, steps)[1:],
            np.linspace(amplitude, -amplitude, 2 * steps)[1:],
            np.linspace(-amplitude, amplitude, 2 * steps)[1:],
        ]
    ).tolist():
        states.append(loading.advance(states[-1], D))
    return states


@pytest.fixture(scope="module")
def states() -> list:
    return cycle(25e-6)


def test_branches_are_found_and_jitter_is_none(states: list) -> None:
    D = np.array([state.D for state in states])
    parts = branches(D + 3e-8 * (-1.0) ** np.arange(len(D)), least=1e-6)
    assert [part.stop - part.start for part in parts] == [60, 120, 120]
    assert [round(D[part.start] * 1e6) for part in parts] == [0, 25, -25]
    assert len(branches(D[:60], least=1e-6)) == 1


def test_a_reversal_repeats_the_first_loading_at_twice_its_size(states: list) -> None:
    D, Q = (np.array([getattr(state, name) for state in states]) for name in ("D", "Q"))
    first, back, forth = branches(D, least=1e-6)
    for branch in (back, forth):
        assert masing_deviation(D[first], Q[first], D[branch], Q[branch]) < 2e-3
    # a contact that holds more on the way back does not
    assert masing_deviation(D[first], Q[first], D[back], 1.1 * Q[back]) > 0.02


def test_what_is_lost_locally_is_the_area_of_the_loop(states: list) -> None:
    D, Q = (np.array([getattr(state, name) for state in states]) for name in ("D", "Q"))
    _, back, forth = branches(D, least=1e-6)
    loop = slice(back.start, forth.stop)
    edges = np.linspace(0, A, 81)
    r = (edges[1:] + edges[:-1]) / 2
    slip = np.array([state.D - state.displacement(r)[0] for state in states[loop]])
    sigma = np.array([state.traction(r) for state in states[loop]])
    found = local_work(r, slip, sigma)
    assert found.total == pytest.approx(loop_work(D[loop], Q[loop]), rel=1e-2)
    assert (found.per_area > -1e-6 * found.per_area.max()).all()
    # most is lost where the contact slips first
    assert found.per_area[0] < found.per_area[55]


def test_the_stiffness_of_the_interface_is_the_pressure_over_the_length() -> None:
    loading = AxisymmetricLoading(SphereContact(P, E, NU, R, MU, 0.8e-6))
    states = [loading.at_block(D) for D in np.linspace(0.1e-6, 6e-6, 50).tolist()]
    r = np.linspace(0.05, 0.9, 12) * A
    slip = np.array([state.D - state.displacement(r)[0] for state in states])
    sigma = np.array([state.traction(r) for state in states])
    rng = np.random.default_rng(1)
    sd = 20.0
    k, k_sd = interface_stiffness(
        slip, sigma + rng.normal(0, sd, sigma.shape), 0 * sigma + sd, MU * 0.8e-6
    )
    true = hertz.pressure(r, P, A) / 0.8e-6
    known = np.isfinite(k)
    assert known.sum() >= 8
    off = (k - true)[known] / np.hypot(k_sd[known], 0.01 * true[known])
    assert np.abs(off).max() < 4


def test_the_uncertainty_of_the_stiffness_is_its_scatter() -> None:
    """Half of the variance of the noise is that of the reference, the same in all frames."""
    soft, k, sd = MU * 0.8e-6, np.array([2e10, 5e10]), 900.0
    slip = np.linspace(0.02, 1.2, 40)[:, None] * soft * np.ones(2)
    sigma = k * soft * -np.expm1(-slip / soft)
    rng, pulls = np.random.default_rng(2), []
    for _ in range(150):
        noise = (rng.normal(size=slip.shape) + rng.normal(size=2)) / math.sqrt(2)
        found, found_sd = interface_stiffness(slip, sigma + sd * noise, 0 * slip + sd, soft)
        pulls.append((found - k) / found_sd)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_slip_before_the_onset() -> None:
    time, slip = np.arange(5.0), np.arange(10.0).reshape(5, 2)
    np.testing.assert_allclose(precursor_slip(time, slip, 2.25), [4.5, 5.5])
    assert np.isnan(precursor_slip(time, slip, 7.0)).all()
    assert np.isnan(precursor_slip(time, slip, math.nan)).all()


def test_slip_before_the_onset_is_not_known_from_frames_long_before_and_after() -> None:
    time = np.linspace(0.0, 10.0, 101)
    slip = np.where(time < 6.03, 0.25 * time, 0.25 * 6.03 + 5.0 * (time - 6.03))[:, None]
    np.testing.assert_allclose(precursor_slip(time, slip, 6.03), 0.25 * 6.03, atol=0.15)
    seen = (time < 4.95) | (time > 8.05)
    assert np.isnan(precursor_slip(time[seen], slip[seen], 6.03)).all()


def test_no_frames_have_no_loop():
    assert loop_work([], []) == 0.0
    assert np.isnan(masing_deviation([0, 1e-6], [0, 0.1], [], []))
    assert np.isnan(masing_deviation([], [], [0, 1e-6], [0, 0.1]))
