"""The forces of the last seconds on a bench that is connected without a run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analysis.arrays import F64
from app.acquisition.ending import Ending
from app.acquisition.force_reader import BenchDevices, ForceReader
from app.acquisition.stage import Stage
from app.acquisition.watchdog import Watchdog
from app.evaluation.history import History
from app.experiment.course import MeasuredBlock
from app.records.bench_view import END_OF_RANGE, ForcesView
from app.settings.sections import Config
from app.system.errors import UnderLoad
from drivers.errors import DeviceFault, DeviceTimeout

READ_S = 0.3  # longest delay of a block of forces
HISTORY_S = 10.0
NEWEST_S = 0.1
NOISE_S = 1.0
POINTS = 120  # points of the force history that is shown
ZERO_S = 1.0  # averaging time of a zero, as that of the step `zero`
LATE_S = 2.0
# a force of more than so many standard deviations, and such a share of the wanted load, is one
SIGMAS, FREE_SHARE = 5.0, 0.005


class LiveForces(ForceReader):
    """The reader of a bench without a run: one thread takes block by block, any may look. A gap is
    put up with, and the stage is asked by its own thread.
    """

    def __init__(self, config: Config, bench: BenchDevices, stage: Stage) -> None:
        super().__init__(
            replace(config, forces=replace(config.forces, on_overflow="continue")),
            bench,
            stage,
            History(config.forces.sample_rate, config.exposure_samples),
            Watchdog(Ending(stage.halt), config.limits.age, is_direct=True),
            pace=1.0,
            extra_s=READ_S,
        )
        self._free_n = FREE_SHARE * config.run.as_planned.normal_force

    def restart(self) -> None:
        """The samples are counted from 0 again."""
        self.history = History(self.history.sample_rate_hz, self.history.exposure_samples)

    def newest(self) -> MeasuredBlock | None:
        """The last tenth of a second, but its gaps; None where nothing is known of it."""
        end, forces = self.history.end, self.history.last(NEWEST_S)
        forces = forces[~np.isnan(forces).any(axis=1)]
        if not len(forces):
            return None
        position_m, moves = self._stage.look()
        travel_m, used = position_m - self._stage.start_m, self._used(forces)
        return MeasuredBlock(end, forces, travel_m, moves, False, used, self.age_s(end))

    def view(self) -> ForcesView | None:
        """What is shown; None before there is anything."""
        now, forces = self.newest(), self.history.last(HISTORY_S)
        if now is None:
            return None
        every = max(1, len(forces) // POINTS)
        whole = len(forces) // every * every  # the newest ones
        history = forces[len(forces) - whole :].reshape(-1, every, 2).mean(axis=1)
        time_s = (np.arange(len(history)) + 1 - len(history)) * every / self.history.sample_rate_hz
        return ForcesView(now.mean, self._noise(forces), now.range_used, time_s, history, now.age_s)

    def zero(self, *, under_load: bool = False) -> tuple[float, float]:
        """The readings without a force in volts, the mean over the next second; from now on those
        of this object.

        Raises
        ------
        UnderLoad
            A force is read that is neither noise nor a small part of the wanted load, and
            `under_load` does not say that it is none; the zero stays as it was.
        DeviceTimeout
            No readings came.
        DeviceFault
            A sensor is at the end of its range, or samples were lost.
        """
        history = self.history
        wanted = round(ZERO_S * history.sample_rate_hz)
        until = history.end + wanted
        if not history.wait_for(until, ZERO_S + LATE_S):
            came = history.end + wanted - until
            raise DeviceTimeout(
                f"zero: {wanted} readings of the sensors were wanted, {came} came within"
                f" {ZERO_S + LATE_S:g} s; see the line of the forces"
            )
        forces = history.last(ZERO_S)
        if np.isnan(forces).any():
            raise DeviceFault("zero: the board lost samples meanwhile; zero once more")
        for sensor, used, volts in zip(
            ("normal", "shear"), self._used(forces), self._config.forces.range, strict=True
        ):
            if used >= END_OF_RANGE:
                raise DeviceFault(
                    f"zero: the {sensor} sensor is at the end of its range of"
                    f" {volts:g} V and has no zero there; let the block hang free, and"
                    " check its gap"
                )
        if not under_load:
            self._check_free(forces)
        normal, shear = (float(v) for v in self._chain.volts(forces).mean(axis=0))
        self.set_zero((normal, shear))
        return normal, shear

    def set_zero(self, volts: tuple[float, float]) -> None:
        """Take these readings for those without a force, also of what is shown."""
        before = self._chain.forces(volts)
        super().set_zero(volts)
        self.history.shift(-before)

    def _used(self, forces: F64) -> tuple[float, float]:
        """Greatest share of the range of each sensor."""
        volts = np.abs(self._chain.volts(forces)).max(axis=0)
        normal, shear = (float(u) for u in volts / self._config.forces.range)
        return normal, shear

    def _check_free(self, forces: F64) -> None:
        """Refuse a zero while these forces, in newtons, are clearly not zero; UnderLoad."""
        normal, shear = (float(f) for f in forces.mean(axis=0))
        most = np.fmax(SIGMAS * np.array(self._noise(forces)), self._free_n)
        if (np.abs((normal, shear)) > most).any():
            raise UnderLoad(
                f"zero: P reads {normal:.3f} N and Q {shear:.3f} N, more than their noise, so that"
                " the block may be pressed; let it hang free and zero again, or say that nothing"
                " touches it"
            )

    def _noise(self, forces: F64) -> tuple[float, float]:
        n = round(NOISE_S * self.history.sample_rate_hz)
        if len(forces) < n or np.isnan(forces[-n:]).any():
            return math.nan, math.nan
        at = np.linspace(-1.0, 1.0, n)
        tail = forces[-n:] - forces[-n:].mean(axis=0)
        slope = (at @ tail) / (at @ at)
        noise = (tail - at[:, None] * slope).std(axis=0)
        normal, shear = (float(s) for s in np.where(2 * np.abs(slope) > noise, math.nan, noise))
        return normal, shear
