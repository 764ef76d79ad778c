"""The history of a place on the picture: chosen by a click, drawn for all frames so far."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from operators import large
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot
from scripted_run import REFERENCE, ScriptedRun
from window_hands import Open, begin, make_run, model_of, wait_for_end

from app.gui import point_history
from app.gui.frame_results import Circles, frame_results
from app.gui.point_history import FieldHistory
from app.gui.source import setup_of
from app.gui.window import MainWindow
from app.records.record_types import FrameMotion

MM = 7.04e-3
ROW, COL = 11, 20  # of the grid of boxes, whose centres are at 10 px and on, 10 px apart
NOT_MEASURED = 17, 13


def centre_px(row: int, col: int) -> tuple[float, float]:
    return 10.0 + 10 * col, 10.0 + 10 * row


def click(window: MainWindow, row: int, col: int) -> None:
    canvas = window.interface.canvas
    x_px, y_px = centre_px(row, col)
    place = canvas.viewport().mapTo(window, canvas.place(x_px * MM, y_px * MM).toPoint())
    assert window.childAt(place) is canvas.viewport()
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.LeftButton, pos=place)


def expected_um(run: ScriptedRun, frame: int, row: int, col: int) -> float:
    one = run._snapshots[frame]
    return float(one.field.ux_px[row, col]) * run.pixel_m * 1e6 - one.motion.lens_m * 1e6


@pytest.mark.parametrize("is_over", [False, True])
def test_a_click_on_the_picture_shows_what_that_point_did(
    qtbot: QtBot, open_window: Open, is_over: bool
) -> None:
    run = make_run()
    window = open_window(model=model_of(lambda: run))
    large(window)
    cell = window.curves.cells[0]
    cell.choice.setFocus()
    qtbot.keyClicks(cell.choice, "Po")
    assert cell.choice.currentText() == "Point uₓ(t)"
    assert "click on the field in the picture" in cell.plot._hint.text()
    first = REFERENCE + 6
    begin(qtbot, window, run, first)
    click(window, ROW, COL)
    for frame in range(first + 1, first + 8):
        run.at(frame)
        qtbot.waitUntil(lambda at=frame: window._view.curves.seen == at)
    if is_over:
        run.request_stop("enough")
        wait_for_end(qtbot, window)
        click(window, ROW + 2, COL)
    row = ROW + 2 * is_over
    times = [run._snapshots[n].conditions.time_s for n in range(first - 1, first + 7)]
    wanted = [expected_um(run, n, row, COL) for n in range(first - 1, first + 7)]
    qtbot.waitUntil(lambda: bool(cell.plot.chart.lines))

    def is_drawn() -> bool:
        (line,) = cell.plot.chart.lines
        return len(line.x) == 8 and line.y[-1] == pytest.approx(wanted[-1], abs=1e-3)

    qtbot.waitUntil(is_drawn)
    (line,) = cell.plot.chart.lines
    assert line.x == pytest.approx(times, abs=2e-3)
    assert line.y == pytest.approx(wanted, abs=1e-3)
    said = re.match(r"at (.*) mm, (.*) mm, 8 fields of the run", cell.plot.chart.caption)
    assert said is not None
    wanted_mm = [at * MM for at in centre_px(row, COL)]
    assert [float(text) for text in said.groups()] == pytest.approx(wanted_mm, abs=0.02)
    assert window.interface.canvas._point.isVisible()
    if not is_over:
        click(window, *NOT_MEASURED)
        qtbot.waitUntil(lambda: "not measured" in cell.plot.chart.caption)


def test_of_a_long_run_every_second_field_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(point_history, "MOST_BYTES", 10 * 4 * 6)
    setup = SimpleNamespace(pixel_um=2.0, grid_rect_px=(0.0, 0.0, 30.0, 20.0))
    history = FieldHistory()
    for n in range(33):
        ux = np.full((2, 3), n, np.float32)
        field = SimpleNamespace(ux_px=ux, uy_px=ux)
        one = SimpleNamespace(frame=n, field=field, motion=FrameMotion(1e-6, 0.0))
        history = history.with_frame(one, n / 8, setup)  # type: ignore[arg-type]
        assert history.with_frame(one, n / 8, setup) is history  # it was seen
    assert (history.every, history.seen) == (4, 33)
    assert [time_s for time_s, _ in history.fields] == [n / 8 for n in range(0, 33, 4)]
    (line,) = history.chart((5.0, 5.0), 1.0, setup).lines  # type: ignore[arg-type]
    assert line.x == pytest.approx([n / 8 - 1 for n in range(0, 33, 4)])
    assert line.y == pytest.approx([2.0 * n - 1 for n in range(0, 33, 4)])
    outside = history.chart((35.0, 5.0), 1.0, setup)  # type: ignore[arg-type]
    assert not outside.lines
    assert "outside" in outside.caption


def test_the_lens_is_taken_off_along_the_drive_whichever_way_it_goes() -> None:
    run = make_run()
    shot, setup = run._snapshots[-1], setup_of(run)
    ux, uy = 7.04 * shot.field.ux_px, 7.04 * shot.field.uy_px
    moved = 1e6 * shot.motion.lens_m
    for angle, lens_x, lens_y in ((math.pi, -moved, 0.0), (math.pi / 2, 0.0, moved)):
        turned = replace(shot, motion=replace(shot.motion, drive_angle_rad=angle))
        frame = frame_results(turned, setup, Circles(run.centre_px, 8 * 10.0, 0.0))
        assert frame is not None
        shown = {key: frame.field(key).values for key in ("ux_um", "uy_um", "u_um", "slip_um")}
        along = -(ux - lens_x) if angle == math.pi else uy - lens_y
        along[np.isnan(shown["slip_um"])] = np.nan
        assert np.isfinite(along).any()
        np.testing.assert_allclose(shown["ux_um"], ux - lens_x, atol=1e-3)
        np.testing.assert_allclose(shown["uy_um"], uy - lens_y, atol=1e-3)
        np.testing.assert_allclose(shown["u_um"], np.hypot(ux - lens_x, uy - lens_y), atol=1e-3)
        np.testing.assert_allclose(shown["slip_um"], along, atol=1e-3)


def test_the_history_is_of_one_run_alone() -> None:
    run = make_run()
    assert FieldHistory().chart((5.0, 5.0), 0.0, setup_of(run)).is_empty
