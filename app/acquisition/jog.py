"""The stage of a bench that is connected without a run: moved only while somebody holds it moving,
within its limits, and while forces are read.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from analysis.options import quantity
from app.acquisition.stage import AGREE_M, Stage
from app.experiment.course import Go, MeasuredBlock
from app.experiment.decisions import broken_limit
from app.records.bench_view import HOLD_S, StageView
from app.settings.sections import Config
from app.system.stopping import Stop, StopAnswer, failed, not_connected, sent_to
from drivers.errors import DeviceError, DeviceFault, OutOfLimits
from drivers.protocols import Actuator

NO_WAY_M = 1e-6  # less is no move
MORE_SHEAR = 0.05  # share of limits.shear_force by which |Q| may grow on the way back


class JoggedStage(Stage):
    """A stage that moves while it is held moving.

    Parameters
    ----------
    config : Config
    actuator : Actuator
    forces : callable
        The newest forces; without them nothing is moved.
    guard : callable
        Called once before the first move; raises what forbids it.
    """

    def __init__(
        self,
        config: Config,
        actuator: Actuator,
        forces: Callable[[], MeasuredBlock | None],
        guard: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(config, actuator)
        self.may_move = True  # others may have moved it
        self._forces, self._guard = forces, guard
        self._is_guarded = False
        self._position_m = math.nan
        self._is_moving = False
        self._holding = threading.Lock()
        self._held_until = -math.inf
        self._under_way: tuple[int, float] | None = None  # direction and velocity
        self._shear_n = 0.0  # |Q| when the move began
        self._said = ""

    @property
    def is_driven(self) -> bool:
        """Whether a jog is under way, or could not be stopped."""
        return self._under_way is not None or self.is_owed

    @property
    def failure(self) -> StopAnswer | None:
        """Of a stop that has failed and is tried again, until one is taken."""
        answer = self.stop_answer
        has_failed = self.is_owed and answer is not None and answer.kind is Stop.FAILED
        return answer if has_failed else None

    @property
    def said(self) -> str:
        """Why it was stopped the last time other than by letting go."""
        failure = self.failure
        return failure.sentence if failure else self._said

    def poll(self) -> None:
        """Read the position, and whether the stage moves."""
        self._position_m, self._is_moving = self.reading()
        if not self.is_connected:
            self.start_m = self._position_m
        self.travel_m = self._position_m - self.start_m
        self.is_connected = True

    def look(self) -> tuple[float, bool]:
        """Position, and whether it moves, as they were read last."""
        return self._position_m, self._is_moving

    def view(self) -> StageView | None:
        """What is shown; None before the first reading."""
        if not self.is_connected:
            return None
        return StageView(self._position_m, self._is_moving, *self._bounds())

    # ------------------------------------------------------------------ motion

    def hold(self, direction: int, velocity_m_s: float) -> None:
        """Begin to move, or let the move go on for another `HOLD_S`.

        Raises
        ------
        DeviceError
            It is not moved, and why.
        """
        stops = self.stops
        self._held_until = time.monotonic() + HOLD_S
        with self._holding:
            if not self.is_connected:
                raise DeviceFault("jog: no actuator is connected; see its line")
            if self.is_owed:
                if self.said:
                    raise DeviceFault(self.said)
                return  # a stop is on its way
            wanted = direction, velocity_m_s
            if self._under_way is None:
                self._begin(direction, velocity_m_s)
            elif self._under_way != wanted:
                self.stop_now()
                return
            self._go_on(wanted, stops)

    def _begin(self, direction: int, velocity_m_s: float) -> None:
        """Check that a move may begin, and prepare it."""
        if self.said:
            raise DeviceFault(self.said)
        limit_n, newest = self._config.limits.shear_force, self._forces()
        leads_back = newest is not None and newest.largest[1] * direction <= 0
        if problem := self._forbidden(math.inf if leads_back else limit_n):
            raise DeviceFault(f"jog: {problem}")
        if not self._is_guarded:
            self._guard()
            self._is_guarded = True
        self.make_ready()
        self.velocity_m_s = math.nan  # another may have set it meanwhile
        self.set_velocity(velocity_m_s)
        newest = self._forces()
        self._shear_n = abs(newest.largest[1]) if newest else 0.0

    def _go_on(self, wanted: tuple[int, float], stops: int) -> None:
        """Send the stage on, unless it is on its way already or was let go of meanwhile."""
        direction, velocity = wanted
        actuator, here = self.actuator, self.actuator.position_m()
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
        target = min(max(target, low), high)
        if not self._under_way and actuator.is_moving():
            return  # it comes to rest first
        if stops != self.stops or time.monotonic() > self._held_until:
            return
        self._under_way = wanted
        try:
            self.go(Go(target - self.start_m, velocity))
        except DeviceError:
            self._held_until = -math.inf  # it may have been taken all the same, so it is stopped
            raise
        if stops != self.stops:  # a stop that came between the lines above wins
            self.stop_now()

    def check(self) -> None:
        """Stop the stage if nobody holds it, or if it must not go on; called often."""
        if self.is_owed:
            self.stop_again()
            return
        if self._under_way is None:
            return
        problem = self._must_stop()
        if not problem and time.monotonic() <= self._held_until:
            return
        if problem:
            self._said = f"jog: it was stopped: {problem}"
        self.stop_within()

    def halt(self) -> None:
        """End any motion; may be called from any thread."""
        self._held_until = -math.inf
        super().halt()
        self._under_way = None
        if self.refusal:
            self._said = f"jog: it was stopped, but not at once: {self.refusal}"

    def let_go(self) -> StopAnswer:
        """Stop the stage; what became of that. What forbade a jog is forgotten."""
        self._said = self.refusal = ""
        self.stop_answer = None
        if not self.is_connected:
            return not_connected("no actuator is connected")
        self.stop_within()
        if self.is_owed:
            return failed(self.refusal)
        self.confirm_stop()
        return self.stop_answer or sent_to(self.name)

    # ------------------------------------------------------------------ limits

    def _bounds(self) -> tuple[float, float]:
        low, high = self.actuator.travel_limits_m
        way = self._config.limits.travel
        return max(low, self.start_m - way), min(high, self.start_m + way)

    def _at_end(self, end_m: float) -> str:
        limits = self._config.limits
        if abs(end_m - self.start_m) < limits.travel - AGREE_M:
            return f"{self.name}: the stage is at the end of its travel, {end_m * 1e3:.4f} mm"
        return (
            f"{self.name}: the stage is {quantity(limits, 'travel')} (limits.travel) from where it"
            " was connected; connect again to count from here, or raise that limit"
        )

    def _must_stop(self) -> str:
        """Why the move under way must end; empty if it may go on."""
        limit_n = self._config.limits.shear_force
        try:
            return self._forbidden(max(limit_n, self._shear_n + MORE_SHEAR * limit_n))
        except Exception as error:  # what can not be judged is stopped
            return f"{type(error).__name__}: {error}"

    def _forbidden(self, most_shear_n: float) -> str:
        """Why the stage may not move, or move on; empty if it may."""
        newest, limits = self._forces(), self._config.limits
        if newest is None or newest.age_s > limits.age:
            return (
                "the stage is moved only while forces are read, and no force came for"
                f" {quantity(limits, 'age')} (limits.age); see the line of the forces"
            )
        problem = broken_limit(self._config, newest, most_shear_n)
        advice = "; lift the block, or, for a shear force, jog the other way"
        return f"{problem}{advice}" if problem else ""
