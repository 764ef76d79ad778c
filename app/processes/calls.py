"""Calls from one process of a run to another: the name of a method, its arguments, its result."""

from __future__ import annotations

import logging
import math
import os
import pickle
import queue
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import AuthenticationError
from multiprocessing.connection import (
    Client,
    Connection,
    Listener,
    answer_challenge,
    deliver_challenge,
)
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from app.system.errors import in_full
from app.system.threads import start_thread

if TYPE_CHECKING:
    if sys.platform == "win32":
        from multiprocessing.connection import PipeConnection

        Line = Connection[Any, Any] | PipeConnection[Any, Any]
    else:
        Line = Connection[Any, Any]

LOG = logging.getLogger(__name__)
ANSWER_S = 5.0  # a process that takes longer to answer is reported
SHAKES_S = 5.0  # a caller that shows no key for so long is let go
REFUSED_S = 0.05  # pause before the next connection is accepted
# carried out however late they come; of any other call its caller was told that nothing came of it
ENDS = ("stop_motion", "let_go", "request_stop", "close")
_call = threading.local()
Methods = Mapping[str, Callable[..., Any]]
Messages = queue.SimpleQueue[Any]


class Gone(ConnectionError):
    """The other process has ended, or let go of this one."""


class Silent(TimeoutError):
    """The other process has not answered in time."""


class Caller:
    """Calls a process that listens at an address, one call at a time, from any thread.

    The connection is made at once, and again after one that failed; a call waits for it, for its
    turn and for its answer `answer_s` in all.
    """

    def __init__(self, address: str, key: bytes) -> None:
        self._address, self._key = address, key
        self._lock = threading.Lock()
        self._line: _Connection | None = _Connection(address, key)
        self._closed = False

    def __call__(self, name: str, *arguments: Any, answer_s: float = ANSWER_S) -> Any:
        """What the method answers; its exception is raised here.

        Raises
        ------
        Gone, Silent
        """
        give_up = time.monotonic() + answer_s
        silent = Silent(f"{name}: no answer within {answer_s:g} s")
        if not self._lock.acquire(timeout=answer_s):
            raise silent
        try:
            if self._closed:
                raise Gone(f"{name}: the connection is closed")
            line, self._line = self._line or _Connection(self._address, self._key), None
            try:
                request = (name, arguments, give_up - answer_s, give_up)
                is_result, result = line.ask(request, give_up)
            except queue.Empty:
                raise silent from None  # an answer that comes late is nobody's
            except (OSError, EOFError, AuthenticationError) as error:
                raise Gone(f"{name}: the other process is gone ({error})") from error
            self._line = line
        finally:
            self._lock.release()
            if self._closed:  # meanwhile
                self.close(waits=False)
        if is_result:
            return result
        raise result

    def close(self, *, waits: bool = True) -> None:
        """Let go once a call under way has ended; returns at once if that is not waited for."""
        self._closed = True
        if self._lock.acquire(blocking=waits):
            self._line = None
            self._lock.release()


class _Connection:
    """A connection that is made and used in a thread of its own, which may be left behind: neither
    connecting nor reading has a time limit of its own. It ends when nobody refers to it.
    """

    def __init__(self, address: str, key: bytes) -> None:
        self._requests: Messages = queue.SimpleQueue()
        self._answers: Messages = queue.SimpleQueue()
        start_thread("line", _converse, address, key, self._requests, self._answers)

    def __del__(self) -> None:
        self._requests.put(None)

    def ask(self, request: Any, give_up: float) -> Any:
        """The answer to a request, or the reason why there is none; `queue.Empty` if it has not
        come by then.
        """
        self._requests.put(request)
        answer = self._answers.get(timeout=max(0.0, give_up - time.monotonic()))
        if isinstance(answer, Exception):
            raise answer
        return answer


