"""A thread of a run that dies, at its first line or in the drive: nobody waits for it, and the run
ends by name with a session that can be read.
"""

import shutil
import threading
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from processes.launched import wait_until
from short_run import BLIND, SMALL

from app.acquisition import analysis_thread, receiver, recorder_thread as recorder
from app.acquisition.channels import LatestChannel
from app.acquisition.ending import Ending
from app.evaluation.history import History
from app.records.record_types import Phase, Samples
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from app.system import priority
from drivers.errors import DeviceTimeout
from drivers.protocols import Frame, LostFrame, TriggerTrain

TIMEOUT = 60
THREADS = ("recorder", "journal", "sync-0", "camera", "analysis")


class Vanished(BaseException):
    """What no `except Exception` sees, as a library that calls `sys.exit` raises."""


def is_thread(name):
    return threading.current_thread().name == f"slipscope-{name}"


def dying(method, name, error, when=lambda: True):
    """The method, which raises instead in the thread of that name."""

    def call(*arguments, **options):
        if is_thread(name) and when():
            raise error
        return method(*arguments, **options)

    return call


def ended(run):
    run.start()
    outcome = run.wait(TIMEOUT)
    assert outcome is not None, "the run did not end"
    assert run.health().state == outcome.state
    return outcome


def made(path, pace, *overrides):
    return live.make_run(config.load(None, [*SMALL, *BLIND, *overrides]), path, pace=pace)


def kill_in_sink(run, name, error, when):
    """Let the thread die as it hands something to the session."""
    create = run._create_sink

    def created():
        sink = create()
        sink.append = dying(sink.append, name, error, when)
        return sink

    run._create_sink = created


def accounted(path, outcome):
    """Whether the session can be read, and its account holds."""
    counts = outcome.counts
    with SessionReader(path) as session:
        assert session.outcome.state == outcome.state
        assert len(list(session.frames())) == counts.frames_recorded
        session.forces()
        session.events()
    assert counts.triggers == counts.frames_recorded + counts.frames_lost
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "pace"), [(PermissionError(13, "not you"), None), (Vanished("away"), 1.0)], ids=repr
)
@pytest.mark.parametrize("name", THREADS)
def test_a_thread_that_dies_at_its_first_line_ends_the_run_by_name(
    tmp_path, monkeypatch, name, error, pace
):
    for module in (recorder, receiver, analysis_thread):
        monkeypatch.setattr(module, "give_way", dying(priority.give_way, name, error))
    run = made(tmp_path / "a.h5", pace)
    if name == "journal":
        kill_in_sink(run, name, error, lambda: True)
    outcome = ended(run)
    assert outcome.state == "failed"
    assert str(error) in outcome.reason
    assert accounted(tmp_path / "a.h5", outcome)


@pytest.mark.parametrize(
    ("error", "pace"), [(PermissionError(13, "not you"), None), (Vanished("away"), 20.0)], ids=repr
)
@pytest.mark.parametrize("name", ["recorder", "journal"])
def test_a_recorder_that_dies_in_the_drive_stops_it(tmp_path, name, error, pace):
    run = made(tmp_path / "a.h5", pace)
    in_drive = lambda: run._experiment.phase is Phase.DRIVE  # noqa: E731
    kill_in_sink(run, name, error, in_drive)
    outcome = ended(run)
    said = "recorder: the session cannot be written: [Errno 13] not you"
    if isinstance(error, Vanished):
        said = f"{name}: Vanished: away"
    assert (outcome.state, outcome.reason) == ("failed", said)
    assert accounted(tmp_path / "a.h5", outcome)
    assert 0 <= run._bench.world.stage_m() < 60e-6


def test_the_memory_that_can_not_be_read_costs_no_frame(tmp_path, monkeypatch):
    def unknown():
        raise psutil.AccessDenied(1)

    hidden = SimpleNamespace(Process=unknown, Error=psutil.Error)
    monkeypatch.setattr(recorder, "psutil", hidden)
    outcome = ended(made(tmp_path / "a.h5", None, "run.travel=5"))
    assert outcome.state == "done"
    assert accounted(tmp_path / "a.h5", outcome)


