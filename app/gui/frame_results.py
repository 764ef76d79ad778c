"""What is drawn of one frame: its image, its fields, and the profiles about the contact's centre.

Lengths on the image are pixels (x, y), with (0, 0) the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.arrays import U8
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.saturation import end_of_scale
from app.evaluation.setup import hertz_radius_m
from app.gui.cells import number, short, typeset
from app.gui.scales import Range, is_one_signed, robust_range
from app.gui.source import Point, Rect, Setup, centres_px
from app.records.lens_motion import drive_of, lens_xy_m
from app.records.quantities import decimals_for, measured_text
from app.records.record_types import F32, F64, ContactResult, Snapshot
from app.runs.run_source import Image
from app.settings.sections import Config

LARGEST_DISPLAY_PX = 1000  # of wider images every second, third ... pixel is shown
COARSE = ", fine detail not converged"  # of the live field: a few iterations for each frame


@dataclass(frozen=True, eq=False)
class ShownImage:
    """An image as displayed: its pixels and its place.

    Attributes
    ----------
    pixels : ndarray
        Grey levels of the screen; 255 says that one of the pixels in its place is saturated.
    """

    pixels: U8
    rect_px: Rect
    caption: str
    full: Image

    @property
    def levels(self) -> Image:
        """The camera's grey levels of the pixels that are displayed."""
        every = round(self.rect_px[2] / self.pixels.shape[1])
        return self.full[::every, ::every]

    @cached_property
    def stretched(self) -> tuple[int, int]:
        """Grey levels that are black and white where the image is stretched: 0.5 and 99.8 %."""
        low, high = np.percentile(self.pixels[::4, ::4], (0.5, 99.8))
        return int(low), int(max(high, low + 1))


