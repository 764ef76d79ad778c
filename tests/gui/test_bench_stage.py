"""The stage of a connected bench in the hands of an operator: sent to a place, homed, stopped."""

from dataclasses import replace
from types import SimpleNamespace
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
    model_of,
    notes_of_panel,
    place_um,
    raises,
    sentences_of_panel,
    words,
    workshop_of_benches,
)
from processes.launched import wait_until
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot
from set_up_hands import write
from window_hands import click, shown

from app.gui.bench_link import LinkState
from app.gui.bench_panel import BenchPanel
from app.gui.bench_stage import StagePanel
from app.gui.cells import Tone
from app.gui.window_model import WindowModel
from app.records.bench_view import BenchView, DeviceState, DeviceView
from app.settings.config import load
from app.system.stopping import failed


def test_an_operator_sends_the_stage_to_a_place(
    qtbot: QtBot, panel: BenchPanel, noted: list[str]
) -> None:
    stage, doing = panel.stage, []
    panel.acts.connect(doing.append)
    assert not stage.go.isEnabled()
    assert not stage.home.isEnabled()
    connect(qtbot, panel)
    qtbot.waitUntil(lambda: stage.goal.value() == pytest.approx(12.5, abs=1e-4))
    assert "sent to 12.0000 to 13.0000 mm" in words(panel)

    write(qtbot, panel.stage.goal, "12.8", Qt.Key.Key_Return)
    qtbot.wait(200)
    assert place_um(panel) == pytest.approx(12500, abs=0.1)  # Enter moves nothing
    click(qtbot, stage.go)
    qtbot.waitUntil(lambda: "goes to 12.8000 mm" in words(panel) and "moving" in stage.place.text())
    qtbot.waitUntil(lambda: "12.8000 mm, at rest" in words(panel))
    qtbot.waitUntil(lambda: any("the stage is at 12.8000 mm, at rest" in one for one in noted))
    assert any("move to 12.8000 mm at 100 µm/s from 12.5000 mm, at rest" in one for one in noted)
    assert "moving" in doing
    assert doing[-1] == ""

    write(qtbot, panel.stage.goal, "14", Qt.Key.Key_Return)
    click(qtbot, stage.go)
    qtbot.waitUntil(lambda: "it can be moved from 12.0000 to 13.0000 mm" in words(panel))
    assert "12.8000 mm, at rest" in words(panel)


@pytest.mark.parametrize("way", ["button", "stop", "disconnect"])
def test_a_move_is_stopped(qtbot: QtBot, panel: BenchPanel, workshop: Bench, way: str) -> None:
    crawl(panel)
    connect(qtbot, panel)
    write(qtbot, panel.stage.goal, "12.9", Qt.Key.Key_Return)
    click(qtbot, panel.stage.go)
    qtbot.waitUntil(lambda: panel.stage.go.text() == "Stop" and place_um(panel) > 12505)
    assert not panel.stage.home.isEnabled()
    if way == "button":
        click(qtbot, panel.stage.go)
    elif way == "stop":
        panel.preview.stop_motion()  # as STOP MOTION does
    else:
        click(qtbot, panel.connect_button)
        qtbot.waitUntil(lambda: panel.link.phase is LinkState.OFF)
        assert workshop.made[0].motion()[2] is False
        return
    qtbot.waitUntil(lambda: "at rest" in words(panel) and panel.stage.go.text() == "Go")
    stood = place_um(panel)
    assert stood < 12880
    qtbot.wait(500)
    assert place_um(panel) == stood  # what the window still asks moves nothing


