"""The window in use: it draws what the run measures, and stops the motion in every state of it."""

import gc
import re
import sys
import threading
import time
from collections import Counter
from dataclasses import replace
from itertools import count as count_up
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import QObject, QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu, QMenuBar
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import (
    Open,
    begin,
    click,
    finish,
    make_run,
    model_of,
    shown,
    wait_for_end,
    wait_for_frame,
    wait_for_words,
)

from app.gui import window as window_module
from app.gui.cells import DASH, readouts
from app.gui.charts import Line
from app.gui.frame_results import shown_image
from app.gui.image_view import describe_point
from app.gui.panels import NOTHING, LiveStrip
from app.gui.source import setup_of
from app.gui.start import run_window
from app.gui.window import MainWindow
from app.records.bench_view import ForcesView, Health


class Hanging(ScriptedRun):
    """`health` does not return until `release` is set."""

    release: threading.Event

    def health(self) -> Health:
        self.release.wait()
        return super().health()


class Raising(ScriptedRun):
    def health(self) -> Health:
        raise OSError("the line went dead")


def drawn(window: MainWindow, key: str) -> Line:
    """The curve of a chart that is of this run."""
    (cell,) = (cell for cell in window.curves.cells if cell.key == key)
    lines = [line for line in cell.plot.chart.lines if not line.is_faint]
    return lines[0] if lines else Line("", np.empty(0), np.empty(0), "shear", ("", ""))


def screen_place(window: MainWindow, x_px: float, y_px: float) -> tuple[int, int]:
    """Where the centre of a pixel of the camera is on the canvas."""
    place = window.interface.canvas.place(7.04e-3 * x_px, 7.04e-3 * y_px)
    return int(place.x()), int(place.y())


def test_the_qt_binding_counts_its_references() -> None:
    """PySide6 6.12.0 loses a reference to None with every call, on Python before 3.12.

    The program then ends within minutes.
    """
    thing = QObject()
    before = sys.getrefcount(None)
    for _ in range(1000):
        thing.setObjectName("x")
    assert sys.getrefcount(None) > before - 500, (
        "this PySide6 crashes this Python; install a version that pyproject.toml allows"
    )


