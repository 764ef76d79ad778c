"""Compliance of the lens holder beside a drift and a temperature, against motions made by a closed
form.
"""

import numpy as np
import pytest
from seeds import SEEDS, holds, serial

from analysis.calibration.compliance import holder_compliance

C, DRIFT, PER_DEGREE = 0.68e-6, 1e-9, 60e-9


def loading(rng, n=160, noise=10e-9):
    """Two loadings and unloadings to 0.9 N in 160 s, in a room that warms up and cools."""
    time = np.arange(n) * 1.0
    Q = 0.9 * np.clip(1.3 * (1 - np.abs(time / 40 % 2 - 1)), 0, 1)
    degrees = 21 + 0.4 * np.sin(time / 55 + rng.uniform(0, 6))
    moved = C * Q + DRIFT * time + PER_DEGREE * degrees + noise * serial(rng, n, 0.5)
    return time, Q + 1e-3 * rng.standard_normal(n), moved, degrees


def test_compliance_drift_and_temperature_hold_their_uncertainties():
    pulls, values = [], []
    for seed in range(SEEDS):
        found = holder_compliance(*loading(np.random.default_rng(seed)))
        values.append(found.value_m_n)
        pulls.append(
            (
                (found.value_m_n - C) / found.sd_m_n,
                (found.drift_m_s - DRIFT) / found.drift_sd_m_s,
                (found.per_unit_m - PER_DEGREE) / found.per_unit_sd_m,
            )
        )
    for column in np.transpose(pulls):
        holds(column)
    assert np.abs(np.array(values) / C - 1).max() < 0.03


def played(moved, play=80e-9):
    """What follows with a play, as a joint that rubs."""
    held, place = [], 0.0
    for at in moved:
        place = min(max(place, at), at + play)
        held.append(place)
    return np.array(held)


def test_a_loop_that_is_not_refused_is_in_the_uncertainty():
    time, Q, moved, degrees = loading(np.random.default_rng(2))
    found = holder_compliance(time, Q, played(moved), degrees)
    assert abs(found.value_m_n - C) < 2 * found.sd_m_n
    assert found.sd_m_n > 0.05 * C


def test_a_temperature_that_is_not_read_widens_the_uncertainty():
    rng = np.random.default_rng(1)
    time, Q, moved, degrees = loading(rng)
    moved = moved + 5 * PER_DEGREE * degrees
    known, unknown = holder_compliance(time, Q, moved, degrees), holder_compliance(time, Q, moved)
    assert unknown.sd_m_n > 3 * known.sd_m_n
    assert abs(unknown.value_m_n - C) < 3 * unknown.sd_m_n
    assert np.isnan(unknown.per_unit_sd_m)


def test_what_is_no_compliance_is_refused():
    rng = np.random.default_rng(2)
    time, Q, moved, _ = loading(rng)
    full = 0.9 * (1 - np.abs(time / 40 % 2 - 1))
    ramp, noise = 0.9 * time / 160, 5e-9 * rng.standard_normal(len(time))
    for arguments, reason in (
        ((time[:30], Q[:30], moved[:30]), "30 readings"),
        ((time, 0.01 * Q, moved), "Q changes by"),
        ((time, ramp, C * ramp), "a drift looks like"),
        ((time, Q, -moved), "against Q"),
        ((time, full, played(C * full, 45e-9) + noise), "has a loop"),
        ((time, Q, C * Q + 0.3e-6 * (Q - 0.45) ** 2 + noise), "has a bend"),
    ):
        with pytest.raises(ValueError, match=reason):
            holder_compliance(*arguments)
