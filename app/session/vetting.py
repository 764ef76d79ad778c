"""What lies where in a session from anywhere: HDF5 is asked in a process of its own, with limits on
memory and time and without a network, unless this computer closed the file itself.

The process is a small one that waits for files and forks for each; where there is no fork, each
file has a fresh one. Its answer is plain data of known types, so that nothing that becomes of it
reaches this process.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import signal
import struct
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec

from app.session import trust
from app.session.contents import COPY, Contents, Refused, contents_of
from app.system.inputs import holes_of

MOST_BYTES = 1 << 30  # memory that HDF5 may take for a file
LEAST_S, S_PER_GB = 5.0, 5.0  # that it may take, and for each GB more of the file
MOST_ANSWER = 1 << 28  # bytes
MOST_SEEN = 8  # files whose contents are remembered
_ASKED = struct.Struct("<Id")  # bytes of a path, seconds
_ANSWERED = struct.Struct("<iI")  # how the process ended, bytes of its answer
_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000

_idle: list[subprocess.Popen[bytes]] = []  # processes that wait for a file
# of the last few files, by their identity: what is in them, or why they cannot be read
_seen: dict[str, Contents | Refused] = {}
_encoded = msgspec.msgpack.Encoder().encode
# what lies where, or else why it cannot be read and what to do
_decoded = msgspec.msgpack.Decoder(tuple[Contents | None, str, str]).decode


def vetted(path: Path) -> Contents:
    """What lies where in a file.

    Raises
    ------
    Refused
        It cannot be read, or HDF5 cannot stand it.
    """
    try:
        identity = trust.identity_of(path)
        found = _seen.get(identity)
        if found is None:
            try:
                found = contents_of(path) if trust.is_known(path) else _of_stranger(path)
            except Refused as refused:
                found = refused
            # another thread may do the same; each of these steps is one for all threads
            for old in list(_seen)[: 1 - MOST_SEEN]:
                _seen.pop(old, None)
            _seen[identity] = found
        if isinstance(found, Refused):
            raise Refused(*found.args)
        return found
    except OSError as error:
        raise Refused(f"the {{}} cannot be read: {error.strerror or error}", COPY) from None


def _of_stranger(path: Path) -> Contents:
    held = path.stat()
    if holes := holes_of(path):
        raise Refused(holes, COPY)
    seconds = LEAST_S + S_PER_GB * held.st_size / 1e9
    ask = _ask_waiting if hasattr(os, "fork") else _ask_fresh
    cause, answer = ask(os.fsencode(path.absolute()), seconds)
    try:
        contents, found, remedy = _decoded(answer)
    except (msgspec.MsgspecError, ValueError):
        raise Refused(f"the {{}} cannot be read: HDF5 {cause}", COPY) from None
    if contents is None:
        raise Refused(found, remedy)
    return contents


def _ask_waiting(path: bytes, seconds: float) -> tuple[str, bytes]:
    """Why there may be no answer, and the answer of a process that forks for the file."""
    process = _waiting()
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(_ASKED.pack(len(path), seconds) + path)
        process.stdin.flush()
        end, length = _ANSWERED.unpack(process.stdout.read(_ANSWERED.size))
        answer = process.stdout.read(min(length, MOST_ANSWER))
    except (OSError, struct.error):
        _end(process)
        return "cannot be started", b""
    except BaseException:
        _end(process)
        raise
    _idle.append(process)
    if end >= 0:
        return "fails at it", answer
    name = signal.Signals(-end).name
    return _too_long(seconds) if name == "SIGALRM" else f"dies of it ({name})", answer


def _ask_fresh(path: bytes, seconds: float) -> tuple[str, bytes]:
    """Likewise of a process for this file alone."""
    import psutil

    process, until = _started(os.fsdecode(path)), time.monotonic() + seconds
    while True:
        with suppress(subprocess.TimeoutExpired):
            return f"dies of it ({process.returncode})", process.communicate(timeout=0.1)[0]
        taken = 0
        with suppress(psutil.Error):
            taken = psutil.Process(process.pid).memory_info().rss
        if taken > MOST_BYTES or time.monotonic() > until:
            _end(process)
            return _too_much() if taken > MOST_BYTES else _too_long(seconds), b""


def _too_long(seconds: float) -> str:
    return f"does not come to an end with it in {seconds:.0f} s"


def _too_much() -> str:
    return f"takes more than {MOST_BYTES >> 20} MiB for it"


def _waiting() -> subprocess.Popen[bytes]:
    """A process that waits for a file."""
    while _idle:
        with suppress(IndexError):  # another thread was faster
            process = _idle.pop()
            if process.poll() is None:
                return process
            _end(process)
    return _started()


def _started(*arguments: str) -> subprocess.Popen[bytes]:
    paths = [*filter(None, sys.path), str(Path(__file__).parents[2])]
    env = {"PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1"}
    env["HDF5_PLUGIN_PRELOAD"] = "::"  # no plug-ins at all
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "app.session.vetting", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | env,
        start_new_session=True,  # Ctrl-C is for this process
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


@atexit.register
def _end_all() -> None:
    while _idle:
        _end(_idle.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # they are the other process's


# ---------------------------------------------------------------------- in the other process


def _answer(path: str) -> bytes:
    try:
        return _encoded((contents_of(Path(path)), "", ""))
    except Refused as refused:
        return _encoded((None, *refused.args))
    except MemoryError:
        return _encoded((None, f"the {{}} cannot be read: HDF5 {_too_much()}", COPY))
    except Exception as error:
        return _encoded((None, f"the {{}} is damaged: {error}", COPY))


def _limit(seconds: float) -> None:
    """End this process by the time, and let it take no more memory than it may, nor write files."""
    import resource

    if sys.platform != "win32":
        for what, most in (("AS", MOST_BYTES), ("CORE", 0), ("FSIZE", 0), ("NPROC", 0)):
            with suppress(ValueError, OSError):  # not of this system
                resource.setrlimit(getattr(resource, f"RLIMIT_{what}"), (most, most))
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _leave_the_network() -> None:
    """Be where no network is, if the system lets anybody: on Linux."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if libc.unshare(_CLONE_NEWNET):
            libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET)


def _serve() -> None:
    """Fork for each file that is asked about, and pass on what becomes of that."""
    asked, answers = sys.stdin.buffer, sys.stdout.buffer
    while len(head := asked.read(_ASKED.size)) == _ASKED.size:
        length, seconds = _ASKED.unpack(head)
        path = os.fsdecode(asked.read(length))
        end, answer = _forked(path, seconds)
        answers.write(_ANSWERED.pack(end, len(answer)) + answer)
        answers.flush()


def _forked(path: str, seconds: float) -> tuple[int, bytes]:
    """How a process that was forked for a file has ended, and its answer."""
    if sys.platform == "win32":
        raise NotImplementedError  # `_ask_fresh` is for systems without
    else:
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                _limit(seconds)
                with os.fdopen(write, "wb") as pipe:
                    pipe.write(_answer(path))
            finally:
                os._exit(0)
        os.close(write)
        with os.fdopen(read, "rb") as pipe:
            answer = pipe.read(MOST_ANSWER)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), answer


if __name__ == "__main__":
    _leave_the_network()
    if sys.argv[1:]:
        sys.stdout.buffer.write(_answer(sys.argv[1]))
    else:
        _serve()
