"""The time line of a replay in use: by mouse and by keys, which act nowhere else."""

import threading
from types import SimpleNamespace

import h5py
import pytest
import short_run
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QLineEdit, QPushButton, QSlider, QVBoxLayout, QWidget
from scripted_run import ScriptedRun
from set_up_hands import write
from sparse_session import sparse_copy
from whole_runs import recorded, replayed
from window_hands import click, look

from app.gui.cells import Tone
from app.gui.playback_bar import PlaybackBar
from app.gui.result_panel import ResultPanel
from app.replay.reanalysis import Reanalysis
from app.replay.replay import Replay
from app.runs.run_source import Kind
from app.session.reader import SessionReader

LEFT = Qt.MouseButton.LeftButton
SKIPPED, LOST, LAST = 45, 50, 62


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The shortest run."""
    path = tmp_path_factory.mktemp("bar") / "a.h5"
    recorded(path, *short_run.SHORT, "stress.method=none", "dic.threads=1")
    return path


@pytest.fixture(scope="module")
def session(whole):
    """The same, of which a frame was not analysed and one not received."""
    return sparse_copy(whole, whole.with_name("run.h5"), [SKIPPED], [LOST])


@pytest.fixture
def replay(session, qtbot):
    """A replay that has played 20 frames and stands."""
    replay = Replay(session, pace=1.0)
    replay.playback.pause()
    replay.start()
    for _ in range(20):
        replay.playback.step()
    qtbot.waitUntil(lambda: len(replay.look(0).snapshots) == 20)
    yield replay
    replay.request_stop("the test is over")
    replay.wait(60)
    replay.browser.close()


class HostWindow(QWidget):
    """A bar beside a text field and a picture that shares its keys."""

    def __init__(self):
        super().__init__()
        self.bar, self.text, self.picture = PlaybackBar(), QLineEdit(), QWidget()
        self.picture.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.picture.setMinimumHeight(50)
        self.bar.add_keys(self.picture)
        self.button, self.slider = QPushButton("Zero"), QSlider(Qt.Orientation.Horizontal)
        layout = QVBoxLayout(self)
        for widget in (self.picture, self.text, self.button, self.slider, self.bar):
            layout.addWidget(widget)
        self.resize(1000, 320)


@pytest.fixture
def host(qtbot, replay):
    host = HostWindow()
    host.bar.attach(replay)
    with qtbot.waitActive(host):
        host.show()
        host.activateWindow()
    yield host
    host.close()
    host.deleteLater()


def test_the_frame_that_is_shown_is_at_its_forces_also_before_the_drive(replay):
    chart = look(replay).charts["forces"]
    assert chart.x_label == "time t from the start of the drive (s)"
    newest = chart.lines[0].x[-1]
    assert newest < 0
    assert chart.guides[-1].text == "19"
    assert chart.guides[-1].value == pytest.approx(newest, abs=0.1)


@pytest.mark.parametrize("where", ["picture", "strip"])
def test_keys_move_through_the_frames_where_they_are_shown(qtbot, host, replay, where):
    widget = host.picture if where == "picture" else host.bar.strip
    widget.setFocus()
    assert (replay.frame, host.bar.number.value()) == (19, 19)
    qtbot.keyClick(widget, Qt.Key.Key_Left)
    qtbot.keyClick(widget, Qt.Key.Key_Left)
    assert (replay.frame, host.bar.number.value()) == (17, 17)
    qtbot.keyClick(widget, Qt.Key.Key_Right)
    assert replay.frame == 18
    qtbot.keyClick(widget, Qt.Key.Key_End)
    assert (replay.frame, host.bar.number.value()) == (LAST, LAST)
    qtbot.keyClick(widget, Qt.Key.Key_Home)
    assert replay.frame == 0
    qtbot.keyClick(widget, Qt.Key.Key_Space)
    assert replay.is_playing
    assert host.bar.play.text() == "Pause"
    qtbot.keyClick(widget, Qt.Key.Key_Space)
    assert not replay.is_playing


def test_keys_are_left_to_a_text_field(qtbot, host, replay):
    host.text.setFocus()
    qtbot.keyClicks(host.text, "a b")
    qtbot.keyClick(host.text, Qt.Key.Key_Left)
    qtbot.keyClick(host.text, Qt.Key.Key_Home)
    qtbot.keyClicks(host.text, "c ")
    assert host.text.text() == "c a b"
    assert (replay.frame, replay.is_playing, replay.is_browsing) == (19, False, False)


def test_keys_are_left_to_buttons_and_sliders(qtbot, host, replay):
    pressed = []
    host.button.clicked.connect(lambda: pressed.append(1))
    host.button.setFocus()
    qtbot.keyClick(host.button, Qt.Key.Key_Space)
    host.slider.setFocus()
    qtbot.keyClick(host.slider, Qt.Key.Key_Right)
    assert (len(pressed), host.slider.value()) == (1, 1)
    assert (replay.frame, replay.is_playing, replay.is_browsing) == (19, False, False)


def test_a_click_on_the_time_line_shows_the_frame_of_that_time(qtbot, host, replay):
    strip, line = host.bar.strip, replay.timeline
    for frame in (40, 3):
        sample = float(line.samples[line.row_of(frame)])
        place = QPoint(round(strip.x_of(sample)), 20)
        qtbot.mouseClick(strip, LEFT, pos=place)
        assert abs(replay.frame - frame) <= 1
    qtbot.mouseClick(strip, LEFT, pos=QPoint(strip.width() - 2, 20))
    assert replay.frame == LAST
    assert host.bar.place.text().endswith("slide · recorded")


def test_the_number_that_is_typed_is_that_of_the_recorded_frame(qtbot, host, replay):
    field = host.bar.number
    write(qtbot, field, "37", Qt.Key.Key_Return)
    assert replay.frame == 37
    view = look(replay)
    assert view.charts.cursor.frame == 37
    assert "frame 37" in view.frame.field("ux_um").caption
    assert field.text() == "frame 37 of 0 to 62"
    write(qtbot, field, str(LOST), Qt.Key.Key_Return)  # it has no image: the nearest one
    assert replay.frame in (LOST - 1, LOST + 1)
    assert field.value() == replay.frame


def test_play_goes_on_from_the_frame_that_is_shown(qtbot, host, replay, monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: clock.now_s, now_s=1000.0)
    monkeypatch.setattr("app.replay.playback.time", clock)
    host.bar.show_frame(30)
    click(qtbot, host.bar.play)
    clock.now_s += 0.26  # eight frames a second
    qtbot.waitUntil(lambda: host.bar.number.value() == 32)
    click(qtbot, host.bar.play)
    clock.now_s += 60
    host.bar.refresh()
    assert replay.frame == host.bar.number.value() == 32


def test_a_frame_that_was_not_analysed_is_shown_and_analysed_on_request(qtbot, host, replay):
    host.bar.show_frame(SKIPPED)
    assert host.bar.place.text().endswith("not analysed")
    view = look(replay)
    assert (view.frame, view.charts.cursor.frame) == (None, SKIPPED)
    assert view.sentence.endswith("(This frame was not analysed during the run.)")
    with SessionReader(replay.path) as recorded:
        assert (view.image.full == recorded.frame(SKIPPED)[2]).all()
        shear = [recorded.snapshot(k).conditions.shear_force_n for k in (SKIPPED - 1, SKIPPED)]
    assert min(shear) - 1e-3 < view.charts.cursor.shear_n < max(shear) + 1e-3
    click(qtbot, host.bar.analyse)
    qtbot.waitUntil(lambda: replay.has_results(SKIPPED))
    qtbot.waitUntil(lambda: not host.bar.analyse.isVisible())
    view = look(replay)
    assert f"frame {SKIPPED}" in view.frame.field("ux_um").caption
    assert "not analysed" not in view.sentence


def test_a_frame_before_the_reference_can_not_be_analysed_and_says_so(qtbot, host, replay):
    said = []
    host.bar.said.connect(lambda sentence, _: said.append(sentence))
    replay.has_results = lambda frame: False
    host.bar.show_frame(2)
    click(qtbot, host.bar.analyse)
    qtbot.waitUntil(lambda: bool(said))
    assert "frame 2 was exposed before a reference was taken" in said[0]
    assert host.bar.analyse.isEnabled()


def test_what_is_still_analysed_of_one_replay_is_not_waited_for_in_the_next(qtbot, host, replay):
    goes_on, is_over, said = threading.Event(), threading.Event(), []

    def slow(frame):
        goes_on.wait(60)
        is_over.set()
        raise OSError("the disk is gone")

    replay.analyse = slow
    host.bar.said.connect(lambda sentence, _: said.append(sentence))
    host.bar.show_frame(SKIPPED)
    click(qtbot, host.bar.analyse)
    assert not host.bar.analyse.isEnabled()
    host.bar.attach(replay)  # as another one
    assert host.bar.analyse.isEnabled()
    assert host.bar.analyse.text() == "Analyse this frame"
    goes_on.set()
    qtbot.waitUntil(is_over.is_set)
    qtbot.wait(100)
    assert said == []


def test_the_verdict_of_the_replay_is_shown_at_its_end(qtbot, host, whole):
    replay, bar = Replay(whole, pace=1.0), host.bar
    bar.attach(replay)
    bar.pace.setFocus()
    qtbot.keyClick(bar.pace, Qt.Key.Key_End)
    assert (bar.pace.currentText(), replay.playback.pace) == ("max", None)
    assert bar.verdict.text() == ""
    replay.start()
    qtbot.waitUntil(lambda: replay.outcome() is not None)
    bar.refresh()
    assert bar.verdict.text() == "the replay agrees to the bit"
    assert "63 of 63 frames gave the recorded results" in bar.verdict.toolTip()
    view = look(replay)
    assert view.agreement.agrees
    assert "agrees to the bit" in view.sentence
    replay.browser.close()


def test_a_pace_of_the_command_line_stands_among_the_others(qtbot, session):
    bar, paces = PlaybackBar(), []
    qtbot.addWidget(bar)
    for pace in (3.0, 0.25, None, 3.0):
        replay = Replay(session, pace=pace)
        bar.attach(replay)
        paces.append(bar.pace.currentText())
        bar.pace.activated.emit(bar.pace.currentIndex())
        assert replay.playback.pace == pace
    bar.attach(None)
    assert paces == ["3 x", "0.25 x", "max", "3 x"]
    assert [bar.pace.itemText(n) for n in range(4, 7)] == ["2 x", "3 x", "5 x"]


def test_a_replay_that_differs_says_in_what(whole, tmp_path, qtbot):
    path = tmp_path / "altered.h5"
    path.write_bytes(whole.read_bytes())
    with h5py.File(path, "r+") as file:
        file["entry/results/centre_ux"][40] += 1e-6
    replay = replayed(path)
    view = look(replay)
    assert not view.agreement.agrees
    with SessionReader(path) as recorded:
        frame = recorded.analysed_frames()[40]
    assert f"first difference: frame {frame}: results/centre_ux" in view.agreement.sentences
    bar = PlaybackBar()
    bar.attach(replay)
    assert bar.verdict.text() == "the replay differs"
    assert "differs: 62 of 63" in bar.verdict.toolTip()
    assert "centre_ux" in bar.verdict.toolTip()
    bar.deleteLater()
    replay.browser.close()


def test_a_replay_is_unmistakable_and_speaks_of_the_past(replay, session, tmp_path):
    view = look(replay)
    assert (view.kind, view.tone, view.badge) == (Kind.REPLAY, Tone.REPLAY, "REPLAY: PAUSED")
    assert view.behind == 0  # frames still to be replayed do not make the window rest
    replay.show(40)
    view = look(replay)
    with SessionReader(session) as recorded:
        now = recorded.snapshot(40).conditions
        events = recorded.events()
    drive = next(e.sample for e in events if e.kind == "phase" and e.text == "drive")
    t, way = now.time_s, now.travel_m * 1e6
    assert view.sentence == (
        f"At t = {t:.2f} s of the recording the actuator pulled at 5 µm/s: {way:.0f} of 22 µm."
    )
    assert (view.charts.cursor.travel_um, view.charts.cursor.shear_n) == (way, now.shear_force_n)
    assert view.charts.cursor.time_s == pytest.approx(now.time_s)
    replay.show(2)
    first = look(replay)
    assert first.sentence.startswith(f"At t = −{(drive - 255) / 1000:.2f} s of the recording the")
    assert "hung free" in first.sentence
    live_run = look(ScriptedRun(320, 240))
    assert (live_run.kind, live_run.badge, live_run.charts.cursor) == (Kind.LIVE, "IDLE", None)
    copy = tmp_path / session.name
    copy.write_bytes(session.read_bytes())
    analysis = Reanalysis(copy, tmp_path / "again.h5", pace=None, overrides=["dic.box=28"])
    assert look(analysis).badge.startswith("ANALYSIS")


def test_a_replay_on_a_small_screen_leaves_room_for_its_picture(qtbot, open_window, replay):
    window = open_window(replay)
    window.showNormal()
    window.resize(960, 540)  # 1920 x 1080 in scale 2
    qtbot.waitUntil(lambda: window.playback.isVisible() and window._view is not None)
    bar = window.playback
    qtbot.waitUntil(lambda: bar.width() == window.width())
    assert window.interface.canvas.box.height() > 120
    assert bar.height() < 80
    parts = (bar.strip, bar.play, bar.number, bar.place)
    places = [one.rect().translated(one.mapTo(bar, one.rect().topLeft())) for one in parts]
    assert all(bar.rect().contains(place) for place in places)
    assert min(place.width() for place in places) >= 40


def test_a_live_run_has_no_time_line(window):
    assert not window.playback.isVisible()


def test_what_can_not_be_browsed_yet_is_switched_off(qtbot, session, tmp_path):
    copy = tmp_path / session.name
    copy.write_bytes(session.read_bytes())
    analysis = Reanalysis(copy, tmp_path / "again.h5", pace=None)
    bar = PlaybackBar()
    bar.attach(analysis)
    bar.show()
    assert not bar.strip.isEnabled()
    bar._move(-1)
    assert not analysis.is_browsing
    analysis.start()
    assert analysis.wait(100).state == "done"
    bar.refresh()
    assert bar.strip.isEnabled()
    bar.show_frame(SKIPPED)  # which has results now
    assert (analysis.frame, bar.place.text().endswith("recorded")) == (SKIPPED, True)
    analysis.browser.close()
    bar.deleteLater()


def test_what_was_where_is_told_by_the_pointer(host, replay):
    strip, line = host.bar.strip, replay.timeline
    lost = next(mark for mark in line.marks if mark.kind == "loss")
    assert "frame 50: no image came" in strip.describe(strip.x_of(lost.sample))
    assert strip.describe(strip.x_of(100)).endswith("background")
    assert QGuiApplication.focusObject() is not None


def test_the_result_of_a_stopped_replay_says_that_it_is_of_a_part(qtbot, replay):
    replay.request_stop("the operator ended the run")
    qtbot.waitUntil(lambda: replay.outcome() is not None)
    panel = ResultPanel()
    qtbot.addWidget(panel)
    panel.show_view(look(replay))
    assert panel.verdict.text() == "STOPPED"
    part = f"20 analysed frames were replayed of {len(replay._frames)}, and the numbers are of"
    assert part in panel.notes.text()
    assert "20 of 20 frames gave the recorded results" in panel.notes.text()
