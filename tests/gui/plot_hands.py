"""A plot in the hands of tests."""

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from window_hands import shown

from app.gui.charts import Chart, Line
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot


def chart(top: float = 1.0, points: int = 50, **more: object) -> Chart:
    x = np.linspace(0.0, 1.0, points)
    line = Line("Q", x, top * x, "shear", ("travel_um", "Q_N"))
    return Chart("Loading curve", "δ (µm)", "Q (N)", (line,), **more)  # type: ignore[arg-type]


@pytest.fixture(name="panel")
def plot_panel(qtbot: QtBot) -> PlotPanel:
    made = shown(qtbot, PlotPanel(CurvePlot(), title="Loading curve"), 420, 320)
    made.show_chart(chart())
    settle(made)
    return made


def settle(panel: PlotPanel) -> None:
    """Let the axes take the room that their numbers need."""
    for _ in range(3):
        panel.plot.grab()
        QApplication.processEvents()
