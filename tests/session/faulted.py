"""Recording, repairing and importing on a disk that fails, and what must hold afterwards:
``python faulted.py FOLDER SCENARIO FIRST STEP FAULT...``, with ``faulty_disk.so`` loaded first.

The program prints a line for each case: the operation, what failed, how the scenario ended, and
what is wrong with what it left. Operation 0 is none: so the scenario ends without a fault.
Each case is a process of its own, and so is the look at what it left.
"""

from __future__ import annotations

import json
import mmap
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from faulty_disk import FAULTS, Fault, FaultyDisk
from session_material import CONTACT, copy_recording, make_header, make_snapshot, make_writer

from app.files.frames import Sources
from app.files.importing import import_files
from app.records.record_types import (
    Counts,
    End,
    Event,
    Outcome,
    Position,
    Record,
    Samples,
    Snapshot,
)
from app.replay.comparison import unlike
from app.session import vetting
from app.session.contents import contents_of
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from app.system.errors import UserError
from drivers.protocols import Frame, LostFrame

FRAMES, SHAPE, DIVISOR, SYNC_FRAMES = 20, (64, 80), 42, 4
LIMIT_S = 60
COUNTS = Counts(FRAMES, FRAMES - 1, FRAMES - 1, 1, FRAMES - 1, 1, FRAMES * DIVISOR, 0)
OUTCOME = Outcome(End.COMPLETE, "the travel is done", COUNTS, None)


def script() -> list[Record]:
    """Everything that is recorded, in its order."""
    rng, records = np.random.default_rng(3), list[Record]()
    for n in range(FRAMES):
        forces = rng.normal(size=(DIVISOR, 2))
        records.append(Samples(n * DIVISOR, forces, 2 * forces))
        records.append(Position((n + 1) * DIVISOR, 1e-6 * n))
        if n == 3:
            records.append(LostFrame(n, n * DIVISOR, "no image within 0.5 s"))
        else:
            image = rng.integers(0, 256, SHAPE, np.uint8)
            records.append(Frame(n, n * DIVISOR, image))
            records.append(make_snapshot(n))
        if n % 3 == 0:
            records.append(Event(n * DIVISOR, "phase", f"phase {n}"))
    return [*records, CONTACT]


RECORDS = script()


class Told:
    """How far a recording has come, as the process that records sees it: records given, records
    synced, whether it was closed.
    """

    def __init__(self) -> None:
        self._shared = np.frombuffer(mmap.mmap(-1, 24), np.int64)

    def reset(self) -> None:
        self._shared[:] = 0

    @property
    def given(self) -> int:
        return int(self._shared[0])

    @property
    def synced(self) -> int:
        return int(self._shared[1])

    @property
    def is_closed(self) -> bool:
        return bool(self._shared[2])

    def give(self) -> None:
        self._shared[0] += 1

    def sync(self) -> None:
        self._shared[1] = self._shared[0]

    def close(self) -> None:
        self._shared[2] = 1


def record(path: Path, told: Told) -> None:
    """Record everything as a run does: after a failure only how it ended is written."""
    writer = open_writer(path)
    failures: list[Exception] = []

    def attempt(step: Callable[[], None]) -> None:
        try:
            step()
        except (UserError, OSError) as error:
            failures.append(error)

    def go_through() -> None:
        for n, one in enumerate(RECORDS):
            writer.append(one)
            told.give()
            if isinstance(one, Snapshot) and n % SYNC_FRAMES == 0:
                writer.flush()
                told.sync()

    def end() -> None:
        writer.append(
            OUTCOME if not failures else Outcome(End.FAILED, str(failures[0]), COUNTS, None)
        )
        writer.flush()

    for step in (go_through, end, writer.close):
        attempt(step)
    if failures:
        raise failures[0]
    told.close()


def open_writer(path: Path) -> SessionRecorder:
    header = make_header(
        frame_shape=SHAPE, divisor=DIVISOR, first_trigger=0, started="2026-11-22T12:00:00+00:00"
    )
    return SessionRecorder.create(path, header, overwrite=True)


