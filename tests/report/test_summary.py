"""The report of a run: digits from uncertainties, units, and what was not measured."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.end_of_run import tell_notes
from app.records.quantities import NO_LAW, Measurement, decimals_for
from app.records.record_types import Counts, End, Outcome, Phase
from app.records.study_results import Joint
from app.records.summary import Summary
from app.report.card import Card, card_quantities
from app.report.summary_rows import compared_rows, outcome_data, outcome_rows, plain, summary_rows
from app.session.legacy import end_of

NAN = math.nan
MEASURED = Summary(
    0.5,
    2.2046e-3,
    0.0413e-3,
    2.19412e-3,
    20.234,
    0.0996,
    0.46311,
    0.92622,
    0.0042,
    0.93011,
    (0.9214, 0.9388),
    4.8312e-6,
    (),
    0.9312,
    0.0111,
    0.803e-6,
    0.045e-6,
    3.421e6,
    0.0321e6,
    0.0077,
)


@pytest.mark.parametrize(
    ("value", "sd", "unit", "text"),
    [
        (2.2046e-3, 0.0413e-3, "mm", "2.20 ± 0.04 mm"),
        (20.234, 0.0996, "s", "20.23 ± 0.10 s"),
        (20.234, 0.99, "s", "20.2 ± 1.0 s"),
        (20.234, 0.949, "s", "20.2 ± 0.9 s"),
        (20.234, 0.354, "s", "20.23 ± 0.35 s"),
        (20.234, 0.356, "s", "20.2 ± 0.4 s"),
        (123.4e-6, 12.3e-6, "um", "123 ± 12 um"),
        (1234.5e-6, 123.0e-6, "um", "1234 ± 123 um"),
        (-0.5, 0.02, "", "-0.500 ± 0.020"),
        (4.8312e-6, NAN, "um/s", "4.83 um/s"),
        (0.9996, NAN, "", "1.00"),
        (0.0, NAN, "N", "0 N"),
        (0.02345, 0.0, "N", "0.0234 N"),
        (NAN, 0.1, "mm", "not measured"),
        (NAN, NAN, "mm", "not measured"),
    ],
)
def test_the_uncertainty_sets_the_digits(value: float, sd: float, unit: str, text: str) -> None:
    assert str(Measurement("", "", value, sd, unit)) == text


@pytest.mark.parametrize(
    ("number", "digits", "decimals"),
    [(0.0994, 2, 3), (0.0996, 2, 2), (9.96, 2, 0), (12.0, 2, 0), (9.996, 3, 1), (0.0, 2, 0)],
)
def test_decimals_count_the_digits_after_rounding(
    number: float, digits: int, decimals: int
) -> None:
    assert decimals_for(number, digits) == decimals


@pytest.mark.parametrize(
    ("value", "extremes", "text"),
    [
        (0.93011, (0.9214, 0.9388), "0.9301 (0.9214 to 0.9388)"),
        (0.93, (0.93, 0.93), "0.930"),
        (0.93, (NAN, 1.0), "0.930"),
        (NAN, (NAN, NAN), "not measured"),
    ],
)
def test_a_range_sets_the_digits_too(
    value: float, extremes: tuple[float, float], text: str
) -> None:
    assert str(Measurement("", "", value, extremes=extremes)) == text


def test_the_summary_is_reported_in_the_units_of_the_paper() -> None:
    assert {row.symbol: row.value for row in summary_rows(MEASURED)} == {
        "P": "0.500 N",
        "a": "2.20 ± 0.04 mm",
        "a_H": "2.19 mm",
        "t_s": "20.23 ± 0.10 s",
        "Q_s": "0.4631 ± 0.0021 N",  # sd(mu_s) P
        "mu_s": "0.926 ± 0.004",
        "mu_d": "0.9301 (0.9214 to 0.9388)",
        "v": "4.83 um/s",
        "mu": "0.931 ± 0.011",
        "L": "0.80 ± 0.04 um",
        "E": "3.421 ± 0.032 MPa",
        "u(mu)": "± 0.8 %",
    }
    assert "u(mu)" not in {
        row.symbol for row in summary_rows(replace(MEASURED, calibration_sd=NAN))
    }


def test_noise_and_inputs_are_told_apart_and_the_dearest_input_first() -> None:
    budgeted = replace(
        MEASURED,
        mu_d_sd=0.0002,
        static_force_sd_n=0.0004,
        budget_inputs=("pixel size", "shear force", "drift"),
        budget_quantities=("mu_d", "young_modulus"),
        budget=(0.0, -0.01, 0.008, 0.004, 0.0, 0.0001),
    )
    rows = {row.symbol: row.value for row in summary_rows(budgeted)}
    assert rows["mu_d"] == "0.930 ± 0.007"  # of both parts, the digits too
    assert rows["E"] == "3.42 ± 0.05 MPa"
    assert rows["Q_s"] == "0.4631 ± 0.0004 N"
    assert rows["u(mu)"] == "0.8 %: shear force +0.8"
    assert rows["u(E)"] == "1.1 %: pixel size -1, shear force +0.4"
    assert rows[""] == "0.9214 to 0.9388"


UNRESOLVED = replace(
    MEASURED,
    law_length_m=0.0301e-6,
    law_length_sd_m=0.0045e-6,
    budget_inputs=("drift",),
    budget_quantities=("law_length",),
    budget=(1.651,),
)
"""Of a rigid contact: L is 0.0301 ± 0.0045 ± 0.0497 um."""


@pytest.mark.parametrize(
    ("value", "sd", "systematic", "is_signed", "text"),
    [
        (0.0301e-6, 0.0045e-6, 0.0497e-6, False, "not resolved, below 0.2 um"),  # 0.1299
        (0.0301e-6, 0.0045e-6, 0.0049e-6, False, "0.030 ± 0.007 um"),
        (0.0301e-6, 0.0150e-6, NAN, False, "0.030 ± 0.015 um"),  # twice
        (0.0301e-6, 0.0151e-6, NAN, False, "not resolved, below 0.07 um"),
        (0.0301e-6, NAN, 0.0351e-6, False, "not resolved, below 0.2 um"),  # 0.1003
        (0.0299e-6, NAN, 0.0350e-6, False, "not resolved, below 0.1 um"),  # 0.0999
        (-0.1e-6, 0.06e-6, NAN, False, "not resolved, below 0.2 um"),
        (0.0, 0.05e-6, NAN, False, "not resolved, below 0.1 um"),
        (-0.1e-6, 0.06e-6, NAN, True, "not resolved, within ± 0.3 um"),
        (-0.1e-6, 0.04e-6, NAN, True, "-0.10 ± 0.04 um"),
    ],
)
def test_what_is_not_resolved_is_told_by_its_bound(
    value: float, sd: float, systematic: float, is_signed: bool, text: str
) -> None:
    """Value + 2 u, by noise and inputs together, rounded up to one digit."""
    told = Measurement("", "", value, sd, "um", systematic=systematic, is_signed=is_signed)
    assert str(told) == text
    assert told.is_resolved == ("not" not in text)


def test_a_length_that_is_not_resolved_is_no_number_anywhere() -> None:
    by_symbol = {row.symbol: row.value for row in summary_rows(UNRESOLVED)}
    told = "not resolved, below 0.2 um"
    assert by_symbol["L"] == told
    data = json.loads(json.dumps(plain(UNRESOLVED)))
    assert data["not_resolved_upper_bound"] == {"law_length_m": pytest.approx(0.2e-6)}
    assert data["law_length_m"] == 0.0301e-6
    assert plain(MEASURED)["not_resolved_upper_bound"] == {}
    card = Card("run", "complete", "", card_quantities(UNRESOLVED), (), (), ())
    row = next(row for row in card.rows if row.symbol == "L")
    assert row[2:] == ("not resolved, below 0.2", "", "", "um")
    assert compared_rows(MEASURED, UNRESOLVED) == [
        ("length of the local law", "L", f"0.80 ± 0.04 um -> {told}"),
    ]
    assert told in str(UNRESOLVED)
    assert "0.80 ± 0.04 um" in str(MEASURED)
    assert "0.0301" not in str(UNRESOLVED)


def test_a_law_that_does_not_hold_is_said_beside_its_numbers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = f"{NO_LAW} mu p (1 - exp(-s/(mu L))): the points lie 2.4 times their uncertainty off it"
    doubted = replace(MEASURED, notes=("a note", told))
    by_symbol = {row.symbol: row.value for row in summary_rows(doubted)}
    assert by_symbol["L"] == "0.80 ± 0.04 um; the law does not hold"
    assert by_symbol["mu"] == "0.931 ± 0.011; the law does not hold"
    assert sum("does not hold" in value for value in by_symbol.values()) == 2
    tell_notes(doubted.notes)
    assert capsys.readouterr().out.splitlines() == [f"WARNING: {told}", "note: a note"]


def test_what_runs_have_in_common_is_told_by_its_bound_too() -> None:
    joint = Joint(decay=2e-6, decay_sd=83e-6, length_m=0.03e-6, length_sd_m=0.05e-6)
    assert "not resolved, within ± 0.0002" in str(joint)
    assert "not resolved, below 0.2 um" in str(joint)
    assert plain(joint)["not_resolved_upper_bound"] == {
        "decay": pytest.approx(0.0002),
        "length_m": pytest.approx(0.2e-6),
    }


def test_two_analyses_are_compared_where_their_digits_differ() -> None:
    again = replace(MEASURED, mu_s=0.92624, onset_time_s=20.3)
    assert compared_rows(MEASURED, again) == [
        ("onset of sliding", "t_s", "20.23 ± 0.10 s -> 20.30 ± 0.10 s")
    ]
    assert compared_rows(MEASURED, MEASURED) == [("the same in all digits shown", "", "")]
    # a session of a time before there was a budget
    budgeted = replace(
        MEASURED, budget_inputs=("drift",), budget_quantities=("law_mu",), budget=(0.01,)
    )
    assert [row.symbol for row in compared_rows(MEASURED, budgeted)] == ["mu"]


def test_every_trigger_and_sample_is_accounted_for() -> None:
    counts = Counts(312, 311, 310, 1, 300, 11, 39000, 7)
    outcome = Outcome(
        End.COMPLETE, "", counts, None, {"peak_memory_mib": 612.4, "cpu_s": 60.0, "wall_s": 40.0}
    )
    assert [f"{row.label}: {row.value}" for row in outcome_rows(outcome)] == [
        "triggers: 312",
        "frames: 311 received, 310 recorded, 1 lost",
        "frames analysed: 300, 11 skipped",
        "force samples: 39000 recorded, 7 lost",
        "peak memory: 612 MiB",
        "processor time: 60.0 s in 40.0 s (1.50 cores)",
    ]


def test_machines_get_si_values_and_null_where_nothing_was_measured() -> None:
    outcome = Outcome(
        End.FAILED, "why", Counts(triggers=3), replace(MEASURED, mu_s=NAN, mu_d_range=(NAN, 1.0))
    )
    data = json.loads(json.dumps(outcome_data(outcome), allow_nan=False))
    assert data["summary"]["apparent_radius_m"] == 2.2046e-3
    assert data["summary"]["mu_s"] is None
    assert data["summary"]["mu_d_range"] == [None, 1.0]
    assert (data["state"], data["counts"]["triggers"]) == ("failed", 3)


def test_any_result_becomes_plain() -> None:
    mixed = {
        "a": np.array([1.0, np.nan]),
        "b": Phase.DRIVE,
        "c": Path("x.h5"),
        "d": (np.int64(3), True, None),
    }
    assert plain(mixed) == {"a": [1.0, None], "b": "drive", "c": "x.h5", "d": [3, True, None]}


@pytest.mark.parametrize(
    ("state", "reason", "ended_as"),
    [
        ("done", "the drive of 60 um is complete", "done"),
        ("done", "all 14 steps are complete", "done"),
        ("done", "all 93 analysed frames were replayed", "done"),
        ("done", "all 93 frames were analysed", "done"),
        ("done", "imported: 20 images, 0 lost, from a.tif", "done"),
        ("done", "the drive of 60 um is complete; repaired, 1 images were lost", "done"),
        ("done", "the travel is done", "done"),  # of the oldest formats
        ("done", "STOP MOTION was pressed", "stopped"),
        ("done", "Ctrl-C was pressed", "stopped"),
        ("done", "the window was closed", "stopped"),
        ("done", "the operator ended the run; repaired, 1 images were lost", "stopped"),
        ("failed", "camera: trigger 5 had no answer", "failed"),
        ("unfinished", "", "unfinished"),
    ],
)
def test_a_run_that_somebody_ended_was_stopped(state: str, reason: str, ended_as: str) -> None:
    outcome = Outcome(end_of(state, reason, 7), reason, Counts(), None)
    assert outcome.ended_as == ended_as
    assert outcome_data(outcome)["state"] == ended_as
