"""Compliance of the lens holder beside a drift and a temperature, against motions made by a closed
form.
"""

import numpy as np
import pytest
from hidden_samples import PER_DEGREE, C, compliance, loading
from seeds import errors, holds, pulls, seen_by

from analysis.calibration.compliance import holder_compliance


def test_compliance_drift_and_temperature_hold_their_uncertainties():
    found = seen_by(compliance)
    for one in found.values():
        holds(pulls(one))
    assert np.abs(errors(found["compliance"])).max() < 0.03


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
