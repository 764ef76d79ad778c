"""An evening at the simulated bench, by mouse and by keyboard alone: connect, set up, start, look,
end, result, a second load, compare, export, replay, close.
"""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from operators import CTRL, Keyboard, Mouse, large, words
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QDialogButtonBox, QFileDialog
from pytestqt.qtbot import QtBot
from short_run import RIGID
from window_hands import Open, wait_for_words

from app.gui.bench_link import LinkState
from app.gui.keys import ACTS, GO_TO, KeyList
from app.gui.run_factory import RunFactory
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.session.reader import SessionReader
from app.settings.config import load

SETTINGS = (
    *RIGID,
    *("camera.width=320", "camera.height=240", "camera.pixel=24", "dic.step=30"),
    *("limits.age=10", "run.normal_force=0.1", "run.background_time=0.2", "sim.press_time=0.3"),
    *("run.settle_time=0.2", "run.reference_time=0.4", "run.travel=3000", "dic.threads=1"),
    *("stress.method=none", "camera.divisor=250", "limits.travel=5000"),
)
Wait = Callable[[Callable[[], object]], None]


@pytest.fixture
def made() -> Iterator[list]:
    """All runs and replays of the evening, which have ended when it is over."""
    kept: list = []
    yield kept
    for one in kept:
        if one.source.health().state != "idle":
            one.source.request_stop("the test is over")
            assert one.source.wait(60) is not None


