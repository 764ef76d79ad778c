"""The bench panel in the hands of an operator: pick, connect, see, jog, zero, disconnect."""

import math
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bench_hands import (  # noqa: F401 (fixtures)
    LEFT,
    SMALL,
    Bench,
    Told,
    bench_panel,
    connect,
    crawl,
    filled,
    model_of,
    normal_n,
    notes_of_panel,
    place_um,
    raises,
    sentences_of_panel,
    words,
    workshop_of_benches,
)
from processes.launched import wait_until
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QWidget
from pytestqt.qtbot import QtBot
from set_up_hands import write
from window_hands import click

from app.gui.bench_link import LinkState
from app.gui.bench_panel import BenchPanel
from app.gui.memory import WindowMemory
from app.runs import live
from app.settings.config import load
from drivers.errors import DeviceFault, DeviceNotFound, OutOfLimits

NARROW_PX = 300  # of the panel at least, in a window as wide as the screen of a laptop


def test_an_operator_connects_sees_jogs_zeroes_and_disconnects(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    workshop.world = ("forces.zero=[0.25, -0.125]",)
    crawl(panel)
    assert words(panel).count("not connected") == 3
    assert not panel.stage.jogs[0].isEnabled()
    assert not panel.zero.isEnabled()
    connect(qtbot, panel)
    qtbot.waitUntil(lambda: words(panel).count("ready") == 3)
    assert "12.5000 mm, at rest" in words(panel)
    # 0.25 V of 300 um/V and 689 N/m, with the sensors' noise
    assert normal_n(panel) == pytest.approx(0.0517, abs=0.002)
    assert not re.search(r"^.?\d\.\d{3}$", words(panel), re.M)  # the strip has the numbers
    readings: list[Any] = []
    panel.read.connect(readings.append)
    qtbot.waitUntil(lambda: len(readings) > 2)
    assert normal_n(panel) == readings[-1].newest[0]
    panel.hide()  # the forces stay live where another part covers the panel
    readings.clear()
    before = panel.link.view
    qtbot.waitUntil(lambda: panel.link.view is not before and bool(readings))
    panel.show()
    assert "can be jogged by −500 to +500 µm" in words(panel)
    assert "min of recording" in words(panel) or "h of recording" in words(panel)

    fast = panel.stage.jogs[3]
    qtbot.mousePress(fast, LEFT)
    qtbot.waitUntil(lambda: place_um(panel) > 12520 and "moving" in words(panel))
    qtbot.mouseRelease(fast, LEFT)
    qtbot.waitUntil(lambda: "at rest" in words(panel))
    stood = place_um(panel)
    assert stood < 12900  # and not at its limit
    qtbot.wait(300)
    assert place_um(panel) == stood

    click(qtbot, panel.zero)
    qtbot.waitUntil(lambda: "is the block free" in words(panel))  # 0.05 N is a force
    panel.resize(NARROW_PX, 700)
    qtbot.waitUntil(lambda: panel.zero_note.width() < NARROW_PX / 2)
    note = panel.zero_note
    assert note.heightForWidth(note.width()) <= note.height()  # the question is read to its end
    assert model_of(panel).config.forces.zero == (0.0, 0.0)
    click(qtbot, panel.zero_act)
    qtbot.waitUntil(lambda: "Zeroed" in words(panel))
    assert model_of(panel).config.forces.zero == pytest.approx((0.25, -0.125), abs=1e-3)
    assert "P had read +0.052 N" in words(panel)
    qtbot.waitUntil(lambda: abs(normal_n(panel)) < 0.0015)
    assert "connect again" not in panel.state.text()  # the zero alone is no other bench

    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: words(panel).count("not connected") == 3)
    assert panel.normal.text.text() == "–"
    assert math.isnan(normal_n(panel))


def test_the_keyboard_connects_and_moves_nothing(qtbot: QtBot, panel: BenchPanel) -> None:
    panel.connect_button.setFocus()
    qtbot.keyClick(panel.connect_button, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: panel.stage.jogs[0].isEnabled() and panel.zero.isEnabled())
    seen: list[QWidget | None] = []
    for _ in range(30):
        qtbot.keyClick(panel.focusWidget() or panel, Qt.Key.Key_Tab)
        seen.append(panel.focusWidget())
    assert panel.exposure in seen
    assert not {panel.zero, *panel.stage.jogs} & set(seen)


