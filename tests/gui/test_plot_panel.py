"""Every plot is zoomed, reset and copied the same way, by mouse and by keyboard."""

from dataclasses import replace

import numpy as np
import pytest
from plot_hands import chart, plot_panel, settle  # noqa: F401 (a fixture)
from pyqtgraph import ScatterPlotItem
from PySide6.QtCore import QEvent, QObject, QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QWheelEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from window_hands import click, shown

from app.gui import theme
from app.gui.charts import Chart, ChartMark, Guide, Line, Span
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot

Ranges = tuple[list[float], list[float]]


def ranges(plot: CurvePlot) -> Ranges:
    x, y = plot.box.viewRange()
    return x, y


def place(plot: CurvePlot, x: float, y: float) -> QPoint:
    return plot.place(x, y).toPoint()


def wheel(plot: CurvePlot, at: QPoint, steps: int) -> None:
    event = QWheelEvent(
        QPointF(at), plot.viewport().mapToGlobal(QPointF(at)), QPoint(), QPoint(0, 120 * steps),
        Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(plot.viewport(), event)


def test_the_wheel_zooms_about_the_pointer_and_over_an_axis_along_it(panel: PlotPanel) -> None:
    plot = panel.plot
    before, at = ranges(plot), place(plot, 0.25, 0.25)
    there = plot.point(QPointF(at))
    wheel(plot, at, 4)
    after = ranges(plot)
    assert np.diff(after[0]) == pytest.approx(np.diff(before[0]) * 0.85**4)
    assert plot.point(QPointF(at)) == pytest.approx(there, abs=0.005)
    plot.reset()
    wheel(plot, QPoint(at.x(), round(plot.axes[1].sceneBoundingRect().bottom()) - 30), 2)
    assert ranges(plot)[1] == before[1]
    assert ranges(plot)[0] != before[0]


@pytest.mark.parametrize("way", ["double click", "R", "button", "menu", "menu of the plot"])
def test_all_is_shown_again(qtbot: QtBot, panel: PlotPanel, way: str) -> None:
    plot = panel.plot
    before = ranges(plot)
    wheel(plot, place(plot, 0.5, 0.5), 3)
    assert plot.is_zoomed
    if way == "double click":
        at = place(plot, 0.5, 0.5)
        qtbot.mouseDClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=at)
        qtbot.mouseRelease(plot.viewport(), Qt.MouseButton.LeftButton, pos=at)
    elif way == "R":
        qtbot.keyClick(plot, Qt.Key.Key_R)
    elif way == "button":
        click(qtbot, panel.show_all)
    elif way == "menu":
        panel.tools.menu().actions()[0].trigger()
    else:
        plot.box.getMenu().viewAll.trigger()
    assert ranges(plot) == before
    assert not plot.is_zoomed


def test_a_zoom_stays_while_the_curve_grows_and_ends_with_the_run(panel: PlotPanel) -> None:
    plot = panel.plot
    wheel(plot, place(plot, 0.5, 0.5), 3)
    zoomed = ranges(plot)
    panel.show_chart(chart(top=7.0))
    assert ranges(plot) == zoomed
    plot.begin_run()
    panel.show_chart(chart(top=7.0))
    assert ranges(plot)[1][1] >= 7.0


def test_dragging_moves_what_is_under_the_pointer_with_it(qtbot: QtBot, panel: PlotPanel) -> None:
    plot = panel.plot
    start, end = place(plot, 0.5, 0.5), place(plot, 0.8, 0.4)
    view = plot.viewport()
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=start)
    qtbot.mouseMove(view, end)
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=end)
    # the press and the end are whole pixels
    assert plot.point(QPointF(end)) == pytest.approx((0.5, 0.5), abs=0.01)


def test_keys_zoom_about_the_middle(qtbot: QtBot, panel: PlotPanel) -> None:
    before, _ = ranges(panel.plot)
    qtbot.keyClick(panel.plot, Qt.Key.Key_Plus)
    after, _ = ranges(panel.plot)
    assert np.diff(after) < np.diff(before)
    assert sum(after) == pytest.approx(sum(before))
    qtbot.keyClick(panel.plot, Qt.Key.Key_Minus)
    assert ranges(panel.plot)[0] == pytest.approx(before)