@pytest.fixture
def window(
    open_window: Open, made: list, tmp_path: Path, short_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[MainWindow]:
    monkeypatch.chdir(tmp_path)
    # STOP here stops no bench of another test
    monkeypatch.setattr("app.processes.folder.MEMORY", short_path)
    factory = RunFactory(made.append, pace=None)
    shown = open_window(model=WindowModel(factory, load(None, SETTINGS)), show=large)
    yield shown
    factory._let_go()


# ------------------------------------------------------------------ what an operator sees


def is_driving(window: MainWindow) -> bool:
    """Whether the stage is seen to move, and the picture has a field."""
    view = window._view
    return view is not None and view.phase == "drive" and window.interface.field is not None


def ended(qtbot: QtBot, window: MainWindow, number: int, made: list) -> None:
    qtbot.waitUntil(
        lambda: (
            len(made) == number
            and window.source is made[-1].source
            and window.outcome() is not None
            and window.result.heading.text() == "Result"
        )
    )


def result(window: MainWindow) -> dict[str, list[str]]:
    """What the result card says of each quantity, which is in view."""
    table = window.result.table
    assert not table.visibleRegion().isEmpty()
    return {
        table.item(k, 0).text(): [table.item(k, j).text() for j in range(2, 5)]
        for k in range(table.rowCount())
    }


def about(session: Path) -> tuple[str, str, float]:
    """How a recorded run ended, its sample, and its load."""
    with SessionReader(session) as read:
        assert read.outcome is not None
        state = read.outcome.ended_as
        text = read.header.config_toml
    config = load(_settings(session, text))
    return state, config.about.sample, config.run.normal_force


def _settings(session: Path, text: str) -> Path:
    path = session.with_suffix(".toml")
    path.write_text(text, encoding="utf-8")
    return path


def is_listed(window: MainWindow, *names: str) -> bool:
    assert window.sessions is not None
    found = window.sessions.list
    items = [found.topLevelItem(k) for k in range(found.topLevelItemCount())]
    known = {item.text(0): item.text(1) for item in items if item is not None}
    return all(known.get(name, "…") != "…" for name in names)


def asked(qtbot: QtBot, window: MainWindow) -> QFileDialog:
    """The question for a file, once it is in front."""
    qtbot.waitUntil(lambda: isinstance(QApplication.activeWindow(), QFileDialog))
    dialog = QApplication.activeWindow()
    assert isinstance(dialog, QFileDialog)
    return dialog


# ------------------------------------------------------------------ the evening


class Evening:
    """What both operators do, and what they see; `hand` does it."""

    def __init__(self, qtbot: QtBot, window: MainWindow, made: list, hand: Mouse | Keyboard):
        self.qtbot, self.window, self.made, self.hand = qtbot, window, made, hand
        self.folder = Path.cwd()

    def connect(self) -> None:
        """Connect the bench: three devices are ready, and forces are read."""
        bench, qtbot = self.window.bench, self.qtbot
        assert bench is not None
        self.hand.go_to("bench")
        assert words(bench).count("not connected") == 3
        self.hand.press(bench.connect_button)
        qtbot.waitUntil(lambda: words(bench).count("ready") == 3 and bench.zero.isEnabled())
        assert "at rest" in bench.stage.place.text()
        assert self.window.readouts.views[0].value.text() != "–"
        assert self.window.top.badge.text() == "IDLE"

    def set_up(self, load_n: str, sample: str, name: str) -> None:
        """Say what the next run is: it is told that the file is free."""
        setup, model = self.window.setup, self.window.model
        assert setup is not None
        assert model is not None
        self.hand.go_to("setup")
        self.hand.type(setup.row("run.normal_force").editor, load_n)
        self.hand.type(setup.session, name)
        self.hand.type(setup.row("about.sample").editor, sample)
        self.hand.press(setup.only_changed)  # which leaves the last field
        self.hand.press(setup.only_changed)
        self.qtbot.waitUntil(lambda: setup.place.text() == f"{self.folder / name}.h5 is free")
        assert not setup.refused.isVisible()
        assert model.config.run.normal_force == float(load_n)

    def sees_a_run(self) -> None:
        """The run has begun and let go of the bench; it is named and drawn."""
        window = self.window
        assert window.bench is not None
        self.qtbot.waitUntil(lambda: is_driving(window))
        assert window.top.badge.text() == "RUNNING"
        said = window.top.sentence
        self.qtbot.waitUntil(lambda: said.text().startswith("The actuator pulls at 5 µm/s"))
        self.qtbot.waitUntil(lambda: "All is well" in window.strip.sentence.text())
        assert not window.top.start.isEnabled()
        assert window.bench.link.phase is LinkState.OFF
        assert not window.notice.isVisible()

    def sees_a_stopped_run(self, session: str, reason: str) -> None:
        """What was recorded until then is there, and its state is none of success or failure."""
        window = self.window
        ended(self.qtbot, window, 1, self.made)
        assert window.top.badge.text() == "STOPPED"
        assert window.result.verdict.text() == "STOPPED"
        assert window.top.sentence.text() == reason
        assert reason in window.result.notes.text()
        assert float(result(window)["normal force"][0]) == pytest.approx(0.1, abs=0.005)
        assert about(self.folder / session) == ("stopped", "PDMS 7", 0.1)

    def sees_a_complete_run(self, session: str) -> None:
        window = self.window
        ended(self.qtbot, window, 2, self.made)
        assert window.top.badge.text() == "DONE"
        assert window.result.verdict.text() == "COMPLETE"
        assert "The drive of 20 µm is complete" in window.top.sentence.text()
        assert float(result(window)["normal force"][0]) == pytest.approx(0.08, abs=0.004)
        assert about(self.folder / session) == ("done", "PDMS 8", 0.08)
        assert window.top.start.isEnabled()

    def compare(self) -> None:
        """Both sessions side by side, with their loads."""
        sessions = self.window.sessions
        assert sessions is not None
        self.qtbot.waitUntil(lambda: is_listed(self.window, "first.h5", "second.h5"))
        self.hand.pick(sessions.list, "first.h5", "second.h5")
        self.hand.press(sessions.compare_button)
        self.qtbot.waitUntil(lambda: len(sessions.comparisons) == 1)
        (view,) = sessions.comparisons
        self.qtbot.waitUntil(view.isActiveWindow)
        table = view.table
        heads = [table.horizontalHeaderItem(k).text() for k in (2, 3)]
        loads = next(
            [table.item(k, j).text() for j in (2, 3)]
            for k in range(table.rowCount())
            if table.item(k, 0).text() == "normal force"
        )
        found = {head.split("\n")[0]: float(at) for head, at in zip(heads, loads, strict=True)}
        assert found == {
            "first": pytest.approx(0.1, abs=0.005),
            "second": pytest.approx(0.08, abs=0.004),
        }

    def export(self) -> None:
        """The summary of the second run as a table, and where it is."""
        sessions = self.window.sessions
        assert sessions is not None
        form = sessions.export_form
        self.hand.pick(sessions.list, "second.h5")
        self.hand.press(sessions.export)
        self.qtbot.waitUntil(form.isVisible)
        kind = next(
            form.kind.itemText(k)
            for k in range(form.kind.count())
            if form.kind.itemText(k).startswith("summary ")
        )
        self.hand.choose(form.kind, kind)
        self.hand.press(form.begin_button)
        path = self.folder / "second-summary.csv"
        self.qtbot.waitUntil(lambda: "Written" in sessions.said.text())
        assert str(path) in sessions.said.text()
        with path.open(encoding="utf-8", newline="") as file:
            assert any("mu_s" in cell for row in csv.reader(file) for cell in row)

    def sees_the_replay(self) -> None:
        window = self.window
        self.qtbot.waitUntil(
            lambda: window.top.badge.text().startswith("REPLAY") and window._view is not None
        )
        assert window.playback.isVisible()
        assert "replay of second.h5" in window.top.title.text()

    def sees_frame(self, number: int) -> None:
        window = self.window
        self.qtbot.waitUntil(
            lambda: (
                window._view.charts.cursor is not None
                and window._view.charts.cursor.frame == number
                and window.top.badge.text() == "REPLAY: PAUSED"
            )
        )
        assert f"frame {number} " in window.playback.number.text()
        # it may still be compiling
        self.qtbot.waitUntil(lambda: window.top.sentence.text().startswith("At t = "))

    def sees_all_closed(self) -> None:
        """The window is gone, and what is in the folder is what was recorded and exported."""
        self.qtbot.waitUntil(lambda: not self.window.isVisible())
        kept = {path.name for path in self.folder.iterdir()}
        assert {"first.h5", "second.h5", "second-summary.csv"} <= kept
        assert not {name for name in kept if "unfinished" in name or name.startswith("third")}


@pytest.mark.slow
def test_an_evening_by_mouse(qtbot: QtBot, window: MainWindow, made: list) -> None:
    mouse = Mouse(qtbot, window)
    evening = Evening(qtbot, window, made, mouse)
    evening.connect()
    evening.set_up("0.1", "PDMS 7", "first")
    mouse.click(window.top.start)
    evening.sees_a_run()

    # another field, and a plot that is zoomed by the wheel, moved, and shown whole again
    mouse.choose(window.interface.which, "raw")
    qtbot.waitUntil(lambda: window.interface.field is None)
    (loading,) = (cell for cell in window.curves.cells if cell.key == "loading")
    mouse.wheel(loading.plot.viewport())
    assert loading.plot.is_zoomed
    mouse.click(loading.show_all)
    assert not loading.plot.is_zoomed

    mouse.click(window.top.stop)
    evening.sees_a_stopped_run("first.h5", "The operator ended the run")

    evening.set_up("0.08", "PDMS 8", "second")
    mouse.type(window.setup.row("run.travel").editor, "20")
    mouse.click(window.top.start)
    evening.sees_a_complete_run("second.h5")

    mouse.go_to("sessions")
    mouse.click(window.sessions.folder)
    dialog = asked(qtbot, window)
    mouse.click(dialog.findChild(QDialogButtonBox).buttons()[0])
    evening.compare()
    window.activateWindow()
    evening.export()
    mouse.click(window.sessions.play_button)
    evening.sees_the_replay()
    mouse.click(window.playback.first)
    first = int(made[-1].source.timeline.frames[0])
    evening.sees_frame(first)
    mouse.click(window.playback.forward)
    evening.sees_frame(first + 1)
    window.close()
    evening.sees_all_closed()


def test_an_evening_by_keyboard_alone(qtbot: QtBot, window: MainWindow, made: list) -> None:
    keyboard = Keyboard(qtbot, window)
    key = keyboard.key
    key(Qt.Key.Key_F1)
    qtbot.waitUntil(lambda: isinstance(QApplication.activeWindow(), KeyList))
    listed = words(QApplication.activeWindow())
    assert all(one in listed for act in ACTS for one in act.keys)
    assert all(one in listed for one in GO_TO.values())

    evening = Evening(qtbot, window, made, keyboard)
    evening.connect()
    evening.set_up("0.1", "PDMS 7", "first")
    key(Qt.Key.Key_F5)
    evening.sees_a_run()

    key(Qt.Key.Key_P, CTRL)
    keyboard.choose(window.interface.which, "raw")
    qtbot.waitUntil(lambda: window.interface.field is None)
    (loading,) = (cell for cell in window.curves.cells if cell.key == "loading")
    keyboard.go_to("curves")
    keyboard.tab_to(loading.plot)
    keyboard.keys("+")
    assert loading.plot.is_zoomed
    keyboard.keys("r")
    assert not loading.plot.is_zoomed

    key(Qt.Key.Key_Escape)
    wait_for_words(qtbot, window, "the simulated actuator is at rest")
    evening.sees_a_stopped_run("first.h5", "STOP MOTION was pressed")
    keyboard.press(window.notice.no)
    assert not window.notice.isVisible()

    evening.set_up("0.08", "PDMS 8", "second")
    keyboard.go_to("setup")
    keyboard.type(window.setup.row("run.travel").editor, "20")
    key(Qt.Key.Key_F5)
    evening.sees_a_complete_run("second.h5")
    keyboard.go_to("result")
    keyboard.press(window.result.copy_csv)
    assert "mu_s" in QGuiApplication.clipboard().text()

    keyboard.go_to("sessions")
    keyboard.press(window.sessions.folder)
    asked(qtbot, window)
    keyboard.keys(str(Path.cwd()))
    key(Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: QApplication.activeWindow() is None)
    window.activateWindow()  # as the desktop does, which is not here
    qtbot.waitUntil(window.isActiveWindow)
    evening.compare()
    keyboard.go_to("sessions")  # from the window of the comparison
    qtbot.waitUntil(window.isActiveWindow)
    evening.export()
    keyboard.pick(window.sessions.list, "second.h5")
    key(Qt.Key.Key_Return)
    evening.sees_the_replay()
    key(Qt.Key.Key_P, CTRL)
    key(Qt.Key.Key_Home)
    first = int(made[-1].source.timeline.frames[0])
    evening.sees_frame(first)
    key(Qt.Key.Key_Right)
    evening.sees_frame(first + 1)
    key(Qt.Key.Key_Escape)
    recorded = "STOP MOTION: nothing was sent, because this is recorded"
    qtbot.waitUntil(lambda: window.notice.text.text().startswith(recorded))
    key(Qt.Key.Key_Q, CTRL)
    evening.sees_all_closed()
