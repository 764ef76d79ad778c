"""What is asked of an actuator: to be ready before anything touches, moves from where the stage
truly is, and stops, which are sent before anything else is done.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from analysis.options import quantity
from app.acquisition.watchdog import Patience
from app.experiment.course import Go
from app.settings.protocol_steps import ROUNDING_M, Motion, Velocity, legs
from app.settings.sections import Config
from app.system.stopping import (
    Stop,
    StopAnswer,
    at_rest,
    failed,
    never_moved,
    not_connected,
    sent_to,
    unread,
)
from app.system.threads import start_thread
from drivers.answers import check_moves, check_position
from drivers.errors import DeviceFault, OutOfLimits
from drivers.protocols import Actuator
from drivers.sources import driver

AGREE_M = 3e-6  # two readings of a stage at rest differ by less
STANDS_WITHIN_S = 1.5  # the fastest moves need a second to decelerate
APART_S = 0.1  # two readings of the position
AGAIN_S = 0.2  # pause before a stop that was refused, or did not help, is sent again
STEADY_M = 0.1e-6  # two readings of a stage at rest agree within it: a few encoder counts
_NOT_BEFORE = {
    "idle": "the run has not begun, and no bench is connected",
    "armed": "the bench is not connected yet; the run ends before it begins",
}


def unsupervised(config: Config) -> str:
    """What a run must say before it begins, if no other process can stop its stage; empty if one
    can, or if the stage is none that moves.
    """
    found = driver("actuator", config.actuator.source)
    if found.nature != "real" or hasattr(found.driver_class, "stopper"):
        return ""
    return (
        f"actuator: no supervisor can stop the stage of '{config.actuator.source}', whose driver"
        " has no stopper(); should this program die or hang, a move ends at its target only: keep"
        " the switch of its power at hand"
    )


class Stage:
    """The actuator of a bench: what runs, jogs and checks ask of it.

    Attributes
    ----------
    start_m : float
        Position at the start of the run; from the drive on, that at its start.
    travel_m : float
        How far from there it was when it was last asked, along +x.
    velocity_m_s : float
        That it was last set to.
    has_failed : bool
        Whether it has failed or fallen silent: it is asked nothing more but to stop, so that it
        costs no time for the samples.
    may_move : bool
        Whether a motion was asked of it, or it was found moving.
    moves, stops : int
        Motions and stops that were asked of it.
    is_connected : bool
        Whether the actuator is open, so that it can be told to stop.
    stop_answer : StopAnswer or None
        What became of the newest stop; None where none was sent.
    refusal : str
        Why the newest stop was not taken, or did not help; empty if it was taken.
    is_owed : bool
        Whether a stop was asked for and none was taken since.
    """

    def __init__(
        self, config: Config, actuator: Actuator, watchdog: Patience | None = None
    ) -> None:
        self.start_m = self.travel_m = 0.0
        self.has_failed = self.may_move = False
        self.velocity_m_s, self.moves, self.stops = math.nan, 0, 0
        self.is_connected = self.is_owed = False
        self.stop_answer: StopAnswer | None = None
        self.refusal, self._stop_again_at = "", 0.0
        self.actuator, self._config = actuator, config
        self._watchdog, self._answering = watchdog or Patience(), threading.Lock()

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.actuator.name

    def arm(self) -> None:
        """See that the drive can be done from where the stage stands. Nothing moves.

        Raises
        ------
        DeviceFault
            The stage moves, or would refuse to (not referenced, motor off).
        OutOfLimits
            There is no room for the travel.
        """
        actuator = self.actuator
        if self.moves_now():
            self.may_move = True
            raise DeviceFault(
                f"{actuator.name}: the stage moves already; stop it, or wait until it stands, then"
                " start again"
            )
        self.make_ready()
        self.start_m = self.place_m()
        steps, jumps = self._config.run.protocol, "can_change_velocity"
        is_jump = [isinstance(step, Velocity) for step in steps]
        if any(is_jump) and not getattr(actuator, jumps, False):
            raise OutOfLimits(
                f"{actuator.name}: step {is_jump.index(True) + 1} (velocity) asks for another"
                " velocity while the stage moves, which it cannot; use a drive, before which it"
                " stops"
            )
        low, high = actuator.travel_limits_m
        for leg in legs(steps):
            for place in leg.end:
                if not low <= self.start_m + place <= high:
                    raise OutOfLimits(self._no_room(leg.number, place))

    def make_ready(self) -> None:
        """See whether a move would be accepted; raises `DeviceFault` if not."""
        getattr(self.actuator, "make_ready", lambda: None)()  # it may have nothing to make ready

    def _no_room(self, number: int, place: float) -> str:
        run, actuator = self._config.run, self.actuator
        low, high = actuator.travel_limits_m
        what = f"run.travel = {quantity(run, 'travel')}"
        if run.steps:
            what = f"step {number} ({run.steps[number - 1].kind}), {place * 1e6:g} um"
        return (
            f"{actuator.name}: {what} from"
            f" {self.start_m * 1e3:.6g} mm, where the stage stands, ends at"
            f" {(self.start_m + place) * 1e3:.6g} mm, and its travel is {low * 1e3:g} to"
            f" {high * 1e3:g} mm; put it where it has room"
        )

    def aim(self) -> None:
        """Set the velocity of the first motion, and read afresh where it starts.

        Raises
        ------
        DeviceFault
            The stage moves, or two readings of its position do not agree.
        """
        actuator = self.actuator
        first_motion = next(s for s in self._config.run.protocol if isinstance(s, Motion))
        self.set_velocity(first_motion.velocity)
        first, moves, second = self.place_m(), self.moves_now(), self.place_m()
        self.may_move = self.may_move or moves
        if moves or not abs(second - first) <= AGREE_M:
            raise DeviceFault(
                f"{actuator.name}: the drive was to begin where the stage stands, it was read at"
                f" {first * 1e3:.6g} and {second * 1e3:.6g} mm{' and moves' * moves}; let nothing"
                " else move it, check its line, and start again"
            )
        self.start_m, self.travel_m = second, 0.0

    def go(self, order: Go) -> None:
        """Send the stage on.

        Raises
        ------
        OutOfLimits
            The target is beyond the limit; nothing moves that did not.
        """
        limits, actuator = self._config.limits, self.actuator
        if abs(order.target_m) > limits.travel + ROUNDING_M:
            raise OutOfLimits(
                f"{actuator.name}: {order.target_m * 1e6:.1f} um from the start of the drive were"
                f" asked, limits.travel is {quantity(limits, 'travel')}"
            )
        self.set_velocity(order.velocity_m_s)
        self.may_move = True
        self.moves += 1
        actuator.move_to(self.start_m + order.target_m)

    def set_velocity(self, velocity_m_s: float) -> None:
        """Set that of the next motion, unless it is set already."""
        if velocity_m_s != self.velocity_m_s:
            self.actuator.set_velocity(velocity_m_s)
            self.velocity_m_s = velocity_m_s

    def look(self) -> tuple[float, bool]:
        """Position, and whether it moves; NaN and False once it has failed."""
        if self.has_failed:
            return math.nan, False
        try:
            moves = self.moves_now()
            # the last one, if it does not move any more
            position = self.place_m()
            if abs(position - self.start_m) > self._config.limits.travel:  # it may be garbled
                position = self.place_m()
        except BaseException:
            self.has_failed = True
            raise
        self.travel_m = position - self.start_m
        return position, moves

    def reading(self) -> tuple[float, bool]:
        """Position, and whether it moves, asked for also once it has failed."""
        moves = self.moves_now()
        return self.place_m(), moves

    def place_m(self) -> float:
        """The position that the actuator gives; DeviceFault if it is no number."""
        return check_position(self.name, self.actuator.position_m())

    def moves_now(self) -> bool:
        """Whether it moves, as the actuator says; DeviceFault if that is no yes or no."""
        return check_moves(self.name, self.actuator.is_moving())

    def halt(self) -> None:
        """End any motion; may be called from any thread."""
        try:
            self.actuator.stop()
        except BaseException:
            self.has_failed = True
            raise

    # ------------------------------------------------------------------ stops

    def stop(self) -> None:
        """Stop the stage, if it is connected, as long as a device may take; one that has not
        returned from a call before is not waited for, as it may not return from this one either.

        Raises
        ------
        DeviceError
            The stage has refused, cannot be reached, or did not return.
        """
        if not self.is_connected:
            return
        name = self.name
        if name in self._watchdog.given_up:
            self.stop_refused(f"{name}: it does not return from its calls")
            start_thread("stop", self.stop_now)
        else:
            self._stop_by(self._watchdog.aside)

    def _stop_by(self, ask: Callable[[str, Callable[[], None]], None]) -> None:
        self.is_owed = True  # also while the thread that stops has no turn
        try:
            ask(self.name, self.stop_now)
        except Exception as error:
            if self.is_owed:  # no other was taken meanwhile
                self.stop_refused(error)
            raise

    def stop_now(self) -> None:
        """Stop the stage in the calling thread.

        Raises
        ------
        DeviceError
            The stage has refused, or cannot be reached.
        """
        # in this order: who sends the stage on sees either that a stop is on its way, or afterwards
        # that one has come
        self.is_owed, self._stop_again_at = True, time.monotonic() + AGAIN_S
        self.stops += 1
        try:
            self.halt()
        except Exception as error:
            self.stop_refused(error)
            raise
        self.is_owed, self.refusal = False, ""
        self._note(sent_to(self.name))

    def stop_within(self) -> None:
        """Stop the stage in another thread, which is waited for as long as for a device; nothing is
        raised, see `is_owed`.
        """
        with suppress(Exception):
            self._stop_by(self._watchdog.ask)

    def stop_again(self) -> None:
        """Send the stop that is owed once more; one at a time, as the next one would wait behind
        it.
        """
        is_due = self.is_owed and time.monotonic() >= self._stop_again_at
        if is_due and self.name not in self._watchdog.given_up:
            self.stop_within()

    def confirm_stop(self) -> None:
        """Read whether the stage stands, for as long as it may decelerate; nothing is done where
        that is known or no stop was sent.
        """
        answer = self.stop_answer
        if answer is None or answer.is_final:
            return
        try:
            found = self._read_at_rest()
        except Exception as error:  # whatever it is, the end of the run goes on
            found = unread(self.name, error)
            if self.refusal:
                found = failed(f"{self.refusal}; nor could its position be read")
        with self._answering:
            self.stop_answer = found

    def answer_to_stop(self, state: str) -> StopAnswer:
        """What the operator is told who has just stopped a run in this state."""
        answer = self.stop_answer
        if answer is not None and (self.is_connected or answer.kind is Stop.FAILED):
            return answer
        ended = "the run has ended and its bench is closed"
        return not_connected(_NOT_BEFORE.get(state, ended))

    def stop_refused(self, problem: object) -> None:
        """The newest stop was not taken, or did not help, and is owed."""
        self.is_owed, self.refusal = True, str(problem)
        if self.may_move:
            self._note(failed(problem, is_final=False))
        else:
            self._note(never_moved(self.name, problem))

    def _note(self, answer: StopAnswer) -> None:
        """A stage that was read at rest stays so: nothing moves it after the end was called for."""
        with self._answering:
            before = self.stop_answer
            is_known = before is not None and before.is_final and before.kind is not Stop.FAILED
            if not (is_known and answer.kind is Stop.SENT):
                self.stop_answer = answer

    def _read_at_rest(self) -> StopAnswer:
        name, moves_before = self.name, self.moves
        give_up = time.monotonic() + STANDS_WITHIN_S
        before, _ = self._watchdog.ask(name, self.reading)
        while True:
            if not self._watchdog.is_direct:
                time.sleep(APART_S)
            place, moves = self._watchdog.ask(name, self.reading)
            if self.moves != moves_before:
                return sent_to(name)  # and somebody has moved it since
            if not moves and abs(place - before) <= STEADY_M:
                return at_rest(name, place, self.refusal)
            if time.monotonic() > give_up:
                says = "says that it moves" if moves else "says that it stands"
                self.stop_refused(
                    f"{name}: {STANDS_WITHIN_S:g} s after the stop it {says}, and was read at"
                    f" {before * 1e3:.4f} and {place * 1e3:.4f} mm"
                )
                return failed(self.refusal)
            self.stop_again()
            before = place
