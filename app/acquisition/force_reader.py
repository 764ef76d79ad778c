"""What comes in from the forces and the stage, block by block: to the disk, to the history, and to
the decisions of the run.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from analysis.arrays import F64
from app.acquisition.losses import Losses
from app.acquisition.stage import Stage
from app.acquisition.watchdog import PATIENCE_S, Watchdog
from app.evaluation.history import History
from app.evaluation.setup import sensor_chain
from app.experiment.course import MeasuredBlock
from app.records.record_types import Gap, Position, Record, Samples
from app.settings.sections import Config
from drivers.errors import DeviceError, DeviceFault
from drivers.protocols import (
    Actuator,
    Camera,
    ForceSource,
    LostSamples,
    SampleBlock,
    TriggerTrain,
)

READ_TIMEOUT_S, PATIENT_S = 2.0, 60.0


class BenchDevices(Protocol):
    """A bench as a run sees it: three devices, opened and closed together."""

    @property
    def forces(self) -> ForceSource: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def actuator(self) -> Actuator: ...

    def open(self) -> None: ...
    def close(self) -> None: ...


@dataclass
class _Look:
    """What one look at the bench has found so far; it may not return."""

    block: SampleBlock | LostSamples | None = None
    now: int = 0
    position_m: float = math.nan
    moves: bool = False


class ForceReader:
    """Takes each block once, with the position of the stage at its end.

    Parameters
    ----------
    pace : float or None
        Seconds of the board per second; None where the sources wait for our own disk and analysis
        (simulation at full speed): they have a minute, hardware has seconds, and nothing grows old.
    extra_s : float
        That a block may take beyond its own time.

    Attributes
    ----------
    record : callable
        Where the records go: to the recorder of a run, else nowhere.
    history : History
        What was read.
    samples_lost : int
    losses : Losses
        Why they are lost.
    block_s : float
        Time between two blocks, seconds; 0 where nothing grows old.
    exposures : int
        Of the camera, as the board has counted them; negative where it counts none.
    """

    def __init__(
        self,
        config: Config,
        bench: BenchDevices,
        stage: Stage,
        history: History,
        watchdog: Watchdog,
        *,
        pace: float | None,
        extra_s: float = READ_TIMEOUT_S,
    ) -> None:
        self.record: Callable[[Record], None] = lambda record: None
        self.samples_lost, self.losses = 0, Losses()
        self.exposures = -1
        self._seen: tuple[float, int] | None = None  # a moment, and the newest sample then
        self._blind: int | None = None  # samples lost since the last block, but in the first gap
        self._config = config
        self._bench = bench
        self._stage = stage
        self.history = history
        self._watchdog = watchdog
        self._chain = sensor_chain(config)
        self._samples_per_s = config.forces.sample_rate * (pace or math.inf)
        self.block_s = config.forces.block / self._samples_per_s
        self._timeout_s = self.block_s + (PATIENT_S if pace is None else extra_s)

    def now(self) -> int:
        """The board's newest sample, read or not."""
        return self.history.end + self._bench.forces.backlog()

    def age_s(self, sample: int) -> float:
        """How long ago a sample was taken; from any thread. NaN before the first block."""
        if self._seen is None:
            return math.nan
        at, newest = self._seen
        return time.monotonic() - at + (newest - sample) / self._samples_per_s

    def set_zero(self, volts: tuple[float, float]) -> None:
        """From the next block on, these readings are those without a force."""
        self._chain = replace(self._chain, zero_v=volts)

    def take(self, *, has_reference: bool = False) -> MeasuredBlock | None:
        """The next block, on its way to the disk, and what it says; None for a gap that the
        settings put up with.

        Raises
        ------
        DeviceFault
            The board lost samples, and the run is to end where it does.
        """
        look, problem = _Look(), None
        try:
            patience_s = PATIENCE_S + self.block_s
            self._watchdog.ask(self._bench.forces.name, lambda: self._look(look), patience_s)
        except Exception as error:  # an actuator that fails, or a board that goes away after the
            problem = error  # block was read, costs no sample
        if isinstance(problem, DeviceError) and self._stage.name in self._watchdog.given_up:
            self._stage.has_failed = True
        block = look.block
        if block is None:
            assert problem is not None
            raise problem
        volts = block.volts if isinstance(block, SampleBlock) else np.full((block.count, 2), np.nan)
        forces = self._chain.forces(volts)
        if isinstance(block, SampleBlock):
            self._blind = None
            self.record(Samples(block.first, volts, forces, self._further(block)))
            if block.exposures is not None:
                self.exposures = int(block.exposures[-1])
        else:
            self._blind = 0 if self._blind is None else self._blind + block.count
            self.samples_lost += block.count
            self.losses.add(block.reason, block.count)
            self.record(Gap(block.first, block.count, block.reason))
        self.record(Position(look.now, look.position_m))
        self.history.append(block.first, forces, look.position_m, look.now)
        age_s = self._watchdog.heard((look.now - block.end) / self._samples_per_s)
        if problem is not None:
            raise problem
        if isinstance(block, LostSamples):
            if self._config.forces.on_overflow == "end":
                raise DeviceFault(
                    f"{block.reason}; {block.count} samples from {block.first} on are lost"
                )
            return None
        normal, shear = np.abs(volts).max(axis=0) / self._config.forces.range
        return MeasuredBlock(
            block.end,
            forces,
            look.position_m - self._stage.start_m,
            look.moves,
            has_reference,
            (float(normal), float(shear)),
            age_s,
            volts=volts,
            asked_sample=look.now,
        )

    def check_gaps(self) -> None:
        """Refuse a board that gives gap after gap, in which nobody knows the forces; DeviceFault.

        One gap has the length that it has, those that follow it may last as long as a board may be
        silent.
        """
        blind_s = (self._blind or 0) / self._samples_per_s
        if blind_s > (self._config.limits.age if self._watchdog.drives else self._timeout_s):
            raise DeviceFault(
                f"{self._bench.forces.name}: nothing but gaps came for {blind_s:.2g} s"
                f" ({self.losses}); check the way to the board and what else this computer does"
            )

    def read_on(self, stood: int, train: TriggerTrain) -> None:
        """Read what was sampled until `stood`, and on until no exposure is open, so that the last
        trigger can have its frame; the first error of a device is raised once all is read.
        """
        problem, exposure = None, self._config.exposure_samples
        while self.history.end < stood:
            before = self.history.end
            try:
                self.take()
            except DeviceError as error:
                problem = problem or error
                if self.history.end == before:
                    break
        if problem:
            raise problem
        for _ in range(train.divisor):
            if (self.history.end - 1 - train.first) % train.divisor + 1 >= exposure:
                return
            self.take()

    def _look(self, look: _Look) -> None:
        watchdog, forces = self._watchdog, self._bench.forces.name
        block = self._bench.forces.read(self._timeout_s)
        look.now, look.block = block.end, block
        watchdog.asked = self._stage.name
        position, moves = self._stage.look()
        watchdog.asked = forces
        # the stage was read now, which is later than the block where more of them wait
        look.now = block.end + self._bench.forces.backlog()
        self._seen = time.monotonic(), look.now
        look.position_m, look.moves = position, moves

    def _further(self, block: SampleBlock) -> F64 | None:
        """Values of the further channels in their units."""
        channels, volts = self._config.forces.auxiliary_channels, block.auxiliary
        found = 0 if volts is None else volts.shape[1]
        if found != len(channels):
            raise DeviceFault(
                f"{self._bench.forces.name}: forces.auxiliary asks for {len(channels)} further"
                f" channels, it delivers {found}; leave them out, or use a source that has them"
            )
        if volts is None:
            return None
        return volts * [c.per_volt for c in channels] + [c.at_zero for c in channels]
