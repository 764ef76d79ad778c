"""What a run shows at a glance, and a bench that is connected without one: its devices, forces,
picture and stage. Both are made in the process that holds the devices and drawn in the window; they
can be pickled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from analysis.arrays import F64, U8
from app.records.record_types import Counts
from app.system.stopping import StopAnswer

KINDS = ("actuator", "camera", "forces")  # kinds of devices, in the order in which a run opens them
END_OF_RANGE = 0.98  # share of a sensor's range beyond which a reading says nothing


class DeviceState(StrEnum):
    """How a device is."""

    CONNECTING = "connecting"
    READY = "ready"
    LOOK = "look"  # connected, and something must be looked at
    FAILED = "failed"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class DeviceView:
    """A device: what it is called, how it is, and the sentence that says so."""

    name: str
    state: DeviceState
    sentence: str


@dataclass(frozen=True, slots=True, eq=False)
class ForcesView:
    """The forces of the last seconds, in newtons; column 0 is P and column 1 is Q.

    Attributes
    ----------
    newest : tuple of float
        Means over the newest tenth of a second.
    noise : tuple of float
        Standard deviations about a straight line during the last second; NaN before there is one,
        and while a force rises or falls by more than that.
    used : tuple of float
        Greatest share of each sensor's range that the newest tenth of a second used.
    time_s : ndarray, shape (n,)
        Times of the history, of which the newest sample is 0.
    history : ndarray, shape (n, 2)
    age_s : float
        How long ago the newest block came.
    """

    newest: tuple[float, float]
    noise: tuple[float, float]
    used: tuple[float, float]
    time_s: F64
    history: F64
    age_s: float


@dataclass(frozen=True, slots=True, eq=False)
class PictureView:
    """A live picture, thinned, and what was measured on all of its pixels.

    Attributes
    ----------
    number : int
        Of the trigger that took it.
    rgb : ndarray, shape (rows, columns, 3), uint8
        Grey levels as they are, from 0 to the end of the scale; red where a pixel is at its end.
    histogram : ndarray, shape (n,)
        Share of the pixels in each of n equal parts of the grey scale.
    saturated, dark : float
        Share of the pixels at the end of the grey scale, and at 0.
    mean : float
        Share of the grey scale.
    focus : float
        `app.acquisition.picture.focus`.
    lost : int
        Triggers without an image so far.
    """

    number: int
    rgb: U8
    histogram: F64
    saturated: float
    dark: float
    mean: float
    focus: float
    lost: int


class StageTask(StrEnum):
    """What a stage without a run was ordered to do."""

    JOG = "jog"  # as long as a button is held
    MOVE = "move"  # to a place
    HOME = "home"  # search its origin


@dataclass(frozen=True, slots=True)
class StageView:
    """Where the stage is, whether it moves, and from where to where it can be moved, in metres;
    what it is ordered to do, None where it is not, and to which place, NaN where that is not known.
    """

    position_m: float
    is_moving: bool
    low_m: float
    high_m: float
    task: StageTask | None = None
    goal_m: float = math.nan


@dataclass(frozen=True, slots=True, eq=False)
class BenchView:
    """A connected bench at a glance; what is not known (yet) is None.

    Attributes
    ----------
    devices : mapping
        Of `KINDS`.
    picture : PictureView or None
        Only if it is another than the caller knows.
    picture_age_s : float
        How long ago the newest one came; infinite before the first.
    bytes_per_s : float
        What a second of recording takes on the disk.
    said : str
        Why the stage was stopped the last time other than by letting go; empty if it was not.
    failure : StopAnswer or None
        That stop, or the one of a dead man, if it failed.
    """

    devices: Mapping[str, DeviceView]
    forces: ForcesView | None
    picture: PictureView | None
    stage: StageView | None
    bytes_per_s: float
    said: str
    failure: StopAnswer | None = None
    picture_age_s: float = math.inf


class BenchPreview(Protocol):
    """A bench that is connected and looked at, without a run; from any thread.

    Whatever cannot be done raises an exception whose text is a sentence for the operator.
    """

    def look(self, known: int = -1) -> BenchView:
        """What it shows now; without the picture if that is the one of number `known`."""

    def jog(self, direction: int, velocity_m_s: float) -> None:
        """Move the stage along x (1) or the other way (-1), or let it move on; it stops if this is
        not called again within `HOLD_S`.
        """

    def move(self, goal_m: float, velocity_m_s: float) -> None:
        """Begin to move the stage to a place within its bounds; it ends there, or within
        `MOVE_HOLD_S` where `go_on` is not called again.
        """

    def home(self) -> None:
        """Begin to search the stage's origin, which may lead anywhere in its travel; it ends as a
        move does, and `limits.travel` counts from there.
        """

    def go_on(self) -> None:
        """Let a move, or a search of the origin, go on; nothing where none is under way."""

    def let_go(self) -> StopAnswer:
        """Stop the stage that is held no more; what became of that."""

    def stop_motion(self) -> StopAnswer:
        """Stop the stage, whoever holds it; what became of that. A jog that was held meanwhile does
        not go on.
        """

    def zero(self, *, under_load: bool = False) -> tuple[float, float]:
        """The readings without a force in volts, from now on those of the forces that are shown.

        They are measured for a second, in which the block must hang free.

        Raises
        ------
        UnderLoad
            The forces are further from zero than their noise explains, and `under_load` does not
            say that this is the sensors' zero; nothing is changed.
        """

    def set_zero(self, volts: tuple[float, float]) -> None:
        """Show the forces from now on with these readings without a force."""

    def adjust_camera(self, exposure_s: float, gain_db: float) -> bool:
        """Take pictures with this exposure, and this gain where that is not below 0, from now on;
        False where that camera has to be connected anew for that.
        """

    def close(self) -> StopAnswer | None:
        """Let go of every device; returns once a run can open them. What became of the newest stop
        of the stage; None where none was sent.
        """


HOLD_S = 0.3  # a jog goes on for so long without being asked again
MOVE_HOLD_S = 1.0  # and a move to a place, which ends by itself


@dataclass(frozen=True, slots=True)
class Health:
    """The state of a run at a glance: cheap to read, at any time, from any thread.

    `queue_fill` is the recorder queue's share in use (0 to 1) and `queue_seconds` the data it can
    hold; `progress` runs from 0 to 1; `disk_free_bytes` is negative while nothing is written (a
    replay). `uncertain` frames may be of another trigger, `exposures` is what the board has
    counted, negative where it counts none, `losses` says why frames and samples are lost, and
    `damage` of which frames little could be measured. `image_age_s` is the time since the trigger
    of the newest image, NaN without one. `shed` is that of `Effort` now. `step` is the one under
    way, ``3 of 6: hold for 10 s``, and `step_number` its number, 0 without one; `left_s` is the
    time left of it, NaN where the operator decides, and `all_left_s` that of all steps; `question`
    waits for an answer. `is_pause_asked` says that the run will wait after a step, `is_paused` that
    it does.
    """

    state: str
    reason: str
    phase: str
    counts: Counts
    queue_fill: float
    queue_seconds: float
    disk_free_bytes: int
    sample: int
    progress: float
    uncertain: int = 0
    exposures: int = -1
    losses: str = ""
    damage: str = ""
    image_age_s: float = math.nan
    shed: int = 0
    shed_why: str = ""
    step: str = ""
    step_number: int = 0
    left_s: float = math.nan
    all_left_s: float = math.nan
    question: str = ""
    is_pause_asked: bool = False
    is_paused: bool = False

    @property
    def doing(self) -> str:
        """The step and the time left: ``3 of 6: hold for 10 s; 4 s left, 60 s of all``."""
        left = f"; {self.left_s:.0f} s left" if math.isfinite(self.left_s) else ""
        has_more = left and self.all_left_s > self.left_s
        every = f", {self.all_left_s:.0f} s of all" if has_more else ""
        return f"{self.step}{left}{every}"
