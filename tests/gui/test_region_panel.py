"""The region drawn on the picture: by mouse, with undo, and in the settings of the next run."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun

from app.gui.desk import Desk
from app.gui.image_view import InterfaceView
from app.gui.region_overlay import PlacedPicture, picture_of
from app.gui.region_panel import RegionPanel
from app.gui.source import setup_of
from app.settings.config import load

SIZE = ("camera.width=320", "camera.height=240")
MIDDLE = "inside 88 48 232 48 232 192 88 192"  # 0.3 of 240 px each way from (160, 120)


@pytest.fixture
def desk() -> Desk:
    return Desk(None, load(None, SIZE))  # type: ignore[arg-type]


class Ground(QWidget):
    """A picture of 320 x 240 px at twice its size, 10 px from the corner; counts what it gets."""

    def __init__(self) -> None:
        super().__init__()
        self.resize(660, 500)
        self.presses = 0

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self.presses += 1


@pytest.fixture
def ground(qtbot: QtBot) -> Ground:
    made = Ground()
    qtbot.addWidget(made)
    made.show()
    return made


@pytest.fixture
def panel(qtbot: QtBot, desk: Desk, ground: Ground) -> RegionPanel:
    picture = PlacedPicture(
        ground,
        lambda x, y: QPointF(10 + 2 * x, 10 + 2 * y),
        lambda at: ((at.x() - 10) / 2, (at.y() - 10) / 2),
    )
    panel = RegionPanel(desk, picture)
    qtbot.addWidget(panel)
    with qtbot.waitActive(panel):
        panel.show()
    return panel


def at(x: float, y: float) -> QPoint:
    """Where a place of the picture, px, is."""
    return QPoint(round(10 + 2 * x), round(10 + 2 * y))


def drag(
    qtbot: QtBot, panel: RegionPanel, start: tuple[float, float], end: tuple[float, float]
) -> None:
    where = panel.overlay
    qtbot.mousePress(where, Qt.MouseButton.LeftButton, pos=at(*start))
    for share in (0.3, 1.0):
        x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
        qtbot.mouseMove(where, at(x, y))
    qtbot.mouseRelease(where, Qt.MouseButton.LeftButton, pos=at(*end))


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
    assert polygon.corners[0] == (50, 20)
    assert polygon.corners[1:] == ((232, 48), (232, 192), (88, 192))
    moved = desk.config.dic.region
    click(qtbot, panel.leave_button)
    assert [one.is_measured for one in desk.config.dic.polygons] == [True, False]
    assert panel.list.count() == len(panel.overlay.polygons) == 2

    for expected in (moved, (MIDDLE,), ()):
        qtbot.keyClick(panel.list, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
        assert desk.config.dic.region == expected
        assert len(panel.overlay.polygons) == len(expected)
    click(qtbot, panel.redo_button)
    click(qtbot, panel.redo_button)
    assert desk.config.dic.region == moved


def test_corners_are_added_and_removed_and_a_polygon_is_moved(
    qtbot: QtBot, panel: RegionPanel, desk: Desk
) -> None:
    click(qtbot, panel.measure_button)
    drag(qtbot, panel, (160, 48), (160, 30))
    corners = desk.config.dic.polygons[0].corners
    assert corners[1] == (160, 30)
    assert len(corners) == 5
    qtbot.mouseDClick(panel.overlay, Qt.MouseButton.LeftButton, pos=at(160, 30))
    assert desk.config.dic.region == (MIDDLE,)
    drag(qtbot, panel, (160, 120), (170, 100))
    assert desk.config.dic.region == ("inside 98 28 242 28 242 172 98 172",)


def test_a_triangle_keeps_its_corners(qtbot: QtBot, panel: RegionPanel, desk: Desk) -> None:
    triangle = "outside 50 50 200 50 120 180"
    desk.set_config(load(None, (*SIZE, f'dic.region=["{triangle}"]')))
    said: list[str] = []
    desk.said.connect(lambda text, _: said.append(text))
    qtbot.mouseDClick(panel.overlay, Qt.MouseButton.LeftButton, pos=at(50, 50))
    assert desk.config.dic.region == (triangle,)
    assert not said


def test_what_is_beside_the_polygons_is_left_to_the_picture(
    qtbot: QtBot, panel: RegionPanel, ground: Ground
) -> None:
    click(qtbot, panel.measure_button)
    qtbot.mouseClick(panel.overlay, Qt.MouseButton.LeftButton, pos=at(20, 20))
    assert ground.presses == 1
    qtbot.mouseClick(panel.overlay, Qt.MouseButton.LeftButton, pos=at(88, 48))
    assert ground.presses == 1
    ground.resize(900, 700)
    assert panel.overlay.size() == ground.size()


def test_a_polygon_is_removed(qtbot: QtBot, panel: RegionPanel, desk: Desk) -> None:
    click(qtbot, panel.measure_button)
    click(qtbot, panel.leave_button)
    panel.list.setCurrentRow(0)
    click(qtbot, panel.remove_button)
    assert [one.is_measured for one in desk.config.dic.polygons] == [False]
    click(qtbot, panel.undo_button)
    assert desk.config.dic.region[0] == MIDDLE


def test_the_region_is_on_the_picture_only_while_the_panel_is_in_sight(
    panel: RegionPanel, desk: Desk, ground: Ground
) -> None:
    desk.set_config(load(None, (*SIZE, f'dic.region=["{MIDDLE}"]')))

    def green_at(x: float, y: float) -> bool:
        colour = ground.grab().toImage().pixelColor(at(x, y))
        return colour.green() > colour.red() + 40

    assert green_at(88, 100)
    assert not green_at(120, 70)
    panel.hide()
    assert not green_at(88, 100)
    panel.show()
    assert green_at(88, 100)
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
    assert not panel.overlay.polygons


def test_places_of_the_picture_are_found_in_the_view(qtbot: QtBot, desk: Desk) -> None:
    view = InterfaceView()
    qtbot.addWidget(view)
    view.resize(700, 600)
    with qtbot.waitExposed(view):
        view.show()
    run = ScriptedRun(320, 240, frames=30)
    run.config = desk.config
    view.show_setup(setup_of(run))
    picture = picture_of(view)
    x, y = picture.point(picture.place(100.0, 60.0))
    assert (x, y) == pytest.approx((100, 60), abs=1.0)
    left, right = picture.place(0.0, 0.0), picture.place(320.0, 0.0)
    assert 300 < right.x() - left.x() < 700
    assert picture.widget.rect().contains(right.toPoint())
