"""A stage on a Newport SMC100CC or CONEX-CC controller. The driver counts in metres, the controller
in millimetres.

A controller keeps errors of the stage until the query ``TS`` reads its state, and the error of the
last command until ``TE`` reads that.

References
----------
Newport, SMC100CC & SMC100PP User's Manual (EDH0206En), chapter 5; CONEX-CC Controller
Documentation, chapter 2: commands, states, errors.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import ClassVar

from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.motion import check_target, check_velocity
from drivers.settings import ActuatorSettings
from drivers.stages.newport_line import TRIES, NewportLine, OutsideStop, find

__all__ = ["ConexCc", "Smc100", "find"]

STOPS_WITHIN_S = 2.0  # the fastest moves need half of that to decelerate
_NUMBER = r"([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)"

HOME_FIRST = "home it with the block free to travel: `slipscope check BENCH.toml --home`"
_STATES = {
    "0A": "NOT REFERENCED from reset",
    "0B": "NOT REFERENCED from HOMING",
    "0C": "NOT REFERENCED from CONFIGURATION",
    "0D": "NOT REFERENCED from DISABLE",
    "0E": "NOT REFERENCED from READY",
    "0F": "NOT REFERENCED from MOVING",
    "14": "CONFIGURATION",
    "1E": "HOMING",
    "28": "MOVING",
    "32": "READY from HOMING",
    "33": "READY from MOVING",
    "34": "READY from DISABLE",
    "3C": "DISABLE from READY",
    "3D": "DISABLE from MOVING",
}
_SMC100_STATES = _STATES | {
    "10": "NOT REFERENCED, error of the ESP stage",
    "11": "NOT REFERENCED from JOGGING",
    "1F": "HOMING, commanded by the keypad",
    "35": "READY from JOGGING",
    "3E": "DISABLE from JOGGING",
    "46": "JOGGING from READY",
    "47": "JOGGING from DISABLE",
}
_CONEX_STATES = _STATES | {
    "10": "NOT REFERENCED, no parameters in memory",
    "36": "READY T from READY",
    "37": "READY T from TRACKING",
    "38": "READY T from DISABLE T",
    "3E": "DISABLE from TRACKING",
    "3F": "DISABLE from READY T",
    "46": "TRACKING from READY T",
    "47": "TRACKING from TRACKING",
}
_REMEDIES = {
    "NOT REFERENCED": HOME_FIRST,
    "CONFIGURATION": "leave it with Newport's program",
    "DISABLE": "its motor is off: find out why, then switch it on and go to the origin with"
    " `slipscope check BENCH.toml --home`",
    "JOGGING": "let go of its keypad",
    "TRACKING": "end the tracking with Newport's program",
    "READY T": "end the tracking with Newport's program",
}
_IN_MOTION = ("HOMING", "MOVING", "JOGGING", "TRACKING")
_END_SWITCHES = 0x0003
_ERROR_BITS = (
    "the stage met the end switch of its negative end of run",
    "the stage met the end switch of its positive end of run",
    "the motor reached its peak current limit",
    "the motor reached its RMS current limit",
    "a short circuit was detected in the motor or its cable",
    "following error: the stage did not follow, it is stalled or overloaded",
    "homing took longer than its time-out",
    "the stage is not the one that the controller is configured for (wrong ESP stage)",
    "the supply voltage of the motor is too low",
    "the output power exceeded 80 W",
)
_REFUSALS = {
    "A": "the command is unknown to it, or came damaged",
    "B": "the controller's address is not correct",
    "C": "a parameter is missing or out of its range",
    "D": "the command is not allowed",
    "E": "the search for the origin has already begun",
    "F": "the name of the ESP stage is unknown",
    "G": "the target is outside its soft limits",
    "H": f"not allowed in the state NOT REFERENCED; {HOME_FIRST}",
    "I": f"not allowed in the state CONFIGURATION; {_REMEDIES['CONFIGURATION']}",
    "J": f"not allowed in the state DISABLE; {_REMEDIES['DISABLE']}",
    "K": "not allowed in the state READY",
    "L": "not allowed while it searches the origin (HOMING); wait for its end",
    "M": "not allowed while it moves (MOVING); stop it first, or wait for its end",
    "N": "the stage stands outside its soft limits",
    "S": "the command came in too slowly (communication time-out)",
    "U": "its memory (EEPROM) cannot be accessed",
    "V": "the command failed while it was executed",
    "W": "not allowed for a stepper controller (PP)",
    "X": "not allowed for a DC controller (CC)",
}


class NewportStage:
    """What both controllers have in common; see `drivers.protocols.Actuator`."""

    name: ClassVar[str]
    _baud: ClassVar[int]
    _signature: ClassVar[str]  # a part of its version
    _states: ClassVar[dict[str, str]]

    def __init__(self, settings: ActuatorSettings, clock: SampleClock) -> None:
        del clock  # the controller keeps its own time
        self.travel_limits_m = settings.travel
        self.velocity_limit_m_s = settings.max_velocity
        self._settings = settings
        self._line: NewportLine | None = None
        self._commanding = threading.RLock()
        self._knowing = threading.Lock()  # of the three below, with the number of stops
        self._fault = ""
        self._is_under_way = False
        self._is_prepared = False
        self._stop_sent_at: float | None = None
        self._moves_begun = 0

    # ------------------------------------------------------------------ open and closed

    def open(self) -> None:
        """Claim the port and read model, stage and state. Nothing moves and nothing is set.

        Raises
        ------
        DeviceNotFound
            There is no such port, or another device is connected to it.
        DeviceFault, DeviceTimeout
            Another program has the port, or nothing answers.
        """
        if self._line is not None:
            return
        s = self._settings
        self._fault, self._stop_sent_at = "", None
        self._is_under_way = self._is_prepared = False
        self._line = line = NewportLine(
            self.name, s.port, s.address, s.baud or self._baud, s.command_pause
        )
        try:
            self._version = self._identified(line)
            self._stage = line.ask("ID?", "(.*)")
            # an earlier program may have left it moving
            self._is_under_way = self._look()[1].startswith(_IN_MOTION)
            low, high = s.travel  # which the controller is told before the first move
            self.travel_limits_m = (
                low if math.isfinite(low) else float(line.ask("SL?", _NUMBER)) * 1e-3,
                high if math.isfinite(high) else float(line.ask("SR?", _NUMBER)) * 1e-3,
            )
        except BaseException:
            self._line = None
            line.close()
            raise

    def _identified(self, line: NewportLine) -> str:
        try:
            version = line.ask("VE", "(.*)")
        except DeviceFault:
            if not line.heard:
                raise
            version = line.heard
        if self._signature not in version:
            remedy = "only SMC100CC and CONEX-CC are known (an ESP30x is not): check port and baud"
            for other in (Smc100, ConexCc):
                if other._signature in version:
                    remedy = f"use the driver of the {other.name}"
            raise DeviceNotFound(
                f"{self.name}: the device on {self._settings.port} says that it is"
                f" {version.strip()!r}; {remedy}"
            )
        return version.strip()

    def make_ready(self) -> None:
        """Give the controller the limits of the settings. Nothing moves.

        Raises
        ------
        DeviceFault
            It would not accept a move: it is not referenced, its motor is off.
        """
        state = self._look()[1]
        if not state.startswith("READY from"):
            raise DeviceFault(
                f"{self.name}: a move is to be made and it is {state}; {_remedy(state)}"
            )
        with self._commanding:
            self._prepare(self._ready())

    def _prepare(self, line: NewportLine) -> None:
        """Give the controller the limits of the settings as soon as it accepts them, and read its
        own.
        """
        s = self._settings
        low, high = s.travel
        if self._look()[1].startswith("READY from"):
            # the controller takes limits of these signs only; `move_to` checks the others
            for command, limit in (("SL", min(low, 0.0)), ("SR", max(high, 0.0))):
                letter = line.tell(command + _mm(limit)) if math.isfinite(limit) else "@"
                # C, G, N: the limit of the controller itself is narrower
                self._check("@" if letter in "CGN" else letter, f"the soft limit {command}")
            if float(line.ask("VA?", _NUMBER)) > s.max_velocity * 1e3:
                self._check(line.tell("VA" + _mm(s.max_velocity)), "its velocity limit")
            self._is_prepared = True
        low = max(low, float(line.ask("SL?", _NUMBER)) * 1e-3)
        high = min(high, float(line.ask("SR?", _NUMBER)) * 1e-3)
        if not low < high:
            raise OutOfLimits(
                f"{self.name}: its soft limits and the travel in the settings have nothing in"
                " common; change one of them"
            )
        self.travel_limits_m = low, high

    def describe(self) -> str:
        """Firmware, stage, state in words, position and travel."""
        line, (bits, state) = self._ready(), self._look()
        low, high = self.travel_limits_m
        return (
            f"{self._version}, stage {self._stage}, {'; '.join([state, *_in_words(bits)])},"
            f" at {float(line.ask('TP', _NUMBER)):.6g} mm, travel {low * 1e3:g} to {high * 1e3:g}"
            " mm"
        )

    def close(self) -> None:
        """Stop a motion that is under way, then let go of the port."""
        if self._line is None:
            return
        try:
            if self._is_under_way:
                self.stop()
        finally:
            line, self._line = self._line, None
            if line is not None:  # nobody else has closed it meanwhile
                line.close()

    # ------------------------------------------------------------------ motion

    def home(self) -> None:
        """Let the controller search its origin, or go there, as fast as it searches, if it knows it
        already; later moves are as fast.

        A motor that is off is switched on first.
        """
        line = self._ready()
        with self._commanding:
            stops, state = line.stops, self._look()[1]
            if state.startswith("DISABLE"):
                self._check(line.tell("MM1"), "switching its motor on")
                state = self._look()[1]
            if state.startswith("READY"):
                search_m_s = float(line.ask("OH?", _NUMBER)) * 1e-3
                self.set_velocity(min(search_m_s, self.velocity_limit_m_s))
                self._go(0.0, stops)
            else:
                self._begin("OR", "EL", "a search of the origin", stops)

    def set_velocity(self, velocity_m_s: float) -> None:
        """Set the speed of later moves."""
        line = self._ready()
        check_velocity(self.name, velocity_m_s, self.velocity_limit_m_s)
        with self._commanding:
            wish = f"a velocity of {velocity_m_s * 1e6:.6g} um/s"
            self._check(line.tell("VA" + _mm(velocity_m_s)), wish)

    def move_to(self, position_m: float) -> None:
        """Start a move that ends by itself.

        A move that a stop overtakes on the way to the controller is not sent.
        """
        self._go(position_m, self._ready().stops)

    def _go(self, position_m: float, stops: int) -> None:
        with self._commanding:
            if not self._is_prepared:
                self._prepare(self._ready())
            check_target(self.name, position_m, self.travel_limits_m)
            wish = f"a move to {position_m * 1e3:.6g} mm"
            self._begin("PA" + _mm(position_m), "M", wish, stops)

    def _begin(self, command: str, done: str, wish: str, stops: int) -> None:
        line = self._ready()
        with self._knowing:
            before = self._fault, self._stop_sent_at, self._is_under_way
            if line.stops == stops:  # otherwise it is not sent, and what moves is to stop
                self._fault, self._stop_sent_at, self._is_under_way = "", None, True
                self._moves_begun += 1
        try:
            letter = line.tell(command, done=done, unless_stopped_since=stops)
        except DeviceError:
            with contextlib.suppress(DeviceError):
                line.stop()  # it may be moving
            raise
        with self._knowing:
            if letter != "@" and line.stops == stops:
                self._fault, self._stop_sent_at, self._is_under_way = before
        self._check(letter, wish)

    def position_m(self) -> float:
        """Position by the encoder.

        Raises `DeviceFault` after a move that failed, until the next one.
        """
        position = float(self._ready().ask("TP", _NUMBER)) * 1e-3
        self._raise_fault()
        return position

    def is_moving(self) -> bool:
        """Whether the stage moves or searches its origin.

        Raises `DeviceFault` after a move that failed, until the next one.
        """
        _, state = self._look()
        self._raise_fault()
        return state.startswith(_IN_MOTION)

    def stop(self) -> None:
        """Send the command to stop at once, before whatever else waits for the line, and read the
        state once, unless the controller has fallen silent before.

        If the stage still moves two seconds later, `is_moving` and `position_m` raise a fault.

        Raises
        ------
        DeviceFault, DeviceTimeout
            The line is dead or the controller does not answer: the stage may still be moving, until
            its move ends.
        """
        line = self._line
        if line is None:
            return
        try:
            try:
                line.stop()
            finally:  # a move that began before it was counted has forgotten earlier stops
                with self._knowing:
                    self._stop_sent_at = time.monotonic()
            if line.is_mute:
                raise DeviceTimeout(
                    f"{self.name}: it was commanded to stop and has answered nothing before; a move"
                    " under way ends by itself at its target: check that the controller is on, and"
                    " its cable"
                )
            self._look(urgent=True)
        except DeviceError:
            self._is_under_way = False  # reported once; `close` need not report it again
            raise

    def stopper(self) -> OutsideStop:
        """What stops the stage from another process."""
        s = self._settings
        return OutsideStop(self.name, s.port, s.baud or self._baud, s.address)

    # ------------------------------------------------------------------ answers of the controller

    def _look(self, *, urgent: bool = False) -> tuple[int, str]:
        """Error bits, which this clears in the controller, and the state in words; notes what they
        mean for a move under way.
        """
        line, begun = self._ready(), self._moves_begun
        bits, state = self._read_state(line, urgent)
        if self._is_under_way and (bits or not state.startswith(_IN_MOTION)):
            bits, state = self._read_again(line, bits, state, urgent)
        moves = state.startswith(_IN_MOTION)
        with self._knowing:
            if begun != self._moves_begun:
                return bits, state  # of the time before a move that has begun meanwhile
            stopped_at = self._stop_sent_at
            fine = moves or stopped_at or state.startswith("READY")
            if self._is_under_way and (bits or not fine):
                what = "; ".join([*_in_words(bits), f"it is now {state}"])
                self._fault = f"{self.name}: the motion failed: {what}; {_remedy(state)}"
            self._is_under_way = self._is_under_way and moves
            if not moves:
                self._stop_sent_at = None
            elif stopped_at is not None and time.monotonic() - stopped_at > STOPS_WITHIN_S:
                self._fault = (
                    f"{self.name}: it was commanded to stop {STOPS_WITHIN_S:g} s ago and is still"
                    f" {state}; switch its motor off"
                )
        if moves and stopped_at is not None:
            line.stop()  # again: it decelerates, or has missed the command
        return bits, state

    def _read_state(self, line: NewportLine, urgent: bool) -> tuple[int, str]:
        word = line.ask("TS", "([0-9A-Fa-f]{6})", urgent=urgent)
        unnamed = f"in a state that its manual does not name ({word[4:]})"
        bits, state = int(word[:4], 16), self._states.get(word[4:].upper(), unnamed)
        if state.startswith("HOMING"):
            bits &= ~_END_SWITCHES  # the origin may be at one of them
        return bits, state

    def _read_again(
        self, line: NewportLine, bits: int, state: str, urgent: bool
    ) -> tuple[int, str]:
        """Bits and state once two readings in a row agree on the state, since an answer may have
        come damaged. Bits that an earlier reading has cleared count where the state is one of
        failure; elsewhere those that are set again do.
        """
        seen = bits
        for _ in range(TRIES):
            before = state
            bits, state = self._read_state(line, urgent)
            seen |= bits
            if state == before or (state.startswith(_IN_MOTION) and not bits):
                break
        has_failed = not state.startswith((*_IN_MOTION, "READY"))
        return (seen if has_failed else bits), state

    def _ready(self) -> NewportLine:
        if self._line is None:
            raise DeviceFault(f"{self.name}: it is not ready; open it first")
        return self._line

    def _raise_fault(self) -> None:
        if self._fault:
            raise DeviceFault(self._fault)

    def _check(self, letter: str, wish: str) -> None:
        if letter == "@":
            return
        reason = _REFUSALS.get(letter, f"its manual does not name the error {letter}")
        if letter == "V" or letter not in _REFUSALS:
            reason += f" ({self._ready().ask('TB' + letter, '(.*)').strip()})"
        kind = OutOfLimits if letter in "CG" else DeviceFault
        raise kind(f"{self.name}: {wish} was requested, the controller refused: {reason}")


class Smc100(NewportStage):
    """A stage on an SMC100CC."""

    name = "SMC100"
    _baud, _signature, _states = 57600, "SMC", _SMC100_STATES


class ConexCc(NewportStage):
    """A stage on a CONEX-CC."""

    name = "CONEX-CC"
    _baud, _signature, _states = 921600, "CONEX-CC", _CONEX_STATES


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.9f}".rstrip("0").rstrip(".")


def _remedy(state: str) -> str:
    return next(
        (text for group, text in _REMEDIES.items() if state.startswith(group)),
        "find out why before the next move",
    )


def _in_words(bits: int) -> list[str]:
    return [
        _ERROR_BITS[i] if i < len(_ERROR_BITS) else f"error bit {i}, which its manual does not name"
        for i in range(16)
        if bits >> i & 1
    ]
