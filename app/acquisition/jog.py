"""The stage of a bench that is connected without a run: moved only while somebody holds it moving,
or watches over a move to a place, within its limits, and while forces are read.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from analysis.options import quantity
from app.acquisition.stage import AGREE_M, Stage
from app.experiment.course import Go, MeasuredBlock
from app.experiment.decisions import broken_limit
from app.records.bench_view import HOLD_S, MOVE_HOLD_S, StageTask, StageView
from app.settings.sections import Config
from app.system.stopping import Stop, StopAnswer, failed, not_connected, sent_to
from drivers.errors import DeviceError, DeviceFault, OutOfLimits
from drivers.protocols import Actuator

NO_WAY_M = 1e-6  # less is no move
MORE_SHEAR = 0.05  # share of limits.shear_force by which |Q| may grow on the way back


@dataclass(frozen=True, slots=True)
class StageOrder:
    """What the stage is ordered to do: which way (1 or -1), how fast, and how far, without end for
    a jog; where the origin is, its search finds out.
    """

    task: StageTask
    direction: int = 0
    velocity_m_s: float = math.nan
    goal_m: float = math.nan

    @property
    def hold_s(self) -> float:
        """How long it goes on without being asked again."""
        return HOLD_S if self.task is StageTask.JOG else MOVE_HOLD_S


HOMING = StageOrder(StageTask.HOME)


class JoggedStage(Stage):
    """A stage that moves while it is held moving, or asked to go on.

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
        self._is_moving = self._is_counted_anew = False  # the travel, after a search
        self._holding = threading.Lock()
        self._held_until = -math.inf
        self._refused_until = -math.inf  # of jogs that were held as it was stopped
        self._under_way: StageOrder | None = None
        self._shear_n = 0.0  # |Q| when the move began
        self._said = ""

    @property
    def is_driven(self) -> bool:
        """Whether it is ordered to move, or could not be stopped."""
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
        if not self.is_connected or self._is_counted_anew:
            self.start_m = self._position_m
            is_over = self._under_way is not HOMING and not self._is_moving
            self._is_counted_anew = self._is_counted_anew and not is_over
        self.travel_m = self._position_m - self.start_m
        self.is_connected = True

    def look(self) -> tuple[float, bool]:
        """Position, and whether it moves, as they were read last."""
        return self._position_m, self._is_moving

    def view(self) -> StageView | None:
        """What is shown; None before the first reading."""
        if not self.is_connected:
            return None
        order = self._under_way
        goal = (order.task, order.goal_m) if order else (None, math.nan)
        return StageView(self._position_m, self._is_moving, *self._bounds(), *goal)

    # ------------------------------------------------------------------ motion

    def hold(self, direction: int, velocity_m_s: float) -> None:
        """Begin to move, or let the jog go on for another `HOLD_S`; one that was held as the stage
        was stopped is refused for as long as it is held.

        Raises
        ------
        DeviceError
            It is not moved, and why.
        """
        if time.monotonic() <= self._refused_until:
            self._refused_until = time.monotonic() + HOLD_S
            raise DeviceFault("jog: STOP MOTION was pressed; let go, then jog again")
        self._keep(StageOrder(StageTask.JOG, direction, velocity_m_s, direction * math.inf))

    def move(self, goal_m: float, velocity_m_s: float) -> None:
        """Begin to move to a place in the stage's own coordinate; it ends there, or after
        `MOVE_HOLD_S` without `go_on`.

        Raises
        ------
        DeviceError
            It is not moved, and why.
        """
        self._forget()
        low, high = self._bounds()
        if not low <= goal_m <= high:
            raise OutOfLimits(
                f"{self.name}: a move to {goal_m * 1e3:.4f} mm was asked; it can be moved from"
                f" {low * 1e3:.4f} to {high * 1e3:.4f} mm: within its travel, and"
                f" {quantity(self._config.limits, 'travel')} (limits.travel) from where it was"
                " connected"
            )
        way = 1 if goal_m > self._position_m else -1
        self._keep(StageOrder(StageTask.MOVE, way, velocity_m_s, goal_m))

    def home(self) -> None:
        """Begin to search the origin, wherever that leads; it ends as a move does, and raises as
        `move` does.
        """
        self._forget()
        self._keep(HOMING)

    def go_on(self) -> None:
        """Let a move, or a search, go on for another `MOVE_HOLD_S`; nothing where none is under
        way, so that a stop wins over what comes late.
        """
        order = self._under_way
        if order is not None and order.task is not StageTask.JOG:
            self._keep(order, begins=False)

    def _forget(self) -> None:
        """What has stopped an earlier move does not forbid one that is asked for now."""
        if not self.is_connected:
            raise DeviceFault("move: no actuator is connected; see its line")
        if self._under_way is None and not self.is_owed:
            self._said = ""

    def _keep(self, order: StageOrder, *, begins: bool = True) -> None:
        """Begin what is ordered, or let it go on."""
        stops = self.stops
        self._held_until = time.monotonic() + order.hold_s
        with self._holding:
            if not self.is_connected:
                raise DeviceFault(f"{order.task}: no actuator is connected; see its line")
            if self.is_owed:
                if self.said:
                    raise DeviceFault(self.said)
                return  # a stop is on its way
            if self._under_way is None:
                if not begins:
                    return
                self._begin(order)
            elif self._under_way != order:
                self.stop_now()
                return
            if order is HOMING:
                self._search(stops)
            else:
                self._go_on(order, stops)

    def _begin(self, order: StageOrder) -> None:
        """Check that a move may begin, and prepare it."""
        if self.said:
            raise DeviceFault(self.said)
        limit_n, newest, way = self._config.limits.shear_force, self._forces(), order.direction
        leads_back = newest is not None and way != 0 and newest.largest[1] * way <= 0
        if problem := self._forbidden(math.inf if leads_back else limit_n):
            raise DeviceFault(f"{order.task}: {problem}")
        if not self._is_guarded:
            self._guard()
            self._is_guarded = True
        if order is not HOMING:  # a stage that does not know its origin would refuse to move
            self.make_ready()
            self.velocity_m_s = math.nan  # another may have set it meanwhile
            self.set_velocity(order.velocity_m_s)
        newest = self._forces()
        self._shear_n = abs(newest.largest[1]) if newest else 0.0

    def _search(self, stops: int) -> None:
        """Let the stage search its origin, or see whether it is done."""
        if self._under_way is None:
            self.may_move = self._is_counted_anew = True
            self.moves += 1
            self._send(HOMING, self.actuator.home, stops)
        elif not self.moves_now():
            self._under_way = None

    def _go_on(self, order: StageOrder, stops: int) -> None:
        """Send the stage on, unless it is on its way already or was let go of meanwhile."""
        direction, velocity = order.direction, order.velocity_m_s
        actuator, here = self.actuator, self.place_m()
        # one that takes a new target while it moves is never sent far
        renews = getattr(actuator, "can_change_velocity", False)
        low, high = self._bounds()
        end = min(max(order.goal_m, low), high)
        if (end - here) * direction < NO_WAY_M:
            self._under_way = None
            if order.task is StageTask.JOG:
                raise OutOfLimits(self._at_end(end))
            return
        if self._under_way and not renews:
            if order.task is StageTask.MOVE and not self.moves_now():
                self._under_way = None
                if abs(end - here) > AGREE_M:
                    raise DeviceFault(
                        f"{self.name}: it was sent to {end * 1e3:.4f} mm and stands at"
                        f" {here * 1e3:.4f} mm; look at it, and move it again"
                    )
            return
        target = here + direction * velocity * 2 * order.hold_s if renews else end
        target = min(max(target, min(here, end)), max(here, end))
        if not self._under_way and self.moves_now():
            return  # it comes to rest first
        self._send(order, lambda: self.go(Go(target - self.start_m, velocity)), stops)

    def _send(self, order: StageOrder, act: Callable[[], None], stops: int) -> None:
        """Send the stage on, unless it was let go of meanwhile."""
        if stops != self.stops or time.monotonic() > self._held_until:
            return
        self._under_way = order
        try:
            act()
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
        if (order := self._under_way) is None:
            return
        problem = self._must_stop()
        if not problem and time.monotonic() <= self._held_until:
            return
        if not problem and order.task is not StageTask.JOG and self._held_until > 0:
            problem = f"nobody asked for {order.hold_s:g} s whether it goes on; move it again"
        if problem:
            self._said = f"{order.task}: it was stopped: {problem}"
        self.stop_within()

    def halt(self) -> None:
        """End any motion; may be called from any thread."""
        self._held_until = -math.inf
        super().halt()
        self._under_way = None
        if self.refusal:
            self._said = f"jog: it was stopped, but not at once: {self.refusal}"

    def let_go(self) -> StopAnswer:
        """Stop the stage that is held no more; what became of that."""
        self._refused_until = -math.inf
        return self._stopped()

    def stop_motion(self) -> StopAnswer:
        """Stop the stage, whoever holds it; what became of that."""
        if (now := time.monotonic()) <= self._held_until:
            self._refused_until = now + HOLD_S
        return self._stopped()

    def _stopped(self) -> StopAnswer:
        """What forbade a jog is forgotten."""
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
        except Exception as error:  # what cannot be judged is stopped
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
