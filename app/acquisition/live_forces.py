"""The forces of the last seconds on a bench that is connected without a run."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, replace

import numpy as np

from app.evaluation.setup import sensor_chain
from app.records.bench_view import F64, ForcesView
from app.settings.sections import Config
from app.system.errors import UnderLoad
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import LostSamples, SampleBlock

HISTORY_S = 10.0
NEWEST_S = 0.1
NOISE_S = 1.0
POINTS = 120  # of the history that is shown
ZERO_S = 1.0  # of the mean that is taken for zero, as that of the step `zero`
LATE_S = 2.0
# a force of more than so many standard deviations, and such a share of the wanted load, is one
SIGMAS, FREE_SHARE = 5.0, 0.005
END_OF_RANGE = 0.98  # share of a sensor's range beyond which a reading says nothing


@dataclass(frozen=True, slots=True)
class Newest:
    """Means of P and Q, newtons, over the newest tenth of a second, and how old they are."""

    normal_n: float
    shear_n: float
    used: tuple[float, float]  # share of the sensors' ranges
    age_s: float


class LiveForces:
    """Keeps the newest volts; one thread appends, any may read.

    Attributes
    ----------
    end : int
        Samples so far.
    """

    def __init__(self, config: Config) -> None:
        self.end = 0
        self._name = config.forces.source
        self._rate = config.forces.sample_rate
        self._range = np.asarray(config.forces.range)
        self._free_n = FREE_SHARE * config.run.normal_force
        self._chain = sensor_chain(config)
        self._volts = np.full((round(HISTORY_S * self._rate), 2), np.nan)
        self._came_at = -math.inf
        self._changed = threading.Condition()

    def append(self, block: SampleBlock | LostSamples) -> None:
        """Take a block, or the gap in its place."""
        lost = block.count if isinstance(block, LostSamples) else 0
        volts = block.volts if isinstance(block, SampleBlock) else np.full((lost, 2), np.nan)
        volts = volts[-len(self._volts) :]
        with self._changed:
            self._volts = np.concatenate((self._volts[len(volts) :], volts))
            self.end += len(volts)
            self._came_at = time.monotonic()
            self._changed.notify_all()

    def newest(self) -> Newest | None:
        """The forces now; None before there are any."""
        volts, age_s = self._last(NEWEST_S)
        if not len(volts) or np.isnan(volts).all():
            return None
        normal, shear = (float(f) for f in np.nanmean(self._chain.forces(volts), axis=0))
        first, second = (float(u) for u in np.nanmax(np.abs(volts) / self._range, axis=0))
        return Newest(normal, shear, (first, second), age_s)

    def view(self) -> ForcesView | None:
        """What is shown; None before there is anything."""
        now = self.newest()
        if now is None:
            return None
        volts, _ = self._last(HISTORY_S)
        forces = self._chain.forces(volts)
        every = max(1, len(forces) // POINTS)
        whole = len(forces) // every * every  # the newest ones
        history = forces[len(forces) - whole :].reshape(-1, every, 2).mean(axis=1)
        time_s = (np.arange(len(history)) + 1 - len(history)) * every / self._rate
        return ForcesView(
            (now.normal_n, now.shear_n),
            self._noise(forces),
            now.used,
            time_s,
            history,
            now.age_s,
        )

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
        wanted = round(ZERO_S * self._rate)
        with self._changed:
            until = self.end + wanted
            if not self._changed.wait_for(lambda: self.end >= until, ZERO_S + LATE_S):
                came = self.end + wanted - until
                raise DeviceTimeout(
                    f"zero: {wanted} readings of the sensors were wanted, {came} came within"
                    f" {ZERO_S + LATE_S:g} s; see the line of the forces"
                )
            volts = self._volts[-wanted:]
        if np.isnan(volts).any():
            raise DeviceFault("zero: the board lost samples meanwhile; zero once more")
        for i, (sensor, used) in enumerate(
            zip(("normal", "shear"), np.abs(volts).max(axis=0) / self._range, strict=True)
        ):
            if used >= END_OF_RANGE:
                raise DeviceFault(
                    f"zero: the {sensor} sensor is at the end of its range of"
                    f" {self._range[i]:g} V and has no zero there; let the block hang free, and"
                    " check its gap"
                )
        if not under_load:
            self._check_free(self._chain.forces(volts))
        normal, shear = (float(v) for v in volts.mean(axis=0))
        self.set_zero((normal, shear))
        return normal, shear

    def set_zero(self, volts: tuple[float, float]) -> None:
        """Take these readings for those without a force from now on."""
        self._chain = replace(self._chain, zero_v=volts)

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

    def _last(self, seconds: float) -> tuple[F64, float]:
        """The volts of that time, or of what there is of it, and how long ago they came."""
        with self._changed:
            known = min(self.end, round(seconds * self._rate), len(self._volts))
            return self._volts[len(self._volts) - known :], time.monotonic() - self._came_at

    def _noise(self, forces: F64) -> tuple[float, float]:
        n = round(NOISE_S * self._rate)
        if len(forces) < n or np.isnan(forces[-n:]).any():
            return math.nan, math.nan
        at = np.linspace(-1.0, 1.0, n)
        tail = forces[-n:] - forces[-n:].mean(axis=0)
        slope = (at @ tail) / (at @ at)
        noise = (tail - at[:, None] * slope).std(axis=0)
        normal, shear = (float(s) for s in np.where(2 * np.abs(slope) > noise, math.nan, noise))
        return normal, shear
