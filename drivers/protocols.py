"""The three devices of a bench and the data that they deliver, all on one clock.

The DAQ sample counter is the only time base: sample 0 is the first sample after
`ForceSource.start`. The board divides its sample clock to trigger the camera, so that trigger ``n``
falls on sample ``first + n * divisor`` and every frame carries that number. The time of the
computer appears nowhere.

A driver is made from the settings of its device and the bench's `drivers.clock.SampleClock`. Every
driver keeps these rules (`drivers.contracts` tries each of them):

- Making a driver touches no hardware. `open` claims the hardware, and is the only place that
  imports a vendor library; `close` may be called at any time, twice, and after a failure.
- Order of a run: ``camera.start(train)``, then ``forces.start(train)``, then reads;
  ``forces.stop()`` ends the trigger train.
- `ForceSource.read` and `Camera.read` are each called from one thread, `Actuator.stop` and `close`
  from any thread.
- The only errors are `drivers.errors.DeviceError`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

if TYPE_CHECKING:  # a supervisor has a stage and no arrays
    import numpy as np

    from analysis.arrays import F64, I64, U8, U16

Image: TypeAlias = "U8 | U16"


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Consecutive readings of the two capacitive sensors.

    Attributes
    ----------
    first : int
        Index of the block's first sample on the DAQ sample clock.
    volts : ndarray, shape (n, 2), float64
        Column 0 is the normal sensor, column 1 the shear sensor. The receiver owns the array.
    exposures : ndarray, shape (n,), int64, or None
        How many exposures of the camera had begun by each sample, as the board counted them on its
        sample clock; None if it does not count them.
    auxiliary : ndarray, shape (n, k), float64, or None
        Volts of the k further channels of `ForceSettings.auxiliary`; None if there are none.
    """

    first: int
    volts: F64
    exposures: I64 | None = None
    auxiliary: F64 | None = None

    @property
    def end(self) -> int:
        """Index of the first sample after the block."""
        return self.first + len(self.volts)


@dataclass(frozen=True, slots=True)
class LostSamples:
    """A gap: samples that the board took and that cannot be read any more. The samples after it
    keep their numbers.
    """

    first: int
    count: int
    reason: str

    @property
    def end(self) -> int:
        """Index of the first sample after the gap."""
        return self.first + self.count


