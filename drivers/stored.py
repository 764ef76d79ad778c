"""The three devices of a recorded experiment, played back on the sample clock: for benches where
some devices are there and some are not.

A stored force source keeps the pace of the recording, each sample and each gap at its number. A
stored camera hands over the picture of a trigger when its exposure has passed on the clock. A
stored stage is where it was, whatever it is told.
"""

from __future__ import annotations

import math
import time
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout, OutOfLimits
from drivers.protocols import Frame, Image, LostFrame, LostSamples, SampleBlock, TriggerTrain
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings


class Recording(Protocol):
    """What was recorded, as the stored devices need it.

    Attributes
    ----------
    name : str
    pace : float or None
        Seconds of the recording per second; None: as fast as it is read.
    volts : ndarray, shape (n, 2)
        Readings of the sensors; row is sample, NaN where samples were lost.
    sample_rate_hz : float
    divisor : int
        Samples from one trigger to the next; the first was on sample 0.
    shape, dtype
        Of the images.
    position_samples, positions_m : ndarray, shape (m,)
        Readings of the stage.
    """

    name: str
    pace: float | None
    volts: NDArray[np.float64]
    sample_rate_hz: float
    divisor: int
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    position_samples: NDArray[np.int64]
    positions_m: NDArray[np.float64]

    def image(self, index: int) -> Image | str | None:
        """The image of a trigger, why it has none, or None beyond the last one."""


