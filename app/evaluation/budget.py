"""What the uncertainties of the operator's inputs do to each result: the experiment is concluded
again with one of them at a time changed by its standard uncertainty, up and down.

References
----------
JCGM 100:2008 (GUM), section 5.1: uncertainty of a result from those of its inputs.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from math import isfinite
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from analysis.dic.fixed_pattern import Pull
from analysis.friction.ratio import forces_around
from analysis.mechanics.relaxation import Relaxation, RelaxationCorrection
from app.evaluation.history import DriveForces
from app.evaluation.readings import NOTHING_SEEN, Readings
from app.evaluation.setup import sensor_chain
from app.records.record_types import Conditions, ContactResult, FrameMotion, RingProfile, Snapshot
from app.records.snapshot_numbers import all_series
from app.settings.sections import Config

Values = dict[str, float]  # results by their names in the session

LOG = logging.getLogger(__name__)
# of an input to both sides, in standard uncertainties: a result that is best with the right input
# grows, or falls, to both, which is no slope. The first pair that leaves a result tells its share,
# because one that lies at the edge of what can be concluded may leave none on one side
STEPS = ((1.0, -1.0), (0.5, -0.5))
MOST_POISSON = 0.5


@dataclass(frozen=True)
class Measured:
    """What an experiment is concluded from, in the world of one value of an input.

    Attributes
    ----------
    config : Config
    drive : list of Snapshot
    contact : ContactResult or None
    averaging : float
        Side of the box over which u_x is averaged, over that of the settings.
    seen : Readings
        What the run itself shows of zeros, cross terms and drift: as uncertain as it is large.
    pull : Pull or None
        Of a fixed pattern, which the displacements are corrected for.
    forces : DriveForces or None
        Of every sample of the drive; None where only those of the frames are known.
    """

    config: Config
    drive: list[Snapshot]
    contact: ContactResult | None
    averaging: float = 1.0
    seen: Readings = NOTHING_SEEN
    pull: Pull | None = None
    forces: DriveForces | None = None

    def given(
        self,
        *,
        length: float = 1.0,
        normal: float = 1.0,
        shear: float = 1.0,
        lens: float = 1.0,
        creep: float = 0.0,
        distortion: float = 0.0,
        added: tuple[float, float] = (0.0, 0.0),
        coupled: tuple[float, float] = (0.0, 0.0),
        rising: tuple[float, float] = (0.0, 0.0),
        later: float = 0.0,
    ) -> Measured:
        """With lengths in the picture, forces and the compliance of the lens holder changed by
        factors, a creep (m/s) of the image taken off, another distortion of the camera's lens, and
        newtons, shares of the other force and newtons per second of the drive added to P and Q, and
        a drive that began later (s).
        """
        camera = self.config.camera
        corner = math.hypot(*camera.shape) / 2 * camera.pixel
        bent, rest_s = distortion / corner**2, self.seen.rest_s

        def misread(time_s: Any, P: Any, Q: Any) -> tuple[Any, Any]:
            more, cross, rate = added, coupled, rising
            return (
                (P + more[0] + cross[0] * Q + rate[0] * time_s) * normal,
                (Q + more[1] + cross[1] * P + rate[1] * time_s) * shear,
            )

        def of(s: Snapshot) -> Snapshot:
            # the lens holder follows the change of Q since the reference, not what is misread
            now, time_s = s.conditions, s.conditions.time_s - later
            P, Q = misread(now.time_s, now.normal_force_n, now.shear_force_n)
            now = replace(now, normal_force_n=P, shear_force_n=Q, time_s=time_s)
            crept = creep * (rest_s + time_s) if creep else 0.0
            return _snapshot(s, now, length, lens=shear * lens, crept=crept, distortion=bent)

        contact = self.contact
        if contact is not None:
            a, sd = contact.apparent_radius_m, contact.apparent_radius_sd_m
            contact = replace(
                contact, apparent_radius_m=a * length, apparent_radius_sd_m=sd * length
            )
        forces = self.forces
        if forces is not None:
            P, Q = misread(forces.time_s, forces.normal_n, forces.shear_n)
            forces = DriveForces(forces.time_s - later, Q, P)
        return replace(self, drive=[*map(of, self.drive)], contact=contact, forces=forces)

    def delayed(self, delay: float) -> Measured:
        """With the forces that are read by that much (s) later, and the lens where they have moved
        it: means over samples, free of hum; where these are not known, what lies between frames,
        and at the end what is read with the last one.
        """
        time_s, P, Q = all_series(self.drive, "time_s", "normal_force_n", "shear_force_n")
        known = np.isfinite(time_s + P + Q)
        if not known.any():
            return self
        at = np.where(known, time_s + delay, math.nan)
        normal, shear = (np.interp(at, time_s[known], force[known]) for force in (P, Q))
        later, forces = np.stack([normal, shear, shear - Q]), self.forces
        if forces is not None:
            exposure_s = self.config.exposure_samples / self.config.forces.sample_rate
            (Q_now, _), (Q_then, P_then) = (
                forces_around(forces, t, exposure_s) for t in (time_s, at)
            )
            read = np.stack([P_then, Q_then, Q_then - Q_now])
            later = np.where(np.isfinite(read).all(axis=0), read, later)
            forces = forces._replace(time_s=forces.time_s - delay)
        compliance = self.config.sample.lens_compliance

        def of(s: Snapshot, normal: float, shear: float, further: float) -> Snapshot:
            # a stiff holder needs no force
            moved = compliance * further if compliance else 0.0
            now = replace(s.conditions, normal_force_n=normal, shear_force_n=shear)
            return _snapshot(s, now, lens_m=moved)

        return replace(self, drive=[*map(of, self.drive, *later.tolist())], forces=forces)

    @property
    def relaxation(self) -> Relaxation:
        """Of the block, by the settings."""
        return Relaxation(self.config.sample.relaxation, self.config.sample.relaxation_time)

    def without_relaxation(self) -> Measured:
        """With what an elastic block of the relaxed modulus would show: the integral of its
        traction, and the motion of its centre. Frames without a traction do not tell the latter.
        """
        if not (self.config.sample.relaxation and any(s.traction for s in self.drive)):
            return self
        block = RelaxationCorrection(self.relaxation)

        def of(s: Snapshot) -> Snapshot:
            motion, traction = s.motion, s.traction
            if motion is None:
                return s
            both = math.nan, math.nan
            if traction is not None:
                both = traction.stress_force_n, traction.block_m - motion.centre_ux_m
            force, bent = block.at(s.conditions.time_s, both) if all(map(isfinite, both)) else both
            if traction is None:
                return replace(s, motion=replace(motion, centre_ux_m=math.nan))
            return replace(
                s,
                motion=replace(motion, centre_ux_m=float(traction.block_m - bent)),
                traction=replace(traction, stress_force_n=float(force)),
            )

        return replace(self, drive=[*map(of, self.drive)])

    def pulled(self, share: float) -> Measured:
        """With that share more of the pull of a fixed pattern undone."""
        pull, pixel = self.pull, self.config.camera.pixel
        assert pull is not None

        def more(u: Any, lens: float) -> Any:
            seen = (u + lens) / pixel
            return u + share * pixel * np.sign(seen) * pull.missing(seen)

        def of(s: Snapshot) -> Snapshot:
            motion, rings = s.motion, s.rings
            if motion is None:
                return s
            lens = motion.lens_m
            moved = replace(motion, centre_ux_m=float(more(motion.centre_ux_m, lens)))
            return replace(
                s, motion=moved, rings=rings and replace(rings, ux_m=more(rings.ux_m, lens))
            )

        return replace(self, drive=[of(s) for s in self.drive])

    def stated(self, table: str, **options: float) -> Measured:
        """With other settings."""
        section = replace(getattr(self.config, table), **options)
        return replace(self, config=replace(self.config, **{table: section}))


def _snapshot(
    s: Snapshot,
    now: Conditions,
    length: float = 1.0,
    *,
    lens: float = 1.0,
    lens_m: float = 0.0,
    crept: float = 0.0,
    distortion: float = 0.0,
) -> Snapshot:
    # `Measured.given` says what is changed; `lens_m` is what the lens has moved beside
    motion, rings = s.motion, s.rings
    was = motion.lens_m if motion else 0.0
    here = was * lens + lens_m

    def moved(u: Any, at: Any = 0.0) -> Any:
        # what is seen along x at the radius `at`, on average over the azimuth
        return (u + was) * (length + 2 * distortion * at**2) - here - crept

    return replace(
        s,
        conditions=now,
        motion=motion
        and FrameMotion(
            here, moved(motion.centre_ux_m), motion.centre_ux_sd_m * length, motion.drive_angle_rad
        ),
        rings=rings
        and RingProfile(
            rings.radius_m * (length + distortion * rings.radius_m**2),
            moved(rings.ux_m, rings.radius_m),
            rings.sd_m * length,
        ),
        traction=s.traction and replace(s.traction, block_m=moved(s.traction.block_m)),
    )


def _changes(
    measured: Measured, step: float = 1.0
) -> Iterator[tuple[str, float, Callable[[], Measured]]]:
    """Each input that has an uncertainty, by how many of that it is changed (`step`, or against
    it), and what is measured after that.
    """
    config = measured.config
    sample, known = config.sample, config.uncertainty
    steps = SimpleNamespace(**{name: step * value for name, value in asdict(known).items()})

    def scaled(table: str, name: str, share: float) -> Measured:
        return measured.stated(table, **{name: getattr(getattr(config, table), name) * (1 + share)})

    def with_pixel() -> Measured:
        return scaled("camera", "pixel", steps.pixel).given(length=1 + steps.pixel)

    def with_lens() -> Measured:
        share = steps.lens_compliance
        return scaled("sample", "lens_compliance", share).given(lens=1 + share)

    normal, shear = (
        step * math.hypot(share, known.sensitivity)
        for share in sensor_chain(config).relative_uncertainty()
    )
    # 0.5 is the most there is: the step goes down, and its sign with it
    nu = -steps.poisson if sample.poisson >= known.poisson else steps.poisson
    if not 0 <= sample.poisson + nu <= MOST_POISSON:
        nu = 0.0
    seen = measured.seen
    zero = [step * math.hypot(known.zero, one) for one in seen.zero]
    cross = [step * math.hypot(known.coupling, one) for one in seen.coupling]
    rates = [step * one for one in seen.zero_drift]
    drift = step * math.hypot(known.drift, seen.drift)
    delay = step * math.hypot(known.delay, seen.delay)
    pulled = step * (measured.pull.relative_sd if measured.pull else 0.0)
    R, E, h, H = steps.lens_radius, steps.young_modulus, steps.roughness, steps.thickness
    g = steps.relaxation if sample.relaxation else 0.0
    changes: list[tuple[str, float, Callable[[], Measured]]] = [
        ("pixel size", steps.pixel, with_pixel),
        ("normal force", normal, lambda: measured.given(normal=1 + normal)),
        ("shear force", shear, lambda: measured.given(shear=1 + shear)),
        ("lens radius", R, lambda: scaled("sample", "lens_radius", R)),
        ("Young's modulus", E, lambda: scaled("sample", "young_modulus", E)),
        ("Poisson's ratio", nu, lambda: measured.stated("sample", poisson=sample.poisson + nu)),
        ("roughness", h, lambda: scaled("sample", "roughness", h)),
        ("thickness", H if sample.thickness else 0.0, lambda: scaled("sample", "thickness", H)),
        ("relaxation", g, lambda: scaled("sample", "relaxation", g)),
        ("relaxation time", g, lambda: scaled("sample", "relaxation_time", g)),
        ("lens compliance", steps.lens_compliance if sample.lens_compliance else 0.0, with_lens),
        (
            "averaging box",
            steps.averaging,
            lambda: replace(measured, averaging=1 + steps.averaging),
        ),
        ("drift", drift, lambda: measured.given(creep=drift)),
        ("distortion", steps.distortion, lambda: measured.given(distortion=steps.distortion)),
        # settings with a higher zero or cross term take more off what is read
        ("zero of P", zero[0], lambda: measured.given(added=(-zero[0], 0))),
        ("zero of Q", zero[1], lambda: measured.given(added=(0, -zero[1]))),
        ("drift of P", rates[0], lambda: measured.given(rising=(-rates[0], 0))),
        ("drift of Q", rates[1], lambda: measured.given(rising=(0, -rates[1]))),
        ("fixed pattern", pulled, lambda: measured.pulled(pulled)),
        ("Q in P", cross[0], lambda: measured.given(coupled=(-cross[0], 0))),
        ("P in Q", cross[1], lambda: measured.given(coupled=(0, -cross[1]))),
        ("delay of the forces", delay, lambda: measured.delayed(delay)),
        ("start of the drive", steps.start, lambda: measured.given(later=steps.start)),
    ]
    yield from ((name, math.copysign(step, sd), change) for name, sd, change in changes if sd)


class Budget(NamedTuple):
    """Which input costs how much.

    `shares` has the relative change of each result by one standard uncertainty of each input, shape
    (inputs, results). `notes` says of which results it is not known, and which input takes them
    away.
    """

    inputs: tuple[str, ...] = ()
    results: tuple[str, ...] = ()
    shares: tuple[tuple[float, ...], ...] = ()
    notes: tuple[str, ...] = ()

    def relative_sd(self, result: str) -> float:
        """Of a result, by all inputs together; NaN where it is not known."""
        if result not in self.results:
            return math.nan
        column = self.results.index(result)
        return math.hypot(*(row[column] for row in self.shares))


def budget(measured: Measured, conclude: Callable[[Measured], Values]) -> Budget:
    """Conclude an experiment again with each input changed.

    `conclude` gives the results by name, NaN where there is none; those that an input takes away,
    however it is changed, are left out and named.
    """
    was = {name: value for name, value in conclude(measured).items() if value and isfinite(value)}
    found: dict[str, dict[str, float]] = {name: {} for name, _, _ in _changes(measured)}
    for both in STEPS:
        sides: dict[str, dict[str, list[float]]] = {name: {} for name in found}
        for name, size, change in (one for step in both for one in _changes(measured, step)):
            if len(found[name]) == len(was):
                continue
            now = _tried(name, change, conclude)
            for result, value in was.items():
                if isfinite(now.get(result, math.nan)):
                    sides[name].setdefault(result, []).append((now[result] / value - 1) / size)
        for name, slopes in sides.items():
            for result, each in slopes.items():
                found[name].setdefault(result, sum(each) / len(each))
    lost: dict[str, list[str]] = {}  # results by the input that takes them away
    for name, shares in found.items():
        if missing := [result for result in was if result not in shares]:
            lost.setdefault(name, missing)
    gone = {result for missing in lost.values() for result in missing}
    results = tuple(result for result in was if result not in gone)
    return Budget(
        tuple(found),
        results,
        tuple(tuple(shares[result] for result in results) for shares in found.values()),
        tuple(_without(name, missing) for name, missing in lost.items()),
    )


def _tried(
    name: str, change: Callable[[], Measured], conclude: Callable[[Measured], Values]
) -> Values:
    try:
        return conclude(change())
    except Exception as error:
        LOG.debug("budget: %s", name, exc_info=error)
        return {}


def _without(name: str, results: list[str]) -> str:
    which = ", ".join(result.replace("_", " ") for result in results)
    return (
        f"budget: the uncertainty by inputs of {which} is not known, because there is no such"
        f" result with another {name}"
    )
