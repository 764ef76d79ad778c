"""Each fault of each device, as the operator is told of it: badge, sentence, the light at the foot,
the result card, the losses by name, and the sound.
"""

import re
import shutil
from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import short_run
from operators import large
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import wait_for_end
from workshops import Makes

from app.gui.cells import Tone
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.bench_view import Health
from app.runs import live
from app.session.files import RESERVE_BYTES
from app.session.reader import SessionReader
from app.settings import config
from drivers.errors import DeviceFault, DeviceNotFound

SETTINGS = (
    *short_run.SMALL,
    *("camera.width=320", "camera.height=240", "camera.pixel=24", "dic.step=30"),
    *("camera.divisor=250", "run.travel=20"),
)
COUNTED = "forces.exposure_counter=ctr1"
DRIVE = 2000  # a sample of the drive
COMPLETE = "The drive of 20 µm is complete"


@pytest.fixture(scope="module")
def window(
    window_thread: None, qapp: QApplication, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[MainWindow]:
    """A window that goes through all these runs, as in an evening without luck."""
    folder = str(tmp_path_factory.mktemp("memory"))
    QSettings.setPath(QSettings.Format.IniFormat, QSettings.Scope.UserScope, folder)
    made = MainWindow(model=WindowModel(Makes(lambda: None), config.load(None, SETTINGS)))
    large(made)
    yield made
    made._must_close = True
    made.close()
    made.deleteLater()


@pytest.fixture
def shows(
    qtbot: QtBot, window: MainWindow, beeps: list[str]
) -> Iterator[Callable[[Any], MainWindow]]:
    """Begins a run in the window."""
    begun: list[Any] = []

    def show(run: Any) -> MainWindow:
        begun.append(run)
        window.model.factory._make = lambda: run
        window._logs.take()
        window.begin()
        qtbot.waitUntil(lambda: window.source is run)
        return window

    yield show
    for run in begun:
        run.request_stop("the test is over")
        wait_for_end(qtbot, window)


@pytest.fixture
def ended(
    qtbot: QtBot, shows: Callable[[Any], MainWindow], tmp_path: Path
) -> Callable[..., tuple[MainWindow, Any]]:
    """Runs in the window with some settings and a bench that was tampered with."""

    def run_of(*settings: str, spoil: Callable[[Any], None] = lambda _bench: None):
        run = live.make_run(config.load(None, (*SETTINGS, *settings)), tmp_path / "x.h5", pace=None)
        spoil(run._bench)
        window = shows(run)
        qtbot.waitUntil(
            lambda: window.outcome() is not None and window.result.heading.text() == "Result"
        )
        window.docks.show("health")
        return window, run

    return run_of


def health(window: MainWindow, name: str) -> tuple[str, str]:
    """A number of the health panel, and why it is what it is."""
    (view,) = (one for one in window.health.cells.views if one.name.text() == name)
    return view.value.text(), view.toolTip()


def light(window: MainWindow) -> tuple[str, str]:
    return window.strip.light.toolTip(), window.strip.sentence.text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "settings", "lost", "why"),
    [
        ("lost-trigger 12 3", (), 3, "missed trigger"),
        ("lost-frame 12", (), 1, "lost on its way"),
        (f"daq-overflow {DRIVE + 7} 300", ("forces.on_overflow=continue",), 300, "overwritten"),
    ],
)
def test_what_is_lost_is_red_by_name_and_the_run_is_done(ended, beeps, fault, settings, lost, why):
    window, _ = ended(f"sim.faults=['{fault}']", *settings)
    name = "samples lost" if "daq" in fault else "frames lost"
    value, hint = health(window, name)
    assert value == str(lost)
    assert why in hint
    assert f"{lost} ×" in hint
    tone, sentence = light(window)
    assert tone == Tone.BAD.name.lower()
    assert sentence.startswith(f"{lost} ")
    assert why in sentence
    assert window.top.badge.text() == "DONE"
    assert window.top.sentence.text() == COMPLETE
    assert not beeps


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "settings"),
    [
        ("late-trigger 12 7", (COUNTED,)),
        ("uncounted-exposure 12", (COUNTED,)),
        ("exposure-wire 12", (COUNTED,)),
        ("exposure-inverted 0", (COUNTED,)),
    ],
)
def test_what_costs_nothing_is_no_alarm(ended, beeps, fault, settings):
    window, run = ended(f"sim.faults=['{fault}']", *settings)
    assert window.top.badge.text() == "DONE"
    assert window.result.verdict.text() == "COMPLETE"
    counts = run.outcome().counts
    assert (counts.frames_lost, counts.samples_lost) == (0, 0)
    tone, sentence = light(window)
    is_uncertain = run.health().uncertain > 0
    assert tone == (Tone.WARN if is_uncertain else Tone.GOOD).name.lower()
    assert ("may be of another trigger" if is_uncertain else "none lost") in sentence
    assert not beeps


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "words"), [(12, "A picture is damaged"), (6, "pictures are damaged")]
)
def test_a_damaged_picture_is_told_and_costs_nothing(ended, beeps, frame, words):
    """Of one in the drive, half of its points; of the reference, half of those of all others."""
    window, run = ended(f"sim.faults=['corrupt-frame {frame}']")
    assert window.top.badge.text() == "DONE"
    tone, sentence = light(window)
    assert tone == Tone.WARN.name.lower()
    assert words in sentence
    assert f"frame {frame if frame != 6 else run.outcome().counts.triggers - 1}: " in sentence
    assert re.search(r"[45]\d% of its points could not be measured", sentence)
    assert run.outcome().counts.frames_lost == 0
    assert f"camera: {run.health().damage}" in run.outcome().summary.notes
    assert not beeps


