"""A recording whose program was killed, whose disk was full or whose files were taken away has
everything that it was given.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from python_program import FOLDERS, python
from session_material import (
    COUNTS,
    OUTCOME,
    SHAPE,
    close_beside_journal,
    copy_recording,
    finish,
    make_snapshot,
    make_writer,
    record,
)

from app.acquisition.recorder_thread import Recorder
from app.records.record_types import DisplacementField, End, Outcome, Record, RingProfile, Samples
from app.session import files
from app.session.files import check_new_session, images_of, results_of
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.recorder import HEAD_BYTES
from app.session.repair import repair
from app.system import disk
from app.system.disk import AppendedFile
from app.system.errors import UserError
from drivers.protocols import Frame
from tests.same_results import difference

KILLED = """
import os, sys
from pathlib import Path
import numpy as np
from app.records.record_types import Samples
from drivers.protocols import Frame
from session_material import SHAPE, make_snapshot, record
writer, _ = record(Path(sys.argv[1]))
writer.flush()
for frame in range(8, 40):  # not flushed
    writer.append(Frame(frame, 5 + 125 * frame, np.zeros(SHAPE, np.uint8)))
    writer.append(Samples(1003 + 50 * (frame - 8), np.zeros((50, 2)), np.zeros((50, 2))))
    writer.append(make_snapshot(frame))
print("ready", flush=True)
if sys.argv[2] == "exit":
    os._exit(3)
sys.stdin.read()
"""


@pytest.mark.slow
@pytest.mark.parametrize("end", ["exit", "kill"])
def test_killed_program_leaves_everything_that_it_was_given(tmp_path: Path, end: str) -> None:
    path = tmp_path / "killed.h5"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, FOLDERS))}
    command = [sys.executable, "-c", KILLED, str(path), end]
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        if end == "kill":
            for refused in (
                lambda: repair(path, tmp_path / "repaired.h5"),
                lambda: make_writer(path, overwrite=True),
                lambda: check_new_session(path, overwrite=True),
            ):
                with pytest.raises(UserError, match="a program is recording this session"):
                    refused()
            child.kill()
        assert child.wait(400) != 0
    writer, written = record(tmp_path / "same.h5")
    writer.close()
    repaired = repair(path, tmp_path / "repaired.h5")
    assert (repaired.found.is_whole, repaired.receipt.frames, repaired.found.results) == (
        True,
        39,
        38,
    )
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.outcome.state == End.UNFINISHED
        assert_array_equal(read.forces().volts[:1003], written.volts)
        assert len(read.forces().volts) == 1003 + 32 * 50
        assert read.events() == written.events
        for index, image in written.images.items():
            assert_array_equal(read.frame(index)[2], image)
        for found, snapshot in zip(read.snapshots(), written.snapshots, strict=False):
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


def test_last_of_the_disk_is_left_to_close_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, written = record(tmp_path / "last.h5")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(
        disk.shutil, "disk_usage", lambda _: usage(10**9, 10**9, files.RESERVE_BYTES)
    )
    with pytest.raises(OSError, match="the disk is full, 34 MB are left"):
        writer.append(Frame(8, 1005, np.ones(SHAPE, np.uint8)))
    writer.append(Outcome(End.FAILED, "the disk is full", COUNTS, None))
    writer.close()
    with SessionReader(written.path) as read:
        assert (read.outcome.state, len(read.triggers())) == ("failed", 8)


def test_frames_that_the_disk_did_not_take_are_lost_with_that_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = iter([1 << 40] * 20 + [files.RESERVE_BYTES] * 80)
    monkeypatch.setattr(files, "free_bytes", lambda _: next(free, 1 << 40))
    writer, failures = make_writer(tmp_path / "full.h5"), []
    recorder = Recorder(writer, 9.0, 1 << 24, 0.4, sender_waits=True, on_failure=failures.append)
    for n in range(50):
        recorder.append(Frame(n, 5 + 125 * n, image_of(n)))
    run_to_end(recorder)
    writer.close()
    assert (recorder.frames_recorded, recorder.frames_refused) == (20, 30)
    assert len(failures) == 1
    assert failures[0].startswith("recorder: the session cannot be written: ")
    assert "the disk is full, 34 MB are left; make room" in failures[0]
    with SessionReader(tmp_path / "full.h5") as read:
        assert read.triggers()["index"].tolist() == list(range(50))
        assert [index for index, _, _ in read.frames()] == list(range(20))
        assert {reason for _, _, reason in read.lost_frames()} == {"it could not be recorded"}


def started(recorder: Recorder) -> list[threading.Thread]:
    """Its works, each in a thread."""
    threads = [threading.Thread(target=work) for _, work in recorder.works()]
    for thread in threads:
        thread.start()
    return threads


def run_to_end(recorder: Recorder) -> None:
    """Let a recorder do all that it was given."""
    threads = started(recorder)
    recorder.end()
    for thread in threads:
        thread.join()


def image_of(frame: int) -> np.ndarray:
    """The image of a frame, which no other of the first 65536 has."""
    image = np.full(SHAPE, frame % 256, np.uint8)
    image[0, 0] = frame // 256
    return image


def test_a_disk_that_stands_still_holds_up_nothing_but_its_sync(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever was handed over is with the system long before; a kill would lose none of it."""
    writer = make_writer(tmp_path / "still.h5")
    goes_on, sync = threading.Event(), os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: (goes_on.wait(60), sync(number)))
    failures: list[str] = []
    recorder = Recorder(writer, 1.0, 1 << 24, 0.1, sender_waits=False, on_failure=failures.append)
    threads = started(recorder)
    for n in range(100):
        recorder.append(Frame(n, n, image_of(n)))
        recorder.append(Samples(n, np.full((1, 2), n), np.full((1, 2), -n)))
    recorder.end()
    for thread in threads[:2]:
        thread.join()
    copy_recording(writer.path, tmp_path / "killed.h5")
    goes_on.set()
    for thread in threads:
        thread.join()
    writer.close()
    assert failures == []
    found = repair(tmp_path / "killed.h5", tmp_path / "repaired.h5")
    assert (found.found.is_whole, found.receipt.frames, found.receipt.samples) == (True, 100, 100)


