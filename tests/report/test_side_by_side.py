"""Two runs beside one another: their differences, and their curves on the same axes."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from app.records.quantities import Measurement
from app.records.record_types import End, Phase
from app.records.snapshot_numbers import ROW
from app.records.summary import Summary
from app.report.card import Card, card_quantities
from app.report.side_by_side import Recorded, compared, curves_of

NAN, NOTHING = math.nan, np.empty((0, 2))


def recorded(value: float, sd: float) -> Recorded:
    card = Card(
        "a", End.COMPLETE, "", (Measurement("apparent radius", "a", value, sd, "mm"),), (), (), ()
    )
    return Recorded(Path("a.h5"), card, 0.5, NOTHING, np.empty((0, 3)), False, "box 20, step 10")


def summary(**known: float) -> Summary:
    empty = {one.name: NAN for one in fields(Summary)[:12]} | {"mu_d_range": (NAN, NAN)}
    return replace(Summary(**empty), **known)


@pytest.mark.parametrize("way", [1, -1])
def test_the_difference_is_that_of_the_last_from_the_first_in_the_noise_of_both(way: int) -> None:
    pair = [recorded(1.0e-3, 3e-5), recorded(1.1e-3, 4e-5)][::way]
    (row,) = compared(pair)
    assert row.values == ("1.000 ± 0.030", "1.10 ± 0.04")[::way]
    assert float(row.difference) == pytest.approx(0.1 * way)
    assert float(row.in_sd) == pytest.approx(2.0 * way)


def test_curves_are_over_the_friction_and_the_radius_of_their_own_run() -> None:
    rows = np.zeros(20, ROW)
    for name in rows.dtype.names:
        if rows.dtype[name].kind == "f":
            rows[name] = NAN
    time = np.arange(20.0)
    rows["phase"], rows["time_s"], rows["travel_m"] = str(Phase.DRIVE), time, 1e-6 * time
    rows["shear_force_n"], rows["normal_force_n"] = 0.02 * time, 0.5
    rows["stick_radius_m"], rows["stick_radius_sd_m"] = 1e-3 - 4e-5 * time, 1e-5
    loading, sticking, _ = curves_of(
        rows, summary(mu_s=0.8, hertz_radius_m=1.25e-3, onset_time_s=15.0)
    )
    np.testing.assert_allclose(loading, np.column_stack([time, 0.02 * time]))
    until = time <= 15
    np.testing.assert_allclose(sticking[:, 0], (0.02 * time / (0.8 * 0.5))[until])
    np.testing.assert_allclose(sticking[:, 1], ((1e-3 - 4e-5 * time) / 1.25e-3)[until])
    np.testing.assert_allclose(sticking[:, 2], 1e-5 / 1.25e-3)


def test_without_a_budget_a_ratio_of_forces_is_as_uncertain_as_the_calibration() -> None:
    found = {q.symbol: q for q in card_quantities(summary(mu_s=0.8, mu_s_sd=0.001,
             normal_force_n=0.5, calibration_sd=0.02))}  # fmt: skip
    assert found["mu_s"].systematic == pytest.approx(0.016)
    assert math.isnan(found["P"].systematic)