def test_no_key_moves_the_stage_after_zero(qtbot: QtBot, panel: BenchPanel) -> None:
    connect(qtbot, panel)
    start = place_um(panel)
    click(qtbot, panel.zero)
    qtbot.waitUntil(lambda: panel.link.is_zeroing and not panel.zero.isEnabled())
    front = QApplication.activeWindow()
    assert front is not None
    QTest.keyPress(front.windowHandle(), Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: "Zeroed" in words(panel))
    QTest.keyRelease(front.windowHandle(), Qt.Key.Key_Space)
    assert place_um(panel) == start


def test_zero_under_load_asks_is_logged_and_can_be_undone(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, noted: list[str]
) -> None:
    workshop.world = ("sim.press_time=0.01",)
    connect(qtbot, panel)

    qtbot.waitUntil(lambda: normal_n(panel) > 0.45)
    qtbot.waitUntil(lambda: not panel.link.view.stage.is_moving)
    bar = filled(qtbot, panel)
    places = [button.mapTo(panel, button.rect().center()) for button in panel.stage.jogs]
    before = panel.zero.mapTo(panel, panel.zero.rect().center())
    click(qtbot, panel.zero)
    qtbot.waitUntil(panel.zero_act.isVisible)
    assert "P reads 0." in words(panel)
    assert "hang free" in words(panel)
    assert model_of(panel).config.forces.zero == (0.0, 0.0)
    assert normal_n(panel) > 0.45
    assert panel.zero_act.geometry().intersected(panel.zero.geometry()).isEmpty()
    qtbot.waitUntil(panel.zero_act.isEnabled)

    click(qtbot, panel.zero_act)
    qtbot.waitUntil(lambda: panel.zero_act.isVisible() and panel.zero_act.text() == "Undo")
    assert min(model_of(panel).zeros & {model_of(panel).config.forces.zero})[0] > 0.1
    qtbot.waitUntil(lambda: abs(normal_n(panel)) < 0.01)
    qtbot.waitUntil(lambda: bar.maximum() > 0)
    assert bar.isEnabled()
    # nothing was moved from under the mouse
    assert [button.mapTo(panel, button.rect().center()) for button in panel.stage.jogs] == places
    assert panel.zero.mapTo(panel, panel.zero.rect().center()).y() == before.y()
    assert any("the block is free" in one for one in noted)
    assert any("Zeroed: P had read +0." in one for one in noted)

    click(qtbot, panel.zero_act)
    assert model_of(panel).config.forces.zero == (0.0, 0.0)
    qtbot.waitUntil(lambda: normal_n(panel) > 0.45)
    assert "The zero before is back" in noted[-1]
    assert not panel.zero_act.isVisible()


def test_a_zero_that_is_set_elsewhere_is_that_of_the_connected_bench(
    qtbot: QtBot, panel: BenchPanel
) -> None:
    connect(qtbot, panel)
    config = model_of(panel).config
    with_zero = replace(config, forces=replace(config.forces, zero=(-2.0, 0.0)))
    model_of(panel).set_config(with_zero)  # as by the form
    qtbot.waitUntil(lambda: normal_n(panel) > 0.3)
    model_of(panel).set_config(config)
    qtbot.waitUntil(lambda: abs(normal_n(panel)) < 0.05)