def test_the_place_of_the_pointer_is_told(qtbot: QtBot, panel: PlotPanel) -> None:
    told: list[tuple[float, float]] = []
    panel.plot.pointed.connect(lambda x, y: told.append((x, y)))
    qtbot.mouseMove(panel.plot.viewport(), place(panel.plot, 0.3, 0.7))
    qtbot.waitUntil(lambda: bool(told))
    assert told[-1] == pytest.approx((0.3, 0.7), abs=0.01)
    qtbot.mouseMove(panel.plot.viewport(), QPoint(1, 1))  # beside the axes
    qtbot.waitUntil(lambda: bool(np.isnan(told[-1]).all()))


def test_only_what_differs_by_a_pixel_is_drawn_again(
    panel: PlotPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    (curve,) = panel.plot._curves
    updates = []
    monkeypatch.setattr(curve._drawing, "setPath", updates.append)
    panel.show_chart(chart())
    panel.show_chart(chart(top=0.9999))
    assert not updates
    panel.show_chart(chart(top=0.9))
    assert len(updates) == 1


def test_axes_stay_while_a_curve_grows_inside_them(panel: PlotPanel) -> None:
    panel.show_chart(chart(top=0.91))
    changes: list[object] = []
    panel.plot.box.sigRangeChanged.connect(lambda *_: changes.append(1))
    for top in np.linspace(0.91, 0.99, 20):
        panel.show_chart(chart(top=float(top)))
    assert not changes
    panel.show_chart(chart(top=2.0))
    assert changes


def draw(panel: PlotPanel, line: Line, **more: object) -> None:
    """Draw one curve in the axes of a chart."""
    panel.show_chart(replace(chart(), lines=(line,), **more))  # type: ignore[arg-type]
    settle(panel)


def around(plot: CurvePlot, x: float, y: float) -> list[tuple[int, int]]:
    """The pixels within 5 px of a point."""
    at = place(plot, x, y)
    return [(at.x() + i, at.y() + k) for i in range(-5, 6) for k in range(-5, 6)]


def distance(colour: QColor, wanted: QColor) -> int:
    return abs(colour.red() - wanted.red()) + abs(colour.blue() - wanted.blue())


def is_near(panel: PlotPanel, x: float, y: float, role: str) -> bool:
    """Whether something of that colour is drawn within 5 px of a point: a thin line at a slant has
    its full colour in one pixel of several, and a dashed one has gaps.
    """
    image, wanted = panel.plot.grab().toImage(), QColor(theme.now().role(role))
    return min(distance(image.pixelColor(*one), wanted) for one in around(panel.plot, x, y)) < 60


@pytest.mark.parametrize("style", ["line", "dashed", "dots", "squares"])
def test_a_curve_is_drawn_where_its_values_are(panel: PlotPanel, style: str) -> None:
    (line,) = chart().lines
    panel.show_chart(
        chart() if style == "line" else replace(chart(), lines=(replace(line, style=style),))
    )
    settle(panel)
    x = np.linspace(0.1, 0.9, 50)
    assert all(is_near(panel, float(x[k]), float(x[k]), "shear") for k in (5, 20, 40))
    assert not is_near(panel, 0.4, 0.6, "shear")


def test_a_curve_that_goes_back_and_forth_is_drawn_whole(panel: PlotPanel) -> None:
    """What pyqtgraph leaves out of a long curve supposes that x rises."""
    turns = np.concatenate([np.linspace(0, 1, 4000), np.linspace(1, 0, 4000)])
    y = np.concatenate([np.linspace(0, 1, 4000), np.linspace(1, 0.5, 4000)])
    loop = Line("", turns, y, "shear", ("x", "y"))
    draw(panel, loop)
    assert is_near(panel, 0.5, 0.5, "shear")
    assert is_near(panel, 0.5, 0.75, "shear")
    assert not is_near(panel, 0.5, 0.25, "shear")


def test_extremes_of_a_long_curve_are_drawn(panel: PlotPanel) -> None:
    x, y = np.linspace(0, 1, 20_000), np.zeros(20_000)
    y[7_000] = 1.0
    draw(panel, Line("", x, y, "shear", ("x", "y")))
    assert is_near(panel, 0.35, 0.8, "shear")
    assert not is_near(panel, 0.45, 0.8, "shear")


def test_a_curve_lies_over_the_grid(panel: PlotPanel) -> None:
    x = np.linspace(0, 1, 50)
    line = Line("", x, np.full(50, 0.53), "shear", ("x", "y"))
    draw(panel, line, y_least=(0.0, 1.0))
    image, wanted = panel.plot.grab().toImage(), QColor(theme.now().shear)
    left, right = (place(panel.plot, at, 0.53) for at in (0.1, 0.9))
    rows = range(left.y() - 2, left.y() + 3)
    for column in range(left.x(), right.x()):  # lines of the grid are in some of them
        assert min(distance(image.pixelColor(column, row), wanted) for row in rows) < 100


def test_a_curve_is_interrupted_where_nothing_was_measured(panel: PlotPanel) -> None:
    x = np.linspace(0, 1, 101)
    y = np.where((x > 0.4) & (x < 0.6), np.nan, x)
    draw(panel, Line("", x, y, "shear", ("x", "y")))
    assert is_near(panel, 0.3, 0.3, "shear")
    assert not is_near(panel, 0.5, 0.5, "shear")


def test_a_band_reaches_as_far_as_the_uncertainty(panel: PlotPanel) -> None:
    x = np.linspace(0, 1, 50)
    line = Line("", x, np.full(50, 0.5), "shear", ("x", "y"), sd=np.full(50, 0.2))
    draw(panel, line, y_least=(0.0, 1.0))
    image = panel.plot.grab().toImage()
    ground = QColor(theme.now().panel)

    def is_tinted(y: float) -> bool:
        at = place(panel.plot, 0.53, y)
        return distance(image.pixelColor(at), ground) > 20

    assert is_tinted(0.67)
    assert is_tinted(0.33)
    assert not is_tinted(0.73)
    assert not is_tinted(0.27)
    # an opaque one is drawn faster, but hides the grid, which a file keeps
    assert panel.plot.band_colour("shear").alpha() == 255
    panel.plot.pen_ratio = 1.0
    assert panel.plot.band_colour("shear").alpha() < 255


def test_a_guide_and_a_span_are_where_their_values_are(panel: PlotPanel) -> None:
    panel.show_chart(
        chart(
            guides=(Guide(0.25, "a", is_upright=True, role="stick"),),
            spans=(Span(0.6, 0.8, "normal"),),
        )
    )
    settle(panel)
    column = [is_near(panel, 0.25, y, "stick") for y in np.linspace(0.05, 0.2, 5)]
    assert any(column)  # it is dashed
    image, ground = panel.plot.grab().toImage(), QColor(theme.now().panel)
    tints = [
        distance(image.pixelColor(place(panel.plot, 0.53, y)), ground) for y in (0.57, 0.7, 0.83)
    ]
    assert tints[1] > 20 > max(tints[0], tints[2])
    panel.show_chart(chart(guides=(Guide(float("nan"), "a", is_upright=True, role="stick"),)))
    assert not panel.plot.labels[0].isVisible()


def test_guides_and_spans_reach_the_ends_of_the_axes_at_each_zoom(panel: PlotPanel) -> None:
    guides = (Guide(0.25, "a", is_upright=True, role="stick"), Guide(0.4, "b", role="model"))
    panel.show_chart(chart(guides=guides, spans=(Span(0.6, 0.8, "normal"),)))
    panel.plot.box.setRange(xRange=(-2.0, 3.0), yRange=(-2.0, 3.0), padding=0)
    settle(panel)
    image, ground = panel.plot.grab().toImage(), QColor(theme.now().panel)

    def differs(x: float, y: float) -> int:
        """From the ground, within 5 px; a line between two pixels has half its colour in each."""
        return max(distance(image.pixelColor(*one), ground) for one in around(panel.plot, x, y))

    for end in (-1.9, 2.8):
        assert differs(0.25, end) > 100
        assert differs(end, 0.4) > 100
        assert differs(end, 0.7) > 20
        assert differs(end, -0.4) < 20


def test_marks_and_names_of_axes_are_where_they_belong(panel: PlotPanel) -> None:
    panel.show_chart(chart(marks=(ChartMark(0.2, 0.7, "5"), ChartMark(0.6, 0.1, "8"))))
    settle(panel)
    scatter = [one for one in panel.plot.box.allChildItems() if type(one) is ScatterPlotItem]
    drawn = [(x, y) for one in scatter for x, y in zip(*one.getData(), strict=True)]
    assert drawn == [(0.2, 0.7), (0.6, 0.1)]
    left, bottom = (axis.labelText for axis in panel.plot.axes)
    assert (left, bottom) == ("Q (N)", "δ (µm)")


@pytest.mark.parametrize("style", ["dots", "squares"])
def test_a_dot_is_as_wide_as_it_is_high(panel: PlotPanel, style: str) -> None:
    """Of points whose x differ by far less than their y."""
    x, y = np.array([0.3, 0.5, 0.7]), np.array([0.0, 500.0, 1000.0])
    draw(panel, Line("c", x, y, "stick", ("x", "y"), style=style))
    shown, centre = panel.plot.grab().toImage(), place(panel.plot, x[1], y[1])
    colour = np.array(QColor(theme.now().role("stick")).getRgb()[:3])
    steps = range(-12, 13)
    is_dot = [
        [
            np.abs(shown.pixelColor(centre + QPoint(i, k)).getRgb()[:3] - colour).max() < 60
            for i in steps
        ]
        for k in steps
    ]
    high, wide = (np.any(is_dot, axis=axis).sum() for axis in (1, 0))
    assert 3 <= wide <= 8
    assert abs(wide - high) <= 1


def test_texts_overprint_neither_each_other_nor_the_curve(panel: PlotPanel) -> None:
    guides = tuple(Guide(0.5 + 0.001 * n, f"line {n}", is_upright=True) for n in range(5))
    guides += (Guide(0.97, "level"),)  # its usual place is on the curve's end
    panel.show_chart(
        chart(guides=guides, marks=(ChartMark(0.5, 0.5, "1"), ChartMark(0.51, 0.5, "2")))
    )
    settle(panel)
    placed = [label.sceneBoundingRect() for label in panel.plot.labels]
    assert all(label.isVisible() for label in panel.plot.labels)
    assert len(placed) == 8
    for n, room in enumerate(placed):
        assert not any(room.intersects(other) for other in placed[:n])
        on_curve = [panel.plot.place(x, x) for x in np.linspace(0, 1, 500)]
        assert not any(room.contains(at) for at in on_curve)
        assert panel.plot.box.sceneBoundingRect().contains(room)


def test_the_name_of_a_mark_at_the_end_of_a_curve_leaves_that_of_its_guide(
    panel: PlotPanel,
) -> None:
    """As at the end of a replay: in the corner of the axes, on a level that has a name."""
    x = np.linspace(0, 1, 200)
    line = Line("Q", x, np.minimum(x * 1.8, 0.93), "shear", ("x", "y"))
    mark, guide = ChartMark(1.0, 0.93, "350"), Guide(0.91, "Q_s")
    panel.show_chart(replace(chart(), lines=(line,), guides=(guide,), marks=(mark,)))
    settle(panel)
    of_guide, of_mark = (label.sceneBoundingRect() for label in panel.plot.labels)
    assert not of_guide.intersects(of_mark)


def test_a_plot_without_a_point_says_what_it_will_show(panel: PlotPanel) -> None:
    hint = panel.plot._hint
    panel.show_chart(Chart("Loading curve", "", "", hint="Q against the travel"))
    assert hint.isVisible()
    assert hint.text() == "Q against the travel"
    assert not any(axis.isVisible() for axis in panel.plot.axes)
    panel.show_chart(replace(chart(), hint="Q against the travel"))
    assert not hint.isVisible()
    assert all(axis.isVisible() for axis in panel.plot.axes)


def test_the_name_of_a_mark_stays_inside_the_axes(panel: PlotPanel) -> None:
    marks = (ChartMark(0.99, 0.99, "1: frame 320"), ChartMark(0.98, 0.97, "2: frame 321"))
    panel.show_chart(chart(marks=marks))
    settle(panel)
    axes = panel.plot.box.sceneBoundingRect()
    assert all(axes.contains(label.sceneBoundingRect()) for label in panel.plot.labels)
    panel.show_chart(chart(marks=(ChartMark(3.0, 0.5, "beyond"),)))
    assert not panel.plot.labels[0].isVisible()


def test_the_legend_lies_above_the_axes_in_as_many_lines_as_it_needs(panel: PlotPanel) -> None:
    (line,) = chart().lines
    lines = tuple(replace(line, name=f"0.{n} N run-{n}") for n in range(8))
    heights = []
    for some in (lines[:1], lines):
        panel.show_chart(replace(chart(), lines=some))
        settle(panel)
        legend = panel.plot.legend.sceneBoundingRect()
        assert legend.bottom() <= panel.plot.box.sceneBoundingRect().top() + 1
        assert legend.right() <= panel.plot.width()
        heights.append(legend.height())
    assert heights[1] > 1.8 * heights[0]


def test_the_legend_has_each_curve_in_its_colour(panel: PlotPanel) -> None:
    (line,) = chart().lines
    lines = tuple(replace(line, name=role, role=role) for role in ("shear", "normal", "stick"))
    panel.show_chart(replace(chart(), lines=lines))
    html = panel.plot.legend.toHtml()
    assert all(theme.now().role(line.role) in html for line in lines)


def test_a_plot_follows_the_look_of_the_window(qapp: QApplication, panel: PlotPanel) -> None:
    try:
        for name in ("light", "dark"):
            theme.apply(qapp, name)
            settle(panel)
            image = panel.plot.grab().toImage()
            assert image.pixelColor(1, image.height() - 2).name() == theme.now().panel
            assert is_near(panel, 0.4, 0.4, "shear")
    finally:
        theme.apply(qapp, "dark")


def test_the_name_of_an_axis_is_in_its_middle_whatever_it_was_before(qtbot: QtBot) -> None:
    plot = shown(qtbot, CurvePlot(), 300, 200)
    _, below = plot.axes
    for name in ("r", "time t from the start of the drive (s)"):
        below.setLabel(name)
        label = below.label.mapRectToParent(below.label.boundingRect())
        assert label.center().x() == pytest.approx(below.size().width() / 2, abs=2)


def test_the_hint_of_an_empty_chart_is_between_its_axes(qtbot: QtBot) -> None:
    plot = shown(qtbot, CurvePlot(), 360, 220)
    plot.show_chart(Chart("c", "Q/P", "c/a", (), hint="The stick radius c of each frame"))
    qtbot.waitUntil(lambda: plot._hint.isVisible() and plot._hint.x() > 20)
    inside = plot.box.sceneBoundingRect().toAlignedRect()
    assert inside.adjusted(-2, -2, 2, 2).contains(plot._hint.geometry())


class PaintCounter(QObject):
    """Counts how often the widgets are painted that it watches."""

    def __init__(self) -> None:
        super().__init__()
        self.painted: list[QObject] = []

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Paint:
            self.painted.append(watched)
        return False


def test_a_caption_that_changes_paints_nothing_but_itself(panel: PlotPanel, qtbot: QtBot) -> None:
    panel.say("frame 1")
    settle(panel)
    ground = panel.caption.grab().toImage()
    assert ground.pixelColor(ground.width() - 2, 1) == panel.grab().toImage().pixelColor(20, 3)
    counter = PaintCounter()
    for part in (panel, panel.caption.parentWidget(), panel.caption):
        part.installEventFilter(counter)
    panel.say("frame 2")
    qtbot.waitUntil(lambda: bool(counter.painted))
    QApplication.processEvents()
    assert set(counter.painted) == {panel.caption}


def test_a_caption_has_one_line_also_after_a_picture_of_the_panel_without_it(
    panel: PlotPanel,
) -> None:
    panel.grab()
    for caption in ("frame 1", "frame 2"):
        panel.say(caption)
        QApplication.processEvents()
    assert panel.caption.height() < 2 * panel.caption.fontMetrics().lineSpacing()
    assert panel.height() == 320
