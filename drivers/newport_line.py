"""The line to a Newport controller: commands out, answers in, from any thread; serial, or over the
network.

The controllers speak ASCII: ``1PA12.5`` and no answer, or ``1TP`` and the answer ``1TP12.5``. What
was wrong with a command they keep until ``TE`` asks for it.
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
# for one query, with its turn and its repetitions: a dead line is known within a second
PATIENCE_S = 0.8
TRIES = 3
_DAMAGED = "AS"  # what a command that came damaged is answered with: it is sent again


def find() -> list[Found]:
    """Serial ports of this computer, none of them opened: any may have a controller behind it."""
    try:
        from serial.tools.list_ports import comports
    except ImportError as error:
        raise _no_pyserial("serial ports") from error
    return [Found(port.device, port.description) for port in sorted(comports())]


def _no_pyserial(who: str) -> DeviceNotFound:
    return DeviceNotFound(
        f"{who}: the package pyserial is not installed; in the folder of SlipScope: pip install"
        " '.[serial]'"
    )


class NewportLine:
    """The line to one controller.

    Queries and their answers take turns, one query at a time, and those of a stop come first.
    Writing has a lock of its own, held for one command only: a stop goes out at once, even while an
    answer is awaited, for it has none that could be mistaken for another.
    """

    def __init__(self, who: str, port: str, address: int, baud: int) -> None:
        self.stops = 0  # how often it was told to stop
        self.heard = ""  # instead of an answer, when the last query failed
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
                    self._socket.close()  # pyserial does not where the other side has gone
            except Exception as error:
                raise DeviceFault(f"{self._who}: {self._name} did not close ({error})") from error

    def stop(self) -> None:
        """Send the command to stop, before whatever waits."""
        with self._pen:
            self.stops += 1
            self._write("ST")

    def ask(
        self, query: str, form: str, *, urgent: bool = False, give_up: float | None = None
    ) -> str:
        """What a query is answered with, of the given form; asked again where the answer is damaged
        or does not come.
        """
        give_up, heard = give_up or time.monotonic() + PATIENCE_S, ""
        for _ in range(TRIES):
            answer, noise = self._exchange((query,), form, give_up, urgent=urgent)
            if answer is not None:
                return answer
            heard = noise or heard
        raise self._unanswered(query, heard)

    def tell(self, command: str, *, done: str = "", unless_stopped_since: int | None = None) -> str:
        """The letter that a command is answered with, "@" for none; sent again where that is in
        doubt, so it must bear repetition.

        `done` are letters which say, to a repetition, that it was understood before. Nothing is
        sent any more once the line has been told to stop more than `unless_stopped_since` times.
        """
        give_up, heard, letter = time.monotonic() + PATIENCE_S, "", None
        for attempt in range(TRIES):
            stops = self.stops
            # what it remembers may be older, or of a stop
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
        """One try: the answer to the last of the commands, or None and what was heard instead."""
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
                    break  # damaged; anything else is the late answer to an earlier query
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
    def _alive(self, asked: str) -> Iterator[None]:
        try:
            yield
        except DeviceError:
            raise
        except Exception as error:  # a dead line shows as OSError, termios.error or, when the port is being closed, TypeError
            raise DeviceFault(
                f"{self._who}: '{asked}' was asked, the line {self._name} is dead ({error}); a move"
                " under way ends by itself at its target:"
                " check cable and power, then start again"
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
                raise self._unanswered("what came before", "")
            self._is_taken = True
        try:
            yield
        finally:
            with self._turns:
                self._is_taken = False
                self._turns.notify_all()

    def _unanswered(self, asked: str, heard: str) -> DeviceError:
        self.heard = heard
        if heard:
            return DeviceFault(
                f"{self._who}: '{asked}' was asked {TRIES} times, noisy line {self._name}: the last"
                f" answer was {heard!r};"
                " check cable, shield, and the speed of the line"
            )
        return DeviceTimeout(
            f"{self._who}: '{asked}' was asked, {self._name} gave no answer within {PATIENCE_S:g}"
            " s;"
            " check that the controller is on, its cable, and the port and address in the settings"
        )


def _claimed(who: str, port: str, baud: int) -> Any:
    """The port, open for nobody else where the system can do that."""
    try:
        import serial
    except ImportError as error:
        raise _no_pyserial(who) from error
    try:
        opened = serial.serial_for_url(
            port, baudrate=baud, xonxoff=True, timeout=0.05, write_timeout=0.3, exclusive=True
        )
        # or a stop waits for the acknowledgement of the query before it: 16 ms at worst instead of
        # 6
        if port.startswith("socket://"):
            opened._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened
    except Exception as error:  # SerialException for most, ValueError for a strange name, termios.error for a strange device
        code = getattr(error, "errno", None)
        # the latter on Windows
        if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in str(error):
            raise DeviceFault(
                f"{who}: {port} was asked, another program has it open; close that program"
            ) from error
        if code == errno.EACCES:
            raise DeviceFault(
                f"{who}: {port} was asked, you may not use it; become a member of its group (often"
                " 'dialout')"
            ) from error
        ports = ", ".join(found.device for found in find()) or "none"
        raise DeviceNotFound(
            f"{who}: the port '{port}' was asked, it can not be opened ({error}); serial ports of"
            f" this computer: {ports}"
        ) from error