def test_a_button_that_loses_the_window_or_the_mouse_stops_the_stage(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    connect(qtbot, panel)
    other = QWidget()
    qtbot.addWidget(other)
    preview = workshop.made[-1]
    for leave in (
        lambda: qtbot.mouseMove(panel.stage.jogs[3], panel.stage.jogs[3].rect().bottomRight() * 5),
        other.show,
        panel.stage.hide,
        panel.hide,
    ):
        other.hide()
        panel.stage.show()
        panel.show()
        panel.activateWindow()
        qtbot.waitUntil(panel.isActiveWindow)
        qtbot.mousePress(panel.stage.jogs[3], LEFT)
        qtbot.waitUntil(lambda: preview.motion()[2])
        leave()
        qtbot.waitUntil(lambda: panel.stage._held is None)
        qtbot.waitUntil(lambda: not preview.motion()[2])
        qtbot.mouseRelease(panel.stage.jogs[3], LEFT)


def test_a_window_that_stands_still_does_not_keep_the_stage_moving(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    connect(qtbot, panel)
    preview = workshop.made[-1]
    qtbot.mousePress(panel.stage.jogs[3], LEFT)
    qtbot.waitUntil(lambda: preview.motion()[2])
    wait_until(lambda: not preview.motion()[2], "its rest")  # no event is handled
    assert preview.motion()[1] < 0.4e-3  # and not at its limit
    qtbot.mouseRelease(panel.stage.jogs[3], LEFT)


@pytest.mark.parametrize(
    ("kind", "name", "why"),
    [
        ("forces", "forces", "NI board: there is no such board; check its name"),
        ("camera", "camera", "camera: it was not found; check its cable"),
        ("actuator", "stage", "SMC100: nothing answers on COM3; check its power"),
    ],
)
def test_each_device_says_why_it_does_not_connect(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, kind: str, name: str, why: str
) -> None:
    workshop.spoil = lambda bench: setattr(
        getattr(bench, kind), "open", raises(DeviceNotFound(why))
    )
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: why in words(panel))
    qtbot.waitUntil(lambda: words(panel).count("ready") >= 1)
    assert panel.devices.lines[kind].word.text() == "failed"
    assert panel.devices.lines[kind].mark.text() == "✗"
    if kind == "forces":
        qtbot.waitUntil(lambda: "not triggered" in words(panel))
    if kind == "actuator":
        qtbot.waitUntil(lambda: panel.picture._picture is not None)
        assert not panel.stage.jogs[0].isEnabled()


def test_where_no_device_is_there_one_tries_again(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    def lose(bench: Any) -> None:
        for kind in ("forces", "camera", "actuator"):
            getattr(bench, kind).open = raises(DeviceNotFound("not there"))

    workshop.spoil = lose
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: panel.connect_button.text() == "Try again")
    workshop.spoil = lambda bench: None
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: words(panel).count("ready") == 3)
    assert panel.connect_button.text() == "Disconnect"


def test_a_silent_device_leaves_the_window_alive(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.acquisition.connected_bench.CAMERA_S", 0.1)
    monkeypatch.setattr("app.acquisition.connected_bench.PATIENCE_S", 0.3)
    release = threading.Event()
    workshop.spoil = lambda bench: setattr(bench.camera, "open", release.wait)
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(panel.zero.isEnabled)
    assert panel.devices.lines["camera"].word.text() == "connecting"
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: "no return from a call" in words(panel))
    qtbot.waitUntil(lambda: panel.link.phase is LinkState.OFF)
    release.set()


def test_a_picture_that_is_not_live_says_so(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    workshop.world = ("sim.faults=['camera-gone 5']",)
    connect(qtbot, panel)
    assert panel.picture.note == ""
    qtbot.waitUntil(lambda: "it was unplugged at trigger 5" in words(panel))
    qtbot.waitUntil(lambda: re.fullmatch(r"not live: \d+ s old", panel.picture.note) is not None)


def test_what_forbids_a_jog_is_said(qtbot: QtBot, panel: BenchPanel, workshop: Bench) -> None:
    workshop.world = ("sim.faults=['saturated 0']",)
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: panel.stage.jogs[3].isEnabled() and panel.zero.isEnabled())
    qtbot.waitUntil(lambda: "reads the end of its range" in words(panel))
    assert panel.shear.text.text() == "sensor at the end of its range"
    qtbot.mousePress(panel.stage.jogs[3], LEFT)
    qtbot.waitUntil(lambda: "so that the force is not known" in words(panel))
    qtbot.mouseRelease(panel.stage.jogs[3], LEFT)


def test_a_stop_that_fails_is_an_alarm(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, told: Told
) -> None:
    connect(qtbot, panel)
    dead = DeviceFault("stage: the line is dead; check the cable")
    workshop.made[-1]._devices["actuator"].device.stop = raises(dead)
    qtbot.mousePress(panel.stage.jogs[0], LEFT)
    qtbot.mouseRelease(panel.stage.jogs[0], LEFT)
    qtbot.waitUntil(lambda: bool(told))
    assert told[0][1]
    assert "cut the actuator's power" in told[0][0]
    assert str(dead) in told[0][0]