FULL = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from app.system import disk
from app.system.disk import AppendedFile
from app.acquisition.recorder_thread import Recorder
from app.records.record_types import End, Outcome, Samples
from drivers.protocols import Frame
from session_material import COUNTS, SHAPE, make_writer
from test_session_crash import image_of, run_to_end
writer = make_writer(Path(sys.argv[1]))
failures = []
recorder = Recorder(writer, 1.0, 1 << 30, 0.4, sender_waits=True, on_failure=failures.append)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
for n in range(2000):
    recorder.append(Frame(n, n, image_of(n)))
    recorder.append(Samples(n, np.full((1, 2), n), np.full((1, 2), -n)))
run_to_end(recorder)
print(recorder.frames_recorded, recorder.frames_refused, *failures[:1], flush=True)
ended = Outcome(End.FAILED, "the disk is full", COUNTS, None)
for step in (lambda: writer.append(ended), writer.close):
    try:
        step()
    except OSError as error:
        print(error, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("most", [100_000, 250_001])
def test_a_disk_that_takes_no_more_ends_by_name_and_loses_nothing(
    tmp_path: Path, most: int
) -> None:
    """The system lets no file grow beyond `most` bytes, whatever room there is: HDF5 would break
    the program.
    """
    pytest.importorskip("resource")
    path = tmp_path / "full.h5"
    done = python("-c", FULL, path, most)
    assert (done.returncode, done.stderr) == (0, "")
    recorded, refused, failure = done.stdout.splitlines()[0].split(" ", 2)
    assert failure.startswith("recorder: the session cannot be written: ")
    assert int(recorded) + int(refused) == 2000
    assert "`slipscope repair" in done.stdout.splitlines()[-1]
    repaired = repair(path, tmp_path / "repaired.h5")
    assert (repaired.receipt.frames, repaired.found.torn) == (int(recorded), 0)
    assert int(recorded) > 0
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert all(np.array_equal(image, image_of(index)) for index, _, image in read.frames())
        assert_array_equal(read.forces().volts[:, 0], np.arange(repaired.receipt.samples))


@pytest.mark.parametrize("fate", ["removed", "renamed", "replaced", "folder removed"])
def test_a_file_that_is_taken_away_is_noticed_and_the_recording_goes_on_beside(
    tmp_path: Path, fate: str
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    writer, written = record(folder / "a.h5")
    images = images_of(written.path)
    if fate == "removed":
        images.unlink()
    elif fate == "renamed":
        images.rename(folder / "elsewhere")
    elif fate == "replaced":
        (folder / "other").write_bytes(b"precious")
        (folder / "other").replace(images)
    else:
        shutil.rmtree(folder)
    writer.flush()
    writer.append(Frame(8, 1005, np.ones(SHAPE, np.uint8)))
    finish(writer)
    assert writer.path == folder / ("a.h5" if fate == "folder removed" else "a-2.h5")
    with SessionReader(writer.path) as read:
        assert_array_equal(read.forces().volts, written.volts)
        assert [index for index, _, _ in read.frames()] == [*written.images, 8]
        assert len(list(read.snapshots())) == len(written.snapshots)
        (event,) = [event for event in read.events() if event.kind == "recording"]
        assert "removed, renamed or replaced; the recording goes on in" in event.text
    if fate == "replaced":
        assert images.read_bytes() == b"precious"


def test_a_session_that_appeared_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "a.h5")
    written.path.write_bytes(b"precious")
    finish(writer)
    assert written.path.read_bytes() == b"precious"
    assert writer.path == tmp_path / "a-2.h5"
    with SessionReader(writer.path) as read:
        assert read.outcome.state == "done"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a-2.h5", "a.h5"]


def test_a_session_that_a_power_cut_left_two_names_is_whole_and_stays(tmp_path: Path) -> None:
    """Its close gives the file of images the name of the session, and then takes the old one."""
    writer, written = record(tmp_path / "a.h5")
    writer.append(OUTCOME)
    close_beside_journal(writer)
    whole = written.path.read_bytes()
    os.link(written.path, images_of(written.path))
    repaired = repair(written.path, tmp_path / "b.h5")
    assert (repaired.output, repaired.receipt.checksum) == (None, writer.receipt.checksum)
    make_writer(written.path, overwrite=True).discard()
    assert written.path.read_bytes() == whole


@pytest.mark.parametrize("of", [journal_of, results_of, images_of])
@pytest.mark.parametrize("how", ["a bit", "the end"])
def test_what_is_damaged_before_the_close_is_not_certified(
    tmp_path: Path, of: Callable[[Path], Path], how: str
) -> None:
    writer, written = record(tmp_path / "a.h5")
    writer.append(OUTCOME)
    path = of(written.path)
    with path.open("r+b") as file:
        if how == "a bit":
            place = HEAD_BYTES + 50 if of is images_of else path.stat().st_size // 2
            file.seek(place)
            byte = file.read(1)[0]
            file.seek(place)
            file.write(bytes([byte ^ 1]))
        else:
            file.truncate(path.stat().st_size - 20)
    with pytest.raises((OSError, UserError), match="slipscope repair"):
        writer.close()
    assert not written.path.exists()
    assert writer.receipt is None
    repair(written.path, tmp_path / "repaired.h5")


def test_frames_that_come_before_a_removed_folder_is_noticed_are_kept(tmp_path: Path) -> None:
    """The disk of a folder that is gone cannot be asked for its room."""
    folder = tmp_path / "run"
    folder.mkdir()
    writer, written = record(folder / "a.h5")
    shutil.rmtree(folder)
    writer.append(Frame(8, 1005, np.ones(SHAPE, np.uint8)))
    writer.flush()
    writer.append(Frame(9, 1006, np.ones(SHAPE, np.uint8)))
    shutil.rmtree(folder)
    writer.append(Frame(10, 1007, np.ones(SHAPE, np.uint8)))
    finish(writer)
    with SessionReader(writer.path) as read:
        assert [index for index, _, _ in read.frames()] == [*written.images, 8, 9, 10]
        assert len([event for event in read.events() if event.kind == "recording"]) == 2


def test_what_is_copied_while_it_grows_is_whole_on_a_system_without_pread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where reading at a place moves that at which the file is written."""
    monkeypatch.delattr(os, "pread", raising=False)
    monkeypatch.setattr(disk, "COPY_BYTES", 1000)
    file = AppendedFile(tmp_path / "a", overwrite=False)
    parts = [bytes([n % 251]) * 777 for n in range(400)]
    file.append(*parts[:200])
    growing = threading.Thread(target=lambda: [file.append(part) for part in parts[200:]])
    growing.start()
    copy = file.copy_to(tmp_path / "b")
    growing.join()
    copy.catch_up(file)
    for held in (file, copy):
        held.close()
        assert held.path.read_bytes() == b"".join(parts)


def test_a_recording_that_can_not_go_on_beside_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer, written = record(tmp_path / "a.h5")
    for of in (journal_of, results_of, images_of):
        of(written.path).unlink()

    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(AppendedFile, "catch_up", refuse)
    with pytest.raises(OSError, match="removed, renamed or replaced, and the recording cannot go"):
        writer.flush()
    with pytest.raises(OSError, match=r"cannot go on beside it: .*No space left") as told:
        writer.close()
    assert "lies beside" not in str(told.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "odd",
    [
        Samples(1003, np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 3))),
        Samples(1003 + (1 << 22), np.zeros((2, 2)), np.zeros((2, 2))),
        replace(make_snapshot(4), rings=RingProfile(*[np.zeros((2, 2))] * 3)),
        replace(
            make_snapshot(4),
            field=DisplacementField(
                *[np.zeros((3, 3), np.float32)] * 5, np.zeros((3, 3), np.uint8)
            ),
        ),
    ],
    ids=["channels", "gaps", "rings", "field"],
)
def test_what_no_session_could_be_made_of_is_refused_at_once(tmp_path: Path, odd: Record) -> None:
    """Not at the close, when all the rest would be lost with it."""
    writer, written = record(tmp_path / "a.h5", sample_rate_hz=100_000.0)
    with pytest.raises(ValueError, match=r"channels|are missing|profile|takes"):
        writer.append(odd)
    finish(writer)
    with SessionReader(written.path) as read:
        assert len(read.forces().volts) == 1003


def test_results_that_fail_cost_no_image(tmp_path: Path) -> None:
    writer, failures = make_writer(tmp_path / "a.h5"), []
    recorder = Recorder(writer, 9.0, 1 << 24, 0.4, sender_waits=True, on_failure=failures.append)
    for n in range(20):
        recorder.append(Frame(n, 5 + 125 * n, image_of(n)))
        recorder.append(replace(make_snapshot(n), rings=RingProfile(*[np.zeros((2, 2))] * 3)))
    run_to_end(recorder)
    writer.close()
    assert (recorder.frames_recorded, recorder.frames_refused, len(failures)) == (20, 0, 1)


@pytest.mark.parametrize("compression", ["none", "gzip"])
@pytest.mark.parametrize("count", [1, 40])
def test_the_images_are_not_copied_where_they_can_stay(
    tmp_path: Path, compression: str, count: int
) -> None:
    shape, path = (120, 160), tmp_path / "large.h5"
    pictures = np.random.default_rng(1).integers(0, 256, (count, *shape), np.uint8)
    writer = make_writer(path, frame_shape=shape, compression=compression)
    inode = images_of(path).stat().st_ino
    for n, picture in enumerate(pictures):
        writer.append(Frame(n, 5 + 125 * n, picture))
    finish(writer)
    stays = compression == "none" and count == 40
    assert (path.stat().st_ino == inode) == stays
    with h5py.File(path) as file:
        images = file["entry/instrument/camera/data"]
        assert_array_equal(images[...], pictures)
        assert (images.id.get_offset() == HEAD_BYTES) == stays
    assert list(tmp_path.iterdir()) == [path]
