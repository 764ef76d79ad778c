"""A session whose program was killed, or whose disk was full, has everything up to its last flush
and no phantom rows.
"""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from collections import namedtuple
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import COUNTS, SHAPE, make_snapshot, make_writer, record

from app.engine.recorder import Recorder
from app.errors import UserError
from app.offline.replay import difference
from app.records import UNFINISHED, LostTrigger, Outcome, ReceivedFrame
from app.session import columns, files
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.repair import repair

KILLED = """
import os, sys
from pathlib import Path
import numpy as np
from app.records import ReceivedFrame, Samples
from session_material import SHAPE, make_snapshot, record
writer, _ = record(Path(sys.argv[1]))
writer.flush()
for frame in range(8, 40):  # not flushed
    writer.append(ReceivedFrame(frame, 5 + 125 * frame, np.zeros(SHAPE, np.uint8)))
    writer.append(Samples(1003 + 50 * (frame - 8), np.zeros((50, 2)), np.zeros((50, 2))))
    writer.append(make_snapshot(frame))
print("ready", flush=True)
if sys.argv[2] == "exit":
    os._exit(3)
sys.stdin.read()
"""


@pytest.mark.parametrize("end", ["exit", "kill"])
def test_killed_program_leaves_everything_flushed(tmp_path: Path, end: str) -> None:
    path = tmp_path / "killed.h5"
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(root), str(Path(__file__).parent)])
    }
    command = [sys.executable, "-c", KILLED, str(path), end]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        if end == "kill":
            with pytest.raises(UserError, match=r"killed\.h5: "):
                SessionReader(path)  # it is being recorded
            child.kill()
        assert child.wait(400) != 0
    writer, written = record(tmp_path / "same.h5")
    writer.close()
    with SessionReader(path) as read:
        assert read.outcome.state == UNFINISHED
        assert read.outcome.counts == COUNTS
        assert_array_equal(read.forces().volts, written.volts)
        assert read.events() == written.events
        for index, _, image in read.frames():
            assert_array_equal(image, written.images[index])
        for found, snapshot in zip(read.snapshots(), written.snapshots, strict=True):
            assert difference(found, snapshot) == ""


def test_columns_of_unequal_length_are_cut_to_the_shortest(tmp_path: Path) -> None:
    """As a kill in the middle of a flush may leave them."""
    writer, written = record(tmp_path / "torn.h5")
    writer.close()
    with h5py.File(written.path, "r+") as file:
        file["/entry/triggers/index"].resize(9, axis=0)
        file["/entry/forces/shear_sensor"].resize(900, axis=0)
    with SessionReader(written.path) as read:
        assert len(read.triggers()) == 8
        assert len(read.forces().volts) == 900


