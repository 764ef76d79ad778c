"""The line to a Newport controller, serial or over the network: sends commands and reads answers,
from any thread.

The controllers speak ASCII: ``1PA12.5`` has no answer, ``1TP`` has the answer ``1TP12.5``. A
controller keeps the error of a command until ``TE`` reads it.
"""

from __future__ import annotations

import errno
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.protocols import Found

ANSWER_S = 0.25  # the controllers take some 10 ms
# for one query with its wait and its repetitions, so that a dead line is found within a second
PATIENCE_S = 0.8
TRIES = 3
_DAMAGED = "AS"  # answers to a command that arrived damaged and is sent again


def find() -> list[Found]:
    """Serial ports of this computer, any of which may lead to a controller; none is opened."""
    try:
        from serial.tools.list_ports import comports
    except ImportError as error:
        raise _no_pyserial("serial ports") from error
    return [Found(port.device, port.description) for port in sorted(comports())]


def _no_pyserial(who: str) -> DeviceNotFound:
    return DeviceNotFound(
        f"{who}: the package pyserial is not installed; in the folder of SlipScope: pip install ."
    )


class NewportLine:
    """The line to one controller.

    Only one query at a time waits for its answer, and those of a stop come first. Writing has a
    lock of its own, held for one command only: a stop is sent at once, even while another answer is
    awaited, because it has no answer that could be mistaken for that one.
    """

    def __init__(self, who: str, port: str, address: int, baud: int) -> None:
        self.stops = 0  # commands to stop so far
        self.heard = ""  # what came instead of an answer when the last query failed
        self._who, self._name, self._address = who, port, address
        self._pen = threading.Lock()
        self._turns = threading.Condition()
        self._is_taken = False
        self._urgent = 0
        self._port = _claimed(who, port, baud)
        self._socket = getattr(self._port, "_socket", None)

    def close(self) -> None:
        """Let go of the port, once the query under way has ended."""
        with self._turn(time.monotonic() + PATIENCE_S, urgent=True):
            try:
                self._port.close()
                if self._socket is not None:
                    self._socket.close()  # pyserial does not if the other side has gone
            except Exception as error:
                raise DeviceFault(f"{self._who}: {self._name} did not close ({error})") from error

    def stop(self) -> None:
        """Send the command to stop, before all that waits."""
        with self._pen:
            self.stops += 1
            self._write("ST")

    def ask(
        self, query: str, form: str, *, urgent: bool = False, give_up: float | None = None
    ) -> str:
        """The answer to a query, of the given form (a regular expression with one group); the query
        is repeated if the answer is damaged or does not come.
        """
        give_up, heard = give_up or time.monotonic() + PATIENCE_S, ""
        for _ in range(TRIES):
            answer, noise = self._exchange((query,), form, give_up, urgent=urgent)
            if answer is not None:
                return answer
            heard = noise or heard
        raise self._unanswered(query, heard)

    def tell(self, command: str, *, done: str = "", unless_stopped_since: int | None = None) -> str:
        """The letter of the error of a command, "@" for none. The command is repeated if its
        arrival is in doubt, so that a repetition must do no harm.

        Parameters
        ----------
        done : str
            Letters with which a repetition is refused if the command had arrived before.
        unless_stopped_since : int, optional
            Number of stops so far; nothing is sent any more after a further one.
        """
        give_up, heard, letter = time.monotonic() + PATIENCE_S, "", None
        for attempt in range(TRIES):
            stops = self.stops
            # the error in its memory may be of an earlier command, or of a stop
            self.ask("TE", "([@A-Z])", give_up=give_up)
            letter, noise = self._exchange(
                (command, "TE"), "([@A-Z])", give_up, unless_stopped_since=unless_stopped_since
            )
            if letter is not None and letter not in _DAMAGED and stops == self.stops:
                return "@" if attempt and letter in done else letter
            if unless_stopped_since not in (None, self.stops):
                return "@"
            heard = noise or heard
        if letter is not None:
            return letter
        raise self._unanswered(command, heard)

    def _exchange(
        self,
        commands: tuple[str, ...],
        form: str,
        give_up: float,
        *,
        urgent: bool = False,
        unless_stopped_since: int | None = None,
    ) -> tuple[str | None, str]:
        """One attempt: the answer to the last of the commands, or None and what came instead."""
        prefix, heard = f"{self._address}{commands[-1].rstrip('?')}", ""
        with self._turn(give_up, urgent=urgent), self._alive(commands[0]):
            self._port.reset_input_buffer()
            with self._pen:
                if unless_stopped_since not in (None, self.stops):
                    return None, ""
                self._write(*commands)
            listen_until = min(time.monotonic() + ANSWER_S, give_up)
            while line := self._read_line(listen_until):
                heard = line
                if match := re.fullmatch(re.escape(prefix) + form, line):
                    return match[1], ""
                if line.startswith(prefix) or not re.match(rf"{self._address}[A-Z]{{2}}", line):
                    break  # it is damaged; anything else is a late answer to an earlier query
        return None, heard

    def _write(self, *commands: str) -> None:
        with self._alive(commands[0]):
            self._port.write(
                "".join(f"{self._address}{command}\r\n" for command in commands).encode("ascii")
            )

    def _read_line(self, until: float) -> str:
        raw = b""
        while not raw.endswith(b"\n") and time.monotonic() < until:
            raw += self._port.read_until(b"\n")
        return raw.decode("ascii", "replace").strip()

    @contextmanager
    def _alive(self, command: str) -> Iterator[None]:
        try:
            yield
        except DeviceError:
            raise
        # a dead line shows as OSError, as termios.error or, while the port is closed, as TypeError
        except Exception as error:
            raise DeviceFault(
                f"{self._who}: '{command}' can not be sent, the line {self._name} is dead"
                f" ({error}); a move under way ends by itself at its target: check cable and power,"
                " then start again"
            ) from error

    @contextmanager
    def _turn(self, give_up: float, *, urgent: bool = False) -> Iterator[None]:
        with self._turns:
            self._urgent += urgent
            is_mine = self._turns.wait_for(
                lambda: not self._is_taken and (urgent or not self._urgent),
                give_up - time.monotonic(),
            )
            self._urgent -= urgent
            self._turns.notify_all()
            if not is_mine:
                raise self._unanswered("an earlier query", "")
            self._is_taken = True
        try:
            yield
        finally:
            with self._turns:
                self._is_taken = False
                self._turns.notify_all()

    def _unanswered(self, query: str, heard: str) -> DeviceError:
        self.heard = heard
        if heard:
            return DeviceFault(
                f"{self._who}: '{query}' was sent {TRIES} times, the line {self._name} is noisy:"
                f" the last answer was {heard!r}; check cable, shield, and the speed of the line"
            )
        return DeviceTimeout(
            f"{self._who}: {self._name} gave no answer to '{query}' within {PATIENCE_S:g} s; check"
            " that the controller is on, its cable, and the port and address in the settings"
        )


def _claimed(who: str, port: str, baud: int) -> Any:
    """The port, opened exclusively if the operating system allows that."""
    try:
        import serial
    except ImportError as error:
        raise _no_pyserial(who) from error
    try:
        opened = serial.serial_for_url(
            port, baudrate=baud, xonxoff=True, timeout=0.05, write_timeout=0.3, exclusive=True
        )
        # otherwise a stop waits for the acknowledgement of the query before it: 16 ms at worst
        # instead of 6
        if port.startswith("socket://"):
            opened._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened
    # SerialException in most cases, ValueError for an odd name, termios.error for an odd device
    except Exception as error:
        code = getattr(error, "errno", None)
        # PermissionError on Windows
        if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in str(error):
            raise DeviceFault(
                f"{who}: another program has {port} open; close that program"
            ) from error
        if code == errno.EACCES:
            raise DeviceFault(
                f"{who}: you may not use {port}; become a member of its group (often 'dialout')"
            ) from error
        ports = ", ".join(found.device for found in find()) or "none"
        raise DeviceNotFound(
            f"{who}: the port '{port}' can not be opened ({error}); serial ports of this computer:"
            f" {ports}"
        ) from error
