"""The benches that run on this computer: a folder for each, with its address and the images that it
shares.

The folder lies in memory where the computer has a place for that, and is its owner's alone.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import shutil
import socket
import stat
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil

from app.system.disk import replace_file
from app.system.errors import UserError
from app.system.stopping import Stop, StopAnswer

if TYPE_CHECKING:
    import numpy as np

    from analysis.arrays import U8, U16, Array

MEMORY = Path("/dev/shm")  # folder in memory, on Linux
FILE = "bench.json"
LOG_FILE = "bench.log"  # of what its process prints, and its drivers
RUN = "app.processes.bench"  # module of the process of a run
DEAD = "dead"  # the process was found gone
ANSWER = "stop.json"  # name of the file with the supervisor's answer
LONGEST = 84  # bytes of the name of `root`: an address in it has 18 more, of 103 on macOS
KEPT_S = 600.0  # after its last change: the folder of a dead bench, with what became of its stage


@dataclass(frozen=True, slots=True)
class RunningBench:
    """A process that has a bench, as its folder says.

    Attributes
    ----------
    name : str
        Of its folder.
    title : str
        For people.
    session : str
        The file that it records; empty for one that is connected without a run.
    address, key : str
        How it is called; empty until it can be.
    pid, analysis_pid, supervisor_pid : int
        Its processes; 0 for one that it does not have.
    born : float
        When its process began, see `_born`, which tells it from a later one of the same number.
    """

    name: str
    title: str
    session: str
    address: str
    key: str
    pid: int
    born: float
    analysis_pid: int = 0
    supervisor_pid: int = 0

    @property
    def is_alive(self) -> bool:
        """Whether its process is still there."""
        try:
            process = psutil.Process(self.pid)
            return bool(_born(process) == self.born and process.status() != "zombie")
        except (psutil.Error, ValueError, OSError):
            return False

    @property
    def has_supervisor(self) -> bool:
        """Whether its supervisor is still there."""
        return self.supervisor_pid > 0 and psutil.pid_exists(self.supervisor_pid)

    @property
    def is_suspended(self) -> bool:
        """Whether its process has no turn until somebody lets it go on."""
        try:
            return bool(psutil.Process(self.pid).status() == psutil.STATUS_STOPPED)
        except psutil.Error:
            return False


def _born(process: psutil.Process) -> float:
    """When a process began. On Linux in ticks since the start of the computer, because there the
    time of day of the beginning changes whenever the clock is set.
    """
    if sys.platform != "linux":
        return float(process.create_time())
    else:
        stat = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8", errors="replace")
        return float(stat.rpartition(")")[2].split()[19])


@contextmanager
def as_user_error() -> Iterator[None]:
    """Turn an error of writing to these folders into one that says what to do."""
    try:
        yield
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        raise UserError(
            f"{where}what programs of a bench share cannot be written:"
            f" {error.strerror or error}; make room there, or make {MEMORY} or the folder that"
            " TMPDIR names one that you can write to"
        ) from None


def root() -> Path:
    """Where the folders of this user's benches are.

    Raises
    ------
    UserError
        It cannot be made, its name is too long, or it is not this user's alone: who can write to it
        could answer in the place of a bench.
    """
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    with as_user_error():
        base = MEMORY if os.access(MEMORY, os.W_OK) else Path(tempfile.gettempdir())
        folder = base / f"slipscope-{user}"
        with suppress(FileExistsError):  # what it is, is looked at below
            folder.mkdir(mode=0o700, parents=True)
        held = folder.lstat()
    found = ""
    if not stat.S_ISDIR(held.st_mode):
        found = "it is no folder"
    elif hasattr(os, "getuid") and held.st_uid != os.getuid():
        found = f"it belongs to another user (number {held.st_uid})"
    elif hasattr(os, "getuid") and held.st_mode & 0o077:
        found = f"others can reach it, its mode is {stat.S_IMODE(held.st_mode):o} and not 700"
    if found:
        raise UserError(
            f"{folder}: the folder of your benches must be yours alone, but {found}; remove it, or"
            " let its owner do so"
        )
    if hasattr(socket, "AF_UNIX") and len(os.fsencode(folder)) > LONGEST:
        raise UserError(
            f"{folder}: this name is too long for the addresses of processes in it, {LONGEST} bytes"
            f" are the most; make {MEMORY} one that you can write to, or let TMPDIR name a folder"
            " with a shorter name"
        )
    return folder


def new_folder() -> Path:
    """An empty folder for a bench; those that dead benches have left are deleted, once nobody asks
    any more what became of the stage.

    Raises
    ------
    UserError
        As of `root`.
    """
    place = root()
    with as_user_error():
        for folder in place.iterdir():
            if _is_left(folder):
                shutil.rmtree(folder, ignore_errors=True)
        while True:
            folder = place / f"{datetime.now():%H%M%S}-{secrets.token_hex(2)}"
            with suppress(FileExistsError):  # of another that begins in this second
                folder.mkdir(mode=0o700)
                return folder


def claim(folder: Path) -> RunningBench:
    """Say that a folder is used by this process, for as long as it lives."""
    me = psutil.Process()
    bench = RunningBench(folder.name, "", "", "", "", me.pid, _born(me))
    publish(folder, bench)
    return bench


def publish(folder: Path, bench: RunningBench) -> None:
    """Make a bench known, or what has changed of it.

    Raises
    ------
    UserError
        There is no room for it.
    """
    with as_user_error():
        _write(folder / FILE, bench)


def refreshed(bench: RunningBench) -> RunningBench:
    """The same bench, as its folder says now, or did at its end."""
    try:
        return _read(root() / bench.name) or bench
    except UserError:
        return bench


def write_stop_answer(path: Path, answer: StopAnswer) -> None:
    """Leave what became of a stop for those who ask for it when the bench is gone."""
    _write(path, answer)


def _write(path: Path, record: RunningBench | StopAnswer) -> None:
    """Replace a file by a record; whoever reads it finds the one or the other."""
    new = path.with_name(f"{path.name}.new")
    new.write_text(json.dumps(asdict(record)), encoding="utf-8")
    replace_file(new, path)


def read_stop_answer(bench: str) -> StopAnswer | None:
    """What the supervisor of a bench of that name has left; None where there is nothing."""
    try:
        answer = json.loads((root() / bench / ANSWER).read_text(encoding="utf-8"))
        return StopAnswer(Stop(answer["kind"]), answer["sentence"])
    except (OSError, ValueError, UserError):
        return None


def reachable() -> list[RunningBench]:
    """The benches that can be called now, with a run or without one, the oldest first."""
    return [bench for bench in _known() if bench.address and bench.is_alive]


def died() -> list[RunningBench]:
    """The benches whose processes are gone without an end in good order, and whose supervisors say
    what became of their stages, if one or the other wrote something a short while ago; the oldest
    first.
    """
    return [
        bench
        for bench in _known()
        if bench.supervisor_pid
        and not (bench.is_alive or is_open(bench.address))
        and _unchanged_s(*(root() / bench.name / file for file in (FILE, ANSWER))) < KEPT_S
    ]


def _known() -> list[RunningBench]:
    found = [_read(folder) for folder in sorted(root().iterdir())]
    return sorted((bench for bench in found if bench), key=lambda bench: bench.born)


def _unchanged_s(*paths: Path) -> float:
    """Seconds since the newest change of these files or folders; infinite where all are gone."""
    changed = -math.inf
    for path in paths:
        with suppress(OSError):  # it was never there, or somebody else has deleted it
            changed = max(changed, path.stat().st_mtime)
    return time.time() - changed


def running() -> list[RunningBench]:
    """The benches whose runs can be called now, the oldest first."""
    return [bench for bench in reachable() if bench.session]


def running_as(name: str | None, who: str) -> RunningBench:
    """The bench that runs on this computer and has this name, or records a session of this name, in
    part; without a name the only one. Errors begin with `who` asks.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    benches = running()
    if not benches:
        raise UserError(f"{who}: no bench of yours runs on this computer; slipscope run starts one")
    wanted = named(benches, name)
    if len(wanted) != 1:
        which = f"'{name}' is the name of" if name else "there are"
        number = str(len(wanted)) if wanted else "none of the"
        names = ", ".join(f"{b.name} ({b.title}, {Path(b.session).name})" for b in benches)
        raise UserError(f"{who}: {which} {number} running benches; name one of: {names}")
    return wanted[0]