class StoredForces:
    """The sensors of a recorded experiment."""

    counts_exposures = False

    def __init__(self, settings: ForceSettings, clock: SampleClock, recording: Recording) -> None:
        self._recording, self._pace = recording, recording.pace or math.inf
        self.name = f"forces of {recording.name}"
        self.sample_rate_hz = clock.sample_rate_hz
        self.block_samples = settings.block
        self._state = "closed"
        self._began = 0.0
        self._next = 0

    def open(self) -> None:
        """See that the recording fits the settings."""
        r = self._recording
        if r.sample_rate_hz != self.sample_rate_hz:
            raise OutOfLimits(
                f"{self.name}: {self.sample_rate_hz:g} Hz was asked, it was recorded at"
                f" {r.sample_rate_hz:g} Hz;"
                " set forces.sample_rate to that"
            )
        self._state = "open"

    def describe(self) -> str:
        """What is played."""
        return f"{len(self._recording.volts)} samples at {self.sample_rate_hz:g} Hz, recorded"

    def start(self, train: TriggerTrain) -> None:
        """Play from sample 0 on."""
        del train
        self._need("open", "to start")
        self._state, self._began, self._next = "running", time.monotonic(), 0

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block, or gap, when its time has come."""
        self._need("running", "for samples")
        first, volts = self._next, self._recording.volts
        lost = np.isnan(volts[first:, 0])
        if not lost.size:
            raise DeviceFault(
                f"{self.name}: sample {first} was asked, the recording ends there; it has been"
                " played to its end"
            )
        if lost[0]:
            n = int(np.argmin(lost)) if not lost.all() else lost.size
        else:
            n = min(self.block_samples, int(np.argmax(lost)) if lost.any() else lost.size)
        wait = self._began + (first + n) / self.sample_rate_hz / self._pace - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout_s))
        if wait > timeout_s:
            raise DeviceTimeout(
                f"{self.name}: {n} samples were asked within {timeout_s:g} s, the pace of the"
                " recording holds them back; wait longer"
            )
        self._next = first + n
        if lost[0]:
            return LostSamples(first, n, f"{self.name}: they were lost when it was recorded")
        return SampleBlock(first, volts[first : first + n].copy())

    def backlog(self) -> int:
        """Samples whose time has come and that were not read."""
        if self._state != "running" or math.isinf(self._pace):
            return 0
        return max(
            0, int((time.monotonic() - self._began) * self._pace * self.sample_rate_hz) - self._next
        )

    def stop(self) -> None:
        """Play no further."""
        self._state = "open" if self._state == "running" else self._state

    def close(self) -> None:
        """Let go of the recording."""
        self._state = "closed"

    def _need(self, state: str, asked: str) -> None:
        if self._state != state:
            raise DeviceFault(
                f"{self.name}: it was asked {asked}, it is {self._state}; open and start it first"
            )


class StoredCamera:
    """The camera of a recorded experiment."""

    def __init__(self, settings: CameraSettings, clock: SampleClock, recording: Recording) -> None:
        self._recording, self._clock = recording, clock
        self.name = f"camera of {recording.name}"
        self.shape, self.dtype = recording.shape, recording.dtype
        self.exposure_samples = settings.exposure_samples(clock.sample_rate_hz)
        self._is_open = False
        self._train: TriggerTrain | None = None
        self._next = 0

    def open(self) -> None:
        """Nothing has to be claimed."""
        self._is_open = True

    def describe(self) -> str:
        """What is played."""
        rows, columns = self.shape
        return f"{columns} x {rows}, {8 * self.dtype.itemsize} bit, recorded"

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers, which must come as they were recorded."""
        if not self._is_open:
            raise DeviceFault(
                f"{self.name}: it was asked to wait for triggers, it is closed; open it first"
            )
        if train.divisor != self._recording.divisor:
            raise OutOfLimits(
                f"{self.name}: a trigger every {train.divisor} samples was asked, it was recorded"
                f" with one every {self._recording.divisor};"
                " set camera.divisor to that"
            )
        self._train, self._next = train, 0

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The picture of the next trigger, once its exposure has passed."""
        train, index, clock = self._train, self._next, self._clock
        if train is None:
            raise DeviceFault(f"{self.name}: a frame was asked, it is not started; start it first")
        end = train.sample(index) + self.exposure_samples
        clock.wait_for(
            lambda: clock.now >= end or clock.phase == "stopped" or self._train is None, timeout_s
        )
        if clock.now < end or self._train is None:
            raise DeviceTimeout(
                f"{self.name}: frame {index} was asked within {timeout_s:g} s, its time has not"
                " come; wait longer, or end here"
            )
        image = self._recording.image(index)
        self._next = index + 1
        if image is None:
            return LostFrame(
                index, train.sample(index), f"{self.name}: the recording ends before it"
            )
        if isinstance(image, str):
            return LostFrame(index, train.sample(index), f"{self.name}: {image}")
        image.setflags(write=False)
        return Frame(index, train.sample(index), image)

    def stop(self) -> None:
        """Wait for triggers no longer."""
        self._train = None

    def close(self) -> None:
        """Stop, and let go of the recording."""
        self.stop()
        self._is_open = False


class StoredActuator:
    """The stage of a recorded experiment: it goes where it went, on the clock of the samples, once
    it was told to move.
    """

    def __init__(
        self, settings: ActuatorSettings, clock: SampleClock, recording: Recording
    ) -> None:
        self._recording, self._clock = recording, clock
        self.name = f"stage of {recording.name}"
        self.travel_limits_m = settings.travel
        self.velocity_limit_m_s = settings.max_velocity
        self._is_open = self._is_told = False

    def open(self) -> None:
        """See that there is a stage in the recording."""
        if not self._recording.positions_m.size:
            raise DeviceFault(
                f"{self.name}: its positions were asked, none was recorded; take another"
                " actuator.source"
            )
        self._is_open = True

    def describe(self) -> str:
        """What is played."""
        travel = float(np.ptp(self._recording.positions_m))
        return (
            f"{len(self._recording.positions_m)} positions, {travel * 1e6:.1f} um of travel,"
            " recorded"
        )

    def home(self) -> None:
        """Refused: a recorded stage can not be sent anywhere."""
        raise DeviceFault(
            f"{self.name}: it was asked to find its origin, it is a recording; take a real or"
            " simulated stage"
        )

    def set_velocity(self, velocity_m_s: float) -> None:
        """The recording has its own; only what no stage could do is refused."""
        self._need("for a velocity")
        if not 0 < velocity_m_s <= self.velocity_limit_m_s:
            raise OutOfLimits(
                f"{self.name}: {velocity_m_s * 1e6:.6g} um/s was asked; use a velocity above 0 and"
                f" up to {self.velocity_limit_m_s * 1e6:g} um/s"
            )

    def move_to(self, position_m: float) -> None:
        """Let the recorded move count as moving from now on."""
        self._need("to move")
        low, high = self.travel_limits_m
        if not low <= position_m <= high:
            raise OutOfLimits(
                f"{self.name}: a move to {position_m * 1e3:.6g} mm was asked; its travel is"
                f" {low * 1e3:g} to {high * 1e3:g} mm"
            )
        self._is_told = True

    def position_m(self) -> float:
        """Where the stage was at the newest sample."""
        self._need("for its position")
        return float(
            np.interp(
                self._clock.now, self._recording.position_samples, self._recording.positions_m
            )
        )

    def is_moving(self) -> bool:
        """Whether the recorded stage has somewhere to go, and was told to."""
        self._need("whether it moves")
        goes = np.flatnonzero(np.diff(self._recording.positions_m))
        return bool(
            self._is_told
            and goes.size
            and self._clock.now < self._recording.position_samples[goes[-1] + 1]
        )

    def stop(self) -> None:
        """A recording moves nothing; it counts as standing."""
        self._is_told = False

    def close(self) -> None:
        """Stop, and let go of the recording."""
        self._is_told = self._is_open = False

    def _need(self, asked: str) -> None:
        if not self._is_open:
            raise DeviceFault(f"{self.name}: it was asked {asked}, it is closed; open it first")