def wrong_with(session: Path, told: int, least: int) -> str:
    """What a session holds that was not given to it, or lacks of the first `least` records; empty
    where there is nothing wrong with it.
    """
    given, sure = RECORDS[:told], RECORDS[:least]
    with SessionReader(session) as read:
        images = {index: image for index, _, image in read.frames()}
        for one in given:
            image = images.pop(one.index, None) if isinstance(one, Frame) else None
            if image is not None and not np.array_equal(image, one.image):
                return f"the image of frame {one.index} was altered"
        if images:
            return f"frames {sorted(images)} were never given"
        kept = {index for index, _, _ in read.frames()}
        lost = {one.index for one in sure if isinstance(one, Frame)} - kept
        if lost:
            return f"frames {sorted(lost)} are missing"
        forces = read.forces()
        blocks = [one for one in given if isinstance(one, Samples)]
        volts = np.concatenate([one.volts for one in blocks]) if blocks else np.zeros((0, 2))
        least_samples = sum(len(one.volts) for one in sure if isinstance(one, Samples))
        n = len(forces.volts)
        if n < least_samples:
            return f"{n} samples, {least_samples} were synced"
        known = np.isfinite(forces.volts[:, 0])  # after a page that was lost others come back
        if not known[:least_samples].all():
            return f"of {least_samples} samples that were synced some are missing"
        for column, as_given in ((forces.volts, volts), (forces.forces, 2 * volts)):
            if n > len(volts) or not np.array_equal(column[known], as_given[:n][known]):
                return "samples were altered"
        for what, there, kind in (
            # a gap where a page of the journal was lost, which the repair says
            ("events", [event for event in read.events() if event.kind != "gap"], Event),
            ("positions", _positions(read), Position),
        ):
            here = [one for one in given if isinstance(one, kind)]
            needed = [one for one in sure if isinstance(one, kind)]
            if there[: len(needed)] != needed or any(one not in here for one in there):
                return f"{what}: {there} of {here}, {len(needed)} synced"
        analysed = set()
        for snapshot in read.snapshots():
            for column, *_ in unlike(snapshot, make_snapshot(snapshot.frame)):
                return f"the results of frame {snapshot.frame} were altered: {column.path}"
            analysed.add(snapshot.frame)
        if lost := {one.frame for one in sure if isinstance(one, Snapshot)} - analysed:
            return f"the results of frames {sorted(lost)} are missing"
    return ""


def _positions(read: SessionReader) -> list[Position]:
    return [Position(int(n), float(m)) for n, m in zip(*read.positions(), strict=True)]


def wrong_with_whole(session: Path, states: set[str], least: int = len(RECORDS)) -> str:
    """What is wrong with a session that claims to be whole, in one of these states."""
    verify(session)
    with SessionReader(session) as read:
        if read.outcome.state not in states:
            return f"{session.name} is {read.outcome.state}"
    return wrong_with(session, len(RECORDS), least)


class Scenario:
    """Something that writes, and what must hold after it.

    `ready` makes a folder to begin with, without faults; `act` works in a copy of it; `wrong` says
    what is wrong with what is left, where `handled` says that the program went on to its end and
    `cut` that the power failed.
    """

    output = "session.h5"
    allowed: tuple[str, ...] = ()  # files that may be left by a failure that was handled

    def __init__(self, begin: Path) -> None:
        self.begin = begin
        self.told = Told()

    def ready(self) -> None:
        raise NotImplementedError

    def act(self, folder: Path) -> None:
        raise NotImplementedError

    def wrong_with_new(self, folder: Path) -> str:
        """What is wrong with a new output that is in place."""
        raise NotImplementedError

    def wrong(self, folder: Path, *, handled: bool, cut: bool) -> str:
        given = {path.name for path in self.begin.iterdir()} - {self.output}
        for name in given:  # what is read must stay as it is
            for path in (self.begin / name, *(self.begin / name).glob("*")):
                copy = folder / path.relative_to(self.begin)
                if path.is_file() and copy.read_bytes() != path.read_bytes():
                    return f"{copy.name} was changed"
        litter = {path.name for path in folder.iterdir()} - {*given, *self.allowed, self.output}
        if handled and litter:
            return f"{sorted(litter)} was left"
        output = folder / self.output
        if not output.exists():
            return "the earlier output is gone"
        is_new = output.read_bytes() != (self.begin / self.output).read_bytes()
        if self.told.is_closed and not is_new:
            return "it was closed, but the earlier output is there"
        return self.wrong_with_new(folder) if is_new else self.wrong_with_earlier(folder, cut=cut)

    def wrong_with_earlier(self, folder: Path, *, cut: bool) -> str:
        """What is wrong where the output is the earlier one."""
        return ""