def named(benches: Sequence[RunningBench], name: str | None) -> list[RunningBench]:
    """Those of this name, or with a session of this name, in part; all without a name."""
    return [b for b in benches if not name or name == b.name or name in b.session]


def _is_left(folder: Path) -> bool:
    """Whether a folder is of a process that was found gone a while ago, and whose supervisor is
    gone, too.
    """
    bench = _read(folder)
    if bench and (bench.is_alive or bench.has_supervisor or is_open(bench.address)):
        return False
    if bench:  # its supervisor may just have answered
        with suppress(OSError):  # it was found gone before, or somebody else has deleted it
            (folder / DEAD).touch(exist_ok=False)
    return _unchanged_s(folder) > KEPT_S


def is_open(address: str) -> bool:
    """Whether a process listens at an address: also one of a container, where it has another
    number.
    """
    if not hasattr(socket, "AF_UNIX"):
        return False
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(0.1)
        try:
            line.connect(address)
        except (TimeoutError, BlockingIOError):  # it accepts no more
            return True
        except OSError:
            return False
    return True


def _read(folder: Path) -> RunningBench | None:
    try:
        return RunningBench(**json.loads((folder / FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def shared_image(path: Path, shape: tuple[int, ...], dtype: np.dtype[Any]) -> U8 | U16:
    """An image, or several, in a file that several processes can map; made where it is not there.

    Raises
    ------
    UserError
        There is no room for it.
    """
    import numpy as np  # `slipscope stop` reads this module and must start fast

    if not path.exists():
        size = math.prod(shape) * dtype.itemsize
        try:
            with path.open("wb") as file:
                file.write(bytes(size))  # a mapped page that there is no room for ends a process
        except OSError as error:
            path.unlink(missing_ok=True)
            raise UserError(
                f"{path}: no room for an image of {size / 1e6:.1f} MB that processes share"
                f" ({error.strerror}); make room in {path.parents[2]}, which in a container is"
                " memory of a size that its start sets (--shm-size)"
            ) from None
    return np.memmap(path, dtype, "r+", shape=shape).view(np.ndarray)


def image_publisher(folder: Path, name: str) -> Callable[[Array], str]:
    """A function that shares images with one caller and answers the name of the file: of two in
    turn, so that one can be looked at while the next comes. The files go with the function.
    """
    import numpy as np  # see `shared_image`

    paths = [folder / f"{name}-{turn}" for turn in "ab"]
    shared: list[Array] = []

    def share(image: Array) -> str:
        if not shared:
            shape = image.shape[0], image.shape[1]
            shared.extend(shared_image(path, shape, image.dtype) for path in paths)
        paths.reverse()
        shared.reverse()
        np.copyto(shared[0], image)
        return paths[0].name

    def remove() -> None:
        shared.clear()  # some systems remove no file that is mapped
        for path in paths:
            with suppress(OSError):
                path.unlink(missing_ok=True)

    weakref.finalize(share, remove)
    return share
