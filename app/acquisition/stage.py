"""What a run asks of its actuator: to be ready before anything touches, and moves by what the
settings ask, from where the stage truly is.
"""

from __future__ import annotations

import math
from typing import Protocol

from analysis.options import quantity
from app.experiment.course import Go
from app.settings.protocol_steps import ROUNDING_M, Motion, Velocity, legs
from app.settings.sections import Config
from drivers.errors import DeviceError, DeviceFault, OutOfLimits
from drivers.protocols import Actuator
from drivers.sources import driver

AGREE_M = 3e-6  # two readings of a stage at rest differ by less


def unsupervised(config: Config) -> str:
    """What a run must say before it begins, if no other process can stop its stage; empty if one
    can, or if the stage is none that moves.
    """
    found = driver("actuator", config.actuator.source)
    if found.nature != "real" or hasattr(found.made, "stopper"):
        return ""
    return (
        f"actuator: no supervisor can stop the stage of '{config.actuator.source}', whose driver"
        " has no stopper(); should this program die or hang, a move ends at its target only: keep"
        " the switch of its power at hand"
    )


class HasActuator(Protocol):
    """A bench as the stage sees it."""

    @property
    def actuator(self) -> Actuator: ...


class Stage:
    """The actuator of a bench, as a run uses it.

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
    """

    def __init__(self, config: Config, bench: HasActuator) -> None:
        self.start_m = self.travel_m = 0.0
        self.has_failed = self.may_move = False
        self.velocity_m_s = math.nan
        self._config, self._bench = config, bench

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self._bench.actuator.name

    def arm(self) -> None:
        """See that the drive can be done from where the stage stands. Nothing moves.

        Raises
        ------
        DeviceFault
            The stage moves, or would refuse to (not referenced, motor off).
        OutOfLimits
            There is no room for the travel.
        """
        actuator = self._bench.actuator
        if actuator.is_moving():
            self.may_move = True
            raise DeviceFault(
                f"{actuator.name}: the stage moves already; stop it, or wait until it stands, then"
                " start again"
            )
        # an actuator may have nothing to make ready
        getattr(actuator, "make_ready", lambda: None)()
        self.start_m = actuator.position_m()
        steps, jumps = self._config.run.protocol, "can_change_velocity"
        is_jump = [isinstance(step, Velocity) for step in steps]
        if any(is_jump) and not getattr(actuator, jumps, False):
            raise OutOfLimits(
                f"{actuator.name}: step {is_jump.index(True) + 1} (velocity) asks for another"
                " velocity while the stage moves, which it can not; use a drive, before which it"
                " stops"
            )
        low, high = actuator.travel_limits_m
        for leg in legs(steps):
            for place in leg.end:
                if not low <= self.start_m + place <= high:
                    raise OutOfLimits(self._no_room(leg.number, place))

    def _no_room(self, number: int, place: float) -> str:
        run, actuator = self._config.run, self._bench.actuator
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
        actuator = self._bench.actuator
        first_motion = next(s for s in self._config.run.protocol if isinstance(s, Motion))
        self._set_velocity(first_motion.velocity)
        first, moves, second = actuator.position_m(), actuator.is_moving(), actuator.position_m()
        self.may_move = self.may_move or moves
        if moves or not abs(second - first) <= AGREE_M:
            raise DeviceFault(
                f"{actuator.name}: the drive was to begin where the stage stands, it was read at"
                f" {first * 1e3:.6g} and {second * 1e3:.6g} mm{' and moves' * moves}; let nothing"
                " else move it, check its line, and start again"
            )
        self.start_m, self.travel_m = second, 0.0

    def drive(self) -> None:
        """Set the stage in motion, by ``run.travel`` from where `aim` has read it."""
        self.may_move = True
        self._bench.actuator.move_to(self.start_m + self._config.run.travel)

    def go(self, order: Go) -> None:
        """Send the stage on.

        Raises
        ------
        OutOfLimits
            The target is beyond the limit; nothing moves that did not.
        """
        limits, actuator = self._config.limits, self._bench.actuator
        if abs(order.target_m) > limits.travel + ROUNDING_M:
            raise OutOfLimits(
                f"{actuator.name}: {order.target_m * 1e6:.1f} um from the start of the drive were"
                f" asked, limits.travel is {quantity(limits, 'travel')}"
            )
        self._set_velocity(order.velocity_m_s)
        self.may_move = True
        actuator.move_to(self.start_m + order.target_m)

    def _set_velocity(self, velocity_m_s: float) -> None:
        if velocity_m_s != self.velocity_m_s:
            self._bench.actuator.set_velocity(velocity_m_s)
            self.velocity_m_s = velocity_m_s

    def look(self) -> tuple[float, bool]:
        """Position, and whether it moves; NaN and False once it has failed."""
        if self.has_failed:
            return math.nan, False
        actuator = self._bench.actuator
        try:
            moves = actuator.is_moving()
            position = actuator.position_m()  # the last one, if it does not move any more
            if abs(position - self.start_m) > self._config.limits.travel:
                position = actuator.position_m()  # one reading may be garbled
        except DeviceError:
            self.has_failed = True
            raise
        self.travel_m = position - self.start_m
        return position, moves

    def reading(self) -> tuple[float, bool]:
        """Position, and whether it moves, asked for also once it has failed."""
        actuator = self._bench.actuator
        moves = actuator.is_moving()
        return actuator.position_m(), moves

    def stop(self) -> None:
        """End any motion; may be called from any thread."""
        try:
            self._bench.actuator.stop()
        except DeviceError:
            self.has_failed = True
            raise
