"""A panel of a bench that is connected for real, in this process, and the hands that use it."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QScrollBar, QWidget
from pytestqt.qtbot import QtBot
from window_hands import click, shown

from app.gui.bench_link import LinkState
from app.gui.bench_panel import BenchPanel
from app.gui.window_model import WindowModel
from app.runs import live
from app.settings.config import load
from app.settings.sections import Config
from drivers.errors import DeviceTimeout

SMALL = (
    "camera.width=160",
    "camera.height=120",
    "dic.box=20",
    "sim.press_time=3000",
    "limits.age=10",  # the machine may be busy
)
Told = list[tuple[str, bool]]
LEFT = Qt.MouseButton.LeftButton


class Bench(SimpleNamespace):
    """A workshop of simulated benches in this process; `spoil` changes their devices."""

    def __init__(self) -> None:
        super().__init__(made=[], spoil=lambda bench: None, problem=None, world=())

    def preview(self, config: Config) -> Any:
        if self.problem:
            raise self.problem
        world = load(None, [*SMALL, *self.world])
        bench = live.make_bench(replace(world, camera=config.camera), 4.0)
        self.spoil(bench)
        preview = live.Preview(config, bench, can_restart=False, bytes_per_s=2e6)
        preview.start()
        self.made.append(preview)
        return preview


def raises(error: Exception) -> Callable[..., Any]:
    def method(*_: object) -> None:
        raise error

    return method


@pytest.fixture(name="workshop")
def workshop_of_benches() -> Iterator[Bench]:
    made = Bench()
    yield made
    for preview in made.made:
        with suppress(DeviceTimeout):
            preview.close()


@pytest.fixture(name="panel")
def bench_panel(qtbot: QtBot, workshop: Bench) -> Iterator[BenchPanel]:
    model = WindowModel(workshop, load(None, SMALL))
    panel = shown(qtbot, BenchPanel(model), 340, 900)
    yield panel
    panel.disconnect_bench()
    qtbot.waitUntil(lambda: panel.link.phase is LinkState.OFF)


@pytest.fixture(name="noted")
def notes_of_panel(panel: BenchPanel) -> list[str]:
    """What the panel has put into the log."""
    notes: list[str] = []
    model_of(panel).noted.connect(notes.append)
    return notes


@pytest.fixture(name="told")
def sentences_of_panel(panel: BenchPanel) -> Told:
    """What the panel has said in the line of the window, and whether it was an alarm."""
    sentences: Told = []
    model_of(panel).said.connect(lambda *sentence: sentences.append(sentence))
    return sentences


def model_of(panel: BenchPanel) -> WindowModel:
    return panel._model


def words(panel: QWidget) -> str:
    """All that the operator can read on the panel."""
    return "\n".join(label.text() for label in panel.findChildren(QLabel) if label.isVisible())


def crawl(panel: BenchPanel) -> None:
    """Let the stage take seconds for its way, so that a slow hand is in time to stop it."""
    model_of(panel).set_config(load(None, (*SMALL, "actuator.max_velocity=20")))


def connect(qtbot: QtBot, panel: BenchPanel) -> None:
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: panel.picture._picture is not None and panel.stage.jogs[0].isEnabled())
    qtbot.waitUntil(panel.zero.isEnabled)


def filled(qtbot: QtBot, panel: BenchPanel) -> QScrollBar:
    """Give a panel so little height that any sentence more must be scrolled to; its scroll bar."""
    bar = panel.verticalScrollBar()
    panel.resize(panel.width(), 300)
    qtbot.waitUntil(lambda: bar.maximum() > 0)
    panel.resize(panel.width(), 300 + bar.maximum())
    qtbot.waitUntil(lambda: bar.maximum() == 0)
    assert not bar.isEnabled()
    return bar


def normal_n(panel: BenchPanel) -> float:
    """P as its scale shows it; NaN where it is not read."""
    assert panel.normal.gauge is not None
    return panel.normal.gauge.value


def place_um(panel: BenchPanel) -> float:
    return panel.link.view.stage.position_m * 1e6
