"""A protocol is made step by step, by keyboard and mouse."""

from dataclasses import replace

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from set_up_hands import click_in_view, heads_of_steps, open_table, steps_of, write
from window_hands import click

from app.gui import theme
from app.gui.form import AS_SET, OWN_STEPS, STEPS_KEY
from app.gui.setup_panel import SetupPanel
from app.gui.window_model import WindowModel
from app.settings.protocol_steps import Drive, Hold
from app.settings.sections import Config


def kinds(model: WindowModel) -> list[str]:
    return [step.kind for step in model.config.run.protocol]


def choose_step(panel: SetupPanel, number: int) -> None:
    """Click on a step."""
    click_in_view(panel, heads_of_steps(panel)[number - 1])


def add_step(panel: SetupPanel, kind: str) -> None:
    (act,) = (one for one in panel.protocol.add.menu().actions() if one.text() == kind)
    act.trigger()


def test_a_protocol_is_made_step_by_step(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    protocol, choice = panel.protocol, panel.row(STEPS_KEY).editor
    assert kinds(model) == ["background", "approach", "reference", "drive"]
    assert not model.config.run.steps
    add_step(panel, "hold")
    assert kinds(model) == ["background", "approach", "reference", "drive", "hold"]
    assert choice.currentText() == OWN_STEPS
    write(qtbot, panel.row(f"{STEPS_KEY}.5.time").editor, "2.5")
    assert steps_of(panel)[-1] == "5  hold for 2.5 s"
    assert protocol.total.text() == "43 s and the operator's time"
    # without values of their own the steps take those of the run
    write(qtbot, panel.row("run.normal_force").editor, "0.3")
    assert steps_of(panel)[1] == "2  approach to 0.3 N"

    choose_step(panel, 4)
    click(qtbot, protocol.double)
    assert kinds(model)[3:] == ["drive", "drive", "hold"]
    click(qtbot, protocol.down)
    assert kinds(model)[3:] == ["drive", "hold", "drive"]
    choose_step(panel, 6)
    write(qtbot, panel.row(f"{STEPS_KEY}.6.travel").editor, "-50")
    assert model.config.run.steps[5].travel == pytest.approx(-50e-6)
    click(qtbot, protocol.up)
    assert kinds(model)[3:] == ["drive", "drive", "hold"]
    choose_step(panel, 6)
    click(qtbot, protocol.remove)
    assert kinds(model)[3:] == ["drive", "drive"]
    assert steps_of(panel)[-1] == "5  drive −50 µm at 5 µm/s · 10 s"
    assert model.config.run.steps[-1].travel == pytest.approx(-50e-6)


def test_what_is_typed_into_a_step_is_of_no_step_that_takes_its_place(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    """It was written into the step of that number of other settings, at which the stage drove."""
    choose_step(panel, 4)
    write(qtbot, panel.row(f"{STEPS_KEY}.4.velocity").editor, "7", end=None)
    other = replace(Config().run, steps=(*Config().run.protocol[:3], Drive(velocity=3e-6), Hold()))
    model.set_config(replace(Config(), run=other))
    assert [getattr(step, "velocity", 0) for step in model.config.run.steps][3:] == [3e-6, 0]
    assert not panel.refusal()


def test_what_is_typed_into_a_step_is_taken_before_the_steps_are_moved(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    choose_step(panel, 4)
    write(qtbot, panel.row(f"{STEPS_KEY}.4.velocity").editor, "7", end=None)
    add_step(panel, "hold")
    assert kinds(model)[3:] == ["drive", "hold"]
    assert model.config.run.steps[3].velocity == pytest.approx(7e-6)
    assert not panel.refusal()


def test_steps_in_an_order_that_can_not_be_are_shown_and_refused(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    row = panel.row(STEPS_KEY)
    choose_step(panel, 4)
    click(qtbot, panel.protocol.up)
    assert steps_of(panel)[2:] == ["3  drive", "4  reference"]
    assert "step 3 (drive) moves the stage before the reference" in row.sentence.text()
    assert panel.refusal().startswith("Protocol cannot be used as typed: run.steps: step 3")
    assert not model.config.run.steps
    click(qtbot, panel.protocol.down)
    assert not panel.refusal()
    assert kinds(model) == ["background", "approach", "reference", "drive"]


def test_a_value_of_a_step_is_refused_beside_it_and_gone_to(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    choose_step(panel, 4)
    speed = panel.row(f"{STEPS_KEY}.4.velocity")
    assert speed.editor.placeholderText() == "5 as run.velocity"
    write(qtbot, speed.editor, "fast")
    assert 'velocity must be a number at least 0 and at most 1000 µm/s; found "fast"' in (
        speed.sentence.text()
    )
    assert speed.editor.text() == "fast"
    assert not panel.row(STEPS_KEY).sentence.isVisible()
    choose_step(panel, 4)  # which closes it
    assert not speed.editor.isVisible()
    panel.go_to_refused()
    qtbot.waitUntil(speed.editor.hasFocus)
    assert speed.editor.isVisible()
    click(qtbot, speed.reset)
    assert not panel.refusal()
    write(qtbot, speed.editor, "8")
    assert model.config.run.steps[3].velocity == pytest.approx(8e-6)


def test_load_and_travel_that_the_steps_say_themselves_are_grey(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    load, travel = panel.row("run.normal_force"), panel.row("run.travel")
    choice = panel.row(STEPS_KEY).editor
    choice.setFocus()
    qtbot.keyClicks(choice, "example")
    assert load.editor.isEnabled()  # the approach of the example presses to it
    assert not travel.editor.isEnabled()
    assert travel.sentence.text() == "Each step of the protocol says its own."
    open_table(panel, "run")
    assert not panel.settings.rows("run.travel")[1].editor.isEnabled()
    assert panel.row("run.background_time").editor.isEnabled()  # which its first step takes
    qtbot.keyClick(choice, Qt.Key.Key_Home)
    assert choice.currentText() == AS_SET
    assert travel.editor.isEnabled()
    assert not travel.sentence.isVisible()


def test_the_steps_can_be_read_in_another_look(qapp: QApplication, panel: SetupPanel) -> None:
    theme.apply(qapp, "light")
    heads = heads_of_steps(panel)
    assert {head.palette().buttonText().color().name() for head in heads} == {theme.now().text}
