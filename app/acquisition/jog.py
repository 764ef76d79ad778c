"""The stage of a bench that is connected without a run: moved only while somebody holds it moving,
within its limits, and while forces are read.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from analysis.options import quantity
from app.acquisition.live_forces import END_OF_RANGE, Newest
from app.acquisition.stage import AGREE_M
from app.records.bench_view import HOLD_S, StageView
from app.settings.sections import Config
from app.system.stopping import StopAnswer, at_rest, failed, not_connected, sent_to, unread
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, OutOfLimits
from drivers.protocols import Actuator

T = TypeVar("T")
PATIENCE_S = 3.0  # for a device that does not return from a call
STANDS_WITHIN_S = 1.5  # the fastest moves need a second to decelerate
APART_S = 0.1  # two readings of the position
STEADY_M = 0.1e-6  # of a stage that stands
AGAIN_S = 0.2  # until a stop that was not taken is tried again
NO_WAY_M = 1e-6  # less is no move
MORE_SHEAR = 0.05  # of its limit, by which |Q| may grow on the way back from beyond it


def within(who: str, step: Callable[[], T]) -> T:
    """What a step with a device returns or raises; `DeviceTimeout` after `PATIENCE_S`."""
    found: list[T] = []
    problems: list[BaseException] = []

    def work() -> None:
        try:
            found.append(step())
        except BaseException as error:  # raised in the thread that waits
            problems.append(error)

    thread = threading.Thread(target=work, name="slipscope-asks", daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    if problems:
        raise problems[0]
    if not found:
        raise DeviceTimeout(
            f"{who}: it did not return from a call within {PATIENCE_S:g} s; check the device, its"
            " connection and its driver"
        )
    return found[0]


class JoggedStage:
    """The actuator, as a jog uses it. It may be stopped from any thread.

    Parameters
    ----------
    config : Config
    actuator : Actuator
    forces : callable
        The newest forces; without them nothing is moved.
    guard : callable
        Called once before the first move; raises what forbids it.

    Attributes
    ----------
    is_connected : bool
    said : str
        Why it was stopped the last time other than by letting go.
    failure : StopAnswer or None
        Of a stop that has failed and is tried again, until one is taken.
    """

    def __init__(
        self,
        config: Config,
        actuator: Actuator,
        forces: Callable[[], Newest | None],
        guard: Callable[[], None] = lambda: None,
    ) -> None:
        self.is_connected = False
        self.said = ""
        self.failure: StopAnswer | None = None
        self._limits, self._actuator = config.limits, actuator
        self._forces, self._guard = forces, guard
        self._is_guarded = False
        self._start_m = self._position_m = math.nan
        self._is_moving = False
        self._holding = threading.Lock()
        self._held_until = -math.inf
        self._under_way: tuple[int, float] | None = None  # direction and velocity
        self._is_unstopped = False  # a stop was asked for, and none has been taken since
        self._again_at = -math.inf  # when the next one is tried
        self._refused = ""  # what the newest one that failed has said
        self._trying: threading.Thread | None = None
        self._target_m = math.nan
        self._shear_n = 0.0  # |Q| when the move began
        self._stops = 0

    @property
    def travel_m(self) -> float:
        """How far the stage is from where it was connected; 0 before."""
        return 0.0 if math.isnan(self._start_m) else self._position_m - self._start_m

    @property
    def is_driven(self) -> bool:
        """Whether a jog is under way, or could not be stopped."""
        return self._under_way is not None or self._is_unstopped

    def poll(self) -> None:
        """Read the position, and whether the stage moves."""
        self._is_moving = self._actuator.is_moving()
        self._position_m = self._actuator.position_m()
        if math.isnan(self._start_m):
            self._start_m = self._position_m
        self.is_connected = True

    def make_ready(self) -> None:
        """See whether a move would be accepted; raises `DeviceFault` if not."""
        getattr(self._actuator, "make_ready", lambda: None)()  # it may have nothing to make ready

    def view(self) -> StageView | None:
        """What is shown; None before the first reading."""
        if not self.is_connected:
            return None
        low, high = self._bounds()
        return StageView(self._position_m, self._is_moving, low, high)

    # ------------------------------------------------------------------ motion

    def hold(self, direction: int, velocity_m_s: float) -> None:
        """Begin to move, or let the move go on for another `HOLD_S`.

        Raises
        ------
        DeviceError
            It is not moved, and why.
        """
        stops = self._stops
        self._held_until = time.monotonic() + HOLD_S
        with self._holding:
            if not self.is_connected:
                raise DeviceFault("jog: no actuator is connected; see its line")
            if self._is_unstopped:
                if self.said:
                    raise DeviceFault(self.said)
                return  # a stop is on its way
            wanted = direction, velocity_m_s
            if self._under_way is None:
                self._begin(direction, velocity_m_s)
            elif self._under_way != wanted:
                self._stop_or_raise()
                return
            self._go_on(wanted, stops)

    def _begin(self, direction: int, velocity_m_s: float) -> None:
        """Check that a move may begin, and prepare it."""
        if self.said:
            raise DeviceFault(self.said)
        if problem := self._forbidden(direction):
            raise DeviceFault(problem)
        if not self._is_guarded:
            self._guard()
            self._is_guarded = True
        self.make_ready()
        self._actuator.set_velocity(velocity_m_s)
        newest = self._forces()
        self._shear_n = abs(newest.shear_n) if newest else 0.0
        self._target_m = math.nan

    def _go_on(self, wanted: tuple[int, float], stops: int) -> None:
        """Send the stage on, unless it is on its way already or was let go of meanwhile."""
        direction, velocity = wanted
        actuator, here = self._actuator, self._actuator.position_m()
        # one that takes a new target while it moves is never sent far
        renews = getattr(actuator, "can_change_velocity", False)
        low, high = self._bounds()
        end = high if direction > 0 else low
        if (end - here) * direction < NO_WAY_M:
            self._under_way = None
            raise OutOfLimits(self._at_end(end))
        if self._under_way and not renews:
            return
        target = here + direction * velocity * 2 * HOLD_S if renews else end
        self._target_m = min(max(target, low), high)
        if not self._under_way and actuator.is_moving():
            return  # it comes to rest first
        if stops != self._stops or time.monotonic() > self._held_until:
            return
        self._under_way = wanted
        try:
            actuator.move_to(self._target_m)
        except DeviceError:
            self._held_until = -math.inf  # it may have been taken all the same, so it is stopped
            raise
        if stops != self._stops:  # a stop that came between the lines above wins
            self._stop_or_raise()

    def check(self) -> None:
        """Stop the stage if nobody holds it, or if it must not go on; called often."""
        if self._is_unstopped:
            if time.monotonic() >= self._again_at and not self._is_being_stopped():
                self._stop_within()
            return
        if self._under_way is None:
            return
        problem = self._must_stop()
        if not problem and time.monotonic() <= self._held_until:
            return
        if problem:
            self.said = f"jog: it was stopped: {problem}"
        self._stop_within()

    def _is_being_stopped(self) -> bool:
        """Whether an earlier stop has not returned yet: the next one would wait behind it."""
        return self._trying is not None and self._trying.is_alive()

    def _stop_within(self) -> StopAnswer | None:
        """Send the stop; the answer if it has failed."""

        def stop() -> None:
            self._trying = threading.current_thread()
            self.stop_now()

        try:
            within(self._actuator.name, stop)
        except Exception as error:
            if self._is_unstopped:  # no other has been taken meanwhile
                self._has_refused(str(error))
            return failed(error)
        return None

    def _stop_or_raise(self) -> None:
        try:
            self.stop_now()
        except Exception as error:
            self._has_refused(str(error))
            raise

    def _has_refused(self, why: str) -> StopAnswer:
        self._is_unstopped, self._refused = True, why
        self.failure = answer = failed(why)
        self.said = answer.sentence
        return answer

    def stop_now(self) -> None:
        """Send the stop in the calling thread; the stage counts as driven until it is taken."""
        # in this order: who holds the stage moving sees either that a stop is on its way, or
        # afterwards that one has come
        self._is_unstopped, self._again_at = True, time.monotonic() + AGAIN_S
        self._stops += 1
        self._held_until = -math.inf
        self._actuator.stop()
        self._is_unstopped, self._under_way = False, None
        if self.failure is not None:
            self.failure = None
            self.said = f"jog: it was stopped, but not at once: {self._refused}"

    def let_go(self) -> StopAnswer:
        """Stop the stage; what became of that. What forbade a jog is forgotten."""
        self.said, self.failure = "", None
        if not self.is_connected:
            return not_connected("no actuator is connected")
        name = self._actuator.name
        return self._stop_within() or self._confirmed(name, self._stops)

    def _confirmed(self, name: str, stops: int) -> StopAnswer:
        """Whether the stage was read at rest."""
        give_up = time.monotonic() + STANDS_WITHIN_S
        try:
            before = within(name, self._actuator.position_m)
            while True:
                time.sleep(APART_S)
                moves = within(name, self._actuator.is_moving)
                place = within(name, self._actuator.position_m)
                if stops != self._stops or self._under_way:
                    return sent_to(name)  # and somebody has moved it since
                if not moves and abs(place - before) <= STEADY_M:
                    return at_rest(name, place)
                if time.monotonic() > give_up:
                    return self._has_refused(
                        f"{name}: {STANDS_WITHIN_S:g} s after the stop it was read at"
                        f" {before * 1e3:.4f} and {place * 1e3:.4f} mm"
                    )
                before = place
        except DeviceError as error:
            return unread(name, error)

    # ------------------------------------------------------------------ limits

    def _bounds(self) -> tuple[float, float]:
        low, high = self._actuator.travel_limits_m
        way = self._limits.travel
        return max(low, self._start_m - way), min(high, self._start_m + way)

    def _at_end(self, end_m: float) -> str:
        name = self._actuator.name
        if abs(end_m - self._start_m) < self._limits.travel - AGREE_M:
            return f"{name}: the stage is at the end of its travel, {end_m * 1e3:.4f} mm"
        return (
            f"{name}: the stage is {quantity(self._limits, 'travel')} (limits.travel) from where it"
            " was connected; connect again to count from here, or raise that limit"
        )

    def _forbidden(self, direction: int) -> str:
        """Why no move may begin this way; empty if one may."""
        newest = self._forces()
        if newest is None or newest.age_s > self._limits.age:
            return (
                "jog: the stage is moved only while forces are read, and none come; see the line of"
                " the forces"
            )
        if problem := self._beyond(newest):
            return f"jog: {problem}"
        if newest.shear_n * direction > self._limits.shear_force:
            return (
                f"jog: Q is {newest.shear_n:.3f} N, beyond limits.shear_force ="
                f" {quantity(self._limits, 'shear_force')}; jog the other way"
            )
        return ""

    def _must_stop(self) -> str:
        """Why the move under way must end; empty if it may go on."""
        try:
            return self._broken_limit()
        except Exception as error:  # what can not be judged is stopped
            return f"{type(error).__name__}: {error}"

    def _broken_limit(self) -> str:
        newest = self._forces()
        if newest is None or newest.age_s > self._limits.age:
            return f"no force came for {quantity(self._limits, 'age')} (limits.age)"
        if problem := self._beyond(newest):
            return problem
        most = self._limits.shear_force
        if abs(newest.shear_n) > max(most, self._shear_n + MORE_SHEAR * most):
            return (
                f"Q reached {newest.shear_n:.3f} N, limits.shear_force is"
                f" {quantity(self._limits, 'shear_force')}; jog the other way"
            )
        return ""

    def _beyond(self, newest: Newest) -> str:
        for sensor, used in zip(("normal", "shear"), newest.used, strict=True):
            if used >= END_OF_RANGE:
                return (
                    f"the {sensor} sensor is at the end of its range, so that the force is not"
                    " known; lift the block, and check forces.range"
                )
        if abs(newest.normal_n) > self._limits.normal_force:
            wrong = "; if it is pressed, forces.sign is wrong" * (newest.normal_n < 0)
            return (
                f"P is {newest.normal_n:.3f} N, beyond limits.normal_force ="
                f" {quantity(self._limits, 'normal_force')}; lift the block{wrong}"
            )
        return ""
