"""What an operator asks of a run that goes on, by mouse and by keyboard: a pause, a note."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest
from operators import Keyboard, Mouse, large
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QInputDialog, QLineEdit
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from short_run import RIGID
from window_hands import Open, begin, finish, make_run, model_of, wait_for_end

from app.gui.experiment_panel import ExperimentPanel
from app.gui.run_factory import RunFactory
from app.gui.run_steps import run_steps
from app.gui.source import setup_of
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.bench_view import Health
from app.records.record_types import Counts
from app.runs.run_source import Kind
from app.session.reader import SessionReader
from app.settings.config import load

SETTINGS = (
    *RIGID,
    *("camera.width=320", "camera.height=240", "camera.pixel=24", "dic.step=30"),
    *("limits.age=10", "sim.press_time=0.3", "dic.threads=1", "stress.method=none"),
    *("camera.divisor=250", "run.normal_force=0.1", "run.settle_time=0.2"),
    'run.steps=[{do="background", time=0.2}, {do="approach"}, {do="reference", time=0.4},'
    ' {do="drive", travel=2}, {do="ask", question="Go on?", timeout=600}, {do="hold", time=600}]',
)
RUNS = Health("running", "", "drive", Counts(), 0.0, 4.0, 1 << 40, 0, 0.5, step="x")


@pytest.fixture
def window(
    open_window: Open, tmp_path: Path, short_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[MainWindow]:
    monkeypatch.chdir(tmp_path)
    # STOP here stops no bench of another test
    monkeypatch.setattr("app.processes.folder.MEMORY", short_path)
    kept: list = []
    factory = RunFactory(kept.append, pace=1.0)
    shown = open_window(
        model=WindowModel(factory, load(None, SETTINGS), tmp_path / "noted.h5"), show=large
    )
    yield shown
    for one in kept:
        one.source.request_stop("the test is over")
        assert one.source.wait(60) is not None


def panel_of(window: MainWindow) -> ExperimentPanel:
    assert window.experiment is not None
    return window.experiment


def test_a_run_waits_between_two_steps_and_takes_notes(qtbot: QtBot, window: MainWindow) -> None:
    mouse, keyboard, panel = Mouse(qtbot, window), Keyboard(qtbot, window), panel_of(window)
    mouse.go_to("experiment")
    assert not panel.pause_button.isEnabled()
    assert "No run is under way" in panel.pause_button.toolTip()
    assert not panel.note.isEnabled()
    assert "none is under way" in panel.note.toolTip()
    mouse.click(window.top.start)
    # the step of the question lasts until it is answered, however slow the operator is
    qtbot.waitUntil(lambda: "Go on?" in panel.question.text())
    qtbot.waitUntil(panel.pause_button.isEnabled)

    mouse.click(panel.pause_button)
    qtbot.waitUntil(lambda: panel.pause_button.text() == "Pauses after this step: withdraw")
    assert "goes on" in panel.pause_button.toolTip()
    for act in (lambda: mouse.click(panel.pause_button), lambda: keyboard.key(Qt.Key.Key_F9)):
        act()
        qtbot.waitUntil(lambda: panel.pause_button.text() == "Pause after this step")
        keyboard.key(Qt.Key.Key_F9)
        qtbot.waitUntil(lambda: panel.pause_button.text() == "Pauses after this step: withdraw")
    keyboard.key(Qt.Key.Key_F4)
    assert QApplication.focusWidget() is panel.note
    keyboard.keys("the door")
    keyboard.key(Qt.Key.Key_Return)
    assert panel.note.text() == ""

    panel.answer.setText("half")
    keyboard.key(Qt.Key.Key_F8)
    qtbot.waitUntil(lambda: panel.button.text().startswith("Resume"))
    assert panel.answer.text() == ""
    assert "paused before step 6" in panel.question.text()
    assert panel.pause_button.text() == "Paused"
    assert panel.note.hasFocus()  # the pause takes no key from who types
    mouse.type(panel.note, "a drop")
    mouse.click(panel.note_button)
    mouse.click(panel.button)
    qtbot.waitUntil(lambda: not panel.pause_button.isEnabled() and "No step" in
                    panel.pause_button.toolTip())  # fmt: skip
    keyboard.key(Qt.Key.Key_F9)
    assert "No step follows" in window.notice.text.text()
    mouse.click(window.top.stop)
    wait_for_end(qtbot, window)
    assert not panel.note_button.isEnabled()
    mouse.go_to("log")
    qtbot.waitUntil(lambda: "Note: the door" in window.log.text.toPlainText())

    with SessionReader(Path("noted.h5")) as session:
        events = session.events()
    notes = [(one.sample, one.text) for one in events if one.kind == "note"]
    assert [one.text for one in events if one.kind == "answer"][:1] == ["half"]
    texts = [text for _, text in notes]
    assert texts == [
        "the door",
        "the run is paused before step 6",
        "a drop",
        "the run goes on with step 6",
    ]
    samples = [sample for sample, _ in notes]
    assert samples == sorted(samples)
    assert samples[0] > 0


@pytest.mark.slow
def test_no_key_but_its_own_pauses_or_notes(qtbot: QtBot, window: MainWindow) -> None:
    panel, keyboard = panel_of(window), Keyboard(qtbot, window)
    Mouse(qtbot, window).go_to("experiment")
    panel.pause_button.setEnabled(True)
    panel.note_button.setEnabled(True)
    seen = set()
    for _ in range(40):
        keyboard.key(Qt.Key.Key_Tab)
        seen.add(QApplication.focusWidget())
    assert not {panel.pause_button, panel.note_button, window.top.start, window.top.stop} & seen
    assert any(isinstance(one, QLineEdit) for one in seen)


STEPS = '{do="approach"}, {do="reference"}, {do="drive", travel=20}'
FASTER = f'run.steps=[{STEPS}, {{do="velocity", velocity=9, travel=40}}]'


@pytest.mark.parametrize(
    ("steps", "number", "health", "text", "why"),
    [
        ("", 3, {}, "Pause after this step", ""),
        ("", 4, {}, "Pause after this step", "No step follows"),
        (FASTER, 3, {}, "Pause after this step", "No step follows before which the stage stands"),
        (FASTER, 2, {}, "Pause after this step", ""),
        ("", 3, {"is_pause_asked": True}, "Pauses after this step: withdraw", ""),
        ("", 3, {"is_paused": True, "question": "?"}, "Paused", "waits already"),
        ("", 3, {"state": "stopping"}, "Pause after this step", "No run is under way"),
    ],
)
def test_a_pause_that_can_not_be_says_why(
    steps: str, number: int, health: dict, text: str, why: str
) -> None:
    config = load(None, (steps,) if steps else ())
    now = run_steps(config, replace(RUNS, step_number=number, **health), None, None, (0, 0), None)
    assert now.pause.startswith(text)
    assert re.match(f".*{re.escape(why)}" if why else "$", now.no_pause)
    assert bool(now.no_note) is (health.get("state") == "stopping")


def test_what_is_played_neither_waits_nor_takes_notes(qtbot: QtBot, open_window: Open) -> None:
    run = make_run()
    window = open_window(model=model_of(lambda: run))
    large(window)
    begin(qtbot, window, run, 30)
    panel, keyboard = panel_of(window), Keyboard(qtbot, window)
    assert panel.note.isEnabled()
    panel.show_setup(replace(setup_of(run), kind=Kind.REPLAY))
    assert not panel.note.isEnabled()
    assert "recorded" in panel.note.toolTip()
    keyboard.key(Qt.Key.Key_F9)
    assert "waits for nobody" in window.notice.text.text()
    window.notice.clear()
    keyboard.key(Qt.Key.Key_F4)
    assert "takes no notes" in window.notice.text.text()
    assert not panel.note.hasFocus()


class Patient(ScriptedRun):
    """A run that notes what is ordered of it."""

    def pause(self) -> None:
        self.calls.append("pause")

    def note(self, text: str) -> None:
        self.calls.append(text)


def test_a_window_that_only_shows_a_run_pauses_it_and_takes_notes(
    qtbot: QtBot, open_window: Open
) -> None:
    run = make_run(Patient)
    window = open_window(run)  # as `slipscope attach` opens it
    assert window.experiment is None
    begin(qtbot, window, run, 10)
    keyboard = Keyboard(qtbot, window)
    keyboard.key(Qt.Key.Key_F9)
    qtbot.waitUntil(lambda: "pause" in run.calls)
    for text in ("the door", ""):
        keyboard.key(Qt.Key.Key_F4)
        (dialog,) = (one for one in window.findChildren(QInputDialog) if one.isVisible())
        assert not dialog.isModal()  # STOP MOTION stays within reach
        dialog.setTextValue(text)
        dialog.accept()
        window.activateWindow()
        qtbot.waitUntil(window.isActiveWindow)
    finish(qtbot, window, run)
    for key, why in ((Qt.Key.Key_F9, "No run is under way"), (Qt.Key.Key_F4, "none is under way")):
        keyboard.key(key)
        assert why in window.notice.text.text()
    qtbot.waitUntil(lambda: run.calls == ["pause", "the door"])


def test_the_end_of_a_run_does_not_wait_for_an_order_without_an_answer(
    qtbot: QtBot, open_window: Open
) -> None:
    answers = Event()

    class Silent(ScriptedRun):
        def note(self, text: str) -> None:
            self.calls.append(text)
            answers.wait(60)

        def pause(self) -> None:
            self.calls.append("pause")

    run = make_run(Silent)
    window = open_window(model=model_of(lambda: run))
    large(window)
    begin(qtbot, window, run, 30)
    mouse, panel = Mouse(qtbot, window), panel_of(window)
    mouse.go_to("experiment")
    mouse.type(panel.note, "the door")
    mouse.click(panel.note_button)
    window.model.ordered.emit("", lambda source: source.pause())
    mouse.click(window.top.stop)
    qtbot.waitUntil(lambda: run.stopped)
    assert "pause" not in run.calls  # any other order waits for those before it
    window.model.ordered.emit("", lambda source: run.calls.append("withdraw"))
    qtbot.wait(100)
    assert "withdraw" not in run.calls  # nor does it overtake those with the end
    answers.set()
    qtbot.waitUntil(lambda: "withdraw" in run.calls)
    assert run.calls[-2:] == ["pause", "withdraw"]
