"""The line to a Newport controller, serial or over the network: sends commands and reads answers,
from any thread.

The controllers speak ASCII: ``1PA12.5`` has no answer, ``1TP`` has the answer ``1TP12.5``. A
controller keeps the error of a command until ``TE`` reads it. It ignores what follows the end of a
command in the same transfer, so that every command is sent apart, once the one before has been
carried and interpreted.
"""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers import installation
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.protocols import Found
from drivers.stages.port_lock import locked
from drivers.turns import TurnClock

ANSWER_S = 0.2  # the controllers take some 10 ms
LEAST_ANSWER_S = 0.1  # where there must be time for repetitions
# for one query with its wait and its repetitions, so that the stage is stopped within a second
PATIENCE_S = 0.6
TRIES = 3
READ_S = 0.05  # longest single read
LOOK_S = 0.1  # between two looks at the clock while another has the line: longer ones do not count
LONGEST_LINE_S = 0.1  # for which a line may go on once its time is over
# of a pause after a command, at its first sending and at each repetition
LONGER = (1, 4, 15)
LONGEST_PAUSE_S = 0.15  # longest pause before a query is repeated
_DAMAGED = "AS"  # answers to a command that arrived damaged and is sent again
TAKES_S, WAITS = 0.3, 3  # a port for which a command waits so long, in so many looks, is dead


def find() -> list[Found]:
    """Serial ports of this computer, any of which may lead to a controller; none is opened."""
    try:
        from serial.tools.list_ports import comports
    except ImportError as error:
        raise _no_pyserial("serial ports") from error
    return [Found(port.device, port.description) for port in sorted(comports())]


def _no_pyserial(who: str) -> DeviceNotFound:
    return DeviceNotFound(
        f"{who}: the package pyserial is not installed; to install it:"
        f" {installation.add('pyserial', needed=True)}"
    )


