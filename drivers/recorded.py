"""The three devices of a recorded experiment, played back on the sample clock, for benches on which
only some devices are present.

A stored force source keeps the pace of the recording, with each sample and each gap at its number.
A stored camera delivers the image of a trigger when its exposure has passed on the clock. A stored
stage is where it was at the time, whatever it is told to do.
"""

from __future__ import annotations

import math
import time
from typing import Any, Protocol

import numpy as np

from analysis.arrays import F64, I64
from drivers.cameras.played_images import PlayedImages
from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout, OutOfLimits
from drivers.motion import check_target, check_velocity
from drivers.protocols import Image, LostSamples, SampleBlock, TriggerTrain
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings

_AGREE_M = 3e-6  # two readings of a stage at rest differ by less
_NEAR_M = 0.5e-6  # further from its place it is on its way again
_ENCODER_M = 0.1e-6  # a stage that has arrived may read off by so much


class Recording(Protocol):
    """The data of an experiment that the stored devices play.

    Attributes
    ----------
    name : str
    pace : float or None
        Seconds of the recording per second; None: as fast as it is read.
    volts : ndarray, shape (n, 2)
        Readings of the sensors, row i at sample i; NaN where samples were lost.
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
    volts: F64
    sample_rate_hz: float
    divisor: int
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    position_samples: I64
    positions_m: F64

    def image(self, index: int) -> Image | str | None:
        """The image of a trigger, the reason why it has none, or None beyond the last trigger."""


class StoredForces:
    """The sensors of a recorded experiment."""

    counts_exposures = False

    def __init__(self, settings: ForceSettings, clock: SampleClock, recording: Recording) -> None:
        self._recording, self._pace = recording, recording.pace or math.inf
        self._further = settings.auxiliary
        self.name = f"forces of {recording.name}"
        self.sample_rate_hz = clock.sample_rate_hz
        self.block_samples = settings.block
        self._state = "closed"
        self._began = 0.0
        self._next = 0
        self._turns = np.empty(0, np.int64)  # samples from which readings are lost, or are not

    def open(self) -> None:
        """Check that the recording has the sample rate of the bench, and no more is asked of it."""
        if self._further:
            raise OutOfLimits(
                f"{self.name}: of a recording P and Q are played, forces.auxiliary asks for"
                f" {len(self._further)} further channels; set forces.auxiliary = []"
            )
        recorded_hz = self._recording.sample_rate_hz
        if recorded_hz != self.sample_rate_hz:
            raise OutOfLimits(
                f"{self.name}: {self.sample_rate_hz:g} Hz was requested, it was recorded at"
                f" {recorded_hz:g} Hz; set forces.sample_rate to that"
            )
        self._state = "open"

    def describe(self) -> str:
        """Length and rate of the recording."""
        return f"{len(self._recording.volts)} samples at {self.sample_rate_hz:g} Hz, recorded"

    def start(self, train: TriggerTrain) -> None:
        """Play from sample 0 on."""
        del train  # the recording has its own triggers
        self._check("open", "cannot start")
        # once: an hour of readings is long
        is_lost = np.isnan(self._recording.volts[:, 0])
        self._turns = np.flatnonzero(is_lost[1:] != is_lost[:-1]) + 1
        self._state, self._began, self._next = "running", time.monotonic(), 0

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block, or gap, when its time has come."""
        self._check("running", "has no samples")
        first, volts = self._next, self._recording.volts
        if first >= len(volts):
            raise DeviceFault(
                f"{self.name}: the recording ends before sample {first}; it has been played to its"
                " end"
            )
        turn = int(np.searchsorted(self._turns, first, side="right"))
        n = (int(self._turns[turn]) if turn < len(self._turns) else len(volts)) - first
        is_lost = math.isnan(volts[first, 0])
        if not is_lost:
            n = min(self.block_samples, n)
        wait = self._began + (first + n) / self.sample_rate_hz / self._pace - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout_s))
        if wait > timeout_s:
            raise DeviceTimeout(
                f"{self.name}: at the pace of the recording, the next {n} samples take longer than"
                f" {timeout_s:g} s; wait longer"
            )
        self._next = first + n
        if is_lost:
            return LostSamples(first, n, f"{self.name}: samples were lost when it was recorded")
        return SampleBlock(first, volts[first : first + n].copy())

    def backlog(self) -> int:
        """Number of samples whose time has come and that have not been read."""
        if self._state != "running" or math.isinf(self._pace):
            return 0
        elapsed_s = time.monotonic() - self._began
        return max(0, int(elapsed_s * self._pace * self.sample_rate_hz) - self._next)

    def stop(self) -> None:
        """Stop playing."""
        self._state = "open" if self._state == "running" else self._state

    def close(self) -> None:
        """Let go of the recording."""
        self._state = "closed"

    def _check(self, state: str, problem: str) -> None:
        if self._state != state:
            raise DeviceFault(
                f"{self.name}: it {problem} while it is {self._state}; open and start it first"
            )


