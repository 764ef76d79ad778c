"""The set-up from evening to evening, and beside the runs of a campaign."""

from dataclasses import replace
from pathlib import Path

from PySide6.QtWidgets import (
    QLabel,
    QToolButton,
)
from pytestqt.qtbot import QtBot
from set_up_hands import Shop, write
from window_hands import click

from app.gui.memory import WindowMemory
from app.gui.setup_panel import SetupPanel
from app.gui.start import opened_model
from app.gui.window_model import WindowModel
from app.settings.sections import Config, RunSettings


def test_the_set_up_of_the_last_evening_is_there_again(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel, tmp_path: Path
) -> None:
    write(qtbot, panel.row("about.operator").editor, "Ada")
    write(qtbot, panel.row("run.normal_force").editor, "0.3")
    write(qtbot, panel.session, "P0.3N")
    kept = tmp_path / "P0.3N.h5"
    qtbot.waitUntil(lambda: (WindowMemory().set_up() or ("", ""))[1] == str(kept))

    again = opened_model(Shop(), None, None)  # type: ignore[arg-type]
    assert (again.config, again.session) == (model.config, kept)
    other = SetupPanel(again)
    qtbot.addWidget(other)
    other.show()
    assert other.restored.isVisible()
    assert again.restored in other.restored.findChild(QLabel).text()
    assert other.row("about.operator").editor.text() == "Ada"
    click(qtbot, other.restored.findChild(QToolButton))
    assert again.config == Config()
    assert not other.restored.isVisible()
    # settings that are given are those that hold
    given = opened_model(Shop(), Config(run=RunSettings(normal_force=0.2)), None)  # type: ignore[arg-type]
    assert given.config.run.normal_force == 0.2
    assert not given.restored


def test_a_set_up_that_can_not_be_used_any_more_gives_way_to_the_defaults() -> None:
    WindowMemory().keep_set_up("[run]\nnormal_force = 50", "", "2026-11-25 22:10")
    model = opened_model(Shop(), None, None)  # type: ignore[arg-type]
    assert model.config == Config()
    assert not model.restored


def test_settings_of_one_run_alone_leave_those_of_the_operator(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    write(qtbot, panel.row("about.sample").editor, "mine")
    write(qtbot, panel.session, "mine")
    qtbot.waitUntil(lambda: WindowMemory().set_up() is not None)
    lent = replace(Config(), run=RunSettings(normal_force=0.2))
    model.lend(lent, Path("theirs.h5"))
    assert panel.lent.isVisible()
    assert panel.row("about.sample").editor.text() == ""
    assert panel.row("run.normal_force").editor.text() == "0.2"
    forces = replace(model.config.forces, zero=(0.1, 0.2))  # as after Zero
    model.set_config(replace(model.config, forces=forces))
    assert model.config.run.normal_force == 0.2
    model.set_busy(True, is_live=True)
    assert not panel.lent.isVisible()
    assert panel.row("about.sample").editor.text() == "mine"
    assert model.session == Path("mine.h5")
    assert model.config.run.normal_force == 0.5
    assert model.config.forces.zero == (0.1, 0.2)
    model.set_busy(False)
    model.lend(lent, Path("theirs.h5"))
    click(qtbot, panel.lent.findChild(QToolButton))
    assert model.config.about.sample == "mine"