class Recording(Scenario):
    """A session recorded over an earlier one."""

    allowed = ("session.h5.journal", "session.h5.images", "session.h5.results")

    def ready(self) -> None:
        make_earlier(self.begin / self.output)

    def act(self, folder: Path) -> None:
        record(folder / self.output, self.told)

    def wrong_with_new(self, folder: Path) -> str:
        if journal_of(folder / self.output).exists():
            return self.wrong_with_repair(folder, self.told.given)
        return self.wrong_with_certified(folder)

    def wrong_with_certified(self, folder: Path) -> str:
        """A run that failed, and was closed in good order, has the state that says so."""
        states = {"done"} if self.told.given == len(RECORDS) else {"failed"}
        if self.told.given == len(RECORDS) and not self.told.is_closed:
            states.add("failed")
        return wrong_with_whole(folder / self.output, states, self.told.given)

    def wrong_with_earlier(self, folder: Path, *, cut: bool) -> str:
        least = self.told.synced if cut else self.told.given
        return self.wrong_with_repair(folder, least) if least else ""

    def wrong_with_repair(self, folder: Path, least: int) -> str:
        repaired = repair(folder / self.output, folder / "repaired.h5")
        if repaired.output is None:
            return self.wrong_with_certified(folder)
        # the last record may have been written by the call that then failed
        return wrong_with(folder / "repaired.h5", self.told.given + 1, least)


class Repair(Scenario):
    """A session that was cut short, repaired over an earlier output."""

    output = "repaired.h5"

    def ready(self) -> None:
        make_earlier(self.begin / self.output)
        cut_short(self.begin / "cut.h5")

    def act(self, folder: Path) -> None:
        repair(folder / "cut.h5", folder / self.output, overwrite=True)
        self.told.close()

    def wrong_with_new(self, folder: Path) -> str:
        return wrong_with_whole(folder / self.output, {"unfinished"})


def make_earlier(path: Path) -> None:
    """An earlier session, small and good."""
    writer = make_writer(path)
    writer.append(Event(0, "phase", "an earlier session"))
    writer.close()


def cut_short(path: Path) -> None:
    """A session as a kill leaves it after its last record."""
    whole = path.with_name("open.h5")
    writer = open_writer(whole)
    for one in RECORDS:
        writer.append(one)
    writer.flush()
    copy_recording(whole, path)
    writer.discard()


