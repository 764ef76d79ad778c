"""The local friction law, Young's modulus and the pressure from the ring means of a drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from analysis.contact.rings import Rings
from analysis.friction.local_law import InvertedRun, LocalLaw, fit_local_law, inverted_run
from analysis.inversion.axisymmetric import AxisymmetricInversion, InvertedRings
from analysis.mechanics.relaxation import Relaxation
from analysis.robust import white_noise
from app.evaluation.budget import Measured
from app.evaluation.history import DriveForces
from app.evaluation.setup import grid_of, places_m
from app.evaluation.tractions import largest_traction, radial_inversion
from app.records.record_types import RingProfile, Snapshot
from app.records.snapshot_numbers import all_series
from app.settings.sections import Config

FORCE_NOISE_N = 1e-3  # noise of a force's mean over an exposure, if the record is too short


class Inverted(NamedTuple):
    """The inversion of a drive, and the frames with rings for it."""

    inversion: AxisymmetricInversion
    frames: list[Snapshot]
    rings: list[Rings]
    P: np.ndarray
    Q: np.ndarray
    time: np.ndarray
    relaxation: Relaxation
    each: list[InvertedRings]  # what inverts each frame, if it is kept
    forces: DriveForces | None

    def law(self, **options: int) -> LocalLaw:
        """The local friction law; options as for `fit_local_law`."""
        return fit_local_law(
            self.rings,
            self.P,
            self.Q,
            self.inversion,
            Q_sd=force_noise(self.Q),
            time=self.time,
            relaxation=self.relaxation,
            inverted=self.each,
            samples=self.forces,
            **options,
        )

    def run(self) -> InvertedRun:
        """Its frames."""
        return inverted_run(self.rings, self.P, self.Q, self.inversion, self.time, self.relaxation)

    def stick_radius(self, share: float, reach: float) -> float:
        """c, where the traction is largest, in metres, in the frame in which Q has come to that
        share of its maximum; `reach` as for `stress_peak`.
        """
        frame = int(np.argmax(share * self.Q.max() <= self.Q))
        try:
            found = self.inversion.solve(self.rings[frame])
        except ValueError:
            return math.nan
        return largest_traction(found, self.inversion.mask_radius, reach)[0]


def inverted(
    measured: Measured,
    hertz_m: float,
    most_frames: int | None = None,
    beside: Inverted | None = None,
) -> Inverted | None:
    """What inverts the rings of a drive; None where no traction was computed.

    `hertz_m` is Hertz's contact radius under the normal force, metres; `most_frames` takes as many
    at most, evenly spaced, and keeps what inverts each. As far as that does not differ it is taken
    from `beside`, of the same frames with another input.
    """
    config, contact, drive = measured.config, measured.contact, measured.drive
    if contact is None or not any(s.traction for s in drive):
        return None
    frames = [s for s in drive if s.rings is not None]  # a long series keeps those of some
    if most_frames and len(frames) > most_frames:
        chosen = np.linspace(0, len(frames) - 1, most_frames).round().astype(int)
        frames = [frames[i] for i in chosen]
    inversion = _inversion(config, contact.centre_px, hertz_m, measured.averaging)
    rings = [_counted(s.rings, inversion) for s in frames if s.rings is not None]
    P, Q, time = all_series(frames, "normal_force_n", "shear_force_n", "time_s")
    each = []
    if most_frames:
        known: Sequence[InvertedRings | None] = [None] * len(rings)
        if beside and beside.inversion is inversion:
            known = beside.each
        each = [
            old if old and old.fits(one) else InvertedRings(inversion, one)
            for old, one in zip(known, rings, strict=True)
        ]
    block, samples = measured.relaxation, measured.forces
    return Inverted(inversion, frames, rings, P, Q, time, block, each, samples)


def force_noise(Q: np.ndarray) -> float:
    """Standard deviation of the noise of a force from frame to frame, newtons."""
    noise = FORCE_NOISE_N
    if len(Q) > 8:
        noise = white_noise(Q)
    return max(noise, 0.01 * FORCE_NOISE_N)


@lru_cache(maxsize=32)  # that of the settings serves all inputs of a budget that do not change it
def _inversion(
    config: Config, centre_px: tuple[float, float], hertz_m: float, averaging: float
) -> AxisymmetricInversion:
    grid = grid_of(config)
    x, y = places_m(config, *np.meshgrid(grid.x_px, grid.y_px))
    centre_x, centre_y = places_m(config, *centre_px)
    return radial_inversion(config, x - centre_x, y - centre_y, hertz_m, averaging)


def _counted(rings: RingProfile, inversion: AxisymmetricInversion) -> Rings:
    """The rings with the number of points that a whole one has."""
    n = min(len(rings.ux_m), len(inversion.radius))
    count = np.where(np.isfinite(rings.ux_m[:n]), inversion.points[:n].round(), 0)
    return Rings(rings.radius_m[:n], rings.ux_m[:n], rings.sd_m[:n], count.astype(np.int64))
