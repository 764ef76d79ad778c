"""The three devices of a bench and what they hand over, all on one clock.

The DAQ sample counter is the only time base: sample 0 is the first sample after
`ForceSource.start`. The board divides its sample clock to trigger the camera, so trigger ``n``
falls on sample ``first + n * divisor`` and every frame carries that number. No host time appears
anywhere.

Rules that every implementation keeps (``tests/contracts.py`` runs each one through them):

- Constructing a device touches nothing; `open` claims the hardware and is the only place that
  imports a vendor library; `close` may be called at any time, twice, and after a failure.
- Order of a run: ``camera.start(train)``, then ``forces.start(train)``, then reads;
  ``forces.stop()`` ends the trigger train.
- `ForceSource.read` and `Camera.read` are each called from one thread; `Actuator.stop` and `close`
  from any thread.
- Errors are `drivers.errors.DeviceError` only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """A block of consecutive readings of the two capacitive sensors, in volts.

    Attributes
    ----------
    first : int
        Index of the block's first sample on the DAQ sample clock.
    volts : ndarray, shape (n, 2), float64
        Column 0 the normal sensor, column 1 the shear sensor. The receiver owns the array.
    exposures : ndarray, shape (n,), int64, or None
        How many exposures of the camera had begun by each sample, counted by the board on its
        sample clock; None where it does not count.
    """

    first: int
    volts: NDArray[np.float64]
    exposures: NDArray[np.int64] | None = None

    @property
    def end(self) -> int:
        """Index of the first sample after the block."""
        return self.first + len(self.volts)


@dataclass(frozen=True, slots=True)
class LostSamples:
    """Samples that the board took and nobody will ever read: a gap with its place and length, never
    a shift of what follows.
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
        """How many triggers fall strictly before `sample`."""
        return max(0, -(-(sample - self.first) // self.divisor))


@dataclass(frozen=True, slots=True)
class Frame:
    """One image of the interface and the trigger that took it.

    Attributes
    ----------
    index : int
        Trigger number, counted from 0.
    sample : int
        Sample on which the exposure started: of the trigger, or later where the board counts
        exposures and saw it late.
    image : ndarray, shape (rows, columns), uint8 or uint16
        Grey levels, read-only; the receiver may keep it.
    """

    index: int
    sample: int
    image: Image


@dataclass(frozen=True, slots=True)
class LostFrame:
    """A trigger that gave no image: an index of its own, never a shift of the others."""

    index: int
    sample: int
    reason: str


@dataclass(frozen=True, slots=True)
class Found:
    """A device that a driver's `find` has found: what to write in the settings (`device` or
    `port`), and what it is.
    """

    device: str
    description: str


@runtime_checkable
class ForceSource(Protocol):
    """The DAQ board: two voltages on a hardware clock, and the camera's trigger train cut from it."""

    name: str
    sample_rate_hz: float
    block_samples: int
    counts_exposures: bool

    def open(self) -> None: ...

    def describe(self) -> str:
        """What was found, in a line, once open: model, serial number, what it is set to."""

    def start(self, train: TriggerTrain) -> None:
        """Start sampling at sample 0 and the trigger train with it, on the same edge."""

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next `block_samples` samples, or more where `backlog` said that more wait, or the gap
        that takes their place.

        Each sample comes in order, and once.

        Raises
        ------
        DeviceTimeout
            No full block came in `timeout_s`.
        DeviceFault
            The board lost samples or went away; the blocks delivered so far stay valid.
        """

    def backlog(self) -> int:
        """Samples that the board has taken and nobody has read yet: the newest one is that far
        ahead of the last block.
        """

    def stop(self) -> None:
        """Stop sampling and the trigger train. May be called twice."""

    def close(self) -> None: ...


@runtime_checkable
class Camera(Protocol):
    """The triggered camera: one answer per trigger, in order."""

    name: str
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    exposure_samples: int

    def open(self) -> None: ...

    def describe(self) -> str:
        """What was found, in a line, once open; after a start also how frames get their trigger
        numbers.
        """

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; call before ``ForceSource.start``."""

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The fate of the next trigger: its frame, or the reason there is none. Indices come in
        order, each once.

        Raises
        ------
        DeviceTimeout
            Nothing is known about the next trigger after `timeout_s` (it may not have happened).
        """

    def stop(self) -> None: ...

    def close(self) -> None: ...


@runtime_checkable
class Actuator(Protocol):
    """The drive of the block, along x; metres in the actuator's own coordinate."""

    name: str

    @property
    def travel_limits_m(self) -> tuple[float, float]:
        """Least and greatest position it can be asked for, known once it is open."""

    @property
    def velocity_limit_m_s(self) -> float:
        """Greatest velocity it can be asked for, known once it is open."""

    def open(self) -> None:
        """Claim the stage; nothing moves."""

    def describe(self) -> str:
        """What was found, in a line, once open: model, and the state of its controller."""

    def home(self) -> None:
        """Find the origin.

        Returns at once; `is_moving` tells when it is done. Never called unless a user asked for it.
        """

    def set_velocity(self, velocity_m_s: float) -> None:
        """Speed of the moves to come.

        Raises `OutOfLimits` and changes nothing where it can not be kept.
        """

    def move_to(self, position_m: float) -> None:
        """Start a move that ends by itself at `position_m`; returns at once.

        A bounded move is the only way to set the block in motion, so that a dead program leaves a
        bench that stops by itself. Raises `OutOfLimits` and does not move where the target lies
        outside `travel_limits_m`.
        """

    def position_m(self) -> float: ...

    def is_moving(self) -> bool: ...

    def stop(self) -> None:
        """End any motion now.

        From any thread, at any time after `open`, also when nothing moves.
        """

    def close(self) -> None:
        """Stop any motion, then let go of the device."""
