"""Every plot is zoomed, reset, copied and saved the same way, by mouse and by keyboard."""

import csv
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QGuiApplication, QImage, QPainter, QWheelEvent
from PySide6.QtWidgets import QApplication, QFileDialog
from pytestqt.qtbot import QtBot

from app.gui import theme
from app.gui.canvas import Canvas
from app.gui.charts import Chart, ChartMark, Guide, Line
from app.gui.lettering import advance
from app.gui.plot_panel import PlotPanel


def chart(top: float = 1.0, points: int = 50, **more: object) -> Chart:
    x = np.linspace(0.0, 1.0, points)
    line = Line("Q", x, top * x, "shear", ("travel_um", "Q_N"))
    return Chart("Loading curve", "δ (µm)", "Q (N)", (line,), **more)  # type: ignore[arg-type]


@pytest.fixture
def panel(qtbot: QtBot) -> PlotPanel:
    made = PlotPanel(Canvas(), title="Loading curve")
    made.resize(420, 320)
    qtbot.addWidget(made)
    with qtbot.waitExposed(made):
        made.show()
    made.show_chart(chart())
    return made


def place(canvas: Canvas, x: float, y: float) -> QPoint:
    left, top = canvas.frame().place(x, y)
    return QPoint(round(left), round(top))


def wheel(canvas: Canvas, at: QPoint, steps: int) -> None:
    event = QWheelEvent(
        QPointF(at), canvas.mapToGlobal(QPointF(at)), QPoint(), QPoint(0, 120 * steps),
        Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(canvas, event)


def test_the_wheel_zooms_about_the_pointer_and_over_an_axis_along_it(panel: PlotPanel) -> None:
    canvas = panel.canvas
    before, at = canvas.frame(), place(canvas, 0.25, 0.25)
    wheel(canvas, at, 4)
    after = canvas.frame()
    assert after.x[1] - after.x[0] == pytest.approx((before.x[1] - before.x[0]) * 0.85**4)
    assert after.point(at.x(), at.y()) == pytest.approx(before.point(at.x(), at.y()))
    canvas.reset()
    wheel(canvas, QPoint(at.x(), canvas.height() - 5), 2)
    assert canvas.frame().y == before.y
    assert canvas.frame().x != before.x


@pytest.mark.parametrize("way", ["double click", "R", "button", "menu"])
def test_all_is_shown_again(qtbot: QtBot, panel: PlotPanel, way: str) -> None:
    canvas = panel.canvas
    before = canvas.frame()
    wheel(canvas, place(canvas, 0.5, 0.5), 3)
    assert canvas.is_zoomed
    if way == "double click":
        qtbot.mouseDClick(canvas, Qt.MouseButton.LeftButton, pos=place(canvas, 0.5, 0.5))
    elif way == "R":
        qtbot.keyClick(canvas, Qt.Key.Key_R)
    elif way == "button":
        qtbot.mouseClick(panel.show_all, Qt.MouseButton.LeftButton)
    else:
        panel.tools.menu().actions()[0].trigger()
    assert canvas.frame() == before


def test_dragging_moves_what_is_under_the_pointer_with_it(qtbot: QtBot, panel: PlotPanel) -> None:
    canvas = panel.canvas
    start, end = place(canvas, 0.5, 0.5), place(canvas, 0.8, 0.4)
    qtbot.mousePress(canvas, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(canvas, end)
    qtbot.mouseRelease(canvas, Qt.MouseButton.LeftButton, pos=end)
    # the press and the end are whole pixels
    assert canvas.frame().point(end.x(), end.y()) == pytest.approx((0.5, 0.5), abs=0.01)


def test_keys_zoom_about_the_middle(qtbot: QtBot, panel: PlotPanel) -> None:
    before = panel.canvas.frame()
    qtbot.keyClick(panel.canvas, Qt.Key.Key_Plus)
    after = panel.canvas.frame()
    assert after.x[1] - after.x[0] < before.x[1] - before.x[0]
    assert sum(after.x) == pytest.approx(sum(before.x))
    qtbot.keyClick(panel.canvas, Qt.Key.Key_Minus)
    assert panel.canvas.frame().x == pytest.approx(before.x)


def test_only_what_differs_by_a_pixel_is_drawn_again(
    qtbot: QtBot, panel: PlotPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    updates = []
    monkeypatch.setattr(panel.canvas, "update", lambda *_: updates.append(1))
    panel.show_chart(chart())
    panel.show_chart(chart(top=0.9999))
    assert not updates
    panel.show_chart(chart(top=0.9))
    assert len(updates) == 1


def test_axes_stay_while_a_curve_grows_inside_them(panel: PlotPanel) -> None:
    panel.show_chart(chart(top=0.91))
    grounds = set()
    for top in np.linspace(0.91, 0.99, 20):
        panel.show_chart(chart(top=float(top)))
        panel.canvas.grab()
        grounds.add(id(panel.canvas._ground))
    assert len(grounds) == 1


def test_the_curve_is_drawn_where_its_values_are(panel: PlotPanel) -> None:
    image = panel.canvas.grab().toImage()
    wanted = QColor(theme.now().shear)
    at = place(panel.canvas, 0.4, 0.4)
    near = [image.pixelColor(at.x(), at.y() + k) for k in range(-2, 3)]
    far = [image.pixelColor(at.x(), at.y() + k) for k in range(-40, -20)]

    def distance(colour: QColor) -> int:
        return abs(colour.red() - wanted.red()) + abs(colour.blue() - wanted.blue())

    assert min(map(distance, near)) < 60 < min(map(distance, far))


def test_texts_overprint_neither_each_other_nor_the_curve(
    panel: PlotPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    guides = tuple(Guide(0.5 + 0.001 * n, f"line {n}", is_upright=True) for n in range(5))
    guides += (Guide(0.97, "level"),)  # its usual place is on the curve's end
    panel.show_chart(
        chart(guides=guides, marks=(ChartMark(0.5, 0.5, "1"), ChartMark(0.51, 0.5, "2")))
    )
    rooms = {}
    write = panel.canvas._name

    def noted(painter: QPainter, text: str, colour: QColor, room: QRectF) -> None:
        rooms[text] = room
        write(painter, text, colour, room)

    monkeypatch.setattr(panel.canvas, "_name", noted)
    panel.canvas.grab()
    assert len(rooms) == 8
    placed = list(rooms.values())
    for n, room in enumerate(placed):
        assert not any(room.intersects(other) for other in placed[:n])
    frame = panel.canvas.frame()
    for text, room in rooms.items():
        on_curve = [frame.place(x, x) for x in np.linspace(0, 1, 500)]
        assert not any(room.contains(*at) for at in on_curve), text


def test_a_plot_without_a_point_says_what_it_will_show(panel: PlotPanel) -> None:
    panel.show_chart(Chart("Loading curve", "", "", hint="Q against the travel"))
    hinted = panel.canvas.grab().toImage()
    panel.show_chart(Chart("Loading curve", "", ""))
    assert hinted != panel.canvas.grab().toImage()
    panel.show_chart(replace(chart(), hint="Q against the travel"))
    drawn = panel.canvas.grab().toImage()
    panel.show_chart(chart())
    assert drawn == panel.canvas.grab().toImage()


def test_a_subscript_is_small_and_below_the_line(qtbot: QtBot) -> None:
    font = QApplication.font()
    assert advance(font, "a") < advance(font, "a_H") < advance(font, "aH") < advance(font, "a_HH")


def test_the_name_of_a_mark_stays_inside_the_axes(
    panel: PlotPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = (ChartMark(0.99, 0.99, "1: frame 320"), ChartMark(0.98, 0.97, "2: frame 321"))
    panel.show_chart(chart())
    bare = panel.canvas.grab().toImage()
    panel.show_chart(chart(marks=marks))
    marked = panel.canvas.grab().toImage()
    frame = panel.canvas.frame()
    right = round(frame.left + frame.width)
    beyond = (right + 1, 0, bare.width() - right - 1, bare.height())
    near = (right - 8, round(frame.top), 3, 40)  # cut off, a name would reach the axes' end
    assert bare.copy(*beyond) == marked.copy(*beyond)
    below = (near[0], near[1] + 12, 3, 28)
    assert bare.copy(*below) == marked.copy(*below)


def test_the_legend_lies_above_the_axes(panel: PlotPanel) -> None:
    text = panel.canvas.fontMetrics()
    assert panel.canvas.frame().top >= text.height()
    narrow = panel.canvas._legend_rows(text, 60.0)  # type: ignore[arg-type]
    assert narrow[-1][0] == 1


def test_copy_by_keyboard(qtbot: QtBot, panel: PlotPanel) -> None:
    QGuiApplication.clipboard().clear()
    panel.canvas.setFocus()
    qtbot.keyClick(panel.canvas, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    assert QGuiApplication.clipboard().image().width() == panel.canvas.width()


@pytest.mark.parametrize("kind", ["png", "svg", "csv"])
def test_save_from_the_menu(qtbot: QtBot, panel: PlotPanel, tmp_path: Path, kind: str) -> None:
    (action,) = (a for a in panel.tools.menu().actions() if kind.upper() in a.text())
    action.trigger()
    dialog = panel.findChild(QFileDialog)
    assert dialog is not None
    assert not dialog.isModal()  # STOP MOTION stays within reach
    path = tmp_path / f"curve.{kind}"
    dialog.fileSelected.emit(str(path))
    dialog.close()
    if kind == "png":
        assert QImage(str(path)).width() == panel.canvas.width()
    elif kind == "svg":
        tree = ElementTree.parse(path)
        texts = "".join(tree.getroot().itertext())
        assert "Q (N)" in texts
        assert list(tree.iter("{http://www.w3.org/2000/svg}polyline"))
    else:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
        assert len(rows) == 50
        assert float(rows[-1]["Q_N"]) == 1.0


def test_a_plot_that_can_not_be_saved_says_so(panel: PlotPanel, tmp_path: Path) -> None:
    for kind in ("png", "svg", "csv"):
        panel._save_or_say(tmp_path / "nowhere" / f"a.{kind}")
        assert "was not saved" in panel.caption.text()
