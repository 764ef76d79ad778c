"""A folder that does not answer holds up neither a setting, nor a run that begins, nor STOP."""

import shutil
import tempfile
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from operators import Mouse, large
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, wait_for_words
from workshops import Makes

from app.files.kinds import EXPORTS
from app.gui import log_panel
from app.gui.memory import WindowMemory
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.replay import archive
from app.settings.sections import Config

CALLS = (
    *((Path, name) for name in ("exists", "is_dir", "is_file", "stat", "open", "resolve")),
    (tempfile, "TemporaryFile"),
    (shutil, "disk_usage"),
)


class SlowFolder:
    """A folder that answers nothing before `answers` is set; `asked` are the calls that the thread
    of the window has made to it, which would have held it up.
    """

    def __init__(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.path, self.answers = path, threading.Event()
        self.asked: list[str] = []
        self.waiting = 0
        for owner, name in CALLS:
            monkeypatch.setattr(owner, name, self._slow(getattr(owner, name)))

    def _slow(self, call: Any) -> Any:
        def slow(*args: Any, **kwargs: Any) -> Any:
            given = [*args, *kwargs.values()]
            if any(str(self.path) in str(one) for one in given if isinstance(one, str | Path)):
                if threading.current_thread() is threading.main_thread():
                    self.asked.append("".join(traceback.format_stack(limit=8)))
                else:
                    self.waiting += 1
                    self.answers.wait(60)
            return call(*args, **kwargs)

        return slow


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SlowFolder]:
    folder = tmp_path / "slow"
    folder.mkdir()
    made = SlowFolder(folder, monkeypatch)
    yield made
    made.answers.set()


@pytest.fixture
def run(slow: SlowFolder) -> ScriptedRun:
    made = ScriptedRun(320, 240, frames=60)
    made.session = slow.path / "a.h5"  # type: ignore[attr-defined]
    return made


@pytest.fixture
def window(
    open_window: Open, slow: SlowFolder, run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> Iterator[MainWindow]:
    WindowMemory().remember("bench", slow.path / "lab.toml")
    WindowMemory().remember("session", slow.path / "a.h5")
    monkeypatch.setattr(archive, "sessions_in", lambda folder: [folder / "a.h5"])
    shown = open_window(
        model=WindowModel(Makes(lambda: run), Config(), slow.path / "a.h5"), show=large
    )
    yield shown
    slow.answers.set()


def test_settings_start_and_stop_wait_for_no_folder(
    qtbot: QtBot,
    window: MainWindow,
    slow: SlowFolder,
    run: ScriptedRun,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mouse, setup, looks = Mouse(qtbot, window), window.setup, []
    refresh = window.log.refresh
    monkeypatch.setattr(log_panel, "LOOK_S", 0.0)
    monkeypatch.setattr(window.log, "refresh", lambda: (refresh(), looks.append(1)))
    qtbot.waitUntil(lambda: slow.waiting > 0)
    mouse.go_to("setup")
    for load in ("0.3", "0.4", "0.2"):
        mouse.type(setup.row("run.normal_force").editor, load)
        qtbot.keyClick(setup.row("run.normal_force").editor, Qt.Key.Key_Return)
    mouse.type(setup.session, str(slow.path / "b"))
    qtbot.keyClick(setup.session, Qt.Key.Key_Return)
    assert window.model.session == slow.path / "b.h5"
    mouse.go_to("bench")
    mouse.go_to("log")
    looks.clear()
    qtbot.waitUntil(lambda: len(looks) > 1)  # for the log of the session
    mouse.go_to("sessions")
    menu = window.sessions.recent.menu()
    menu.aboutToShow.emit()
    assert str(slow.path / "a.h5") in [act.text() for act in menu.actions()]
    mouse.click(window.top.start)
    qtbot.waitUntil(lambda: run.started)
    run.at(30)
    qtbot.waitUntil(lambda: window._view is not None)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert run.called.wait(60)
    assert run.calls == ["stop_motion"]
    wait_for_words(qtbot, window, "at rest")
    assert not slow.answers.is_set()
    assert slow.asked == []


def test_forms_of_a_session_wait_for_no_folder(
    qtbot: QtBot, window: MainWindow, slow: SlowFolder
) -> None:
    sessions, session = window.sessions, slow.path / "a.h5"
    sessions.analysis_form.show_session(session)
    slow.waiting = 0
    sessions.export_form.show_session(session)
    sessions.export_form.kind.setCurrentIndex([one.what for one in EXPORTS].index("forces"))
    qtbot.waitUntil(lambda: slow.waiting > 0)
    assert slow.asked == []
    slow.answers.set()
    qtbot.waitUntil(
        lambda: (
            sessions.export_form.file.text() == str(slow.path / "a-forces.csv")
            and sessions.analysis_form.file.text() == "a-analysis.h5"
        )
    )


def test_a_bench_file_is_read_beside_the_window(
    qtbot: QtBot, window: MainWindow, slow: SlowFolder
) -> None:
    own = slow.path / "lab.toml"
    window.bench.pick(own)
    qtbot.waitUntil(lambda: slow.waiting > 0)
    assert slow.asked == []
    slow.answers.set()
    qtbot.waitUntil(lambda: "lab.toml" in window.bench.said.text())


def test_settings_are_saved_and_loaded_beside_the_window(
    qtbot: QtBot, window: MainWindow, slow: SlowFolder
) -> None:
    setup, own, said = window.setup, slow.path / "lab.toml", []
    window.model.said.connect(lambda text, _: said.append(text))
    for act, words in ((setup.save, "are saved in"), (setup.load, "has the settings of")):
        slow.answers.clear()
        slow.waiting = 0
        act(own)
        qtbot.waitUntil(lambda: slow.waiting > 0)
        assert slow.asked == []
        assert not [text for text in said if words in text]
        slow.answers.set()
        qtbot.waitUntil(lambda words=words: any(words in text for text in said))
    assert setup.compared.text() == "all as in lab.toml"


@pytest.mark.parametrize("name", ["nowhere/x", "x.txt/"])
def test_a_name_that_can_not_be_used_does_not_come_to_the_next_run(
    qtbot: QtBot, window: MainWindow, slow: SlowFolder, name: str
) -> None:
    slow.answers.set()
    setup, first = window.setup, window.model.session
    setup.session.setText(str(slow.path / name / "x"))
    setup.session.setModified(True)
    setup.session.editingFinished.emit()
    qtbot.waitUntil(lambda: "does not exist" in setup.place.text())
    assert window.model.session == first
    assert "cannot be used" in setup.refusal()
