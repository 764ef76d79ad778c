"""One first loading: numbers, figures, comparisons and the window take the same frames for it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from app.gui.charts import Chart
from app.gui.run_charts import Cursor, RunCharts
from app.gui.run_curves import NO_CURVES, extended, force_strips
from app.records.legs import first_loading, numbered_instants
from app.records.record_types import Conditions, FrameMotion, Phase, Snapshot, Stick, Traction
from app.records.snapshot_numbers import ROW, numbers_of, series_of
from app.records.summary import Summary
from app.report.figures import draw_force
from app.report.paper.runs import FigureRun
from app.report.side_by_side import curves_of
from app.settings.config import Config

SLIDE, HOLD, AGAIN = 12, 6, 12  # frames of the steps 4, 5 and 6
CLIMB_M = 4e-6
SUMMARY = Summary(0.5, 2e-3, 0.0, 2e-3, math.inf, math.nan, 0.4, 0.9, 0.01, 0.9, (0.8, 1.0), 5e-6)


def _part(kind: Any, **numbers: Any) -> Any:
    """A part of a snapshot that is 0 but for these numbers."""
    return kind(**(dict.fromkeys(kind.__slots__, 0.0) | numbers))


def _shots(travel_m: np.ndarray, steps: np.ndarray) -> list[Snapshot]:
    shots = []
    for i, (travel, step) in enumerate(zip(travel_m, steps, strict=True)):
        conditions = _part(
            Conditions, phase=Phase.DRIVE, time_s=float(i), travel_m=float(travel),
            shear_force_n=0.01 * (i + 1), normal_force_n=0.5, step=int(step),
        )  # fmt: skip
        stick = _part(Stick, stick_radius_m=1e-3)
        traction = _part(Traction, peak_radius_m=1e-3, peak_radius_sd_m=1e-5)
        shots.append(
            Snapshot(i, 100 * i, conditions=conditions, stick=stick, traction=traction,
                     motion=_part(FrameMotion))
        )  # fmt: skip
    return shots


def _rows(shots: list[Snapshot]) -> np.ndarray:
    rows = np.zeros(len(shots), ROW)
    for row, shot in zip(rows, shots, strict=True):
        for name, value in numbers_of(shot).items():
            if name in ROW.fields:
                row[name] = str(value) if name == "phase" else value
    return rows


def slide_hold_slide() -> tuple[list[Snapshot], int]:
    """Two slides forwards with a hold between them, and the frames of the first."""
    travel = CLIMB_M * np.concatenate(
        [np.arange(SLIDE), np.full(HOLD, SLIDE - 1), SLIDE - 1 + np.arange(1, AGAIN + 1)]
    )
    return _shots(travel, np.repeat([4, 5, 6], [SLIDE, HOLD, AGAIN])), SLIDE


def there_and_back() -> tuple[list[Snapshot], int]:
    """A drive that turns back twice, in one step."""
    up = np.arange(SLIDE)
    travel = CLIMB_M * np.concatenate([up, up[-2::-1], up[1:]])
    return _shots(travel, np.ones(len(travel), int)), SLIDE


@pytest.mark.parametrize("made", [slide_hold_slide, there_and_back])
def test_all_take_the_same_frames_for_the_first_loading(made: Any) -> None:
    shots, frames = made()
    assert [s.frame for s in first_loading(shots)] == list(range(frames))
    rows = _rows(shots)
    _, sticking, _ = curves_of(rows, SUMMARY)
    assert len(sticking) == frames
    run: Any = SimpleNamespace(frames=rows, summary=SUMMARY, contact=None)
    assert FigureRun(run, None).rows.tolist() == list(range(frames))


def test_without_readings_the_stage_is_not_known_beyond_the_first_loading() -> None:
    """It rests through a hold, and starts again after it."""
    shots, frames = slide_hold_slide()
    count = len(shots)
    bare = _shots(np.full(count, np.nan), np.array([s.conditions.step for s in shots]))
    sliding = replace(SUMMARY, sliding_velocity_m_s=2e-6)
    known = 2.0 * np.arange(frames)
    axes = Figure().subplots()
    draw_force(axes, bare, [], sliding)
    beyond = np.full(count - frames, np.nan)
    np.testing.assert_allclose(axes.lines[0].get_xdata(), np.append(known, beyond))
    assert axes.get_xlabel() == r"stage displacement $\delta = v\,t$ (µm)"
    loading, _, is_steady = curves_of(_rows(bare), sliding)
    np.testing.assert_allclose(loading[:, 0], known)
    assert is_steady
    assert not curves_of(_rows(shots), sliding)[2]
    assert not curves_of(_rows(bare), replace(SUMMARY, sliding_velocity_m_s=math.nan))[2]


@pytest.mark.parametrize("made", [slide_hold_slide, there_and_back])
@pytest.mark.parametrize("at_once", [1, 5, 100])
def test_the_window_follows_c_through_the_first_loading_only(made: Any, at_once: int) -> None:
    """However many frames come at a time: after the stage has come back, too."""
    shots, frames = made()
    setup: Any = SimpleNamespace(config=Config(), kind="live")
    curves = NO_CURVES
    for start in range(0, len(shots), at_once):
        curves = extended(curves, tuple(shots[start : start + at_once]), setup)
    assert len(curves.loading) == len(shots)
    assert len(curves.peaks) == frames
    assert np.isfinite(curves.sticking[:, 1]).sum() == frames


def test_the_window_draws_v_t_where_nothing_read_the_stage() -> None:
    """Once the velocity is known, in the first loading, and the axis says so."""
    shots, frames = slide_hold_slide()
    bare = _shots(np.full(len(shots), np.nan), np.array([s.conditions.step for s in shots]))
    setup: Any = SimpleNamespace(config=Config(), kind="replay")
    sliding = replace(SUMMARY, sliding_velocity_m_s=2e-6)

    def drawn(shots: list[Snapshot], summary: Any, at: Cursor | None = None) -> Chart:
        curves = extended(NO_CURVES, tuple(shots), setup)
        strips, point = force_strips((np.empty(0),) * 3, 0.0, setup), Chart("", "", "")
        return RunCharts(setup, curves, None, strips, summary, point, at)["loading"]

    chart = drawn(bare, sliding, Cursor(3, 3.0, np.nan, 0.25))
    np.testing.assert_allclose(chart.lines[0].x, 2.0 * np.arange(frames))
    np.testing.assert_allclose(chart.lines[0].y, series_of(bare[:frames], "shear_force_n"))
    assert chart.x_label == "travel δ = v t (µm)"
    assert [(mark.x, mark.y) for mark in chart.marks] == [(6.0, 0.25)]
    assert chart.lines[0].columns == ("v_t_um", "Q_N")
    for time_s, is_marked in ((-0.5, False), (0.0, True), (frames - 1.0, True), (frames, False)):
        at = Cursor(3, time_s, np.nan, 0.25)
        assert bool(drawn(bare, sliding, at).marks) is is_marked
    assert drawn(bare, None).is_empty
    assert "v t" in drawn(bare, None).hint
    read = drawn(shots, sliding)
    np.testing.assert_allclose(read.lines[0].x, 1e6 * series_of(shots, "travel_m"))
    assert read.x_label == "travel δ (µm)"
    assert read.lines[0].columns == ("travel_um", "Q_N")


def test_the_instants_lie_in_the_first_loading() -> None:
    """Of a slide that sticks for long: 1.4 t_s lies in the hold, or in the next slide."""
    shots, frames = slide_hold_slide()
    onset = replace(SUMMARY, onset_time_s=float(frames - 2))
    assert numbered_instants(shots, onset)[-1] == frames - 1