class _FullDisk:
    """A dataset that is real but for its writes, which fail as those to a full disk do."""

    def __init__(self, real: h5py.Dataset) -> None:
        self._real = real

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    @property
    def id(self) -> _FullDisk:
        return self

    def write_direct_chunk(self, *_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    __setitem__ = write_direct_chunk


def test_failed_chunk_leaves_no_phantom(tmp_path: Path) -> None:
    """An image that can not be written, and a field of which the second quantity can not."""
    writer, written = record(tmp_path / "full.h5")
    writer.append(ReceivedFrame(8, 1005, np.ones(SHAPE, np.uint8)))
    writer._images = _FullDisk(writer._images)
    uy = "/entry/fields/uy"
    writer._fields[uy] = _FullDisk(writer._fields[uy])
    with pytest.raises(OSError, match="No space left"):
        writer.append(ReceivedFrame(9, 1130, np.ones(SHAPE, np.uint8)))
    with pytest.raises(OSError, match="No space left"):
        writer.append(make_snapshot(8))
    writer.append(Outcome("failed", "disk full", COUNTS, None))
    writer.close()
    with SessionReader(written.path) as read:
        assert [index for index, _, _ in read.frames()] == [0, 1, 2, 4, 5, 6, 7, 8]
        assert len(list(read.snapshots())) == 6
        assert read.triggers()["analysed"].tolist()[-2:] == [True, False]
        assert read.outcome.state == "failed"
    with h5py.File(written.path, "r") as file:
        assert file["/entry/instrument/camera/data"].shape[0] == 8
        assert {
            file[f"/entry/fields/{name}"].shape[0]
            for name in ("frame", "ux", "uy", "ux_errors", "uy_errors", "zncc", "status")
        } == {4}


def test_failed_flush_closes_the_session_and_everything_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, written = record(tmp_path / "flush.h5")
    writer.append(ReceivedFrame(8, 1005, np.ones(SHAPE, np.uint8)))
    writer.append(LostTrigger(9, 1130, "late"))
    lengthen = columns._lengthen

    def full_disk(column: h5py.Dataset, *rest: Any) -> None:
        lengthen(column, *rest)
        if column.name == "/entry/triggers/reason":
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(columns, "_lengthen", full_disk)
        with pytest.raises(
            OSError,
            match=r"flush\.h5: it can not be written: .*No space left.*; `slipscope repair`",
        ):
            writer.flush()
    with pytest.raises(OSError, match="it could not be written to its end"):
        writer.append(Outcome("failed", "the disk is full", COUNTS, None))
    writer.close()
    assert writer.receipt is None
    repair(written.path, tmp_path / "repaired.h5")
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.triggers()["index"].tolist() == list(range(10))
        assert read.lost_frames()[-1] == (9, 1130, "late")


def test_last_of_the_disk_is_left_to_close_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, written = record(tmp_path / "last.h5")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(
        files.shutil, "disk_usage", lambda _: usage(10**9, 10**9, files.RESERVE_BYTES)
    )
    with pytest.raises(OSError, match="the disk is full, 34 MB are left"):
        writer.append(ReceivedFrame(8, 1005, np.ones(SHAPE, np.uint8)))
    writer.append(Outcome("failed", "the disk is full", COUNTS, None))
    writer.close()
    with SessionReader(written.path) as read:
        assert (read.outcome.state, len(read.triggers())) == ("failed", 8)


def image_of(frame: int) -> np.ndarray:
    """The image of a frame, which no other of the first 65536 has."""
    image = np.full(SHAPE, frame % 256, np.uint8)
    image[0, 0] = frame // 256
    return image


def test_disk_that_stands_still_ends_the_run_by_name_and_loses_nothing_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = make_writer(tmp_path / "still.h5")
    goes_on, sync = threading.Event(), os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: (goes_on.wait(60), sync(number)))
    failures: list[str] = []
    recorder = Recorder(
        writer,
        1.0,
        50 * 12 * 16,
        1e-6,
        sender_waits=False,
        on_failure=lambda reason: (failures.append(reason), goes_on.set()),
    )
    thread = threading.Thread(target=recorder.work)
    thread.start()
    sent = 0
    while not failures and sent < 60_000:
        recorder.append(ReceivedFrame(sent, sent, image_of(sent)))
        sent += 1
    recorder.end()
    thread.join()
    writer.close()
    assert failures[0].startswith("recorder: the disk is slower than the data, 1 s of it wait")
    assert sent == recorder.frames_recorded > 50
    with SessionReader(tmp_path / "still.h5") as read:
        assert [np.array_equal(image, image_of(index)) for index, _, image in read.frames()] == [
            True
        ] * sent


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from app.engine.recorder import Recorder
from app.records import Outcome, ReceivedFrame, Samples
from session_material import COUNTS, SHAPE, make_writer
from test_session_crash import image_of
writer = make_writer(Path(sys.argv[1]))
failures = []
recorder = Recorder(writer, 1.0, 1 << 30, 0.001, sender_waits=True, on_failure=failures.append)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
for n in range(2000):
    recorder.append(ReceivedFrame(n, n, image_of(n)))
    recorder.append(Samples(n, np.full((1, 2), n), np.full((1, 2), -n)))
recorder.end()
recorder.work()
print(recorder.frames_recorded, *failures, flush=True)
ended = Outcome("failed", "the disk is full", COUNTS, None)
for step in (lambda: writer.append(ended), writer.close):
    try:
        step()
    except OSError as error:
        print(error, flush=True)
"""


@pytest.mark.parametrize("most", [100_000, 250_001])
def test_no_room_at_all_even_to_close_the_file_loses_nothing(tmp_path: Path, most: int) -> None:
    """The system lets no file grow beyond `most` bytes, so HDF5 can not write its indexes; the
    journal and the images are there.

    HDF5 2.0 may crash such a program at its very end, after all was said: the exit code is not
    looked at.
    """
    pytest.importorskip("resource")
    path = tmp_path / "full.h5"
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(root), str(Path(__file__).parent)])
    }
    command = [sys.executable, "-c", FULL, str(path), str(most)]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=400, check=False
    )
    recorded, _, failure = done.stdout.splitlines()[0].partition(" ")
    assert failure.startswith("recorder: the session can not be written: ")
    assert "full.h5: it can" in done.stdout
    assert journal_of(path).exists()
    repaired = repair(path, tmp_path / "repaired.h5")
    assert (repaired.receipt.frames, repaired.torn) == (int(recorded), 0)
    assert int(recorded) > 0
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert all(np.array_equal(image, image_of(index)) for index, _, image in read.frames())
        assert_array_equal(read.forces().volts[:, 0], np.arange(repaired.receipt.samples))
        assert repaired.receipt.samples >= int(recorded) - 1
