"""What the picture draws over itself, in the coordinates of its axes."""

from __future__ import annotations

import csv
import math
import threading
from dataclasses import replace
from unittest.mock import Mock, create_autospec

import numpy as np
import pytest
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QColor, QImage, QPainter, QPixmap
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from app.gui import theme
from app.gui.frame_results import KINDS, Circles, FieldImage, ShownImage
from app.gui.plots import raster
from app.gui.plots.picture import PicturePlot, colour_table

MM, CENTRE_PX = 7.04e-3, (900.0, 310.0)
RADII_PX = {"a": 260.0, "aH": 200.0, "c": 120.0}


@pytest.fixture
def plot(qtbot: QtBot) -> PicturePlot:
    """A picture of 1600 x 1200 pixels with the circles of a contact away from its diagonal."""
    made = PicturePlot()
    qtbot.addWidget(made)
    made.resize(800, 600)
    made.show()
    made.begin_run((1600, 1200), MM, (-0.5, -0.5, 1600.0, 1200.0))
    apparent, hertz, stick = RADII_PX.values()
    made.show_circles(Circles(CENTRE_PX, apparent, stick, hertz))
    return made


def drawn(plot: PicturePlot, ratio: float = 1.0) -> np.ndarray:
    """Red, green and blue of what a screen with so many pixels for one shows, shape (y, x, 3)."""
    view = plot.viewport()
    picture = QPixmap(view.size() * ratio)
    picture.setDevicePixelRatio(ratio)
    view.render(picture)
    image = picture.toImage().convertToFormat(QImage.Format.Format_RGB32)
    pixels = np.array(image.constBits()).reshape(image.height(), image.bytesPerLine() // 4, 4)
    return pixels[:, : image.width(), 2::-1].astype(int)


def places(plot: PicturePlot, colour: str, near: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """How far right of the contact's centre, and below it, the pixels of a colour are, px."""
    is_there = (np.abs(drawn(plot) - QColor(colour).getRgb()[:3]) <= near).all(axis=2)
    y, x = np.nonzero(is_there)
    centre = plot.place(*(MM * at for at in CENTRE_PX))
    return x + 0.5 - centre.x(), y + 0.5 - centre.y()


def test_each_circle_has_its_name_on_it(plot: PicturePlot) -> None:
    roles = {"a": "apparent", "aH": "muted", "c": "stick"}
    shares = {"a": (0.5, 0.75), "aH": (0.2, 0.5), "c": (0.8, 1.0)}  # dashed, dotted, solid
    turns = []
    for name, radius_px in RADII_PX.items():
        radius = MM * radius_px / plot.box.viewPixelSize()[0]
        x, y = places(plot, theme.DARK.role(roles[name]))
        away = np.hypot(x, y) - radius
        is_line = np.abs(away) < 1.5
        assert is_line.sum() / (2 * np.pi * radius) == pytest.approx(
            np.mean(shares[name]), abs=np.ptp(shares[name]) / 2
        ), name
        assert np.mean(away[is_line]) == pytest.approx(0.0, abs=0.3), name
        assert (x[is_line].mean(), y[is_line].mean()) == pytest.approx((0.0, 0.0), abs=4), name
        x, y = places(plot, theme.DARK.role(roles[name]), near=60)  # at the edges of letters
        away = np.hypot(x, y) - radius
        word = (np.abs(away) < 10) & (np.abs(away) > 1.5)
        assert word.sum() >= 4, name
        assert max(np.ptp(x[word]), np.ptp(y[word])) < 16, name
        turns.append(math.degrees(math.atan2(y[word].mean(), x[word].mean())))
    assert np.ptp(turns) > 30  # they do not cover each other


def test_the_name_on_a_circle_is_its_own(plot: PicturePlot) -> None:
    painter, pens, found = Mock(), [], {}
    plot._contact.paint(painter)
    for what, arguments, _ in painter.method_calls:
        if what == "setPen":
            pens.append(arguments[0].color().name())
        elif what == "drawStaticText":
            corner, text = arguments
            at = corner + QRectF(QPointF(), text.size()).center()
            radius = math.hypot(at.x(), at.y()) * plot.box.viewPixelSize()[0] / MM
            found[text.text()] = (pens[-1], round(radius))
    colours = {"a": "apparent", "a<sub>H</sub>": "muted", "c": "stick"}
    assert found == {
        name: (QColor(theme.DARK.role(role)).name(), radius)
        for (name, role), radius in zip(colours.items(), RADII_PX.values(), strict=True)
    }


def test_the_cross_is_in_the_centre_of_the_contact(plot: PicturePlot) -> None:
    x, y = places(plot, "#ffffff")
    is_near = np.hypot(x, y) < 12
    assert is_near.sum() >= 40
    assert (x[is_near].mean(), y[is_near].mean()) == pytest.approx((0.0, 0.0), abs=0.5)


def test_what_a_circle_has_moved_by_is_drawn_from_half_a_pixel_on(
    qtbot: QtBot, plot: PicturePlot
) -> None:
    """The load gives another radius a_H at each look, and the picture takes long to draw."""
    pixel_px = plot.box.viewPixelSize()[0] / MM
    apparent, hertz, stick = RADII_PX.values()
    painted: list[object] = []

    def show(moved: float) -> bool:
        """Whether all is drawn again where a_H is larger by so many pixels of the screen."""
        qtbot.wait(50)
        before = len(painted)
        plot.show_circles(Circles(CENTRE_PX, apparent, stick, hertz + moved * pixel_px))
        qtbot.wait(50)
        return len(painted) > before

    plot.scene().changed.connect(painted.append)
    show(0.0)  # where the pixels are of the size that they have got by now
    assert [show(moved) for moved in (0.2, 0.4, 0.6, 0.9, 1.3)] == [False, False, True, False, True]
    assert plot.circles is not None
    assert plot.circles.hertz_px == pytest.approx(hertz + 1.3 * pixel_px)


def test_a_circle_that_moves_inside_another_is_drawn_anew(plot: PicturePlot) -> None:
    apparent, hertz, _ = RADII_PX.values()
    pixel_px = plot.box.viewPixelSize()[0] / MM
    for stick in (120.0, 60.0, 90.0):
        plot.show_circles(Circles(CENTRE_PX, apparent, stick, hertz))
        x, y = places(plot, theme.DARK.stick)
        # the name has its colour, too
        assert np.median(np.hypot(x, y)) * pixel_px == pytest.approx(stick, abs=2 * pixel_px)


def show(plot: PicturePlot, kind: str, values: np.ndarray) -> None:
    """Show grey levels in one of the ways that there are."""
    whole = (-0.5, -0.5, 1600.0, 1200.0)
    if kind == "image":
        plot.show_image(ShownImage(values, whole, "", values), (0, 255))
    elif kind == "colours":
        plot.show_colours(np.dstack([values] * 3), whole)
    else:
        plot.show_field(FieldImage(KINDS["ux_um"], values.astype(np.float32), ""), (0.0, 255.0))


@pytest.mark.parametrize(
    ("width_mm", "ratio"), [(None, 1.25), (7.3, 1.0), (7.3, 2.0), (1.7, 1.25), (0.31, 2.0)]
)
@pytest.mark.parametrize("kind", ["image", "colours", "field"])
def test_a_pixel_is_seen_where_the_axes_say(
    plot: PicturePlot, kind: str, width_mm: float | None, ratio: float
) -> None:
    """Its edges, to half a pixel of the screen, at each zoom."""
    every, column, row = 8, 131, 58
    left, top = MM * (column * every - 0.5), MM * (row * every - 0.5)
    right, bottom = left + MM * every, top + MM * every
    if width_mm is not None:
        x, y = (left - 0.37 * width_mm, left + 0.63 * width_mm), (top - 0.3 * width_mm, top + 0.1)
        plot.box.setRange(xRange=x, yRange=y, padding=0)
    values = np.full((150, 200), 20, np.uint8)
    show(plot, kind, values)
    dark = drawn(plot, ratio)
    values = values.copy()
    values[row, column] = 200
    show(plot, kind, values)
    y, x = np.nonzero((dark != drawn(plot, ratio)).any(axis=2))
    start, end = plot.place(left, top), plot.place(right, bottom)
    room = plot.box.sceneBoundingRect()
    for seen, ends, axes in (
        (x, (start.x(), end.x()), (room.left(), room.right())),
        (y, (start.y(), end.y()), (room.top(), room.bottom())),
    ):
        first, last = (ratio * at for at in np.clip(ends, *axes))
        assert seen.min() == pytest.approx(first, abs=0.51)
        assert seen.max() + 1 == pytest.approx(last, abs=0.51)


def test_a_small_image_is_prepared_after_the_picture_of_a_connected_bench(
    plot: PicturePlot,
) -> None:
    grey = np.arange(120 * 160, dtype=np.uint8).reshape(120, 160)
    image = ShownImage(grey, (-0.5, -0.5, 1600.0, 1200.0), "", grey)
    plot.show_image(image, (0, 255))
    seen = drawn(plot)
    plot.show_colours(np.zeros((120, 160, 3), np.uint8), image.rect_px)
    assert (drawn(plot) != seen).any()
    plot.prepare(replace(image, pixels=grey.copy()), None)
    plot.show_image(image, (0, 255))
    np.testing.assert_array_equal(drawn(plot), seen)


@pytest.mark.parametrize("change", ["nothing", "zoom", "colours", "pixels"])
@pytest.mark.parametrize("kind", ["image", "field"])
def test_what_is_made_beforehand_is_drawn_where_nothing_else_has_changed(
    plot: PicturePlot, kind: str, change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it is made anew, and looks as if nothing had been made beforehand."""
    rows, columns = np.mgrid[:150, :200]
    pixels = (rows + columns) % 250
    shown = [(shift + pixels).astype(np.uint8) for shift in (0, 3, 5)]
    images = [ShownImage(one, (-0.5, -0.5, 1600.0, 1200.0), "", one) for one in shown]
    fields = [FieldImage(KINDS["ux_um"], one.astype(np.float32), "") for one in shown]
    top, white = 255.0, 255

    def show_next(n: int) -> None:
        if kind == "image":
            plot.show_image(images[n], (0, white))
        else:
            plot.show_field(fields[n], (0.0, top))

    show_next(0)
    drawn(plot)
    work = (images[1], None) if kind == "image" else (None, fields[1])
    thread = threading.Thread(target=plot.prepare, args=work)
    thread.start()
    thread.join()
    made = raster._Image._scaled_part
    makes = create_autospec(made, side_effect=made)
    monkeypatch.setattr(raster._Image, "_scaled_part", makes)
    if change == "zoom":
        plot.box.setXRange(2.0, 5.0, padding=0)
    elif change == "colours":
        top, white = 200.0, 200
    next_one = 2 if change == "pixels" else 1
    show_next(next_one)
    seen = drawn(plot)
    assert makes.called == (change != "nothing")
    images[next_one] = replace(images[next_one], pixels=images[next_one].pixels.copy())
    fields[next_one] = replace(fields[next_one], values=fields[next_one].values.copy())
    show_next(next_one)
    makes.reset_mock()
    np.testing.assert_array_equal(drawn(plot), seen)
    assert makes.called


def show_field_over_image(plot: PicturePlot, lost: int | list[int]) -> None:
    """A field that lies within an image and has lost points in columns of one row."""
    plot.begin_run((1600, 1200), MM, (399.5, 299.5, 800.0, 600.0))
    show(plot, "image", np.full((150, 200), 77, np.uint8))
    values = np.full((6, 8), 3.0, np.float32)
    values[2, lost] = np.nan
    plot.show_field(FieldImage(KINDS["ux_um"], values, ""), (0.0, 4.0))


@pytest.mark.parametrize("lost", [5, 0, 7])
@pytest.mark.parametrize("opacity", [1.0, 0.0])
def test_the_image_is_seen_beside_the_field_and_where_it_was_not_measured(
    plot: PicturePlot, opacity: float, lost: int
) -> None:
    show_field_over_image(plot, lost)
    plot.set_opacity(opacity)
    beside, measured, unknown = (300.0, 600.0), (450.0, 350.0), (450.0 + 100.0 * lost, 550.0)
    grey = (77, 77, 77)
    field = tuple(colour_table(is_diverging=False)[int(255 * 3 / 4) + 1, :3]) if opacity else grey
    assert drawn_at(plot, *beside) == grey
    assert drawn_at(plot, *measured) == field
    assert drawn_at(plot, *unknown) == grey
    values = np.full((6, 8), 3.0, np.float32)
    plot.show_field(FieldImage(KINDS["ux_um"], values, ""), (0.0, 4.0))
    assert drawn_at(plot, *beside) == grey
    assert drawn_at(plot, *unknown) == field
    plot.show_field(None, (0.0, 1.0))
    assert drawn_at(plot, *unknown) == grey


@pytest.mark.parametrize("lost", [[], [7], [0, 1]])
def test_the_image_is_drawn_only_where_a_field_that_has_lost_columns_at_its_edge_does_not_hide_it(
    plot: PicturePlot, lost: list[int]
) -> None:
    show_field_over_image(plot, lost)
    drawn(plot)
    for column in range(8):
        at = plot.place(MM * (450 + 100 * column), MM * 350).toPoint()
        is_drawn = any(part.contains(at) for part, _ in plot._below._image._parts)
        assert is_drawn == (column in lost), column


def drawn_at(plot: PicturePlot, x_px: float, y_px: float) -> tuple[int, ...]:
    """Red, green and blue at a place in pixels of the image."""
    at = plot.place(MM * x_px, MM * y_px)
    return tuple(drawn(plot)[int(at.y()), int(at.x())].tolist())


def test_the_scale_bar_is_no_longer_than_the_picture_in_a_wide_window(plot: PicturePlot) -> None:
    plot.resize(2000, 400)
    bar = plot._scale
    assert 0.15 < bar.size / (1600 * MM) < 0.6


@pytest.mark.parametrize("width_mm", [9.0, 2.0, 0.2, 0.03])
def test_the_scale_bar_says_its_own_length(plot: PicturePlot, width_mm: float) -> None:
    plot.box.setXRange(1.0, 1.0 + width_mm, padding=0)
    bar = plot._scale
    value, unit = bar.text.toPlainText().split()
    assert float(value) * {"mm": 1.0, "µm": 1e-3}[unit] == pytest.approx(bar.size)
    (low, high), _ = plot.box.viewRange()
    assert 0.15 < bar.size / (high - low) < 0.6


def test_the_scale_bar_is_seen_on_white_paper(plot: PicturePlot) -> None:
    page = QImage(800, 600, QImage.Format.Format_RGB32)
    page.fill("white")
    painter = QPainter(page)
    plot.paint(painter, QRectF(page.rect()))
    painter.end()
    bar = plot._scale
    at = plot.mapFromScene(bar.bar.sceneBoundingRect().center())
    column = [page.pixelColor(at.x(), at.y() + down).lightness() for down in range(-6, 7)]
    assert column[6] == 255
    assert min(column[:6]) < 80 > min(column[7:])  # its edges, above and below


def test_the_words_of_the_scale_bar_stand_on_a_dark_ground(plot: PicturePlot) -> None:
    show(plot, "image", np.full((150, 200), 250, np.uint8))
    drawn(plot)
    words = plot._scale.text
    room = words.mapRectToScene(words.boundingRect()).toRect()
    x, y = room.left() + 2, room.top() + 2
    assert drawn(plot)[y, x].max() < 150
    assert drawn(plot)[y, x - 6].min() == 250


def test_a_field_about_its_median_is_saved_as_it_was_measured(plot: PicturePlot) -> None:
    values = np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 9.0]], np.float32)
    field = FieldImage(KINDS["ux_um"], values, "").about_median()
    assert field.offset == 4.0
    plot.begin_run((30, 20), MM, (0.0, 0.0, 30.0, 20.0))
    plot.show_field(field, (-5.0, 5.0))
    head, *rows = csv.reader(plot.table().splitlines())
    assert head == ["x_mm", "y_mm", "ux_um"]
    saved = {(round(float(x) / MM), round(float(y) / MM)): float(u) for x, y, u in rows}
    assert saved == {(5, 5): 1.0, (15, 5): 2.0, (5, 15): 4.0, (15, 15): 5.0, (25, 15): 9.0}


def test_the_numbers_of_the_colour_bar_leave_nothing_behind(
    qtbot: QtBot, plot: PicturePlot
) -> None:
    """The topmost one, too, which stands out above the bar."""
    values = np.linspace(0.0, 3.0, 48, dtype=np.float32).reshape(6, 8)
    qtbot.waitExposed(plot)
    for end in (5e-5, 1.5, 3.0):
        plot.show_field(FieldImage(KINDS["ux_um"], values, ""), (0.0, end))
        qtbot.wait(50)
    whole = plot.grab().toImage()
    on_screen = plot.screen().grabWindow(plot.winId()).toImage()
    assert on_screen.convertToFormat(whole.format()) == whole


@pytest.mark.parametrize(
    ("ends", "scale"),
    [
        ((-3.0, 3.0), 1),
        ((0.95, 0.995), 1),
        ((-150.0, 150.0), 1),
        ((-0.1, 0.1), 1),
        ((0.0, 9999.0), 1),
        ((0.0, 5e-5), 1e-5),
        ((-2e-3, 2e-3), 1e-3),
        ((0.0, 6e5), 1e5),
    ],
)
def test_the_colour_bar_has_numbers_enough_and_an_outline(
    plot: PicturePlot, ends: tuple[float, float], scale: float
) -> None:
    plot.resize(800, 300)
    plot.show_field(FieldImage(KINDS["ux_um"], np.zeros((6, 8), np.float32), ""), ends)
    QApplication.processEvents()
    picture = QPixmap(1, 1)
    painter = QPainter(picture)
    _, _, numbers = plot._bar.axis.generateDrawSpecs(painter)
    painter.end()
    rooms = [place for place, *_ in numbers]
    assert len(rooms) >= 5
    values = [float(text.replace("−", "-")) for *_, text in numbers]
    assert ends[0] <= scale * min(values)
    assert scale * max(values) <= ends[1] * (1 + 1e-9)
    assert ("×" in plot._bar.getAxis("left").labelText) == (scale != 1)
    assert not any(one.intersects(other) for n, one in enumerate(rooms) for other in rooms[:n])
    assert all(plot._bar.getAxis(side).isVisible() for side in ("left", "right", "top", "bottom"))


@pytest.mark.parametrize(
    ("angle", "name"),
    [
        (0.0, "x, driving direction → (mm)"),
        (-3.0, "x, driving direction → (mm)"),
        (-178.0, "x, driving direction ← (mm)"),
        (90.0, "x (mm)"),
        (-30.0, "x (mm)"),
    ],
)
def test_the_axis_says_which_way_the_drive_goes_in_the_picture(
    plot: PicturePlot, angle: float, name: str
) -> None:
    plot.begin_run((640, 480), 7e-3, (0.0, 0.0, 640.0, 480.0), math.radians(angle))
    assert plot.axes[1].labelText == name


def test_the_name_of_an_axis_is_beside_its_numbers_at_every_size(
    qtbot: QtBot, plot: PicturePlot
) -> None:
    plot.begin_run((640, 480), 7e-3, (0.0, 0.0, 640.0, 480.0))
    axis = plot.axes[0]
    for width in range(420, 640, 8):
        for height in (300, 500):
            plot.resize(width, height)
            for _ in range(4):  # all that is waiting is done by now
                QApplication.processEvents()
            picture = QPixmap(1, 1)
            painter = QPainter(picture)
            _, _, numbers = axis.generateDrawSpecs(painter)
            painter.end()
            left = min(place.left() for place, *_ in numbers)
            name = axis.mapRectFromItem(axis.label, axis.label.boundingRect())
            assert name.right() - 4 < left, (width, height)  # its margin is 4 px