class NewportLine:
    """The line to one controller.

    A controller hears nothing for a while after a command that has no answer, some for 10 ms and
    some for 60. The line pauses for `pause_s` then, and longer at each repetition; a pause after
    which a silent controller has answered is kept for the commands that follow.

    Only one query at a time waits for its answer, and those of a stop come first. Writing has a
    lock of its own, held for one command only: a stop waits for nothing but the end of the command
    before it, even while another answer is awaited, because it has no answer that could be mistaken
    for that one.
    """

    def __init__(self, who: str, port: str, address: int, baud: int, pause_s: float = 0.01) -> None:
        self.pause_s = pause_s
        self.stops = 0  # commands to stop so far
        self.heard = ""  # what came instead of an answer when the last query failed
        self.is_mute = False  # the last query had no answer at all
        self._who, self._name, self._address, self._baud = who, port, address, baud
        self._pen = threading.Lock()
        self._clear_at = 0.0  # the controller will have interpreted what was written so far
        # what is waited for: a controller is not blamed for the time in which this program had no
        # turn to listen, and an emulated one had none to answer
        self.clock = TurnClock()
        self._is_owed = False  # an answer that was given up may still come
        self._turns = threading.Condition()
        self._is_taken = False
        self._urgent = 0
        with ExitStack() as claims:
            if "://" in port:  # the operating system knows the owner of a serial port only
                claims.enter_context(locked(who, port))
            self._port = _claimed(who, port, baud, exclusive=True)
            self._claims = claims.pop_all()
        self._socket = getattr(self._port, "_socket", None)

    def close(self) -> None:
        """Let go of the port, once the query under way has ended."""
        with self._turn(self.clock.read() + PATIENCE_S, urgent=True):
            try:
                self._port.close()
                if self._socket is not None:
                    self._socket.close()  # pyserial does not if the other side has gone
            except Exception as error:
                raise DeviceFault(f"{self._who}: {self._name} did not close ({error})") from error
            finally:
                self._claims.close()

    def stop(self) -> None:
        """Send the command to stop, before all that waits."""
        with self._pen:
            self.stops += 1
            clear_at = self._clear_at
            self._write("ST")
            if clear_at > time.monotonic():  # a controller may ignore what comes too early
                time.sleep(max(0.0, max(clear_at, self._clear_at) - time.monotonic()))
                self._write("ST")

    def ask(
        self, query: str, form: str, *, urgent: bool = False, give_up: float | None = None
    ) -> str:
        """The answer to a query, of the given form (a regular expression with one group); the query
        is repeated if the answer is damaged or does not come.
        """
        give_up, heard = give_up or self.clock.read() + PATIENCE_S, ""
        for _ in range(TRIES):
            answer, noise = self._exchange(query, form, give_up, urgent=urgent)
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
        give_up, heard, letter = self.clock.read() + PATIENCE_S + LONGEST_PAUSE_S, "", None
        planned_s = pauses_s(self.pause_s)
        for attempt, pause_s in enumerate(planned_s):
            stops = self.stops
            # the error in its memory may be of an earlier command, or of a stop
            try:
                self.ask("TE", "([@A-Z])", give_up=give_up)
                if self._is_owed:  # it would pass for that to the command; answers keep their order
                    self.ask("VE", "(.*)", give_up=give_up)
                    self._is_owed = False
            except DeviceTimeout:
                if not attempt:
                    raise
                break  # silent since the command
            # a stop may have to wait for the end of an answer: these have no part of the pauses
            left_s = give_up - LONGEST_PAUSE_S - self.clock.read() - sum(planned_s[attempt:])
            if attempt and give_up - self.clock.read() < pause_s:
                break  # its answer would come too late
            letter, noise = self._exchange(
                "TE",
                "([@A-Z])",
                give_up,
                after=command,
                pause_s=pause_s,
                answer_s=min(ANSWER_S, max(LEAST_ANSWER_S, left_s / (TRIES - attempt))),
                unless_stopped_since=unless_stopped_since,
            )
            if letter is not None and not heard:  # silent at every attempt before
                self.pause_s = pause_s
            if letter is not None and letter not in _DAMAGED and stops == self.stops:
                return "@" if attempt and letter in done else letter
            if unless_stopped_since not in (None, self.stops):
                return "@"
            heard = noise or heard
        if letter is not None:
            return letter
        raise self._unanswered(command, heard, is_command=True)

    def _exchange(
        self,
        query: str,
        form: str,
        give_up: float,
        *,
        urgent: bool = False,
        after: str = "",
        pause_s: float | None = None,
        answer_s: float | None = None,
        unless_stopped_since: int | None = None,
    ) -> tuple[str | None, str]:
        """One attempt: the answer to a query, or None and what came instead. The command `after`
        which it asks is sent first, unless there was a further stop, and `pause_s` is waited.
        """
        prefix, heard = f"{self._address}{query.rstrip('?')}", ""
        with self._turn(give_up, urgent=urgent), self._alive(after or query):
            self._port.reset_input_buffer()
            if after and not self._send(after, unless_stopped_since, pause_s):
                return None, ""
            self._send(query)
            written = self._clear_at
            listen_until = min(self.clock.read() + (answer_s or ANSWER_S), give_up)
            is_over = False
            while not is_over and (line := self._read_line(listen_until)):
                is_over = self.clock.read() >= listen_until
                self.is_mute = False
                is_whole = line.endswith(("\r", "\n"))  # otherwise digits may be missing
                line = heard = line.strip()
                if is_whole and (match := re.fullmatch(re.escape(prefix) + form, line)):
                    with self._pen:  # the controller listens, unless there was a stop meanwhile
                        self._clear_at = 0.0 if self._clear_at == written else self._clear_at
                    return match[1], ""
                if line.startswith(prefix) or not re.match(rf"{self._address}[A-Z]{{2}}", line):
                    break  # it is damaged; anything else is a late answer to an earlier query
            else:
                self._is_owed = True
        return None, heard

    def _send(
        self,
        command: str,
        unless_stopped_since: int | None = None,
        pause_s: float | None = None,
    ) -> bool:
        """Send a command once the line is clear and no stop waits; whether it was sent."""
        while True:
            time.sleep(max(0.0, self._clear_at - time.monotonic()))
            with self._pen:
                if unless_stopped_since not in (None, self.stops):
                    return False
                if self._clear_at <= time.monotonic():
                    self._write(command, pause_s)
                    return True

    def _write(self, command: str, pause_s: float | None = None) -> None:
        sent = f"{self._address}{command}\r\n".encode("ascii")
        with self._alive(command):
            write_whole(self._port, sent)
        pause_s = self.pause_s if pause_s is None else pause_s
        self._clear_at = time.monotonic() + len(sent) * 10 / self._baud + pause_s

    def _read_line(self, until: float) -> str:
        """A line, or what there is of it by then; what came while there was no turn counts."""
        raw, is_over = b"", False
        while not raw.endswith(b"\n") and not is_over:
            more = self._port.read_until(b"\n")
            raw += more
            late_s = self.clock.read(READ_S) - until
            is_over = late_s >= 0 and (not more or late_s > LONGEST_LINE_S)
        return raw.decode("ascii", "replace")

    @contextmanager
    def _alive(self, command: str) -> Iterator[None]:
        try:
            yield
        except DeviceError:
            raise
        # a dead line shows as OSError, as termios.error or, while the port is closed, as TypeError
        except Exception as error:
            raise DeviceFault(
                f"{self._who}: '{command}' cannot be sent, the line {self._name} is dead"
                f" ({error}); a move under way ends by itself at its target: check cable and power,"
                " then start again"
            ) from error

    @contextmanager
    def _turn(self, give_up: float, *, urgent: bool = False) -> Iterator[None]:
        def is_free() -> bool:
            return not self._is_taken and (urgent or not self._urgent)

        with self._turns:
            self._urgent += urgent
            is_mine = is_free()
            while not is_mine and (left_s := give_up - self.clock.read()) > 0:
                is_mine = self._turns.wait_for(is_free, min(left_s, LOOK_S))
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

    def _unanswered(self, query: str, heard: str, *, is_command: bool = False) -> DeviceError:
        self.heard, self.is_mute = heard, not heard
        if heard:
            asked = "TE" if is_command else query.rstrip("?")
            what, remedy = "noisy: the last answer was", "cable, shield, and the speed of the line"
            if re.match(rf"{self._address}(?!{asked})[A-Z]{{2}}", heard):
                what = "noisy or slow: the last answer, to another query, was"
                remedy = "what holds the line up or talks on it, as a port server, then its cable"
            return DeviceFault(
                f"{self._who}: '{query}' was sent {TRIES} times, the line {self._name} is"
                f" {what} {heard!r}; check {remedy}"
            )
        remedy = "its cable, and the port and address in the settings"
        if is_command:
            remedy = "and its cable, or raise actuator.command_pause if it needs longer"
        return DeviceTimeout(
            f"{self._who}: {self._name} gave no answer to '{query}' within {PATIENCE_S:g} s; check"
            f" that the controller is on, {remedy}"
        )


