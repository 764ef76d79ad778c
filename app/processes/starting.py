"""Starts the processes of a run, and says when they are ready."""

from __future__ import annotations

import os
import pickle
import queue
import re
import subprocess
import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from app.system.errors import UserError
from app.system.threads import start_thread
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from app.settings.sections import Config

Process = subprocess.Popen[bytes]
READY_S = 120.0  # a process that is not ready by then is ended
# -P: nothing is imported from the current folder because it is the current one
PROGRAM = sys.executable, "-P", "-m", "app.processes"
ENDS_S = 5.0  # time that a process has to end once it says no more
_PLACE = re.compile(r'  File "(.+)", line (\d+)')  # a place in a traceback
LOOKS = 4  # into which a wait is divided
_output: list[BinaryIO] = []


class ProcessFailed(DeviceError):
    """A part of the bench could not begin."""


@dataclass(frozen=True, slots=True)
class RunOrder:
    """A run that is to be made."""

    config: Config
    output: Path
    pace: float
    overwrite: bool


@dataclass(frozen=True, slots=True)
class Launch:
    """What a process that has a bench is given: a run to be made, or the settings of a bench to be
    connected; its folder; and whether its log goes to the terminal.
    """

    order: Any
    folder: Path
    is_verbose: bool = False


def start_process(
    module: str, payload: Any, log: Path | None = None, *, folder: Path | None = None
) -> Process:
    """A new process, the `main` of that module, that was given `payload`, which can be pickled; its
    command line names its folder, if it has one.

    It is a session of its own: neither Ctrl-C nor a closed terminal reaches it. What it has to say
    on standard error goes to `log`, or to that of this process.

    Raises
    ------
    ProcessFailed
        The system starts none.
    """
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    own: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        flags = subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP
        own = {"creationflags": flags}
    command = [*PROGRAM, module]
    try:
        with log.open("ab") if log else nullcontext() as errors:
            process = subprocess.Popen(
                [*command, str(folder)] if folder else command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=os.environ | {"PYTHONPATH": paths},
                **own,
            )
    except OSError as error:  # no memory, too many processes or files
        raise ProcessFailed(
            f"{_part(module)}: its process cannot be started: {error.strerror or error}"
        ) from error
    assert process.stdin is not None
    try:
        pickle.dump(payload, process.stdin)
        process.stdin.flush()
    except OSError:
        pass  # it is gone already, which `wait_until_ready` will tell
    return process


def wait_until_ready(
    process: Process, log: Path | None = None, within_s: float | None = READY_S
) -> Any:
    """What a process says once it is ready.

    Parameters
    ----------
    log : Path, optional
        File of its standard error, in which the reason is looked for.
    within_s : float, optional
        After which a process that says nothing is ended; None for one that may take any time.

    Raises
    ------
    UserError, DeviceError
        It cannot begin for that reason.
    ProcessFailed
        It ended before it was ready, or was not ready in time.
    """
    said: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def listen() -> None:
        try:
            said.put((pickle.load(cast(BinaryIO, process.stdout)),))
        except Exception as error:  # it has ended, or what it says cannot be understood here
            said.put(error)

    start_thread("ready", listen)
    part = _part(cast(list[str], process.args)[len(PROGRAM)])
    try:
        ready = said.get(timeout=within_s)
    except queue.Empty:
        end(process, 0.0)
        raise ProcessFailed(
            f"{part}: its process was not ready within {within_s:g} s and was ended:"
            f" {_reason(log)}; a driver may hang while it is imported or made"
        ) from None
    if isinstance(ready, Exception):
        code = end(process, ENDS_S)
        raise ProcessFailed(
            f"{part}: its process ended with code {code} before it was ready: {_reason(log)}"
        ) from None
    if isinstance(ready[0], UserError | DeviceError):
        raise ready[0]
    return ready[0]


def end(process: Process, within_s: float) -> int:
    """The exit code of a process, which is killed if it goes on for longer than that."""
    with suppress(subprocess.TimeoutExpired):
        return process.wait(within_s)
    process.kill()
    return process.wait()


def _part(module: str) -> str:
    """What a sentence calls the process of a module."""
    return module.rpartition(".")[2]


def _reason(log: Path | None) -> str:
    """The last that a process has said, and the line of a program that it was in."""
    if log is None:
        return "standard error says why"
    try:
        said = log.read_text(encoding="utf-8", errors="replace").strip()
    except OSError as error:
        return f"its log cannot be read ({error.strerror})"
    if not said:
        return "it said nothing"
    *before, last = said.splitlines()
    places = [found for line in before if (found := _PLACE.match(line))]
    if not places:
        return last
    return f"{last} ({Path(places[-1][1]).name}, line {places[-1][2]})"


def end_with_parent() -> None:
    """End this process as soon as the one that started it is gone, or lets go of its pipe."""

    def listen() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os._exit(1)

    start_thread("parent", listen)


def next_awake(items: queue.SimpleQueue[str], within_s: float) -> str:
    """The next item; `queue.Empty` after so long. A look that takes longer than it should counts as
    a short one: this process was suspended, or had no turn, and what came meanwhile is still to be
    read.
    """
    for _ in range(LOOKS - 1):
        with suppress(queue.Empty):
            return items.get(timeout=within_s / LOOKS)
    return items.get(timeout=within_s / LOOKS)


def payload() -> Any:
    """What this process was given."""
    return pickle.load(sys.stdin.buffer)


def keep_output() -> None:
    """Keep standard output for what is told to the process that started this one: whatever else is
    printed in this process, also by a library that is not of Python, goes to standard error.
    """
    _output.append(os.fdopen(os.dup(1), "wb"))  # it is not inherited
    try:
        os.dup2(2, 1)
    except OSError:  # there is no standard error
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), 1)
    sys.stdout = sys.stderr


def send(what: Any) -> None:
    """Tell the process that started this one.

    Raises
    ------
    OSError
        It is gone.
    """
    pickle.dump(what, _output[0])
    _output[0].flush()


def report_ready(what: Any) -> None:
    """Tell the process that started this one that it is ready, or why it is not; once."""
    kind = next((k for k in (UserError, DeviceError) if isinstance(what, k)), None)
    if kind is not None and not type(what).__module__.startswith(("app.", "drivers.")):
        what = kind(str(what))  # the other process may not know its type
    with suppress(OSError):  # nobody listens any more
        send(what)