def _converse(
    address: str,
    key: bytes,
    requests: Messages,
    answers: Messages,
) -> None:
    """Connect, then ask what is requested until that is None or fails.

    `Connection.send` keeps a view of its buffer in the traceback of a broken pipe, of which Python
    3.13 complains on the standard error as it collects both.
    """
    try:
        with Client(address, authkey=key) as line:
            while (request := requests.get()) is not None:
                line.send_bytes(pickle.dumps(request))
                answers.put(line.recv())
    except Exception as error:
        answers.put(error)


class Server:
    """Answers calls in threads of its own, one a connection.

    Parameters
    ----------
    folder : Path
        Where the address is, if it is a file.
    key : bytes
        Who does not know it is turned away.
    methods : callable
        Gives a new connection the methods that it may call.
    """

    def __init__(self, folder: Path, key: bytes, methods: Callable[[], Methods]) -> None:
        place = str(folder / "calls")
        if sys.platform == "win32":
            place = rf"\\.\pipe\slipscope-{folder.name}-{os.getpid()}"
        self.address, self._key = place, key
        self.connections = 0
        self._methods = methods
        self._lock, self._is_closed = threading.Lock(), False
        self._listeners: list[Listener] = []
        self.listen()

    def listen(self) -> None:
        """Accept connections at the address; again, where its file was deleted."""
        listener = Listener(self.address, backlog=8)
        self._listeners.append(listener)
        start_thread("calls", self._accept, listener)

    def close(self) -> None:
        """Accept no further connection; those that are made stay."""
        self._is_closed = True
        with suppress(OSError):
            Client(self.address).close()  # the thread that waits for one goes on
        for listener in self._listeners:
            with suppress(OSError):  # its file is gone already
                listener.close()

    def _accept(self, listener: Listener) -> None:
        while not self._is_closed:
            try:
                line = listener.accept()
            except Exception as error:  # of the one that called, or no descriptor is left
                LOG.debug("a connection was refused", exc_info=error)
                time.sleep(REFUSED_S)
                continue
            # the handshake, too, is in that thread: who says nothing blocks nobody else
            start_thread("caller", self._serve, line)

    def _serve(self, line: Line) -> None:
        with line:
            try:
                shaken = cast("Connection[Any, Any]", _TimedHandshake(line))
                deliver_challenge(shaken, self._key)
                answer_challenge(shaken, self._key)
            except Exception as error:  # it does not know the key, says nothing, or is gone
                LOG.debug("a connection was refused", exc_info=error)
                return
            with self._lock:
                self.connections += 1
            try:
                answer_calls(line, self._methods())
            except OSError:
                pass  # the caller is gone
            finally:
                with self._lock:
                    self.connections -= 1


class _TimedHandshake:
    """A connection during the handshake, in which each message must come in time."""

    def __init__(self, line: Line) -> None:
        self._line, self.send_bytes = line, line.send_bytes

    def recv_bytes(self, size: int) -> bytes:
        """The next message.

        Raises
        ------
        Silent
        """
        if not self._line.poll(SHAKES_S):
            raise Silent(f"a caller has said nothing for {SHAKES_S:g} s")
        return self._line.recv_bytes(size)


def answer_calls(line: Line, methods: Methods) -> None:
    """Answer the calls of one connection until it ends. A process that was suspended, or had no
    turn, finds calls whose callers have given up.
    """
    while True:
        try:
            name, arguments, _call.asked_at, give_up = line.recv()
        except EOFError:
            return
        try:
            if time.monotonic() > give_up and name not in ENDS:  # of all processes alike
                raise Silent(f"{name}: it came too late and was not carried out")
            answer = True, methods[name](*arguments)
        except Exception as error:
            LOG.debug("%s failed", name, exc_info=error)
            answer = False, sendable(error)
        line.send_bytes(pickle.dumps(answer))


def asked_at() -> float:
    """When the call that this thread answers was asked for, by the clock of `time.monotonic`;
    infinite where it answers none.
    """
    at: float = getattr(_call, "asked_at", math.inf)
    return at


def sendable(error: Exception) -> Exception:
    """The error, or one that says the same and can be sent."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(in_full(error))
    return error