class StoredCamera(PlayedImages):
    """The camera of a recorded experiment."""

    def __init__(self, settings: CameraSettings, clock: SampleClock, recording: Recording) -> None:
        super().__init__(settings, clock)
        self._recording = recording
        self.name = f"camera of {recording.name}"
        self.shape, self.dtype = recording.shape, recording.dtype

    def describe(self) -> str:
        """Size and depth of the recorded images."""
        rows, columns = self.shape
        return f"{columns} x {rows}, {8 * self.dtype.itemsize} bit, recorded"

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers, which must come as they were recorded."""
        if train.divisor != self._recording.divisor:
            raise OutOfLimits(
                f"{self.name}: a trigger every {train.divisor} samples was requested, it was"
                f" recorded with one every {self._recording.divisor}; set camera.divisor to that"
            )
        super().start(train)

    def image(self, index: int) -> Image | str:
        """The recorded image of a trigger, or why it has none."""
        image = self._recording.image(index)
        if image is None:
            image = "the recording ends before it"
        return f"{self.name}: {image}" if isinstance(image, str) else image


class StoredActuator:
    """The stage of a recorded experiment: once it has been sent anywhere, it repeats the recorded
    motion on the sample clock.
    """

    def __init__(
        self, settings: ActuatorSettings, clock: SampleClock, recording: Recording
    ) -> None:
        self._recording, self._clock = recording, clock
        self.name = f"stage of {recording.name}"
        self.travel_limits_m = settings.travel
        self.velocity_limit_m_s = settings.max_velocity
        self._is_open = self._is_sent = False
        self._leg_end = 0  # sample on which the recorded stage arrives

    def open(self) -> None:
        """Check that positions of a stage were recorded."""
        if not self._recording.positions_m.size:
            raise DeviceFault(
                f"{self.name}: no position was recorded; choose another actuator.source"
            )
        self._is_open = True

    def describe(self) -> str:
        """Number of recorded positions, and the travel."""
        travel = float(np.ptp(self._recording.positions_m))
        return (
            f"{len(self._recording.positions_m)} positions, {travel * 1e6:.1f} um of travel,"
            " recorded"
        )

    def home(self) -> None:
        """Refused: a recorded stage cannot be sent anywhere."""
        raise DeviceFault(
            f"{self.name}: a recording cannot search its origin; choose a real or simulated stage"
        )

    def set_velocity(self, velocity_m_s: float) -> None:
        """Check the limit; the recording keeps its own velocity."""
        self._check()
        check_velocity(self.name, velocity_m_s, self.velocity_limit_m_s)

    def move_to(self, position_m: float) -> None:
        """Check the travel; from now on the recorded motion counts as this move.

        Raises `OutOfLimits` also where the recorded motion goes further than that.
        """
        self._check()
        check_target(self.name, position_m, self.travel_limits_m)
        here, later = self.position_m(), self._recording.position_samples >= self._clock.now
        asked, way = abs(position_m - here), 1.0 if position_m >= here else -1.0
        ahead = (self._recording.positions_m[later] - here) * way
        recorded, leg_end = _leg(self._recording.position_samples[later], ahead, asked)
        if recorded > asked + _AGREE_M:
            raise OutOfLimits(
                f"{self.name}: a move of {asked * 1e6:.1f} um was requested, the"
                f" recorded stage goes {recorded * 1e6:.1f} um; set run.travel to what was"
                " recorded, or choose another actuator.source"
            )
        self._leg_end = leg_end
        self._is_sent = True

    def position_m(self) -> float:
        """Position of the stage at the newest sample."""
        self._check()
        return float(
            np.interp(
                self._clock.now, self._recording.position_samples, self._recording.positions_m
            )
        )

    def is_moving(self) -> bool:
        """Whether the stage has been sent anywhere and the recorded one is not there yet."""
        self._check()
        return self._is_sent and self._clock.now < self._leg_end

    def stop(self) -> None:
        """Count as standing from now on."""
        self._is_sent = False

    def close(self) -> None:
        """Stop, and let go of the recording."""
        self._is_sent = self._is_open = False

    def _check(self) -> None:
        if not self._is_open:
            raise DeviceFault(f"{self.name}: it is closed; open it first")


def _leg(samples: I64, ahead: F64, asked_m: float) -> tuple[float, int]:
    """How far a recorded stage goes on until it rests at what is asked, or turns back, and the
    sample on which it is there; `ahead` (m) are its places at `samples`, along the motion.
    """
    comes_back = np.flatnonzero(np.maximum.accumulate(ahead) - ahead > _NEAR_M)
    way = ahead[: comes_back[0] if comes_back.size else None]
    furthest = float(way.max(initial=0.0))
    beyond = np.flatnonzero(way > asked_m + _NEAR_M)
    if not (beyond.size or comes_back.size):
        changes = np.flatnonzero(np.diff(way))
        return furthest, int(samples[changes[-1] + 1]) if changes.size else 0
    near, there = (int(np.argmax(way >= min(asked_m, furthest) - m)) for m in (_NEAR_M, _ENCODER_M))
    # it rests where it is read there more often than a stage that passes
    if beyond.size and beyond[0] - there > 1.5 * (there - near) + 2:
        furthest = asked_m
    return furthest, int(samples[there])