def shown_image(full: Image, full_scale: int = 0) -> ShownImage:
    """`full` thinned for the screen; its grey levels end at `full_scale`, 0: with its type."""
    full_scale = full_scale or int(np.iinfo(full.dtype).max)
    every = max(1, math.ceil(full.shape[1] / LARGEST_DISPLAY_PX))
    thin = full[::every, ::every]
    pixels = np.array(thin if full_scale == 255 else thin * (255.0 / full_scale), np.uint8)
    rows, cols = pixels.shape
    rect = (-every / 2, -every / 2, float(every * cols), float(every * rows))
    caption = "display 1:1" if every == 1 else f"display 1:{every}, data full"
    end = end_of_scale(full, full_scale)
    if full.max() >= end:
        rows = np.flatnonzero(full.max(axis=1) >= end)
        row, column = np.divmod(np.flatnonzero(full[rows] >= end), full.shape[1])
        pixels[rows[row] // every, column // every] = 255
        percent = 100 * len(row) / full.size
        caption += f", {short(percent, 2) if percent >= 0.01 else '< 0.01'} % saturated"
    return ShownImage(pixels, rect, caption, full)


# ------------------------------------------------------------------ fields


@dataclass(frozen=True, slots=True)
class FieldKind:
    """A field that can be shown: how it is called, and of which sign it is.

    Attributes
    ----------
    key : str
        How a file calls it, with its unit.
    sign : str
        "one": never below zero; "both": about zero; "drive": as the values are.
    """

    key: str
    symbol: str
    unit: str
    hint: str
    sign: str


FIELDS = (
    FieldKind(
        "ux_um",
        "uₓ",
        "µm",
        "Displacement along the rows of the picture, without the lens' motion",
        "drive",
    ),
    FieldKind(
        "uy_um", "uᵧ", "µm", "Displacement down the picture, without the lens' motion", "both"
    ),
    FieldKind("u_um", "|u|", "µm", "Magnitude of the displacement", "one"),
    FieldKind("sigma_kPa", "σₓz", "kPa", "Shear traction σ_xz, along the drive", "drive"),
    FieldKind(
        "slip_um",
        "slip",
        "µm",
        "How far the block's surface has moved over the lens inside the contact, along the drive",
        "drive",
    ),
    FieldKind(
        "zncc",
        "correlation",
        "",
        "Correlation (ZNCC) of each box with the reference, 0 to 1: 1 is perfect",
        "one",
    ),
    FieldKind("ux_sd_um", "noise of uₓ", "µm", "Standard uncertainty of uₓ of each box", "one"),
)
KINDS = {kind.key: kind for kind in FIELDS}


@dataclass(frozen=True, eq=False)
class FieldImage:
    """A field over the image.

    `offset` was subtracted from all values: their median, 0 where they are shown as they are.
    """

    kind: FieldKind
    values: F32
    caption: str
    offset: float = 0.0

    @cached_property
    def extent(self) -> Range:
        """What nearly all of its values lie in."""
        return robust_range(self.values)

    @property
    def is_diverging(self) -> bool:
        """Whether the colours go both ways from zero."""
        if self.kind.sign == "drive" and not self.offset:
            return not is_one_signed(*self.extent)
        return self.kind.sign == "both" or bool(self.offset)

    @property
    def label(self) -> str:
        """Symbol and unit, for the colour bar."""
        symbol = self.kind.symbol
        if self.offset:
            sign = "−" if self.offset > 0 else "+"
            size = abs(self.offset)
            symbol = f"{symbol} {sign} {number(size, max(1, decimals_for(size, 1)))}"
        return f"{symbol} ({self.kind.unit})" if self.kind.unit else symbol

    def about_median(self) -> FieldImage:
        """With its median taken off; itself where there are none or it has no sign."""
        offset = float(np.nanmedian(self.values)) if np.isfinite(self.extent[0]) else 0.0
        if self.kind.sign == "one" or not offset:
            return self
        return FieldImage(self.kind, self.values - np.float32(offset), self.caption, offset)


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """Azimuthal means about the contact's centre with their standard uncertainties, and those of
    Cattaneo and Mindlin's contact for the measured stick radius.
    """

    radius_mm: F64
    values: F64
    sd: F64
    model: F64


@dataclass(frozen=True, eq=False)
class FrameResults:
    """What is drawn of a frame that has a displacement field.

    Fields and profiles are computed when they are shown.
    """

    frame: int
    snapshot: Snapshot
    setup: Setup
    circles: Circles

    @cached_property
    def _made(self) -> dict[str, FieldImage]:
        return {}

    @property
    def keys(self) -> tuple[str, ...]:
        """The fields that there are."""
        has_stress = self.snapshot.stress_field_pa is not None
        return tuple(kind.key for kind in FIELDS if kind.key != "sigma_kPa" or has_stress)

    def prepare(self, before: FrameResults) -> None:
        """Compute the fields that were shown of the frame before."""
        for key in tuple(before._made):  # another thread may ask for one now
            if key in self.keys:
                _ = self.field(key).extent

    def field(self, key: str) -> FieldImage:
        """The field of that name."""
        if key not in self._made:
            time_s, kind = self.snapshot.conditions.time_s, KINDS[key]
            when = f", t = {time_s:.2f} s" if math.isfinite(time_s) else ""
            doubt = COARSE if key == "sigma_kPa" else ""
            caption = f"{kind.symbol} of frame {self.frame}{when}{doubt}"
            self._made[key] = FieldImage(kind, self._values(key), caption)
        return self._made[key]

    def _values(self, key: str) -> F32:
        field, stress = self.snapshot.field, self.snapshot.stress_field_pa
        assert field is not None
        ux_um, uy_um = over_lens_um(self.snapshot, self.setup)
        match key:
            case "ux_um":
                return ux_um
            case "uy_um":
                return uy_um
            case "u_um":
                size: F32 = np.hypot(ux_um, uy_um)
                return size
            case "slip_um":
                assert self.snapshot.motion is not None
                along = drive_of(self.snapshot.motion).along(ux_um, uy_um)
                return self._in_contact(along.astype(np.float32))
            case "zncc":
                return field.zncc
            case "ux_sd_um":
                return field.ux_std_px * np.float32(self.setup.pixel_um)
        assert stress is not None
        return stress * np.float32(1e-3)

    def _in_contact(self, values: F32) -> F32:
        """`values` inside the apparent contact, else NaN: u_x is the slip there, for the lens does
        not deform.
        """
        circles = self.circles
        radius = circles.apparent_px if math.isfinite(circles.apparent_px) else circles.hertz_px
        if circles.centre_px is None:
            return np.full_like(values, np.nan)
        centres = centres_px(self.setup.grid_rect_px, values)
        x, y = (at - middle for at, middle in zip(centres, circles.centre_px, strict=True))
        return np.where(np.hypot(x, y[:, None]) <= radius, values, np.float32(np.nan))

    # ------------------------------------------------------------------ profiles

    @cached_property
    def displacement_um(self) -> Profile | None:
        """u_x at each radius, where it was computed."""
        rings, motion, config = self.snapshot.rings, self.snapshot.motion, self.setup.config
        if rings is None or motion is None:
            return None
        model = np.full(rings.radius_m.shape, math.nan)
        if (contact := self._sheared_contact) is not None:
            radii = np.concatenate([[0.0], rings.radius_m])
            young, poisson = config.sample.young_modulus, config.sample.poisson
            moved, _ = cattaneo_mindlin.radial_displacement(radii, *contact, young, poisson)
            model = motion.centre_ux_m + moved[0] - moved[1:]
        return Profile(rings.radius_m * 1e3, rings.ux_m * 1e6, rings.sd_m * 1e6, model * 1e6)

    @cached_property
    def traction_kpa(self) -> Profile | None:
        """The shear traction at each radius, where it was computed."""
        stress = self.snapshot.stress
        if stress is None:
            return None
        model = np.full(stress.radius_m.shape, math.nan)
        if (contact := self._sheared_contact) is not None:
            model = cattaneo_mindlin.traction(stress.radius_m, *contact)
        return Profile(
            stress.radius_m * 1e3, stress.stress_pa * 1e-3, stress.sd_pa * 1e-3, model * 1e-3
        )

    @property
    def _sheared_contact(self) -> tuple[float, float, float, float] | None:
        """Q, mu, P and a of Cattaneo and Mindlin's contact with the measured c; None: no c."""
        P, config = self.snapshot.conditions.normal_force_n, self.setup.config
        c, mu = self.stick_mm * 1e-3, full_slip(self.snapshot, config)
        if not (math.isfinite(c) and mu > 0):
            return None
        a = hertz_radius_m(config, P)
        return mu * P * (1 - min(1.0, c / a) ** 3), mu, P, a

    @property
    def stick_mm(self) -> float:
        """The radius c of the fitted profile; NaN: not known."""
        stick = self.snapshot.stick
        return stick.stick_radius_m * 1e3 if stick else math.nan

    @property
    def peak_mm(self) -> float:
        """The radius c by the largest traction; NaN: not known."""
        traction = self.snapshot.traction
        return traction.peak_radius_m * 1e3 if traction else math.nan

    @property
    def balance(self) -> str:
        """The force that the traction adds up to, beside Q."""
        traction = self.snapshot.traction
        if traction is None:
            return ""
        force = typeset(measured_text(traction.stress_force_n, traction.stress_force_sd_n))
        shear = number(self.snapshot.conditions.shear_force_n, 3)
        return f"∫σ dA = {force} N, Q = {shear} N"


def over_lens_um(snapshot: Snapshot, setup: Setup) -> tuple[F32, F32]:
    """u_x and u_y without the motion of the lens (um), of a snapshot that has a field."""
    field, motion, um = snapshot.field, snapshot.motion, np.float32(setup.pixel_um)
    assert field is not None
    assert motion is not None
    x_m, y_m = lens_xy_m(motion)
    return field.ux_px * um - np.float32(x_m * 1e6), field.uy_px * um - np.float32(y_m * 1e6)


# ------------------------------------------------------------------ one frame


def frame_results(snapshot: Snapshot, setup: Setup, around: Circles) -> FrameResults | None:
    """What is drawn of `snapshot`; None where it has no displacement field."""
    if snapshot.field is None or snapshot.motion is None:
        return None
    return FrameResults(snapshot.frame, snapshot, setup, around)


def full_slip(snapshot: Snapshot, config: Config) -> float:
    """The friction coefficient of a profile that gave c; NaN where none did."""
    P, stick = snapshot.conditions.normal_force_n, snapshot.stick
    if stick is None or not P > 0:
        return math.nan
    return stick.full_slip_pa / hertz.peak_pressure(P, hertz_radius_m(config, P))


@dataclass(frozen=True, slots=True, eq=False)
class Circles:
    """Centre of the contact, and the radii a (apparent), a_H (after Hertz, for the load) and c
    (stick) on the image; NaN: not known.
    """

    centre_px: Point | None
    apparent_px: float
    stick_px: float
    hertz_px: float = math.nan


def circles(
    contact: ContactResult | None, stick_m: float, normal_n: float, setup: Setup
) -> Circles:
    """The circles of the contact, of which some may not be known yet."""
    centre = contact.centre_px if contact and all(map(math.isfinite, contact.centre_px)) else None
    apparent_m = contact.apparent_radius_m if contact else math.nan
    radii_m = apparent_m, stick_m, hertz_radius_m(setup.config, normal_n)
    return Circles(centre, *(radius * 1e6 / setup.pixel_um for radius in radii_m))