@dataclass(frozen=True, slots=True)
class TriggerTrain:
    """The camera triggers cut from the sample clock: trigger ``n`` falls on sample ``first + n *
    divisor``.
    """

    first: int
    divisor: int

    def sample(self, index: int) -> int:
        """Sample on which trigger `index` falls."""
        return self.first + index * self.divisor

    def count_before(self, sample: int) -> int:
        """Number of triggers strictly before `sample`."""
        return max(0, -(-(sample - self.first) // self.divisor))


class _TriggerFate:
    """What both answers to a trigger have: its number, and the triggers that it may be about."""

    __slots__ = ()
    index: int
    first: int
    last: int

    def __post_init__(self) -> None:
        for name in ("first", "last"):
            if getattr(self, name) < 0:
                object.__setattr__(self, name, self.index)

    @property
    def is_certain(self) -> bool:
        """Whether it can be about one trigger only."""
        return self.first == self.last


@dataclass(frozen=True, slots=True)
class Frame(_TriggerFate):
    """One image of the interface, with the trigger that took it.

    Attributes
    ----------
    index : int
        Trigger number, counted from 0.
    sample : int
        Sample on which the exposure started: that of the trigger, or a later one if the board
        counts exposures and found this one late.
    image : ndarray, shape (rows, columns), uint8 or uint16
        Grey levels, read-only; the receiver may keep it.
    first, last : int
        The triggers that can have taken it, from the first to the last; both are `index` where it
        is certain, and where they are not given. A camera that the board does not trigger is never
        certain.
    stamp_s : float
        Time that the camera's own clock gave to it, seconds from an origin of its own; NaN where it
        gave none.
    doubt : str
        What is in doubt, or which witness has failed; empty where nothing is.
    """

    index: int
    sample: int
    image: Image
    first: int = -1
    last: int = -1
    stamp_s: float = math.nan
    doubt: str = ""


@dataclass(frozen=True, slots=True)
class LostFrame(_TriggerFate):
    """A trigger without an image. It keeps its index, and so do the others.

    Where it is not certain which trigger has none, it is one from `first` to `last`.
    """

    index: int
    sample: int
    reason: str
    first: int = -1
    last: int = -1


@dataclass(frozen=True, slots=True)
class Found:
    """A device on this computer: what to write in the settings (as `device` or `port`), and a
    description.
    """

    device: str
    description: str


class AnyDevice(Protocol):
    """What all devices have."""

    name: str

    def open(self) -> None:
        """Claim the hardware; nothing moves."""

    def describe(self) -> str:
        """Model, serial number and settings in one line, once open."""

    def close(self) -> None: ...


@runtime_checkable
class ForceSource(AnyDevice, Protocol):
    """The DAQ board: two voltages on a hardware clock, and the camera triggers made from that
    clock.
    """

    sample_rate_hz: float
    block_samples: int
    counts_exposures: bool

    def start(self, train: TriggerTrain) -> None:
        """Start sampling at sample 0, and the trigger train on the same edge."""

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next `block_samples` samples, or more if `backlog` has said that more are waiting, or
        the gap in their place.

        Samples come in order, each of them once.

        Raises
        ------
        DeviceTimeout
            No full block came within `timeout_s`.
        DeviceFault
            The board has failed or is gone; the blocks delivered so far stay valid.
        """

    def backlog(self) -> int:
        """Number of samples that the board has taken and that have not been read yet."""

    def stop(self) -> None:
        """Stop sampling and the trigger train. May be called twice."""


@runtime_checkable
class Camera(AnyDevice, Protocol):
    """The triggered camera: one answer per trigger, in order.

    A camera that the board does not trigger has ``is_triggered = False``, says "uncertain" in
    `describe`, and gives every frame a `first` and a later `last`;
    `drivers.cameras.software_trigger` is the base of such cameras.
    """

    shape: tuple[int, int]
    dtype: np.dtype[Any]
    exposure_samples: int

    def describe(self) -> str:
        """Model and settings in one line, once open; after a start, also how frames get their
        trigger numbers.
        """

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; call before ``ForceSource.start``."""

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The frame of the next trigger, or the reason why it has none. Indices come in order, each
        of them once.

        Raises
        ------
        DeviceTimeout
            Nothing is known about the next trigger after `timeout_s`; perhaps it has not come yet.
        """

    def stop(self) -> None: ...


@runtime_checkable
class AdjustableCamera(Protocol):
    """A camera whose exposure and gain can be changed while it takes images."""

    def adjust(self, exposure_s: float, gain_db: float) -> None:
        """Set the exposure, and the gain where that is not below 0; a frame that is being exposed
        may have either.

        Raises
        ------
        OutOfLimits
            It does not have that exposure or gain; what was not set stays as it was.
        """


@runtime_checkable
class Actuator(AnyDevice, Protocol):
    """The drive of the block along x; positions are metres in the actuator's own coordinate.

    One that takes `set_velocity` and `move_to` while it moves, and goes on at the new velocity
    without a stop, has an attribute `can_change_velocity`, which is True.
    """

    @property
    def travel_limits_m(self) -> tuple[float, float]:
        """Least and greatest position that it can be sent to, known once it is open."""

    @property
    def velocity_limit_m_s(self) -> float:
        """Greatest velocity that it can be set to, known once it is open."""

    def home(self) -> None:
        """Search the origin.

        Returns at once; `is_moving` says when the search is over. Only ever called because a user
        has asked for it.
        """

    def set_velocity(self, velocity_m_s: float) -> None:
        """Set the speed of later moves.

        Raises `OutOfLimits`, and changes nothing, if the stage cannot move at that speed.
        """

    def move_to(self, position_m: float) -> None:
        """Start a move that ends by itself at `position_m`; returns at once.

        A bounded move is the only way to set the block in motion, so that the bench stops by itself
        if the program dies. Raises `OutOfLimits`, and does not move, if the target lies outside
        `travel_limits_m`.
        """

    def position_m(self) -> float: ...

    def is_moving(self) -> bool: ...

    def stop(self) -> None:
        """End any motion now.

        May be called from any thread at any time after `open`, also when nothing moves.
        """

    def close(self) -> None:
        """Stop any motion, then let go of the device."""


@runtime_checkable
class MadeReady(Protocol):
    """An actuator that can tell, before a contact is pressed, that it would refuse a move."""

    def make_ready(self) -> None:
        """Do what must come before a move; nothing moves.

        Raises `drivers.errors.DeviceFault` if a move would be refused, and says what to do.
        """


class OutsideStopper(Protocol):
    """Stops an actuator from another process, without its driver; can be pickled."""

    def stop(self) -> None:
        """End any motion now, by a way of its own to the controller.

        Raises `drivers.errors.DeviceError` if the command cannot be sent.
        """


@runtime_checkable
class StoppedFromOutside(Protocol):
    """An actuator that another process can stop, also when that of its driver hangs or is gone."""

    def stopper(self) -> OutsideStopper:
        """What the other process needs; once the actuator is open."""
