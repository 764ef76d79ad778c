"""The region drawn on the picture: by mouse, with undo, and in the settings of the next run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot
from window_hands import click, shown

from app.gui.frame_results import Circles
from app.gui.plots.picture import PicturePlot
from app.gui.region_panel import CIRCLE, CONTACT, POLYGON, RegionPanel
from app.gui.window_model import WindowModel
from app.settings.config import load

SIZE = ("camera.width=320", "camera.height=240")
MM = 7.04e-3
LEFT = Qt.MouseButton.LeftButton
MIDDLE = "inside 88 48 232 48 232 192 88 192"  # 0.3 of 240 px each way from (160, 120)


@pytest.fixture
def model() -> WindowModel:
    return WindowModel(None, load(None, SIZE))  # type: ignore[arg-type]


@pytest.fixture
def picture(qtbot: QtBot, model: WindowModel) -> PicturePlot:
    """A picture of 320 x 240 px."""
    made = shown(qtbot, PicturePlot(), 720, 560)
    made.begin_run((320, 240), MM, (0.0, 0.0, 320.0, 240.0))
    made.grab()  # it takes its final size
    return made


@pytest.fixture
def panel(qtbot: QtBot, model: WindowModel, picture: PicturePlot) -> RegionPanel:
    return shown(qtbot, RegionPanel(model, picture))


def at(panel: RegionPanel, x: float, y: float) -> QPoint:
    """Where a place of the picture, px, is."""
    return panel.picture.place(x * MM, y * MM).toPoint()


def drag(
    qtbot: QtBot, panel: RegionPanel, start: tuple[float, float], end: tuple[float, float]
) -> None:
    where = panel.picture.viewport()
    at_places = [at(panel, *place) for place in np.linspace(start, end, 4)]
    qtbot.mouseMove(where, at(panel, *start))
    qtbot.mousePress(where, LEFT, pos=at(panel, *start))
    for place in at_places:
        qtbot.wait(12)  # what comes sooner is left out
        send_move(where, place)
    qtbot.mouseRelease(where, LEFT, pos=at_places[-1])


def send_move(where: QWidget, place: QPoint) -> None:
    """Move the mouse with its left button down, which QTest cannot."""
    here = where.mapToGlobal(place).toPointF()
    none = Qt.KeyboardModifier.NoModifier
    kind = QEvent.Type.MouseMove
    event = QMouseEvent(kind, place.toPointF(), here, Qt.MouseButton.NoButton, LEFT, none)
    QApplication.sendEvent(where, event)


def press(qtbot: QtBot, panel: RegionPanel, place: tuple[float, float], times: int = 1) -> None:
    """Click on a place of the picture, once or twice."""
    where, there = panel.picture.viewport(), at(panel, *place)
    qtbot.mouseMove(where, there)
    qtbot.mouseClick(where, LEFT, pos=there)
    if times == 2:
        qtbot.mouseDClick(where, LEFT, pos=there)
        qtbot.mouseRelease(where, LEFT, pos=there)


def test_a_corner_is_dragged_and_every_change_can_be_undone(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    assert model.config.dic.region == ()
    assert not panel.undo_button.isEnabled()
    click(qtbot, panel.measure_button)
    assert model.config.dic.region == (MIDDLE,)
    drag(qtbot, panel, (88, 48), (50, 20))
    (polygon,) = model.config.dic.polygons
    np.testing.assert_allclose(polygon.corners[0], (50, 20), atol=1)
    (left, top), *others = polygon.corners
    assert others == [(232, top), (232, 192), (left, 192)]
    moved = model.config.dic.region
    click(qtbot, panel.leave_button)
    assert [one.is_measured for one in model.config.dic.polygons] == [True, False]
    assert panel.list.count() == len(panel.shapes.polygons) == 2

    for expected in (moved, (MIDDLE,), ()):
        qtbot.keyClick(panel.list, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
        assert model.config.dic.region == expected
        assert len(panel.shapes.polygons) == len(expected)
    click(qtbot, panel.redo_button)
    click(qtbot, panel.redo_button)
    assert model.config.dic.region == moved


def test_shapes_of_another_set_up_do_not_come_back_by_undo(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    panel.add(True)
    config = model.config
    model.set_config(replace(config, run=replace(config.run, normal_force=0.1)))
    assert panel.undo_button.isEnabled()  # the region is the one that was drawn
    panel.add(False)
    panel.undo_stack.undo()
    assert len(panel.region) == 1
    model.set_config(load(None, SIZE))
    assert not panel.undo_button.isEnabled()
    assert not panel.redo_button.isEnabled()
    panel.undo_stack.undo()
    assert panel.region == ()


def test_corners_are_added_and_removed_and_a_shape_is_moved(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    click(qtbot, panel.measure_button)
    press(qtbot, panel, (160, 48))
    corners = model.config.dic.polygons[0].corners
    assert len(corners) == 5
    np.testing.assert_allclose(corners[1], (160, 48), atol=1)
    drag(qtbot, panel, (160, 48), (160, 30))
    corners = model.config.dic.polygons[0].corners
    np.testing.assert_allclose(corners[1], (160, 30), atol=1)
    assert (corners[0], *corners[2:]) == ((88, 48), (232, 48), (232, 192), (88, 192))
    press(qtbot, panel, (160, 30), times=2)
    assert model.config.dic.region == (MIDDLE,)
    drag(qtbot, panel, (130, 120), (140, 100))
    (polygon,) = model.config.dic.polygons
    moved = np.array(((98, 28), (242, 28), (242, 172), (98, 172)))
    np.testing.assert_allclose(polygon.corners, moved, atol=1)
    assert not panel.picture.is_zoomed  # the picture did not move along


def test_a_circle_stays_one_when_it_is_dragged(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    panel.kind.setCurrentText(CIRCLE)
    click(qtbot, panel.measure_button)
    (polygon,) = model.config.dic.polygons
    assert len(polygon.corners) == 32
    radii = np.hypot(*(np.array(polygon.corners) - (160, 120)).T)
    np.testing.assert_allclose(radii, 72, atol=1)
    assert panel.list.item(0).text() == f"measure: circle, radius {72 * MM:.2f} mm"
    rim = 160 + 72 / np.sqrt(2), 120 + 72 / np.sqrt(2)
    drag(qtbot, panel, rim, (160 + 50 / np.sqrt(2), 120 + 50 / np.sqrt(2)))
    radii = np.hypot(*(np.array(model.config.dic.polygons[0].corners) - (160, 120)).T)
    np.testing.assert_allclose(radii, 50, atol=2)
    assert f"circle, radius {50 * MM:.2f}"[:-1] in panel.list.item(0).text()
    click(qtbot, panel.undo_button)
    assert model.config.dic.polygons == (polygon,)


def test_a_small_circle_stays_one_when_it_is_made_large(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    panel.kind.setCurrentText(CIRCLE)
    click(qtbot, panel.measure_button)
    for before, after in ((72, 12), (12, 90)):
        near, far = (160 + r / np.sqrt(2) for r in (before, after))
        drag(qtbot, panel, (near, near - 40), (far, far - 40))
        click(qtbot, panel.undo_button)  # it is drawn anew, as a settings file has it
        click(qtbot, panel.redo_button)
    radii = np.hypot(*(np.array(model.config.dic.polygons[0].corners) - (160, 120)).T)
    np.testing.assert_allclose(radii, 90, atol=2)
    assert panel.list.item(0).text().startswith("measure: circle, radius")


def test_a_circle_about_the_contact_has_so_many_of_its_radii(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel, said: list[str]
) -> None:
    panel.kind.setCurrentText(CONTACT)
    click(qtbot, panel.leave_button)
    assert model.config.dic.region == ()
    assert "measured in a run" in said[0]
    panel.picture.show_circles(Circles((150.0, 100.0), 40.0, 20.0))
    panel.factor.setValue(1.2)
    click(qtbot, panel.leave_button)
    (polygon,) = model.config.dic.polygons
    assert not polygon.is_measured
    radii = np.hypot(*(np.array(polygon.corners) - (150, 100)).T)
    np.testing.assert_allclose(radii, 48, atol=1)


def test_the_panel_says_how_large_a_shape_is_and_how_many_boxes_fit(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    fit, _, of_all = panel.boxes.text().partition(" ")
    assert of_all.startswith(f"of {fit} boxes of 20 px")
    click(qtbot, panel.measure_button)
    side = 144 * MM
    assert panel.list.item(0).text() == f"measure: rectangle, {side:.2f} × {side:.2f} mm"
    other = replace(model.config, camera=replace(model.config.camera, pixel=2e-3 * MM))
    model.set_config(other)
    assert panel.list.item(0).text() == f"measure: rectangle, {2 * side:.2f} × {2 * side:.2f} mm"
    inside = int(panel.boxes.text().partition(" ")[0])
    assert inside == pytest.approx(14.4**2, rel=0.1)  # a box every 10 px
    panel.kind.setCurrentText(POLYGON)
    click(qtbot, panel.leave_button)
    assert panel.list.item(1).text().startswith("leave out: 8 corners")
    assert 0 < int(panel.boxes.text().partition(" ")[0]) < inside


def test_a_triangle_keeps_its_corners(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel, said: list[str]
) -> None:
    triangle = "outside 50 50 200 50 120 180"
    model.set_config(load(None, (*SIZE, f'dic.region=["{triangle}"]')))
    press(qtbot, panel, (50, 50), times=2)
    assert model.config.dic.region == (triangle,)
    assert not said


def test_what_is_beside_the_shapes_is_left_to_the_picture(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel
) -> None:
    click(qtbot, panel.measure_button)
    drag(qtbot, panel, (20, 20), (40, 60))
    assert panel.picture.is_zoomed  # moved
    press(qtbot, panel, (20, 20), times=2)
    assert not panel.picture.is_zoomed
    assert model.config.dic.region == (MIDDLE,)


def test_a_polygon_is_removed(qtbot: QtBot, panel: RegionPanel, model: WindowModel) -> None:
    click(qtbot, panel.measure_button)
    click(qtbot, panel.leave_button)
    panel.list.setCurrentRow(0)
    click(qtbot, panel.remove_button)
    assert [one.is_measured for one in model.config.dic.polygons] == [False]
    click(qtbot, panel.undo_button)
    assert model.config.dic.region[0] == MIDDLE


def test_the_region_is_on_the_picture_only_while_the_panel_is_in_sight(
    panel: RegionPanel, model: WindowModel
) -> None:
    model.set_config(load(None, (*SIZE, f'dic.region=["{MIDDLE}"]')))

    def green_at(x: float, y: float) -> bool:
        colour = panel.picture.grab().toImage().pixelColor(at(panel, x, y))
        return colour.green() > colour.red() + 40

    assert green_at(88, 100)
    assert not green_at(120, 70)
    panel.hide()
    assert not green_at(88, 100)
    panel.show()
    assert green_at(88, 100)
    assert "measured inside the green" in panel.sentence.text()
    model.set_busy(True)
    assert "keeps the region that it began with" in panel.sentence.text()


def test_a_method_that_knows_no_region_says_so(
    qtbot: QtBot, panel: RegionPanel, model: WindowModel, said: list[str]
) -> None:
    model.set_config(load(None, (*SIZE, "dic.method=direct")))
    click(qtbot, panel.measure_button)
    assert model.config.dic.region == ()
    assert "dic.region asked with method 'direct'" in said[0]
    assert not panel.shapes.polygons