def test_looking_at_a_run_asks_the_disk_nothing(tmp_path, monkeypatch):
    """A disk that stands still would hold up whoever looks."""
    run, asked = made(tmp_path / "a.h5", None, "run.travel=5"), []
    monkeypatch.setattr(recorder, "free_bytes", lambda path: asked.append(path.parent) or 7)
    assert run.health().disk_free_bytes == -1
    assert ended(run).state == "done"
    with monkeypatch.context() as standing:
        standing.setattr(shutil, "disk_usage", lambda path: 1 / 0)
        assert run.health().disk_free_bytes == 7
    assert {*asked} == {tmp_path}


@pytest.mark.parametrize("sender_waits", [True, False])
@pytest.mark.parametrize("kind", ["images", "forces"])
def test_nobody_waits_for_a_recorder_that_died(kind, sender_waits):
    """Its queue is full when it dies: who hands over is let go, and every frame is counted."""
    may_die, put = threading.Event(), []

    def die(record):
        may_die.wait(TIMEOUT)
        raise Vanished("away")

    told = []
    sink = SimpleNamespace(append=die, syncs=())
    made = recorder.Recorder(sink, 1.0, 100, 1.0, sender_waits=sender_waits, on_failure=told.append)
    image = np.zeros((20, 20), np.uint8)
    volts = np.zeros((recorder.SMALL_QUEUE_BYTES // 16, 2))  # one block fills the queue
    records = [
        Frame(n, n, image) if kind == "images" else Samples(n, volts, volts) for n in range(4)
    ]

    def send():
        for record in records:
            made.append(record)
            put.append(record)

    works = dict(made.works())
    ending = Ending(lambda: None)
    dying = ending.spawn("recorder", works["recorder" if kind == "images" else "journal"])
    sending = threading.Thread(target=send, daemon=True)
    sending.start()
    wait_until(lambda: len(put) == 2)  # one is in the hands of the thread, one waits
    may_die.set()
    for thread in (sending, dying):
        thread.join(TIMEOUT)
        assert not thread.is_alive()
    assert ending.failed
    assert "Vanished: away" in ending.reason
    assert made.frames_refused == (4 if kind == "images" else 0)
    assert bool(told) == (not sender_waits)


def test_no_image_is_recorded_after_one_that_could_not_be(tmp_path):
    """The disk may have room again by then; the images before it stay without a gap."""
    taken = []

    def append(record):
        if isinstance(record, Frame) and record.index == 1:
            raise OSError(28, "No space left")
        taken.append(record)

    sink = SimpleNamespace(append=append, syncs=(), path=tmp_path)
    made = recorder.Recorder(sink, 1.0, 100, 1.0, sender_waits=True, on_failure=lambda *_: None)
    works = [threading.Thread(target=work, daemon=True) for _, work in made.works()]
    for work in works:
        work.start()
    for n in range(4):
        made.append(Frame(n, n, np.zeros((20, 20), np.uint8)))
    made.end()
    for work in works:
        work.join(TIMEOUT)
    assert [type(record) for record in taken] == [Frame, LostFrame, LostFrame, LostFrame]
    assert (made.frames_recorded, made.frames_refused) == (1, 3)


def test_the_last_answers_are_not_waited_for_at_full_speed(monkeypatch):
    """A simulated or recorded camera answers at once that there is nothing more."""
    monkeypatch.setattr(receiver, "PATIENCE_S", 0.5)
    reads, lost = [], []

    def read(timeout_s):
        reads.append(timeout_s)
        raise DeviceTimeout("camera: nothing is due")

    history = History(1000.0, 10)
    history.append(0, np.zeros((100, 2)), 0.0, 100)
    history.finish()
    made = receiver.Receiver(
        SimpleNamespace(name="camera", read=read),
        TriggerTrain(0, 50),
        history,
        SimpleNamespace(append=lost.append),
        LatestChannel(1, sender_waits=False),
        Ending(lambda: None),
        config.load(None, []).limits,
        0.05,
    )
    made.work()
    assert 2 <= len(reads) <= 60
    assert [record.index for record in lost] == [0, 1]
