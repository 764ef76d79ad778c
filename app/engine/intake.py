"""What comes in from the forces and the stage, block by block: to the disk, to the history, and to
the decisions of the run.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.engine.experiment import Measured
from app.engine.history import History
from app.engine.pipeline import sensor_chain
from app.engine.recorder import Recorder
from app.records import Gap, Position, Samples
from app.settings import Config
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import Actuator, Camera, ForceSource, LostSamples, SampleBlock

READ_TIMEOUT_S = 2.0
PATIENT_READS = 30


class BenchDevices(Protocol):
    """A bench as the engine sees it: three devices, opened and closed together."""

    @property
    def forces(self) -> ForceSource: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def actuator(self) -> Actuator: ...

    def open(self) -> None: ...
    def close(self) -> None: ...


class Intake:
    """Takes each block once, with the position of the stage at its end.

    Parameters
    ----------
    patient : bool
        True where the sources wait for our own disk and analysis (simulation at full speed): they
        have a minute, hardware has seconds.

    Attributes
    ----------
    samples_lost : int
    start_m : float
        Position of the stage at the start of the run.
    """

    def __init__(
        self, config: Config, bench: BenchDevices, history: History, *, patient: bool
    ) -> None:
        self.samples_lost = 0
        self.start_m = 0.0
        self._config = config
        self._bench = bench
        self._history = history
        self._chain = sensor_chain(config)
        self._reads = PATIENT_READS if patient else 1

    def begin(self) -> None:
        """The run starts where the stage is now."""
        self.start_m = self._bench.actuator.position_m()

    def now(self) -> int:
        """The board's newest sample, read or not."""
        return self._history.end + self._bench.forces.backlog()

    def take(self, recorder: Recorder, has_reference: bool = False) -> Measured | None:
        """The next block, on its way to the disk, and what it says; None for a gap that the
        settings put up with.

        Raises
        ------
        DeviceFault
            The board lost samples, and the run is to end where it does.
        """
        block = self._read()
        volts = block.volts if isinstance(block, SampleBlock) else np.full((block.count, 2), np.nan)
        forces = self._chain.forces(volts)
        if isinstance(block, SampleBlock):
            recorder.append(Samples(block.first, volts, forces, self._further(block)))
        else:
            self.samples_lost += block.count
            recorder.append(Gap(block.first, block.count, block.reason))
        now, position, moving = block.end, math.nan, False
        try:
            stage = self._bench.actuator.position_m(), self._bench.actuator.is_moving()
            # the stage was read now, which is later than the block where more of them wait
            now = max(now, self.now())
            position, moving = stage
        finally:  # an actuator that fails, or a board that goes away now, costs no sample
            recorder.append(Position(now, position))
            self._history.append(block.first, forces, position, now)
        if isinstance(block, LostSamples):
            if self._config.forces.on_overflow == "end":
                raise DeviceFault(
                    f"{block.reason}; {block.count} samples from {block.first} on are lost"
                )
            return None
        normal, shear = np.abs(volts).max(axis=0) / self._config.forces.range
        return Measured(
            block.end,
            forces,
            position - self.start_m,
            moving,
            has_reference,
            (float(normal), float(shear)),
        )

    def _further(self, block: SampleBlock) -> NDArray[np.float64] | None:
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

    def _read(self) -> SampleBlock | LostSamples:
        for attempts_left in reversed(range(self._reads)):
            try:
                return self._bench.forces.read(READ_TIMEOUT_S)
            except DeviceTimeout:
                if not attempts_left:
                    raise
        raise AssertionError("unreachable")
