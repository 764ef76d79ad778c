"""The picture of a scripted run of 330 frames, on the screen, and who looks at it."""

from dataclasses import replace

import pytest
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import shown

from app.gui.image_view import InterfaceView
from app.gui.source import setup_of


@pytest.fixture(name="script", scope="module")
def script_of_frames() -> ScriptedRun:
    run = ScriptedRun(320, 240, frames=330)
    run.config = replace(run.config, camera=replace(run.config.camera, width=320, height=240))
    return run


@pytest.fixture(name="run")
def run_of_script(script: ScriptedRun) -> ScriptedRun:
    script.started, script.stopped = True, False
    return script.at(0)


@pytest.fixture(name="picture")
def picture_of_run(qtbot: QtBot, run: ScriptedRun) -> InterfaceView:
    view = shown(qtbot, InterfaceView(), 800, 760)
    view.show_setup(setup_of(run))
    return view


def choose(view: InterfaceView, key: str) -> None:
    view.which.setCurrentIndex(view.which.findData(key))
