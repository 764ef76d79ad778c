"""Recorded sessions side by side, in a window of their own: numbers, differences, and curves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

import numpy as np
from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QSplitter, QWidget

from app.gui.cells import number, typeset
from app.gui.charts import Chart, Line
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot
from app.gui.result_panel import fill, read_only_table
from app.gui.run_charts import MODEL_POINTS, STEADY_Q, TRAVEL_Q
from app.gui.widgets import button, column, holding, label, row
from app.report.side_by_side import Recorded, as_csv, colours, compared

LOADING, STICKING = "Loading curves Q(δ)", "Stick radius c / a"


class ComparisonView(QWidget):
    """Two or more sessions: a table, c/a over Q/(mu P), and Q over the travel."""

    def __init__(self, sessions: Sequence[Recorded], parent: QWidget | None = None) -> None:
        super().__init__(parent, Qt.WindowType.Window)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.sessions = tuple(sessions)
        self.setObjectName("body")
        self.setWindowTitle(f"{' · '.join(one.name for one in sessions)} – side by side")
        heads = tuple(f"{one.name}\n{_about(one)}" for one in sessions)
        pair = len(sessions) == 2
        apart = ("difference", "in σ") if pair else ()
        self.columns = ("quantity", "symbol", *heads, *apart, "unit")
        self.table = read_only_table(self.columns)
        fill(
            self.table,
            self.columns,
            [
                (r.name, r.symbol, *r.values, *((r.difference, r.in_sd) if pair else ()), r.unit)
                for r in compared(sessions)
            ],
        )
        self.colours = colours([one.load_n for one in sessions])
        self.loading = PlotPanel(CurvePlot(), title=LOADING)
        self.sticking = PlotPanel(CurvePlot(), title=STICKING)
        for panel in (self.loading, self.sticking):
            panel.origin = ", ".join(f"{one.name} {_about(one)}" for one in sessions)
        self._draw()
        self.copy = button(
            "Copy as CSV",
            "All numbers, unrounded, to the clipboard",
            lambda: QGuiApplication.clipboard().setText(as_csv(sessions)),
        )
        named = (
            f"<span style='color: {colour}; font-weight: 600'>● {_breakable(one.name)},"
            f" {_about(one)}</span>"
            for one, colour in zip(sessions, self.colours, strict=True)
        )
        legend = label(" &nbsp; ".join(named), "muted", wraps=True)
        split = QSplitter(Qt.Orientation.Vertical)
        split.addWidget(self.table)
        split.addWidget(holding(row((self.loading, 1), (self.sticking, 1), spacing=8)))
        split.setSizes([280, 380])
        self.setLayout(
            column(
                row((legend, 1), self.copy),
                (split, 1),
                label("σ: by noise. a: after Hertz. Dashed: Cattaneo and Mindlin.", "muted"),
                margins=(10, 8, 10, 8),
            )
        )
        room = QGuiApplication.primaryScreen().availableSize()
        self.resize(QSize(1040, 720).boundedTo(room))

    def _draw(self) -> None:
        ratio = np.linspace(0.0, 1.0, MODEL_POINTS)
        columns = ("Q_to_mu_s_P", "c_to_a")
        model = Line(
            "Cattaneo–Mindlin", ratio, (1 - ratio) ** (1 / 3), "model", columns, style="dashed"
        )
        loading, sticking = [], [model]
        for one, colour in zip(self.sessions, self.colours, strict=True):
            travel_um, shear = one.loading.T
            held = STEADY_Q if one.is_steady else TRAVEL_Q
            loading.append(Line(one.name, travel_um, shear, colour, held))
            x, y, sd = one.sticking[np.argsort(one.sticking[:, 0], kind="stable")].T
            sticking.append(Line(one.name, x, y, colour, columns, sd=sd, style="dots"))
        steady = [one.name for one in self.sessions if one.is_steady]
        travel = "travel δ (µm)" + (f"; v t in {', '.join(steady)}" if steady else "")
        self.loading.show_chart(Chart(LOADING, travel, "shear force Q (N)", tuple(loading)))
        self.sticking.show_chart(
            Chart(STICKING, "Q / (μₛ P)", "stick radius c / a", tuple(sticking), y_least=(0, 1.2))
        )


def _breakable(name: str) -> str:
    """A name as rich text, which may go on in the next line."""
    return re.sub(r"([-_.])", "\\1\u200b", escape(name))


def _about(one: Recorded) -> str:
    return f"P = {number(one.load_n, 3)} N, {typeset(one.preset)}"
