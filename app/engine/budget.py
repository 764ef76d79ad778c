"""What the uncertainties of the operator's inputs do to each result: the experiment is concluded
again with one of them changed by its standard uncertainty at a time.

References
----------
JCGM 100:2008 (GUM), section 5.1: uncertainty of a result from those of its inputs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from app.engine.setup import sensor_chain
from app.records import ContactResult, Motion, RingProfile, Snapshot
from app.settings import Config

Values = dict[str, float]  # results by their names in the session


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
    """

    config: Config
    drive: list[Snapshot]
    contact: ContactResult | None
    averaging: float = 1.0

    def given(
        self,
        *,
        length: float = 1.0,
        normal: float = 1.0,
        shear: float = 1.0,
        lens: float = 1.0,
        creep: float = 0.0,
        distortion: float = 0.0,
    ) -> Measured:
        """With lengths in the picture, forces and the compliance of the lens holder changed by
        factors, a creep (m/s) of the image taken off, and another distortion of the camera's lens.
        """
        camera = self.config.camera
        corner = math.hypot(*camera.shape) / 2 * camera.pixel
        drive = [
            _snapshot(s, length, normal, shear, lens, creep, distortion / corner**2)
            for s in self.drive
        ]
        contact = self.contact
        if contact is not None:
            a, sd = contact.apparent_radius_m, contact.apparent_radius_sd_m
            contact = replace(
                contact, apparent_radius_m=a * length, apparent_radius_sd_m=sd * length
            )
        return replace(self, drive=drive, contact=contact)

    def stated(self, table: str, **options: float) -> Measured:
        """With other settings."""
        section = replace(getattr(self.config, table), **options)
        return replace(self, config=replace(self.config, **{table: section}))


def _snapshot(
    s: Snapshot,
    length: float,
    normal: float,
    shear: float,
    lens: float,
    creep: float,
    distortion: float,
) -> Snapshot:
    now, motion, rings = s.conditions, s.motion, s.rings
    was = motion.lens_m if motion else 0.0
    here = was * shear * lens
    crept = creep * now.time_s if creep else 0.0

    def moved(u: Any, at: Any = 0.0) -> Any:
        # what is seen along x at the radius `at`, on average over the azimuth
        return (u + was) * (length + 2 * distortion * at**2) - here - crept

    return replace(
        s,
        conditions=replace(
            now,
            normal_force_n=now.normal_force_n * normal,
            shear_force_n=now.shear_force_n * shear,
        ),
        motion=motion
        and Motion(
            here, moved(motion.centre_ux_m), motion.centre_ux_sd_m * length, motion.drive_angle_rad
        ),
        rings=rings
        and RingProfile(
            rings.radius_m * (length + distortion * rings.radius_m**2),
            moved(rings.ux_m, rings.radius_m),
            rings.sd_m * length,
        ),
    )


def _changes(measured: Measured) -> Iterator[tuple[str, float, Callable[[], Measured]]]:
    """Each input that has an uncertainty, the sign of a step by that, and what is measured after
    it.
    """
    config, told = measured.config, measured.config.uncertainty
    sample = config.sample

    def scaled(table: str, name: str, share: float) -> Measured:
        return measured.stated(table, **{name: getattr(getattr(config, table), name) * (1 + share)})

    def with_pixel() -> Measured:
        return scaled("camera", "pixel", told.pixel).given(length=1 + told.pixel)

    def with_lens() -> Measured:
        share = told.lens_compliance
        return scaled("sample", "lens_compliance", share).given(lens=1 + share)

    normal, shear = (
        math.hypot(share, told.sensitivity) for share in sensor_chain(config).relative_uncertainty()
    )
    # 0.5 is the most there is: the step goes down, and its sign with it
    nu = -told.poisson if sample.poisson >= told.poisson else told.poisson
    R, E, h, H = told.lens_radius, told.young_modulus, told.roughness, told.thickness
    changes: list[tuple[str, float, Callable[[], Measured]]] = [
        ("pixel size", told.pixel, with_pixel),
        ("normal force", normal, lambda: measured.given(normal=1 + normal)),
        ("shear force", shear, lambda: measured.given(shear=1 + shear)),
        ("lens radius", R, lambda: scaled("sample", "lens_radius", R)),
        ("Young's modulus", E, lambda: scaled("sample", "young_modulus", E)),
        ("Poisson's ratio", nu, lambda: measured.stated("sample", poisson=sample.poisson + nu)),
        ("roughness", h, lambda: scaled("sample", "roughness", h)),
        ("thickness", H if sample.thickness else 0.0, lambda: scaled("sample", "thickness", H)),
        ("lens compliance", told.lens_compliance if sample.lens_compliance else 0.0, with_lens),
        ("averaging box", told.averaging, lambda: replace(measured, averaging=1 + told.averaging)),
        ("drift", told.drift, lambda: measured.given(creep=told.drift)),
        ("distortion", told.distortion, lambda: measured.given(distortion=told.distortion)),
    ]
    yield from ((name, math.copysign(1.0, sd), change) for name, sd, change in changes if sd)


class Budget(NamedTuple):
    """Which input costs how much.

    `shares` has the relative change of each result by one standard uncertainty of each input, shape
    (inputs, results).
    """

    inputs: tuple[str, ...] = ()
    results: tuple[str, ...] = ()
    shares: tuple[tuple[float, ...], ...] = ()

    def relative_sd(self, result: str) -> float:
        """Of a result, by all inputs together; NaN where it is not known."""
        if result not in self.results:
            return math.nan
        column = self.results.index(result)
        return math.hypot(*(row[column] for row in self.shares))


def budget(measured: Measured, conclude: Callable[[Measured], Values]) -> Budget:
    """Conclude an experiment again with each input changed.

    `conclude` gives the results by name, NaN where there is none; those that an input takes away
    are left out.
    """
    was = conclude(measured)
    changed = [(name, sign, conclude(change())) for name, sign, change in _changes(measured)]
    every = [was, *(now for _, _, now in changed)]
    results = tuple(
        result
        for result, value in was.items()
        if value and all(math.isfinite(one.get(result, math.nan)) for one in every)
    )
    shares = tuple(
        tuple(sign * (now[result] / was[result] - 1) for result in results)
        for _, sign, now in changed
    )
    return Budget(tuple(name for name, _, _ in changed), results, shares)