@dataclass(frozen=True, slots=True)
class OutsideStop:
    """Stops a controller from another process, through a way of its own to the port; can be
    pickled.
    """

    who: str
    port: str
    baud: int
    address: int

    def stop(self) -> None:
        """Send the command to stop, at once and twice more: the first may meet the rest of a
        command of a program that has died, or a controller that interprets that command.

        Raises
        ------
        DeviceNotFound, DeviceFault
            The port cannot be opened or written to, or the controller takes nothing from it.
        """
        way = _claimed(self.who, self.port, self.baud, exclusive=False)
        try:
            for pause in (0.05, LONGEST_PAUSE_S, 0.0):
                write_whole(way, f"{self.address}ST\r\n".encode("ascii"))
                time.sleep(pause)
            waits = 0
            while is_held := bool(getattr(way, "out_waiting", 0)):  # a socket does not tell
                if waits == WAITS:
                    break
                waits += 1
                time.sleep(TAKES_S / WAITS)
        except Exception as error:  # see `NewportLine._alive`
            raise DeviceFault(
                f"{self.who}: 'ST' cannot be sent, the line {self.port} is dead ({error}); a move"
                " under way ends by itself at its target: check cable and power"
            ) from error
        finally:
            way.close()
        if is_held:
            raise DeviceFault(
                f"{self.who}: 'ST' was written to {self.port}, and the controller has not taken it"
                f" within {TAKES_S:g} s, it holds up what is sent to it (XOFF); it may take it"
                " later, and a move under way ends by itself at its target: watch the stage, then"
                " switch the controller off and on"
            )


def pauses_s(first_s: float) -> list[float]:
    """Pauses after a command at its first sending and at each repetition."""
    return [max(first_s, min(times * first_s, LONGEST_PAUSE_S)) for times in LONGER]


def write_whole(port: Any, sent: bytes) -> None:
    """Write to a port all of this, and each byte once, however late this thread has its turns.

    pyserial's `write` also fails where the port has taken everything, if that was too late, and
    does not say how much was taken. On Windows the system counts both for a serial port.

    Raises
    ------
    TimeoutError
        The port has made this thread wait for `TAKES_S`.
    OSError
    """
    wire = getattr(port, "_socket", None)
    if wire is None and os.name != "posix":
        port.write(sent)
        return
    take, waits = wire.send if wire else partial(os.write, port.fileno()), 0
    while sent:
        try:
            sent = sent[take(sent) :]
        except BlockingIOError:
            if waits == WAITS:
                raise TimeoutError(f"it did not take all of it in {TAKES_S:g} s") from None
            waits += 1  # one that lasts longer than it should counts as a short one
            select.select([], [port], [], TAKES_S / WAITS)


def _claimed(who: str, port: str, baud: int, *, exclusive: bool) -> Any:
    """The port, opened exclusively if that is asked and the operating system allows it."""
    try:
        import serial
    except ImportError as error:
        raise _no_pyserial(who) from error
    try:
        if "://" in port and not port.startswith("socket://"):  # pyserial knows others
            raise ValueError("neither a device nor socket://host:port")
        opened = serial.serial_for_url(
            port,
            baudrate=baud,
            xonxoff=True,
            timeout=READ_S,
            write_timeout=TAKES_S,
            exclusive=exclusive or None,
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
            f"{who}: the port '{port}' cannot be opened ({error}); serial ports of this computer:"
            f" {ports}"
        ) from error