def test_everything_that_the_run_measures_is_drawn(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    begin(qtbot, window, run, 50)
    qtbot.waitUntil(lambda: len(drawn(window, "loading").x) == 30)
    travel, shear = drawn(window, "loading").x, drawn(window, "loading").y
    snapshots = run.snapshots_since(20)
    np.testing.assert_allclose(travel, [s.conditions.travel_m * 1e6 for s in snapshots])
    np.testing.assert_allclose(shear, [s.conditions.shear_force_n for s in snapshots])
    # black is 0 and white is full scale
    grey = QColor(window.interface.canvas.grab().toImage().pixel(*screen_place(window, 3, 3)))
    assert (grey.red(), grey.green(), grey.blue()) == (run.pressed[3, 3],) * 3
    x, y = run.centre_px[0] + run.radius_m / 7.04e-6, run.centre_px[1]
    left, top = screen_place(window, x, y)
    near = (left - 3, top - 8, 7, 17)
    with_circles = window.interface.canvas.grab().toImage().copy(*near)
    window.interface.show_circles.click()
    assert window.interface.canvas.grab().toImage().copy(*near) != with_circles
    inside = (left - 20, top - 8, 7, 17)
    without = window.interface.canvas.grab().toImage().copy(*inside)
    window.interface.show_circles.click()
    assert window.interface.canvas.grab().toImage().copy(*inside) == without
    assert window.top.badge.text() == "RUNNING"
    assert {v.name.text(): v.value.text() for v in window.health.cells.views}[
        "frames received"
    ] == "50"


def test_start_and_end_by_button_and_key(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    assert not window.top.stop.isEnabled()
    qtbot.keyClick(window, Qt.Key.Key_F5)
    assert run.started
    assert not window.top.start.isEnabled()
    click(qtbot, window.top.stop)
    assert run.called.wait(60)
    assert run.calls == ["the operator ended the run"]
    wait_for_end(qtbot, window)
    assert not window.top.stop.isEnabled()
    assert not window.top.start.isEnabled()  # nothing makes a next run


@pytest.mark.parametrize("kind", [ScriptedRun, Raising, Hanging])
def test_stop_motion_works_whatever_the_run_does(
    qtbot: QtBot, open_window: Open, monkeypatch: pytest.MonkeyPatch, kind: type[ScriptedRun]
) -> None:
    monkeypatch.setattr(window_module, "SILENT_S", 0.0)
    Hanging.release = threading.Event()
    run = make_run(kind)
    window = open_window(run)
    window.begin()
    if kind is Raising:
        wait_for_words(qtbot, window, "the line went dead")
    if kind is Hanging:
        wait_for_words(qtbot, window, "has not answered")
    assert window.top.stop_motion.isEnabled()
    for press in (
        lambda: qtbot.mousePress(window.top.stop_motion, Qt.MouseButton.LeftButton),
        lambda: qtbot.keyClick(window, Qt.Key.Key_Escape),
    ):
        run.called.clear()
        run.calls.clear()
        press()
        assert run.called.wait(60)
        assert run.calls == ["stop_motion"]
    Hanging.release.set()


def test_a_list_that_is_open_does_not_swallow_the_stop(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    begin(qtbot, window, run, 30)
    run.outcome = lambda: None  # type: ignore[method-assign]
    menu = window.findChildren(QMenuBar)[0].actions()[0].menu()
    assert isinstance(menu, QMenu)
    for key in (Qt.Key.Key_Escape, Qt.Key.Key_F12):
        run.called.clear()
        run.calls.clear()
        with qtbot.waitSignal(window._timer.timeout):  # when the window has seen that it is open
            menu.popup(window.mapToGlobal(window.rect().center()))
        assert QApplication.activePopupWidget() is menu
        QTest.keyClick(menu.windowHandle(), key)  # as the screen delivers it
        assert run.called.wait(60)
        assert run.calls == ["stop_motion"]
        menu.close()


def test_a_list_that_opens_does_not_swallow_the_stop_until_a_tick(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    begin(qtbot, window, run, 30)
    run.outcome = lambda: None  # type: ignore[method-assign]
    window._timer.stop()
    menu = window.findChildren(QMenuBar)[0].actions()[0].menu()
    assert isinstance(menu, QMenu)
    menu.popup(window.mapToGlobal(window.rect().center()))
    assert QApplication.activePopupWidget() is menu
    screen = QApplication.instance()
    assert isinstance(screen, QApplication)
    screen.focusWindowChanged.emit(menu.windowHandle())  # it gives the keys to the menu, as X does
    QTest.keyClick(menu.windowHandle(), Qt.Key.Key_Escape)
    assert run.called.wait(60)
    qtbot.wait(50)
    assert run.calls == ["stop_motion"]
    menu.close()


def test_stop_motion_works_while_the_window_can_not_draw(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, caplog: pytest.LogCaptureFixture
) -> None:
    views: list[object] = []

    def broken(view: object) -> None:
        views.append(view)
        raise ValueError("no such colour")

    window.interface.show_view = broken  # type: ignore[method-assign]
    window.begin()
    wait_for_words(qtbot, window, "no such colour")
    qtbot.waitUntil(lambda: len(views) > 3)
    # logged with the place where it happened, and not again at every redraw
    assert [record.exc_info is not None for record in caplog.records] == [True]
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert run.called.wait(60)


def test_a_stop_that_failed_stays_on_the_screen(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    def fails() -> None:
        raise OSError("actuator: no answer")

    run.stop_motion = fails  # type: ignore[method-assign]
    window.begin()
    window.stop_motion()
    qtbot.waitUntil(lambda: window.notice.is_alarm)
    run.at(30)
    wait_for_frame(qtbot, window, 30)
    health, run.health = run.health, lambda: 1 / 0  # type: ignore[method-assign, assignment]
    qtbot.waitUntil(lambda: bool(window._reported))
    run.health = health  # type: ignore[method-assign]
    qtbot.waitUntil(lambda: not window._reported)
    assert (
        window.notice.text.text()
        == "STOP MOTION FAILED, cut the actuator's power: actuator: no answer"
    )


def test_a_run_stopped_before_it_began_is_replaced(qtbot: QtBot, open_window: Open) -> None:
    runs = [make_run(), make_run()]
    window = open_window(runs[0], model_of(lambda: runs[1]))
    window.stop_motion()
    assert runs[0].called.wait(60)
    window.begin()
    qtbot.waitUntil(lambda: runs[1].started)
    assert not runs[0].started


def test_a_window_of_a_busy_program_on_a_computer_just_started_draws(
    qtbot: QtBot, open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, worked = time.monotonic(), time.thread_time
    monkeypatch.setattr(time, "monotonic", lambda: time.perf_counter() - started)
    monkeypatch.setattr(time, "thread_time", lambda: 1e6 + worked())
    run = make_run()
    window = open_window(model=model_of(lambda: run))
    window.begin()
    qtbot.waitUntil(lambda: window._view is not None)


def test_a_run_stopped_while_it_is_made_does_not_begin(qtbot: QtBot, open_window: Open) -> None:
    run, may_be_made = make_run(), threading.Event()
    window = open_window(model=model_of(lambda: may_be_made.wait(60) and run))
    window.begin()
    assert window.top.badge.text() == "MAKING READY"
    assert not window.top.start.isEnabled()
    making = window._pending
    window.model.begin_asked.emit()  # as from the panel: one run is made at a time
    assert window._pending is making
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    may_be_made.set()
    qtbot.waitUntil(lambda: bool(run.calls))
    assert not run.started
    assert window.top.start.isEnabled()


def test_a_passing_trouble_is_taken_back(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    window.begin()
    health, run.health = run.health, lambda: 1 / 0  # type: ignore[method-assign, assignment]
    wait_for_words(qtbot, window, "division by zero")
    run.health = health  # type: ignore[method-assign]
    qtbot.waitUntil(lambda: not window.notice.isVisible())


def test_after_a_run_start_makes_the_next(qtbot: QtBot, open_window: Open) -> None:
    runs: list[ScriptedRun] = []

    def make() -> ScriptedRun:
        runs.append(make_run(title=f"run {len(runs)}"))
        return runs[-1]

    window = open_window(model=model_of(make))
    window.begin()
    qtbot.waitUntil(lambda: bool(runs) and runs[0].started)
    finish(qtbot, window, runs[0])
    qtbot.waitUntil(lambda: window.result.heading.text() == "Result")
    window.begin()
    qtbot.waitUntil(lambda: window.top.title.text() == "run 1" and window._view is not None)
    assert [run.started for run in runs] == [True, True]
    assert window.outcome() is None
    assert window.docks.if_made("setup") is None  # nothing was typed there
    qtbot.waitUntil(lambda: len(drawn(window, "loading").x) == 0)


def test_a_run_that_can_not_be_made_or_started_gives_a_sentence(
    qtbot: QtBot, open_window: Open
) -> None:
    def none() -> ScriptedRun:
        raise ValueError("camera: no such driver 'redlak'")

    window = open_window(model=model_of(none))
    window.stop_motion()
    wait_for_words(qtbot, window, "no bench is connected")
    qtbot.keyClick(window, Qt.Key.Key_F5)
    sentence = "The run could not be made: camera: no such driver 'redlak'"
    qtbot.waitUntil(lambda: window.notice.text.text() == sentence)
    assert window.top.start.isEnabled()
    run = make_run()
    run.start()
    other = open_window(run)
    other.begin()
    assert "The run did not start: run: start was asked" in other.notice.text.text()


def test_the_strip_says_of_what_its_numbers_are(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    strip, shear = window.readouts, window.readouts.views[1].value
    begin(qtbot, window, run, 30)
    qtbot.waitUntil(lambda: shear.text() != DASH)
    assert (strip.stamp.text(), shear.objectName()) == ("", "value")
    finish(qtbot, window, run)
    of_run = shear.text()
    assert re.fullmatch(r"ended \d\d:\d\d\nrun", strip.stamp.text())
    assert shear.objectName() == "old"
    forces = ForcesView((0.5, 0.125), (0.0, 0.0), (0.1, 0.1), np.zeros(1), np.zeros((1, 2)), 0.1)
    strip.show_bench(forces)
    assert (strip.stamp.text(), shear.text()) == ("connected bench", "0.125")
    assert [view.value.text() for view in strip.views[2:]] == ["0.250", DASH, DASH]
    assert shear.objectName() == "value"
    strip.show_run(NOTHING)  # of a frame of a replay that is chosen meanwhile
    assert (strip.stamp.text(), shear.text()) == ("connected bench", "0.125")
    strip.show_run(window._view.readouts)
    strip.show_bench(replace(forces, age_s=3.2))
    assert (strip.stamp.text(), shear.objectName()) == ("no reading for 3 s", "old")
    strip.show_bench(None)
    assert shear.text() == of_run
    assert "ended" in strip.stamp.text()


def test_the_name_of_a_run_that_is_over_is_not_cut_short(qtbot: QtBot) -> None:
    strip = shown(qtbot, LiveStrip(), 600, 60)
    strip.begin(Path("slipscope-20261127-020225.h5"))
    strip.end(NOTHING)
    room, flags = strip.stamp.contentsRect(), Qt.TextFlag.TextWordWrap
    written = strip.stamp.fontMetrics().boundingRect(room, flags, strip.stamp.text())
    assert written.width() <= room.width()
    assert written.height() <= room.height()
    assert strip.stamp.text().replace("\u200b", "").endswith("\nslipscope-20261127-020225")


def test_a_run_that_ends_moves_nothing_below_the_strip(window: MainWindow) -> None:
    window.resize(1500, 768)
    window.reset_layout()
    strip, below = window.readouts, window.interface
    window._timer.stop()
    assert window._reader is not None
    window._reader.close(60)  # no view of the run that waits takes the place of what is shown here
    QApplication.processEvents()
    before, stick = (strip.sizeHint(), below.mapTo(window, QPoint())), strip.views[4]
    strip.begin(Path(f"{9 * 'a_very_long_name_of_a_session_'}.h5"))
    strip.end(readouts(0.5, 0.4, 1e-4, 0.0, 0.04e-3))
    QApplication.processEvents()
    assert (strip.sizeHint(), below.mapTo(window, QPoint())) == before
    assert stick.value.text() == "< 0.08"
    assert stick.minimumWidth() >= stick.sizeHint().width()  # whatever else wants room


def test_numbers_that_come_move_nothing_beside_them(qtbot: QtBot) -> None:
    strip = LiveStrip()
    qtbot.addWidget(strip)
    strip.show()
    least = strip.minimumSizeHint()
    for cells in (readouts(1.9, -1.85, -189.9e-6, 1.62e-3, 0.01e-3), readouts(0.5, 0.4, 0, 0, 1)):
        strip.show_run(cells)
        QApplication.processEvents()
        assert strip.minimumSizeHint() == least


def test_a_point_is_read_in_px_mm_and_um(run: ScriptedRun) -> None:
    scene = setup_of(run)
    text = describe_point(scene, None, 100.0, 50.0)
    assert text == "x 100 px, y 50 px  ·  0.70 mm, 0.35 mm"
    rows, columns = 1200, 1600  # no two pixels beside one another are alike
    picture = shown_image(np.add.outer(200 * np.arange(rows), np.arange(columns)).astype(np.uint16))
    text = describe_point(scene, None, 100.4, 49.6, picture)
    assert text.endswith(f"grey {200 * 50 + 100}")
    assert "grey" not in describe_point(scene, None, 1400.0, 1300.0, picture)


def test_run_window_returns_the_outcome_and_leaves_nothing(qapp: QApplication) -> None:
    before = set(threading.enumerate())
    run, shown = make_run(), list[MainWindow]()

    def ready(window: MainWindow) -> None:
        run.at(60)
        shown.append(window)

    outcome = run_window(
        run,
        autostart=True,
        on_ready=ready,
        close_when=lambda: bool(shown and shown[0].outcome()),
    )
    shown.clear()
    assert outcome is not None
    assert outcome.state == "done"
    gc.collect()
    assert not [w for w in QApplication.topLevelWidgets() if isinstance(w, MainWindow)]
    left = [t for t in threading.enumerate() if t.name.startswith("slipscope-window")]
    assert not set(left) - before


def test_a_program_that_is_told_to_end_stops_the_motion_and_closes(qapp: QApplication) -> None:
    run, told = make_run(), threading.Event()
    outcome = run_window(run, autostart=True, on_ready=lambda _: told.set(), close_when=told.is_set)
    assert run.calls == ["stop_motion"]
    assert outcome is not None
    assert outcome.reason == "STOP MOTION was pressed"


@pytest.mark.slow
def test_a_window_on_a_run_of_others_leaves_it_running(qapp: QApplication) -> None:
    run, told = make_run(), threading.Event()
    run.stays = True
    assert run_window(run, autostart=True, on_ready=lambda w: w.close()) is None
    run_window(run, autostart=True, on_ready=lambda _: told.set(), close_when=told.is_set)
    assert run.calls == []


def test_sixteen_bit_images_end_at_the_cameras_full_scale() -> None:
    full = np.random.default_rng(1).integers(1000, 3000, (240, 320)).astype(np.uint16)
    shown = shown_image(full, 4095)
    np.testing.assert_allclose(shown.pixels, full / 4095 * 255, atol=1)
    low, high = shown.stretched
    assert 1000 <= low * 4095 / 255 + 16 < 1100
    assert 2900 < (high + 1) * 4095 / 255 <= 3016


def test_each_redraw_draws_the_picture_and_in_turn_all_the_rest(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: Counter[str] = Counter()

    def count(part: object, name: str, key: str) -> None:
        was = getattr(part, name)

        def counted(*args: object) -> None:
            drawn[key] += 1
            was(*args)

        monkeypatch.setattr(part, name, counted)

    ticks = count_up(0.0, 0.1)  # a redraw each 0.1 s, whatever this machine has to do beside
    clock = SimpleNamespace(monotonic=lambda: next(ticks))
    monkeypatch.setattr("app.gui.redraw_scheduler.time", clock)
    count(window.interface, "show_view", "picture")
    count(window.readouts, "show_cells", "readouts")
    cells = [cell for cell in window.curves.cells if cell.isVisible()]
    for cell in cells:
        count(cell, "show_run", cell.key)
    begin(qtbot, window, run, 20)
    for frame in range(21, 35):
        pictures = drawn["picture"]
        run.at(frame)
        qtbot.waitUntil(lambda n=pictures: drawn["picture"] > n)  # type: ignore[misc]
    others = [drawn["readouts"], *(drawn[cell.key] for cell in cells)]
    assert 2 <= min(others) <= max(others) < drawn["picture"]
    run.at(run.frames)
    qtbot.waitUntil(lambda: window._view is not None and window._view.ended)
    assert len(cells[0].plot.chart.lines[0].x) == len(window._view.charts[cells[0].key].lines[0].x)