def failing(error: Exception) -> Callable[..., Any]:
    def call(*_args: Any, **_more: Any) -> Any:
        raise error

    return call


NOT_THERE = DeviceNotFound("board Dev1: there is no such board; check its name")
REFUSED = DeviceFault("SMC100: the move was refused in this state; home it")


@pytest.mark.parametrize(
    ("fault", "device", "method", "error", "words"),
    [
        ("camera-gone 12", "", "", None, "unplugged at trigger 12"),
        (f"daq-overflow {DRIVE + 7} 300", "", "", None, "300 samples from 2007 on are lost"),
        ("end-of-run 10", "", "", None, "met its end switch after 10 µm"),
        ("", "forces", "open", NOT_THERE, str(NOT_THERE)),
        ("", "actuator", "move_to", REFUSED, str(REFUSED)),
        ("", "camera", "read", RuntimeError("no such pixel format"), "no such pixel format"),
    ],
)
def test_a_device_that_fails_is_named_heard_and_loses_no_data(
    ended, beeps, tmp_path, fault, device, method, error, words
):
    """One of each kind; all that fails is in tests/engine/test_faults.py."""
    window, run = ended(
        "recording.results=forces",
        *([f"sim.faults=['{fault}']"] if fault else []),
        spoil=lambda bench: (
            setattr(getattr(bench, device), method, failing(error)) if device else None
        ),
    )
    assert window.top.badge.text() == "FAILED"
    said = window.top.sentence.text()
    assert words[1:] in said  # a sentence begins with a capital
    assert said in window.result.notes.text()
    assert window.result.verdict.text() == "FAILED"
    assert beeps
    assert window.top.sentence.objectName() == window.top.place.objectName() == "fault"
    if fault.startswith("camera-gone"):
        assert re.fullmatch(
            r"simulated actuator is at rest at \d+\.\d{4} mm", window.top.place.text()
        )
    tone, sentence = light(window)
    assert tone == Tone.BAD.name.lower()
    assert "All is well" not in sentence
    assert window.top.start.isEnabled()
    counts, path = run.outcome().counts, tmp_path / "x.h5"
    if counts.samples:
        with SessionReader(path) as read:
            assert read.outcome.state == "failed"
            assert read.forces().volts.shape[0] == counts.samples + counts.samples_lost
    shown = "\n".join(text for _, text in window._logs.take())
    assert words[1:] in shown.replace("um", "µm")


# ------------------------------------------------------------------ the disk


def test_a_full_disk_is_told(
    qtbot: QtBot,
    shows: Callable[[Any], MainWindow],
    tmp_path: Path,
    beeps: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usage, run = (
        namedtuple("usage", "total used free"),
        live.make_run(config.load(None, SETTINGS), tmp_path / "x.h5", pace=None),
    )

    def free(_: object) -> Any:
        is_driving = run._experiment.phase == "drive"
        return usage(1 << 40, 0, RESERVE_BYTES if is_driving else 1 << 40)

    monkeypatch.setattr(shutil, "disk_usage", free)
    window = shows(run)
    wait_for_end(qtbot, window)
    assert window.top.badge.text() == "FAILED"
    assert "the disk is full, 34 MB are left; make room" in window.top.sentence.text()
    assert beeps == ["beep"]


class Slow(ScriptedRun):
    """A run whose disk is slower than its data."""

    fill = 0.6

    def health(self) -> Health:
        return replace(super().health(), queue_fill=self.fill)


@pytest.mark.parametrize(("fill", "tone"), [(0.6, "warn"), (0.9, "bad")])
def test_a_disk_that_falls_behind_is_told_before_the_run_ends(
    qtbot: QtBot, shows: Callable[[Any], MainWindow], fill: float, tone: str
) -> None:
    run = Slow(320, 240, frames=60)
    run.fill = fill
    window = shows(run.at(30))
    waiting = f"{4 * fill:.1f} of 4.0 s"
    qtbot.waitUntil(lambda: f"{waiting} wait to be recorded" in window.strip.sentence.text())
    assert window.strip.light.toolTip() == tone
    assert "The disk is slower than the data" in window.top.sentence.text()
    assert window.top.badge.text() == "RUNNING"
