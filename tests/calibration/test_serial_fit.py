"""A fit to the readings of a record."""

import math

import numpy as np
import pytest

from analysis.calibration.serial_fit import serial_fit


def test_a_step_of_rounded_readings_that_comes_once_may_be_off_for_all_of_them():
    """0.6 steps in the whole record: where between two steps the readings lie is not known."""
    t = np.linspace(-1, 1, 200)
    readings = np.round(0.6 * t + 0.1)
    assert np.count_nonzero(np.diff(readings)) == 1
    fit = serial_fit("rounded", np.column_stack([np.ones(200), t]), readings, resolution=1.0)
    together = np.array([1.0, np.abs(t).sum() / (t**2).sum()]) / math.sqrt(12)
    assert fit.sds == pytest.approx(together)
    assert abs(fit.values[1] - 0.6) < fit.sds[1]
