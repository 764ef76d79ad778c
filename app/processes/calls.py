"""Calls from one process of a run to another: the name of a method, its arguments, its result."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable, Mapping
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from typing import Any

LOG = logging.getLogger(__name__)
ANSWER_S = 5.0  # a process that takes longer to answer is reported
Methods = Mapping[str, Callable[..., Any]]


class Gone(ConnectionError):
    """The other process has ended, or let go of this one."""


class Silent(TimeoutError):
    """The other process has not answered in time."""


class Caller:
    """Calls a process that listens at an address, one call at a time, from any thread."""

    def __init__(self, address: str, key: bytes) -> None:
        self._address, self._key = address, key
        self._lock = threading.Lock()
        self._line: Connection[Any, Any] | None = None
        self._closed = False

    def __call__(self, name: str, *arguments: Any, answer_s: float | None = ANSWER_S) -> Any:
        """What the method answers; its exception is raised here.

        Raises
        ------
        Gone, Silent
        """
        with self._lock:
            if self._closed:
                raise Gone(f"{name}: the connection is closed")
            try:
                if self._line is None:
                    self._line = Client(self._address, authkey=self._key)
                self._line.send((name, arguments))
                if not self._line.poll(answer_s):
                    self._line.close()  # an answer that comes late is nobody's
                    self._line = None
                    raise Silent(f"{name}: no answer within {answer_s:g} s")
                is_result, result = self._line.recv()
            except TimeoutError:
                raise
            except (OSError, EOFError) as error:
                raise Gone(f"{name}: the other process is gone ({error})") from error
        if is_result:
            return result
        raise result

    def close(self) -> None:
        """Let go; a call under way ends first."""
        with self._lock:
            self._closed = True
            if self._line is not None:
                self._line.close()


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
        self._listener = Listener(place, authkey=key, backlog=8)
        self.address = place
        self.connections = 0
        self._methods = methods
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, name="slipscope-calls", daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                line = self._listener.accept()
            except Exception as error:  # of the one that called; the next may know the key
                LOG.debug("a connection was refused", exc_info=error)
                continue
            with self._lock:
                self.connections += 1
            threading.Thread(
                target=self._serve, args=(line,), name="slipscope-caller", daemon=True
            ).start()

    def _serve(self, line: Connection[Any, Any]) -> None:
        try:
            with line:
                serve(line, self._methods())
        except OSError:
            pass  # the caller is gone
        finally:
            with self._lock:
                self.connections -= 1


def serve(line: Connection[Any, Any], methods: Methods) -> None:
    """Answer the calls of one connection until it ends."""
    while True:
        try:
            name, arguments = line.recv()
        except EOFError:
            return
        try:
            answer = True, methods[name](*arguments)
        except Exception as error:
            LOG.debug("%s failed", name, exc_info=error)
            answer = False, plain(error)
        line.send(answer)


def plain(error: Exception) -> Exception:
    """The error, or one that says the same and can be sent."""
    import pickle

    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