def test_a_window_that_stands_still_stops_a_move(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    connect(qtbot, panel)
    write(qtbot, panel.stage.goal, "12.9", Qt.Key.Key_Return)
    click(qtbot, panel.stage.go)
    qtbot.waitUntil(lambda: panel.link.task is not None)
    preview = workshop.made[0]
    wait_until(lambda: not preview.motion()[2], "its rest")  # and the window does nothing
    assert preview.look().stage.position_m < 12.89e-3
    qtbot.waitUntil(lambda: "nobody asked for 1 s whether it goes on" in words(panel))


def test_the_origin_is_searched_after_a_question_only(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    asked: list[tuple[Any, ...]] = []
    model_of(panel).asked.connect(lambda *question: asked.append(question))
    connect(qtbot, panel)
    click(qtbot, panel.stage.home)
    qtbot.wait(200)
    assert place_um(panel) == pytest.approx(12500, abs=0.1)
    (sentence, yes, search, no) = asked[0]
    assert "Is the block lifted" in sentence
    assert (yes, no) == ("It is free, search", "No")
    search()
    qtbot.waitUntil(lambda: "searches its origin; STOP MOTION" in words(panel))
    qtbot.waitUntil(lambda: place_um(panel) < 11900)  # further than limits.travel
    click(qtbot, panel.stage.go)
    qtbot.waitUntil(lambda: "at rest" in panel.stage.place.text())
    qtbot.waitUntil(lambda: "can be jogged by −500 to +500 µm" in words(panel))  # from here on


def test_connecting_jogging_and_disconnecting_are_in_the_log(
    qtbot: QtBot, panel: BenchPanel, noted: list[str]
) -> None:
    connect(qtbot, panel)
    qtbot.waitUntil(lambda: sum("ready" in one for one in noted) == 3)
    assert noted[0] == "Bench: connecting (current set-up)"
    qtbot.mousePress(panel.stage.jogs[3], LEFT)
    qtbot.waitUntil(lambda: place_um(panel) > 12510)
    assert panel.link.task is not None
    qtbot.mouseRelease(panel.stage.jogs[3], LEFT)
    qtbot.waitUntil(lambda: any("the stage is at" in one for one in noted))
    jogs = [one for one in noted if "jog" in one]
    assert jogs == ["Bench: jog along the drive at 100 µm/s from 12.5000 mm, at rest"]
    where = next(one for one in noted if "the stage is at" in one)
    assert f"{place_um(panel) / 1e3:.4f} mm, at rest" in where
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: noted[-1] == "Bench: not connected any more")


def test_each_button_of_the_jog_does_what_it_says(qtbot: QtBot, workshop: Bench) -> None:
    asked: list[tuple[int, float]] = []
    link: Any = SimpleNamespace(hold=lambda *order: asked.append(order), let_go=lambda: None)
    desk = WindowModel(workshop, load(None, SMALL))
    stage = StagePanel(desk, link, lambda sentence: None, QLabel())
    qtbot.addWidget(stage)
    stage.show_settings(desk.config)
    for jog, text, does, order in zip(
        stage.jogs,
        ("« 100", "‹ 10", "10 ›", "100 »"),
        (
            "against the drive at 100",
            "against the drive at 10",
            "along the drive at 10",
            "along the drive at 100",
        ),
        ((-1, 100e-6), (-1, 10e-6), (1, 10e-6), (1, 100e-6)),
        strict=True,
    ):
        jog.pressed.emit()
        jog.released.emit()
        assert (jog.text(), jog.accessibleName()) == (text, f"jog {does} µm/s")
        assert asked.pop() == pytest.approx(order)
    assert not asked


def test_a_stop_wins_over_a_jog_that_is_held(qtbot: QtBot, panel: BenchPanel) -> None:
    connect(qtbot, panel)
    qtbot.mousePress(panel.stage.jogs[3], LEFT)
    qtbot.waitUntil(lambda: place_um(panel) > 12510)
    model_of(panel).stop_pressed.emit()
    panel.preview.stop_motion()
    qtbot.waitUntil(lambda: "at rest" in words(panel))
    qtbot.wait(400)
    stood = place_um(panel)
    qtbot.wait(400)
    assert place_um(panel) == stood
    qtbot.mouseRelease(panel.stage.jogs[3], LEFT)


def test_the_picture_is_live_while_the_panel_is_hidden_and_says_when_it_is_not(
    qtbot: QtBot, panel: BenchPanel
) -> None:
    seen: list[tuple[Any, ...]] = []
    panel.seen.connect(lambda *picture: seen.append(picture))
    connect(qtbot, panel)
    panel.hide()
    seen.clear()
    qtbot.waitUntil(lambda: len({picture.number for picture, *_ in seen}) > 2)
    assert all(note == "" and is_connected for _, _, note, is_connected in seen)
    panel.disconnect_bench()
    qtbot.waitUntil(lambda: "not live: the bench is not connected since" in seen[-1][2])
    assert seen[-1][0] is seen[-2][0]
    assert seen[-1][3] is False


@pytest.mark.parametrize("typed", ["12,56", "12.56"])
def test_a_place_is_typed_with_a_comma_or_a_point_and_shown_as_the_language_has_it(
    german: None, qtbot: QtBot, workshop: Bench, typed: str
) -> None:
    panel = shown(qtbot, BenchPanel(WindowModel(workshop, load(None, SMALL))))
    panel.stage.goal.setEnabled(True)
    write(qtbot, panel.stage.goal, typed, Qt.Key.Key_Return)
    assert panel.stage.goal.value() == 12.56
    assert panel.stage.goal.text() == "12,5600 mm"
    assert panel.exposure.text() == "10,00 ms"


def test_disconnecting_scrolls_the_panel_nowhere(qtbot: QtBot, panel: BenchPanel) -> None:
    panel.resize(340, 300)
    connect(qtbot, panel)
    assert panel.connect_button.hasFocus()
    assert panel.verticalScrollBar().value() == 0
    click(qtbot, panel.connect_button)
    qtbot.waitUntil(lambda: panel.link.phase is LinkState.OFF and panel.connect_button.isEnabled())
    assert panel.verticalScrollBar().value() == 0


def test_a_stop_that_fails_as_the_bench_is_let_go_of_is_an_alarm(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, told: Told
) -> None:
    connect(qtbot, panel)
    close, answer = workshop.made[-1].close, failed("stage: the line is dead")
    workshop.made[-1].close = lambda: (close(), answer)[1]
    panel.disconnect_bench()
    qtbot.waitUntil(lambda: told == [(answer.sentence, True)])


def test_why_the_stage_was_stopped_is_said_once_and_not_over_what_is_newer(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench, noted: list[str]
) -> None:
    connect(qtbot, panel)
    look, why = workshop.made[-1].look, [""]
    workshop.made[-1].look = lambda known=-1: replace(look(known), said=why[-1])
    for reason in ("jog: it was stopped: Q", "", "jog: it was stopped: Q", "jog: P"):
        why.append(reason)
        qtbot.waitUntil(lambda: panel.link.view.said == why[-1])
        panel._tick()
        if reason:
            assert panel.said.text() == reason
        panel._say("Zeroed.", Tone.NEUTRAL)
        for _ in range(2):
            panel._tick()
        assert panel.said.text() == "Zeroed."
    assert [one for one in noted if "jog" in one] == [f"Bench: {one}" for one in why if one]


def test_what_is_wrong_with_a_device_is_said_until_it_is_mended(
    qtbot: QtBot, panel: BenchPanel, workshop: Bench
) -> None:
    connect(qtbot, panel)
    look, why = workshop.made[-1].look, [""]

    def looked(known: int = -1) -> BenchView:
        view, sentence = look(known), why[-1]
        state = DeviceState.LOOK if sentence else DeviceState.READY
        camera = DeviceView("cam", state, sentence)
        return replace(view, devices={**view.devices, "camera": camera})

    workshop.made[-1].look = looked

    def becomes(sentence: str, said: str) -> None:
        why.append(sentence)
        qtbot.waitUntil(lambda: panel.link.view.devices["camera"].sentence == sentence)
        panel._tick()
        assert panel.said.text() == said

    for sentence in ("no picture comes", "", "no picture comes", "1 image is lost"):
        becomes(sentence, f"Camera: cam: {sentence}" if sentence else "")
        assert panel.said.isVisible() is bool(sentence)
    becomes("2 images are lost", "Camera: cam: 2 images are lost")
    panel._say("Zeroed.", Tone.NEUTRAL)
    becomes("3 images are lost", "Zeroed.")  # a number that counts on is no news
    becomes("it is warm", "Camera: cam: it is warm")
    panel._say("Zeroed.", Tone.NEUTRAL)
    becomes("", "Zeroed.")
