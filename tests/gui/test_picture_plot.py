"""What the picture draws over itself, in the coordinates of its axes."""

from __future__ import annotations

import csv
import math

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtWidgets import QGraphicsEllipseItem, QGraphicsPathItem
from pytestqt.qtbot import QtBot

from app.gui.frame_results import KINDS, Circles, FieldImage
from app.gui.plots.picture import PicturePlot

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


def drawn(plot: PicturePlot, kind: type) -> list:
    """The items of a kind that are seen."""
    return [one for one in plot.box.allChildItems() if type(one) is kind and one.isVisible()]


def test_each_circle_has_its_name_on_it(plot: PicturePlot) -> None:
    x, y = (MM * at for at in CENTRE_PX)
    names = {one.textItem.toPlainText(): one.pos() for one in drawn(plot, pg.TextItem)}
    for name, radius in RADII_PX.items():
        away = math.hypot(names[name].x() - x, names[name].y() - y)
        assert away == pytest.approx(MM * radius), name
    rects = [one.rect() for one in drawn(plot, QGraphicsEllipseItem)]
    assert sorted({round(one.width() / 2 / MM) for one in rects}) == sorted(RADII_PX.values())
    for one in rects:
        assert (one.center().x(), one.center().y()) == pytest.approx((x, y))


def test_the_cross_is_in_the_centre_of_the_contact(plot: PicturePlot) -> None:
    crosses = [one for one in drawn(plot, QGraphicsPathItem) if one.childItems()]
    places = [(one.pos().x(), one.pos().y()) for one in crosses]
    assert places == [pytest.approx([MM * at for at in CENTRE_PX])]


@pytest.mark.parametrize("width_mm", [9.0, 2.0, 0.2, 0.03])
def test_the_scale_bar_says_its_own_length(plot: PicturePlot, width_mm: float) -> None:
    plot.box.setXRange(1.0, 1.0 + width_mm, padding=0)
    (bar,) = drawn(plot, pg.ScaleBar)
    value, unit = bar.text.toPlainText().split()
    assert float(value) * {"mm": 1.0, "µm": 1e-3}[unit] == pytest.approx(bar.size)
    (low, high), _ = plot.box.viewRange()
    assert 0.15 < bar.size / (high - low) < 0.6


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
