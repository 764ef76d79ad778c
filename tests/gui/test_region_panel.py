"""The region drawn on the picture: by mouse, with undo, and in the settings of the next run."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtWidgets import QHBoxLayout, QWidget
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun

from app.config import load
from app.gui.desk import Desk
from app.gui.image_view import InterfaceView
from app.gui.region_panel import RegionPanel
from app.gui.source import setup_of

SIZE = ("camera.width=320", "camera.height=240")
MIDDLE = "inside 88 48 232 48 232 192 88 192"  # 0.3 of 240 px each way from (160, 120)


@pytest.fixture
def desk() -> Desk:
    return Desk(None, load(None, SIZE))  # type: ignore[arg-type]


@pytest.fixture
def panel(qtbot: QtBot, desk: Desk) -> Iterator[RegionPanel]:
    view, window = InterfaceView(), QWidget()
    panel = RegionPanel(desk, view)
    layout = QHBoxLayout(window)
    layout.addWidget(view, 1)
    layout.addWidget(panel)
    window.resize(1000, 600)
    qtbot.addWidget(window)
    run = ScriptedRun(320, 240, frames=30)
    run.config = desk.config
    view.show_setup(setup_of(run))
    with qtbot.waitActive(window):
        window.show()
    yield panel


def at(panel: RegionPanel, x: float, y: float) -> QPoint:
    """Where a place of the picture, px, is in the view."""
    plot = panel._view.plot
    return plot.mapFromScene(plot.getPlotItem().vb.mapViewToScene(QPointF(x, y)))


def drag(
    qtbot: QtBot, panel: RegionPanel, start: tuple[float, float], end: tuple[float, float]
) -> None:
    where = panel._view.plot.viewport()
    qtbot.mouseMove(where, at(panel, *start))
    qtbot.mousePress(where, Qt.MouseButton.LeftButton, pos=at(panel, *start))
    for share in (0.2, 0.6, 1.0):
        x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
        qtbot.mouseMove(where, at(panel, x, y))
        qtbot.wait(20)
    qtbot.mouseRelease(where, Qt.MouseButton.LeftButton, pos=at(panel, *end))
    qtbot.wait(20)


def click(qtbot: QtBot, widget: QWidget) -> None:
    qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)


def test_a_corner_is_dragged_and_every_change_can_be_undone(
    qtbot: QtBot, panel: RegionPanel, desk: Desk
) -> None:
    assert desk.config.dic.region == ()
    assert not panel.undo_button.isEnabled()
    click(qtbot, panel.measure_button)
    assert desk.config.dic.region == (MIDDLE,)
    drag(qtbot, panel, (88, 48), (50, 20))
    (polygon,) = desk.config.dic.polygons
    assert polygon.corners[0] == pytest.approx((50, 20), abs=2)
    assert polygon.corners[1:] == ((232, 48), (232, 192), (88, 192))
    moved = desk.config.dic.region
    click(qtbot, panel.leave_button)
    assert [one.is_measured for one in desk.config.dic.polygons] == [True, False]
    assert panel.list.count() == len(panel.drawn) == 2

    for expected in (moved, (MIDDLE,), ()):
        qtbot.keyClick(panel.list, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
        assert desk.config.dic.region == expected
        assert len(panel.drawn) == len(expected)
    click(qtbot, panel.redo_button)
    click(qtbot, panel.redo_button)
    assert desk.config.dic.region == moved


def test_an_edge_that_is_clicked_has_a_new_corner(
    qtbot: QtBot, panel: RegionPanel, desk: Desk
) -> None:
    click(qtbot, panel.measure_button)
    where = panel._view.plot.viewport()
    qtbot.mouseMove(where, at(panel, 160, 48))
    qtbot.wait(20)
    qtbot.mouseClick(where, Qt.MouseButton.LeftButton, pos=at(panel, 160, 48))
    qtbot.waitUntil(lambda: len(desk.config.dic.polygons[0].corners) == 5)
    assert desk.config.dic.polygons[0].corners[1] == pytest.approx((160, 48), abs=2)


def test_a_polygon_is_removed(qtbot: QtBot, panel: RegionPanel, desk: Desk) -> None:
    click(qtbot, panel.measure_button)
    click(qtbot, panel.leave_button)
    panel.list.setCurrentRow(0)
    click(qtbot, panel.remove_button)
    assert [one.is_measured for one in desk.config.dic.polygons] == [False]
    click(qtbot, panel.undo_button)
    assert desk.config.dic.region[0] == MIDDLE


def test_the_region_is_on_the_picture_only_while_the_panel_is_in_sight(
    panel: RegionPanel, desk: Desk
) -> None:
    desk.set_config(load(None, (*SIZE, f'dic.region=["{MIDDLE}"]')))
    items = panel._view.plot.getPlotItem().items
    (roi,) = panel.drawn
    assert roi in items
    panel.hide()
    assert roi not in items
    panel.show()
    assert panel.drawn[0] in items
    assert "measured inside the green" in panel.sentence.text()
    desk.set_busy(True)
    assert "keeps the region that it began with" in panel.sentence.text()


def test_a_method_that_knows_no_region_says_so(
    qtbot: QtBot, panel: RegionPanel, desk: Desk
) -> None:
    desk.set_config(load(None, (*SIZE, "dic.method=direct")))
    said: list[str] = []
    desk.said.connect(lambda text, _: said.append(text))
    click(qtbot, panel.measure_button)
    assert desk.config.dic.region == ()
    assert "dic.region asked with method 'direct'" in said[0]
    assert not panel.drawn
