"""Starts the processes of a run, and says hello."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from typing import Any, BinaryIO, cast

from app.errors import UserError
from drivers.errors import DeviceError


class ProcessFailed(DeviceError):
    """A part of the bench could not begin."""


def started(module: str, payload: Any, log: Path | None = None) -> subprocess.Popen[bytes]:
    """A new process, the `main` of that module, that was given `payload`, which can be pickled.

    It is a session of its own: neither Ctrl-C nor a closed terminal reaches it. What it has to say
    on standard error goes to `log`, or to that of this process.
    """
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    own: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        flags = subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP
        own = {"creationflags": flags}
    with log.open("ab") if log else nullcontext() as errors:
        process = subprocess.Popen(
            # -P: nothing is imported from the current folder because it is the current one
            [sys.executable, "-P", "-m", "app.processes", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=os.environ | {"PYTHONPATH": paths},
            **own,
        )
    assert process.stdin is not None
    try:
        pickle.dump(payload, process.stdin)
        process.stdin.flush()
    except OSError:
        pass  # it is gone already, which its hello will tell
    return process


def hello_of(process: subprocess.Popen[bytes], log: Path | None = None) -> Any:
    """What a process says once it is ready.

    Raises
    ------
    UserError, DeviceError
        It can not begin for that reason.
    ProcessFailed
        It ended before it was ready.
    """
    try:
        hello = pickle.load(cast(BinaryIO, process.stdout))
    except (EOFError, OSError, pickle.UnpicklingError):
        code = process.wait()
        said = log.read_text(encoding="utf-8", errors="replace").strip() if log else ""
        last = said.splitlines()[-1] if said else "it said nothing"
        part = cast(list[str], process.args)[-1].rpartition(".")[2]
        raise ProcessFailed(
            f"{part}: its process ended with code {code} before it was ready: {last}"
        ) from None
    if isinstance(hello, UserError | DeviceError):
        raise hello
    return hello


def end_with_parent() -> None:
    """End this process as soon as the one that started it is gone, or lets go of its pipe."""

    def listen() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os._exit(1)

    threading.Thread(target=listen, name="slipscope-parent", daemon=True).start()


def payload() -> Any:
    """What this process was given."""
    return pickle.load(sys.stdin.buffer)


def say_hello(what: Any) -> None:
    """Tell the process that started this one that it is ready, or why it is not; once."""
    try:
        pickle.dump(what, sys.stdout.buffer)
        sys.stdout.buffer.flush()
    except OSError:
        pass  # nobody listens any more
    sys.stdout = sys.stderr  # what is printed from now on is for nobody but the log