class Import(Scenario):
    """Images imported over an earlier output, as `slipscope replay -o` writes one, too."""

    output = "imported.h5"

    def ready(self) -> None:
        make_earlier(self.begin / self.output)
        (self.begin / "images").mkdir()
        rng = np.random.default_rng(0)
        image = cv2.GaussianBlur(rng.integers(0, 256, SHAPE, np.uint8), (0, 0), 1.5)
        for n in range(3):
            cv2.imwrite(str(self.begin / f"images/{n}.png"), np.roll(image, n, axis=1))
        whole = self.begin.with_name("whole")
        shutil.copytree(self.begin, whole)
        self.act(whole)
        self.told.reset()

    def act(self, folder: Path) -> None:
        sources = Sources(
            images=[folder / "images"],
            pixel_um=7.04,
            reference=0,
            rate_hz=1000,
            divisor=125,
            overrides=("dic.box=20", "dic.step=10", "dic.threads=1", "stress.method=none"),
        )
        import_files(sources, folder / self.output, overwrite=True)
        self.told.close()

    def wrong_with_new(self, folder: Path) -> str:
        whole = self.begin.with_name("whole") / self.output
        verify(folder / self.output)
        with SessionReader(whole) as asked, SessionReader(folder / self.output) as read:
            for one, other in zip(asked.snapshots(), read.snapshots(), strict=True):
                for column, *_ in unlike(one, other):
                    return f"the results of frame {one.frame} were altered: {column.path}"
            for (n, _, image), (m, _, other_image) in zip(
                asked.frames(), read.frames(), strict=True
            ):
                if n != m or not np.array_equal(image, other_image):
                    return f"the image of frame {n} was altered"
        return ""


SCENARIOS = {"recording": Recording, "repair": Repair, "import": Import}


def run_cases(folder: Path, name: str, faults: Sequence[str], first: int, step: int) -> None:
    """Every `step`-th operation of a scenario from `first` on, with each of the faults; with each
    fault it begins one later.
    """
    begin, case, answers = folder / "begin", folder / "case", os.dup(1)
    disk = FaultyDisk(folder / "control", str(case))
    begin.mkdir()
    scenario = SCENARIOS[name](begin)
    if failed := in_child(scenario.ready, limit_s=600):  # it may compile
        raise SystemExit(failed)

    def at_once(fault: Fault, at: int) -> dict[str, object]:
        shutil.rmtree(case, ignore_errors=True)
        shutil.copytree(begin, case)
        scenario.told.reset()
        disk.arm(fault, at)
        began = time.monotonic()
        ended = in_child(lambda: scenario.act(case), dies=at % 8 == 0)  # which takes twice as long
        disk.disarm()
        seconds, hit = time.monotonic() - began, disk.hit
        if fault.cut:
            disk.lose(np.random.default_rng(at), case)
        elif fault.forgets:
            disk.lose_failed(case)
        handled = ended != f"signal {signal.SIGKILL}"
        wrong = in_child(lambda: scenario.wrong(case, handled=handled, cut=fault.forgets))
        return {"at": at, "hit": hit, "ended": ended, "wrong": wrong, "seconds": round(seconds, 2)}

    def tell(fault: str, at: int) -> None:
        told = {"fault": fault} | at_once(FAULTS[fault], at)
        os.write(answers, (json.dumps(told) + "\n").encode())

    operations: dict[int, int] = {}  # by their kinds
    for n, fault in enumerate(faults):
        kinds = FAULTS[fault].kinds
        if kinds not in operations:
            tell(fault, 0)
            operations[kinds] = disk.count
        for at in range(1 + (first + n) % step, operations[kinds] + 1, step):
            tell(fault, at)


class ChildDone(SystemExit):
    """The end of a child, by way of the interpreter's own end."""


def in_child(act: Callable[[], object], *, dies: bool = False, limit_s: int = LIMIT_S) -> str:
    """What a function returned in a process of its own, or the sentence, the exception, the signal
    by which it ended. With `dies` the process goes to the end of the interpreter.
    """
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        signal.alarm(limit_s)
        try:
            answer = act() or ""
        except (UserError, OSError) as error:
            answer = f"refused: {error}"
        except BaseException:
            answer = "unexpected: " + traceback.format_exc(limit=-3)
        os.write(writing, str(answer).encode()[:60_000])
        os.close(writing)
        if dies:
            raise ChildDone
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read().decode()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return answer if code == 0 else f"signal {-code}" if code < 0 else f"exit {code}: {answer}"


if __name__ == "__main__":
    # not in another process, which would take longer to begin than all the rest
    vetting._of_stranger = contents_of
    run_cases(
        Path(sys.argv[1]), sys.argv[2], sys.argv[5:], first=int(sys.argv[3]), step=int(sys.argv[4])
    )
