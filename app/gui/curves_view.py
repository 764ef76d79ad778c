"""The charts of a run, as many as there is room for, with earlier runs faintly behind."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from functools import partial

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QComboBox, QGridLayout, QWidget

from app.gui.background import Act, Take
from app.gui.charts import Chart, ChartMark, Line
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot
from app.gui.run_charts import TITLES, Cursor, no_chart
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import tool_button, widget
from app.report.side_by_side import colours

LEAST_CELL = (300, 190)  # width and height of a chart that can be read
GAP = 8
MOST_EARLIER, EARLIER_POINTS = 5, 300  # of earlier runs, and of each of their curves
COMPARED = {"loading": ("",), "sticking": ("fitted profile",)}  # what is kept of a run: curves


@dataclass(frozen=True)
class EarlierRun:
    """The curves that are kept of a run that is over, by the chart's key."""

    name: str
    load_n: float
    lines: dict[str, tuple[Line, ...]]


@dataclass
class Shown:
    """What all charts share: the run as it was drawn last, marked frames, earlier runs."""

    view: ViewState | None = None
    marks: list[ChartMark] = field(default_factory=list)
    earlier: deque[EarlierRun] = field(default_factory=lambda: deque(maxlen=MOST_EARLIER))

    def chart(self, key: str) -> Chart:
        """A chart with what is behind it."""
        chart = self.view.charts[key] if self.view else no_chart(key)
        if behind := self._behind(key):
            caption = " · ".join(filter(None, (chart.caption, "faint: earlier runs")))
            chart = replace(chart, lines=(*behind, *chart.lines), caption=caption)
        if key == "loading" and self.marks:
            chart = replace(chart, marks=(*chart.marks, *self.marks))
        return chart  # as it was made, with its extents, where nothing is added

    def _behind(self, key: str) -> tuple[Line, ...]:
        """The curves of earlier runs, in colours from the smallest load to the largest."""
        runs = sorted(self.earlier, key=lambda run: run.load_n)
        ramp = colours(range(1, len(runs) + 1))
        return tuple(
            replace(line, role=colour)
            for run, colour in zip(runs, ramp, strict=True)
            for line in run.lines.get(key, ())
        )

    def begin_run(self, setup: Setup | None) -> None:
        """Keep a few curves of the run that is over, whose setup this is; forget the rest of it."""
        if setup is not None and self.view is not None:
            kept = {
                key: tuple(
                    _kept(line, setup.name)
                    for line in self.view.charts[key].lines
                    if line.name in names and len(line.x)
                )
                for key, names in COMPARED.items()
            }
            if any(kept.values()):
                for same in [run for run in self.earlier if run.name == setup.name]:
                    self.earlier.remove(same)  # a session that was played twice
                self.earlier.append(EarlierRun(setup.name, setup.load_n, kept))
        self.view = None
        self.marks.clear()


def _kept(line: Line, name: str) -> Line:
    every = max(1, len(line.x) // EARLIER_POINTS)
    x, y = line.x[::every].copy(), line.y[::every].copy()
    return Line(name, x, y, "muted", line.columns, width=1.2, is_faint=True)


class ChartCell(PlotPanel):
    """A chart that the operator chooses, of all that there are of a run."""

    plot: CurvePlot

    def __init__(self, key: str, shown: Shown, mark: Act, enlarge: Take) -> None:
        self.choice = widget(QComboBox, toolTip="What is drawn here")
        for name, title in TITLES.items():
            self.choice.addItem(title, name)
        tip = "Number the frame that the picture shows, on the curve"
        self.mark = tool_button("mark", tip, mark, style="")
        tip = "Enlarge: this plot in place of all, or all of them again"
        self.enlarge = tool_button("⤢", tip, partial(enlarge, self), style="")
        super().__init__(CurvePlot(), self.mark, self.enlarge, heading=self.choice)
        self._shown = shown
        self.choice.setCurrentIndex(list(TITLES).index(key))
        self.choice.currentIndexChanged.connect(self._choose)
        self._choose()

    @property
    def key(self) -> str:
        """Of the chart that is shown."""
        return str(self.choice.currentData())

    def show_view(self, view: ViewState) -> None:
        """Draw the chart, if it has changed."""
        self._shown.view = view
        self.show_run()

    def show_run(self) -> None:
        """Draw what is shared by now."""
        self.show_chart(self._shown.chart(self.key))

    def begin_run(self, origin: str) -> None:
        """Show all of the next run, whose name that is."""
        self.origin = origin
        self.saved.hide()
        self.plot.begin_run()

    def _choose(self) -> None:
        self.mark.setVisible(self.key == "loading")
        self.plot.begin_run()
        self.show_run()


class CurvesView(QWidget):
    """Charts side by side: as many of them as can be read in the room that there is."""

    name, title = "curves", "Curves"

    def __init__(self) -> None:
        super().__init__()
        self.shown = Shown()
        self._setup: Setup | None = None
        self._large: ChartCell | None = None  # that is alone in view
        self.cells: list[ChartCell] = []  # made when there is room for them
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setSpacing(GAP)
        self._rows_columns = (1, 1)
        self._arrange()

    def show_setup(self, setup: Setup) -> None:
        """Empty the charts for a new run; a few curves of the last one stay behind them."""
        self.shown.begin_run(self._setup)
        self._setup = setup
        for cell in self.cells:
            cell.begin_run(setup.name)

    def mark_frame(self) -> None:
        """Number the frame that the picture shows."""
        view, marks = self.shown.view, self.shown.marks
        if view is None or view.shown is None:
            return
        frame, now = view.shown.frame, view.shown.conditions
        cursor = Cursor(frame, now.time_s, now.travel_m * 1e6, now.shear_force_n)
        charts = replace(view.charts, cursor=view.charts.cursor or cursor)
        places = charts["loading"].marks
        marks += [replace(one, text=f"{len(marks) + 1}: frame {frame}") for one in places]
        for cell in self.cells:
            cell.show_run()
            if cell.key == "loading" and not places:
                cell.say_below(f"Frame {frame} is not marked: no travel is known of it.")

    def enlarge(self, cell: ChartCell) -> None:
        """Let a chart fill the room of all, or show all of them again."""
        self._large = None if self._large is cell else cell
        self._arrange()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many charts as there is room for."""
        width, height = LEAST_CELL
        size = event.size()
        columns = max(1, min(3, (size.width() + GAP) // (width + GAP)))
        rows = max(1, min((size.height() + GAP) // (height + GAP), -(-len(TITLES) // columns)))
        if (rows, columns) != self._rows_columns:
            self._rows_columns = rows, columns
            self._arrange()
        super().resizeEvent(event)

    def _arrange(self) -> None:
        """Put the charts that are in view in their places."""
        rows, columns = (1, 1) if self._large else self._rows_columns
        for key in list(TITLES)[len(self.cells) : rows * columns]:
            cell = ChartCell(key, self.shown, self.mark_frame, self.enlarge)
            cell.setParent(self)  # also where it finds no room, so that all end with this one
            cell.begin_run(self._setup.name if self._setup else "")
            self.cells.append(cell)
        in_view = [self._large] if self._large else self.cells[: rows * columns]
        for cell in self.cells:
            self._grid.removeWidget(cell)
            cell.setVisible(cell in in_view)
        for n, cell in enumerate(in_view):
            self._grid.addWidget(cell, n // columns, n % columns)
            cell.show_run()  # it was not drawn while it could not be seen
        for n in range(len(TITLES)):
            self._grid.setRowStretch(n, int(n < rows))
            self._grid.setColumnStretch(n, int(n < columns))
