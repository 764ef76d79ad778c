"""Boxes of numbers change by what is typed, and by nothing else."""

import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractSpinBox
from pytestqt.qtbot import QtBot
from window_hands import make_run, shown
from workshops import Makes

from app.gui.bench_panel import BenchPanel
from app.gui.campaign_panel import NewCampaign
from app.gui.plots.picture import PicturePlot
from app.gui.region_panel import CONTACT, RegionPanel
from app.gui.session_forms import AnalysisForm
from app.gui.window_model import WindowModel
from app.settings.config import load

FINE_S = 0.125e-3  # has more digits than the box of the exposure


@pytest.fixture
def model() -> WindowModel:
    return WindowModel(Makes(make_run), load(None, [f"camera.exposure={1e3 * FINE_S}"]))


def test_an_exposure_that_is_only_passed_by_keeps_all_its_digits(
    qtbot: QtBot, model: WindowModel
) -> None:
    panel = shown(qtbot, BenchPanel(model))
    for box in (panel.exposure, panel.gain, panel.exposure):
        box.setFocus(Qt.FocusReason.TabFocusReason)
    assert model.config.camera.exposure == FINE_S
    panel.exposure.selectAll()
    qtbot.keyClicks(panel.exposure, "0.25\r")
    assert model.config.camera.exposure == pytest.approx(0.25e-3)
    assert model.config.camera.gain == load(None, []).camera.gain


@pytest.mark.parametrize("kind", ["bench", "region", "campaign", "analysis"])
def test_the_wheel_changes_no_number(qtbot: QtBot, model: WindowModel, kind: str) -> None:
    match kind:
        case "bench":
            panel = BenchPanel(model)
        case "region":
            picture = PicturePlot()
            qtbot.addWidget(picture)
            panel = RegionPanel(model, picture)
            panel.kind.setCurrentText(CONTACT)
        case "campaign":
            panel = NewCampaign()
        case _:
            panel = AnalysisForm()
    shown(qtbot, panel)
    boxes = [one for one in panel.findChildren(QAbstractSpinBox) if one.isVisible()]
    assert boxes
    for box in boxes:
        box.setEnabled(True)
        before = box.text()
        place = QPointF(box.mapTo(panel, box.rect().center()))
        QTest.wheelEvent(panel.windowHandle(), place, QPoint(0, 120))
        assert box.text() == before
