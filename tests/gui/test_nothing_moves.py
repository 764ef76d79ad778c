"""What an operator presses stays where it is while devices connect, steps follow and runs end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bench_hands import LEFT, Bench, bench_panel, raises, words, workshop_of_benches  # noqa: F401
from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot
from window_hands import click, shown
from workshops import Makes

from app.gui.bench_panel import BenchPanel
from app.gui.experiment_panel import ExperimentPanel
from app.gui.run_steps import planned, run_steps
from app.gui.window_model import WindowModel
from app.records.bench_view import Health
from app.records.record_types import Counts
from app.settings.config import load
from drivers.errors import DeviceFault, DeviceNotFound

ASKS = (
    'run.steps=[{do="background"}, {do="ask", question="Is it dry?"}, {do="approach"},'
    ' {do="reference"}, {do="drive"}]'
)


def places(panel: QWidget, *parts: QWidget) -> list[QPoint]:
    return [part.mapTo(panel, QPoint()) for part in parts]


def test_no_button_of_the_bench_moves_while_devices_connect_or_fail(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    why = "not there, and the sentence about it has so many words that it needs several lines"
    workshop.spoil = lambda bench: setattr(bench.camera, "open", raises(DeviceNotFound(why)))
    parts = (panel.connect_button, panel.zero, *panel.stage.jogs, panel.stage.go)
    body, seen = panel.widget(), []

    def look() -> bool:
        seen.append(places(body, *parts))
        return all(word in words(panel) for word in ("failed", "ready"))

    panel._show()
    QApplication.processEvents()  # what is laid out then is not yet what is seen
    look()
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(look)
    qtbot.waitUntil(panel.zero.isEnabled)
    look()
    assert len(set(map(str, ([at.y() for at in one] for one in seen)))) == 1
    assert why in panel.said.text()  # which is below the buttons
    assert panel.said.mapTo(body, QPoint()).y() > panel.stage.go.mapTo(body, QPoint()).y()

    gone = "bench: its process (number 4194304) has ended, and its devices are free; connect it"
    gone += " again, or begin a run"
    workshop.made[-1].look = raises(DeviceFault(gone))
    qtbot.waitUntil(lambda: gone in panel.state.text())
    QApplication.processEvents()
    look()
    assert len(set(map(str, ([at.y() for at in one] for one in seen)))) == 1


def test_what_is_pressed_during_a_run_stays_where_it_is(qtbot: QtBot) -> None:
    config = load(None, (ASKS,))
    panel = shown(qtbot, ExperimentPanel(WindowModel(Makes(lambda: None), config)), 320, 600)
    health: Any = Health("running", "", "contact", Counts(), 0.0, 4.0, 1 << 40, 0, 0.5)
    seen = []
    for number, question, reason in ((1, "", ""), (2, "Is it dry?", "Is it dry?"), (3, "", "why")):
        state = replace(
            health, step_number=number, step=f"{number} of 5", question=question, reason=reason
        )
        panel._show(run_steps(config, state, None, None, (0.31, 0.002), planned(config)))
        panel.layout().activate()
        seen.append(places(panel, panel.button, panel.pause_button, panel.note, panel.note_button))
    assert seen[0] == seen[1] == seen[2]