def test_a_dead_mans_stop_that_fails_is_an_alarm_once(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, told: Told
) -> None:
    connect(qtbot, panel)
    preview = workshop.made[-1]
    preview._devices["actuator"].device.stop = raises(DeviceFault("stage: the line is dead"))
    preview.jog(1, 10e-6)  # and nobody says any more that it goes on
    qtbot.waitUntil(lambda: bool(told))
    qtbot.wait(400)
    assert len(told) == 1
    assert told[0][1]
    assert "stage: the line is dead" in told[0][0]


def test_a_bench_that_can_not_be_made_says_why(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    workshop.problem = DeviceNotFound("pylon camera: its package cannot be loaded")
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: str(workshop.problem) in words(panel))
    assert panel.connect_button.text() == "Connect"


def test_a_bench_whose_process_ends_says_so(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    connect(qtbot, panel)
    gone = DeviceFault("bench: its process has ended, and its devices are free")
    workshop.made[-1].look = raises(gone)
    qtbot.waitUntil(lambda: str(gone) in words(panel))
    assert panel.connect_button.text() == "Connect"


def choose_driver(qtbot: QtBot, panel: BenchPanel, kind: str, text: str) -> None:
    """Choose from the list of a device, by keys."""
    one = panel.devices.lines[kind].source
    qtbot.waitUntil(lambda: one.isEnabled() and one.findText(text) >= 0)
    one.setFocus()
    while one.currentText() != text:
        before = one.currentIndex()
        qtbot.keyClick(one, Qt.Key.Key_Down if before < one.findText(text) else Qt.Key.Key_Up)
        assert one.currentIndex() != before


def test_each_device_of_a_bench_has_its_own_driver(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, tmp_path: Path
) -> None:
    model, lines = model_of(panel), panel.devices.lines
    assert [one.source.currentText() for one in lines.values()] == ["simulated"] * 3
    assert "not connected" in lines["camera"].word.text()
    choose_driver(qtbot, panel, "actuator", "smc100-emulated")
    qtbot.waitUntil(lambda: model.config.sources == ("sim", "sim", "smc100-emulated"))
    camera = lines["camera"].source
    tip = camera.itemData(camera.findText("pylon"), Qt.ItemDataRole.ToolTipRole)
    assert "device at this computer" in tip

    # a replay needs a session, which is asked for once
    camera.setCurrentIndex(camera.findData("replay"))
    camera.activated.emit(camera.currentIndex())
    dialog = panel.findChild(QFileDialog)
    assert dialog is not None
    assert model.config.camera.source == "sim"
    session = tmp_path / "made.h5"
    session.touch()
    dialog.fileSelected.emit(str(session))
    qtbot.waitUntil(lambda: model.config.camera.source == "replay")
    assert model.config.replay.session == str(session)
    assert camera.currentText() == "replay of a session"
    dialog.close()
    forces = lines["forces"].source
    forces.activated.emit(forces.findData("replay"))
    qtbot.waitUntil(lambda: model.config.sources == ("replay", "replay", "smc100-emulated"))

    # drivers that are set up otherwise are shown, those of other labs too; what cannot be used
    # leaves the device as it was, and says why
    model.set_config(load(None, SMALL))
    assert [one.source.currentText() for one in lines.values()] == ["simulated"] * 3
    panel.devices._put("actuator", "nobody:Stage")
    qtbot.waitUntil(lambda: "cannot be imported" in words(panel))
    assert model.config.actuator.source == "sim"
    connect(qtbot, panel)
    assert not any(one.source.isVisible() for one in lines.values())


def test_a_run_takes_the_bench(qtbot: QtBot, panel: BenchPanel) -> None:
    connect(qtbot, panel)
    model_of(panel).set_busy(True)
    qtbot.waitUntil(lambda: "A run has the bench." in words(panel))
    assert panel.link.phase is LinkState.OFF
    assert not panel.connect_button.isEnabled()
    model_of(panel).set_busy(False)
    qtbot.waitUntil(panel.connect_button.isEnabled)
    assert "A run has the bench." not in words(panel)
    assert "Not connected." in words(panel)


def test_benches_are_picked_by_name_or_file_and_remembered(
    qtbot: QtBot,
    panel: BenchPanel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = tmp_path / "lab.toml"
    own.write_text('[camera]\nwidth = 320\nheight = 240\n[actuator]\nsource = "sim"\n')

    def choose(name: str) -> None:
        index = panel.bench.findText(name)
        panel.bench.setFocus()
        while panel.bench.currentIndex() != index:
            key = Qt.Key.Key_Down if panel.bench.currentIndex() < index else Qt.Key.Key_Up
            before = panel.bench.currentIndex()
            qtbot.keyClick(panel.bench, key)
            if panel.bench.currentIndex() == before:
                break

    choose("cyclic-shear")
    qtbot.waitUntil(lambda: model_of(panel).config == load(Path("cyclic-shear")))
    panel._pick(panel.bench.count() - 1)
    (dialog,) = panel.findChildren(QFileDialog)
    dialog.fileSelected.emit(str(own))
    dialog.close()
    qtbot.waitUntil(lambda: model_of(panel).config.camera.width == 320)
    assert panel.bench.currentText() == "lab.toml"
    assert WindowMemory().recent("bench") == [own]
    own.write_text("[camera]\nwdth = 1\n")
    panel.pick(own)
    qtbot.waitUntil(lambda: "unknown key 'camera.wdth'" in words(panel))
    assert model_of(panel).config.camera.width == 320


def test_exposure_and_gain_are_those_of_the_next_run(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, noted: list[str]
) -> None:
    connect(qtbot, panel)
    before = workshop.made[0].look().picture.mean
    write(qtbot, panel.exposure, "20", Qt.Key.Key_Return)
    assert model_of(panel).config.camera.exposure == pytest.approx(0.02)
    # the picture has it, and the bench stays connected
    qtbot.waitUntil(lambda: workshop.made[0].look().picture.mean > 1.8 * before)
    words_of_log = "Bench: the camera has exposure 20 ms"
    qtbot.waitUntil(lambda: [one for one in noted if "camera has" in one] == [words_of_log])
    assert len(workshop.made) == 1
    assert "connect again" not in words(panel)
    write(qtbot, panel.exposure, "900", Qt.Key.Key_Return)
    assert "longer than the trigger period" in words(panel)
    assert panel.exposure.value() == 20.0
    assert model_of(panel).config.camera.exposure == pytest.approx(0.02)


def test_a_camera_that_can_not_change_while_it_is_connected_is_connected_anew(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(qtbot, panel)
    monkeypatch.setattr(live.Preview, "adjust_camera", lambda *_: False)
    panel.exposure.setValue(20)
    panel.exposure.editingFinished.emit()
    qtbot.waitUntil(lambda: len(workshop.made) == 2)
    qtbot.waitUntil(lambda: workshop.made[-1].look().picture is not None)


def test_a_gain_that_the_camera_does_not_have_is_a_sentence(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect(qtbot, panel)
    why = OutOfLimits("camera: Gain = 50 was requested, it can have 0 to 24")
    monkeypatch.setattr(live.Preview, "adjust_camera", raises(why))
    panel.gain.setValue(50)
    panel.gain.editingFinished.emit()
    qtbot.waitUntil(lambda: "it can have 0 to 24" in words(panel))
    assert len(workshop.made) == 1


def test_settings_that_change_meanwhile_are_told_of(qtbot: QtBot, panel: BenchPanel) -> None:
    connect(qtbot, panel)
    config = model_of(panel).config
    model_of(panel).set_config(replace(config, camera=replace(config.camera, divisor=250)))
    qtbot.waitUntil(lambda: "connect again to see them" in words(panel))


@pytest.mark.parametrize("width", [340, 300])
def test_the_panel_fits_a_narrow_dock(qtbot: QtBot, panel: BenchPanel, width: int) -> None:
    connect(qtbot, panel)
    panel.resize(width, 500)
    qtbot.waitUntil(lambda: panel.verticalScrollBar().maximum() > 0)
    assert panel.horizontalScrollBar().maximum() == 0
