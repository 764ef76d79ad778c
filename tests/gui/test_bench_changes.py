"""Changes while a driver is loaded or a bench connects anew take nothing back."""

import threading
from dataclasses import replace
from typing import Any

import pytest
from bench_hands import (  # noqa: F401 (fixtures)
    LEFT,
    Bench,
    bench_panel,
    connect,
    model_of,
    workshop_of_benches,
)
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from set_up_hands import write
from window_hands import click

from app.gui.bench_link import LinkState
from app.gui.bench_panel import BenchPanel
from app.gui.form import Form
from app.runs import live


@pytest.mark.parametrize("way", ["run", "disconnect"])
def test_an_exposure_that_needs_another_connection_brings_no_bench_back(
    qtbot: QtBot,
    panel: BenchPanel,
    workshop: Bench,
    monkeypatch: pytest.MonkeyPatch,
    way: str,
) -> None:
    asked, answers, answered = (threading.Event() for _ in range(3))

    def adjust_camera(*_: object) -> bool:
        asked.set()
        assert answers.wait(60)
        return False

    monkeypatch.setattr(live.Preview, "adjust_camera", adjust_camera)
    tell = panel._show_adjusted
    monkeypatch.setattr(panel, "_show_adjusted", lambda news: (tell(news), answered.set()))
    connect(qtbot, panel)
    write(qtbot, panel.exposure, "0.5", Qt.Key.Key_Return)
    assert asked.wait(60)
    if way == "run":
        model_of(panel).set_busy(True, is_live=True)
    else:
        click(qtbot, panel.connect_button)
    answers.set()
    qtbot.waitUntil(answered.is_set)
    qtbot.waitUntil(lambda: panel.link.phase is LinkState.OFF)
    qtbot.wait(50)
    assert panel.link.phase is LinkState.OFF
    assert len(workshop.made) == 1
    model_of(panel).set_busy(False)


def test_what_is_typed_while_a_driver_is_loaded_holds(
    qtbot: QtBot, panel: BenchPanel, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, line = model_of(panel), panel.devices.lines["actuator"]
    qtbot.waitUntil(lambda: line.source.findData("smc100-emulated") >= 0)
    put, loaded, asked = Form.put, threading.Event(), threading.Event()

    def slow(form: Form, key: str, value: Any, text: str | None = None) -> bool:
        asked.set()
        assert loaded.wait(60)
        return put(form, key, value, text)

    monkeypatch.setattr(Form, "put", slow)
    panel.devices._choose("actuator", line.source.findData("smc100-emulated"))
    assert asked.wait(60)
    config = model.config
    model.set_config(replace(config, run=replace(config.run, normal_force=0.33)))
    loaded.set()
    qtbot.waitUntil(lambda: model.config.actuator.source == "smc100-emulated")
    assert model.config.run.normal_force == 0.33
