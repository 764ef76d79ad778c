"""What is drawn of one frame: its image, its fields, and the traction about the contact's centre.

Lengths on the image are pixels (x, y), with (0, 0) the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.mechanics import cattaneo_mindlin, hertz
from app.gui.cells import number, typeset
from app.gui.source import Image, Rect, Setup
from app.records import F32, F64, ContactResult, Snapshot
from app.report.quantities import measured_text
from app.settings import Config

LARGEST_DISPLAY_PX = 1000  # of wider images every second, third ... pixel is shown
LIMITS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # times a power of ten: ends of a scale


@dataclass(frozen=True, slots=True, eq=False)
class ShownImage:
    """An image as displayed: its pixels and place, the grey levels of black and white."""

    pixels: Image
    rect_px: Rect
    levels: tuple[float, float]
    caption: str
    full: Image


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """A field over the image; the colour scale runs from -limit to +limit."""

    values: F32
    limit: float
    symbol: str
    unit: str
    caption: str


@dataclass(frozen=True, slots=True, eq=False)
class TractionProfile:
    """Shear traction about the contact's centre with its standard uncertainty.

    `model_kpa` is the traction of Cattaneo and Mindlin for the measured stick radius.
    """

    radius_mm: F64
    stress_kpa: F64
    sd_kpa: F64
    model_kpa: F64
    stick_mm: float
    peak_mm: float
    caption: str


@dataclass(frozen=True, slots=True, eq=False)
class FrameResults:
    """What is drawn of a frame that has a displacement field; None: not computed."""

    frame: int
    displacement: Overlay
    traction: Overlay | None
    profile: TractionProfile | None


@dataclass(frozen=True, slots=True, eq=False)
class Circles:
    """Centre of the contact, apparent radius a and stick radius c on the image; NaN: not known."""

    centre_px: tuple[float, float] | None
    apparent_px: float
    stick_px: float
    apparent_mm: float


def shown_image(full: Image) -> ShownImage:
    """`full` thinned for the screen; black and white are 0.5 and 99.8 % of its grey levels."""
    every = max(1, math.ceil(full.shape[1] / LARGEST_DISPLAY_PX))
    pixels = full[::every, ::every].copy()
    rows, cols = pixels.shape
    rect = (-every / 2, -every / 2, float(every * cols), float(every * rows))
    low, high = np.percentile(pixels[::4, ::4].astype(np.float32), (0.5, 99.8))
    caption = "display 1:1" if every == 1 else f"display 1:{every}, data full"
    return ShownImage(pixels, rect, (float(low), float(max(high, low + 1))), caption, full)


COARSE = ", fine detail not converged"  # of the live field: a few iterations for each frame


def frame_results(snapshot: Snapshot, setup: Setup) -> FrameResults | None:
    """What is drawn of `snapshot`; None where it has no displacement field."""
    field, motion, kpa = snapshot.field, snapshot.motion, None
    if field is None or motion is None:
        return None
    ux_um = field.ux_px * np.float32(setup.pixel_um) - np.float32(motion.lens_m * 1e6)
    if snapshot.stress_field_pa is not None:
        kpa = _overlay(snapshot.stress_field_pa * np.float32(1e-3), "σₓ", "kPa", snapshot, COARSE)
    return FrameResults(
        snapshot.frame,
        _overlay(ux_um, "uₓ", "µm", snapshot),
        kpa,
        traction_profile(snapshot, setup.config),
    )


def _overlay(values: F32, symbol: str, unit: str, snapshot: Snapshot, doubt: str = "") -> Overlay:
    time_s = snapshot.conditions.time_s
    when = f", t = {time_s:.2f} s" if math.isfinite(time_s) else ""
    caption = f"{symbol} of frame {snapshot.frame}{when}{doubt}"
    return Overlay(values, symmetric_limit(values), symbol, unit, caption)


def symmetric_limit(values: F32) -> float:
    """The least round number (`LIMITS` times a power of ten) above 99 % of |values|; at least 1."""
    finite = np.abs(values[np.isfinite(values)])
    top = max(1.0, float(np.percentile(finite, 99)) if finite.size else 0.0)
    decade = 10.0 ** math.floor(math.log10(top))
    return next(step * decade for step in LIMITS if top <= step * decade)


def traction_profile(snapshot: Snapshot, config: Config) -> TractionProfile | None:
    """The profile of the shear traction, beside that of Cattaneo and Mindlin for the same c.

    None where the displacement was not inverted.
    """
    profile, traction, stick = snapshot.stress, snapshot.traction, snapshot.stick
    if profile is None or traction is None:
        return None
    radius_m, P = profile.radius_m, snapshot.conditions.normal_force_n
    c = stick.stick_radius_m if stick else math.nan
    model = np.full(radius_m.shape, math.nan)
    if P > 0 and stick:
        sample = config.sample
        a = hertz.contact_radius(P, sample.young_modulus, sample.poisson, sample.lens_radius)
        mu = stick.full_slip_pa / hertz.peak_pressure(P, a)
        Q = mu * P * (1 - min(1.0, c / a) ** 3)
        model = cattaneo_mindlin.traction(radius_m, Q, mu, P, a)
    force = typeset(measured_text(traction.stress_force_n, traction.stress_force_sd_n))
    return TractionProfile(
        radius_m * 1e3,
        profile.stress_pa * 1e-3,
        profile.sd_pa * 1e-3,
        model * 1e-3,
        c * 1e3,
        traction.peak_radius_m * 1e3,
        f"∫σ dA = {force} N, Q = {number(snapshot.conditions.shear_force_n, 3)} N",
    )


def circles(contact: ContactResult | None, stick_m: float, setup: Setup) -> Circles:
    """The circles of the contact, of which some may not be known yet."""
    centre = contact.centre_px if contact and all(map(math.isfinite, contact.centre_px)) else None
    apparent_um = contact.apparent_radius_m * 1e6 if contact else math.nan
    return Circles(
        centre,
        apparent_um / setup.pixel_um,
        stick_m * 1e6 / setup.pixel_um,
        apparent_um * 1e-3,
    )
