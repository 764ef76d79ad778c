"""A serial port with an emulated device connected to it: a pseudo-terminal or a network port, which
can be slow, noisy, mute or cut.
"""

from __future__ import annotations

import heapq
import itertools
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Protocol


class Device(Protocol):
    """The device on the line."""

    def answer(self, command: bytes) -> bytes:
        """The answer to a command, both without the end of the line; empty if there is none.

        Raises `ConnectionError` if the line has been pulled out.
        """


def garbled(answer: bytes) -> bytes:
    """An answer after a disturbed line: every third byte is changed."""
    return bytes(byte | 0x80 if i % 3 == 1 else byte for i, byte in enumerate(answer))


class SerialLine:
    """The line and its far end.

    Parameters
    ----------
    device : Device
    over : str
        "pty" (not on Windows) or "tcp"; "": "pty" if the system has it.
    byte_s : float
        Time that a byte takes in each direction: 10 / 57600 for 57600 baud.
    think_s : float
        Time between a command and the answer.
    deaf_s : float
        How long the device ignores what it receives after the end of a command, unless it answers
        before. 0: it hears all; above: also what came together with that command is ignored (SMC100
        manual, section 6.3).

    Attributes
    ----------
    url : str
        That a driver opens, once the line has started.
    arrivals : list of (float, bytes)
        Commands with the time (``time.monotonic``) at which their last byte arrived.
    ignored : bytes
        What came while the device was deaf.
    is_mute : bool
        Whether answers are lost.
    noise : function
        Gives what arrives of each answer.
    """

    def __init__(
        self,
        device: Device,
        over: str = "",
        *,
        byte_s: float = 0.0,
        think_s: float = 0.0,
        deaf_s: float = 0.0,
    ) -> None:
        self.url = ""
        self.ignored = b""
        self.arrivals: list[tuple[float, bytes]] = []
        self.is_mute = False
        self.noise: Callable[[bytes], bytes] = lambda answer: answer
        self._device = device
        self._over = over or ("pty" if os.name == "posix" else "tcp")
        self.byte_s, self.think_s = byte_s, think_s
        self.deaf_s, self._deaf_until = deaf_s, 0.0
        self._wire: _Pty | _Tcp | None = None
        self._thread: threading.Thread | None = None
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = itertools.count()
        # times at which the wires to and from the device will have carried everything so far
        self._free_at = [0.0, 0.0]

    def start(self) -> str:
        """Begin to listen; gives the url."""
        self._wire = _Pty() if self._over == "pty" else _Tcp()
        self.url = self._wire.url
        self._alarm, self._bell = socket.socketpair()
        self._thread = threading.Thread(
            target=self._serve, args=(self._wire,), name="serial line", daemon=True
        )
        self._thread.start()
        return self.url

    def cut(self) -> None:
        """Cut the line, also one that is no longer needed: the port of the other side is gone."""
        if self._thread is None:
            return
        self._bell.close()
        self._thread.join()
        self._thread = None

    def _serve(self, wire: _Pty | _Tcp) -> None:
        pending = b""
        try:
            while True:
                wait = max(0.0, self._due[0][0] - time.monotonic()) if self._due else None
                ready, _, _ = select.select([self._alarm, *wire.ears()], [], [], wait)
                if self._alarm in ready:
                    return
                *commands, pending = self._heard(pending, wire.receive(ready))
                for command in commands:
                    self._after(
                        0, len(command) + 1, 0.0, partial(self._arrive, wire, command.strip())
                    )
                while self._due and self._due[0][0] <= time.monotonic():
                    heapq.heappop(self._due)[2]()
        except ConnectionError:
            return
        finally:
            self._due.clear()
            wire.close()
            self._alarm.close()

    def _heard(self, pending: bytes, received: bytes) -> list[bytes]:
        """Commands that are complete, then the beginning of the next."""
        if not self.deaf_s:
            return (pending + received).split(b"\n")
        if received and time.monotonic() < self._deaf_until:
            self.ignored += received
            return [pending]
        command, end, rest = (pending + received).partition(b"\n")
        if not end:
            return [command]
        carried_s = len(command + end) * self.byte_s
        self._deaf_until = time.monotonic() + carried_s + self.deaf_s
        self.ignored += rest
        return [command, b""]

    def _after(self, way: int, n_bytes: int, delay_s: float, action: Callable[[], None]) -> None:
        self._free_at[way] = (
            max(self._free_at[way], time.monotonic() + delay_s) + n_bytes * self.byte_s
        )
        heapq.heappush(self._due, (self._free_at[way], next(self._numbers), action))

    def _arrive(self, wire: _Pty | _Tcp, command: bytes) -> None:
        self.arrivals.append((time.monotonic(), command))
        answer = self._device.answer(command)
        if answer and not self.is_mute:
            self._deaf_until = 0.0  # it is done with the query
            sent = self.noise(answer) + b"\r\n"
            self._after(1, len(sent), self.think_s, lambda: wire.send(sent))


class _Pty:
    """A pseudo-terminal, of which one end stays open, so that drivers may come and go."""

    _master: int
    _slave: int
    url: str

    def __init__(self) -> None:
        import pty
        import tty

        if sys.platform != "win32":
            self._master, self._slave = pty.openpty()
            tty.setraw(self._slave)
            self.url = os.ttyname(self._slave)

    def ears(self) -> list[int | socket.socket]:
        return [self._master]

    def receive(self, ready: list[int | socket.socket]) -> bytes:
        return os.read(self._master, 4096) if self._master in ready else b""

    def send(self, answer: bytes) -> None:
        os.write(self._master, answer)

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class _Tcp:
    """A port of this computer, as of a server of serial devices: what any caller sends goes to the
    device, and its answers go to all of them.
    """

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._callers: list[socket.socket] = []
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def ears(self) -> list[int | socket.socket]:
        return [self._listener, *self._callers]

    def receive(self, ready: list[int | socket.socket]) -> bytes:
        received = b"".join(
            self._from(caller) for caller in tuple(self._callers) if caller in ready
        )
        if self._listener in ready:
            caller, _ = self._listener.accept()
            caller.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._callers.append(caller)
        return received

    def _from(self, caller: socket.socket) -> bytes:
        try:
            received = caller.recv(4096)
        except OSError:
            received = b""
        if not received:
            caller.close()
            self._callers.remove(caller)
        return received

    def send(self, answer: bytes) -> None:
        for caller in self._callers:
            with suppress(OSError):  # it has hung up
                caller.sendall(answer)

    def close(self) -> None:
        for each in (self._listener, *self._callers):
            each.close()
