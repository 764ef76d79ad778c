"""What the window shows, as plain values: everything is decided here, without Qt; the views only
draw.

`read` takes the newest from a source, `resolve` turns it into a frozen `ViewState`. Lengths on the
image are pixels (x, y), with (0, 0) the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mechanics import cattaneo_mindlin, hertz
from app.config import exposure_samples
from app.gui.cells import (
    disk_cell,
    health_cells,
    operator_sentence,
    queue_cell,
    readouts,
    result_cells,
    setting_cells,
    state_tone,
)
from app.gui.numbers import Cell, Tone, measured, number
from app.gui.source import Image, PlaybackSource, RunSource
from app.records import (
    F32,
    F64,
    ContactResult,
    Health,
    Outcome,
    Phase,
    Snapshot,
    Summary,
    series_of,
)
from app.sections import Config

Rect = tuple[float, float, float, float]  # left, top, width, height in px
LARGEST_DISPLAY_PX = 1000  # wider images are shown one pixel in two, three ...
FORCE_POINTS = 2000  # points of a force strip; more than the screen has columns
MOST_UNCERTAIN = 0.2  # of the radius of the largest traction: beyond, it is not drawn
ENDED = ("done", "failed")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What does not change during a run."""

    title: str
    pixel_um: float
    field_rect_px: Rect
    sample_rate_hz: float
    config: Config


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The newest a source had to give."""

    health: Health
    image: Image | None
    snapshots: tuple[Snapshot, ...]
    contact: ContactResult | None
    forces: tuple[NDArray[Any], F64, F64]
    outcome: Outcome | None
    browsed: Snapshot | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The run so far, one point per analysed frame; points that could not be measured are left out
    of each curve.
    """

    seen: int
    travel_um: F64
    shear_n: F64
    stick_shear_n: F64
    stick_mm: F64
    stick_sd_mm: F64
    peak_shear_n: F64
    peak_mm: F64
    drive_start_s: float  # on the clock of the samples; NaN while unknown
    newest: Snapshot | None
    newest_field: Snapshot | None


@dataclass(frozen=True, slots=True, eq=False)
class ImageView:
    """The image as displayed: pixels, where they lie, grey levels of black and white, and what was
    left out.
    """

    pixels: Image
    rect_px: Rect
    levels: tuple[float, float]
    caption: str
    full: Image


@dataclass(frozen=True, slots=True, eq=False)
class FieldView:
    """A field over the image; the colour scale runs from -limit to +limit."""

    values: F32
    rect_px: Rect
    limit: float
    symbol: str
    unit: str
    caption: str
    frame: int


@dataclass(frozen=True, slots=True, eq=False)
class StressView:
    """Shear traction about the contact's centre, its band of one standard uncertainty, and Cattaneo
    and Mindlin's beside it.
    """

    radius_mm: F64
    stress_kpa: F64
    sd_kpa: F64
    model_kpa: F64
    stick_mm: float
    peak_mm: float
    caption: str


@dataclass(frozen=True, slots=True, eq=False)
class ForceView:
    """P and Q against time."""

    time_s: F64
    normal_n: F64
    shear_n: F64
    time_label: str


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """All that the window shows of a run at one instant."""

    state: str
    tone: Tone
    phase: str
    sentence: str
    progress: float
    health: tuple[Cell, ...]
    queue_fill: float
    queue: Cell
    disk: Cell
    image: ImageView | None
    field: FieldView | None
    stress_field: FieldView | None
    stress: StressView | None
    centre_px: tuple[float, float] | None
    apparent_px: float
    stick_px: float
    apparent_mm: float
    curves: Curves
    forces: ForceView
    readouts: tuple[Cell, ...]
    result: tuple[Cell, ...]
    notes: str
    summary: Summary | None
    outcome: Outcome | None

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self.outcome is not None or self.state in ENDED


def scene_of(source: RunSource) -> Scene:
    """What does not change during the run of `source`."""
    x, y = np.asarray(source.grid_x_px, float), np.asarray(source.grid_y_px, float)
    config = source.config
    step_x = float(x[1] - x[0]) if len(x) > 1 else float(config.dic.step)
    step_y = float(y[1] - y[0]) if len(y) > 1 else float(config.dic.step)
    rect = (
        (float(x[0]) - step_x / 2, float(y[0]) - step_y / 2, step_x * len(x), step_y * len(y))
        if len(x) and len(y)
        else (0.0,) * 4
    )
    return Scene(source.title, source.pixel_m * 1e6, rect, source.sample_rate_hz, config)


def read(source: RunSource, seen: int) -> Reading:
    """The newest of `source`; of the snapshots, those after the first `seen`."""
    outcome = source.outcome()  # first: what is read after it is then complete
    return Reading(
        source.health(),
        source.latest_image(),
        tuple(source.snapshots_since(seen)),
        source.contact(),
        source.force_history(FORCE_POINTS),
        outcome,
        source.browsed() if isinstance(source, PlaybackSource) else None,
    )


def no_curves() -> Curves:
    """Curves before the first frame."""
    empty = np.empty(0)
    return Curves(0, empty, empty, empty, empty, empty, empty, empty, math.nan, None, None)


def extended(curves: Curves, snapshots: tuple[Snapshot, ...], scene: Scene) -> Curves:
    """`curves` with the points of newer `snapshots`; the same object if there are none."""
    if not snapshots:
        return curves
    loaded = [s for s in snapshots if s.conditions.phase not in (Phase.BACKGROUND, Phase.CONTACT)]
    travel, shear, stick, stick_sd, peak, peak_sd = (
        series_of(loaded, name)
        for name in (
            "travel_m",
            "shear_force_n",
            "stick_radius_m",
            "stick_radius_sd_m",
            "peak_radius_m",
            "peak_radius_sd_m",
        )
    )
    pulled = np.isfinite(travel) & np.isfinite(shear)
    stuck = np.isfinite(stick) & np.isfinite(shear)
    peaked = peak_sd < MOST_UNCERTAIN * peak
    fields = [s for s in snapshots if s.field is not None]
    newest = snapshots[-1]
    start = curves.drive_start_s
    if math.isfinite(newest.conditions.time_s):
        middle = newest.sample + exposure_samples(scene.config) / 2
        start = middle / scene.sample_rate_hz - newest.conditions.time_s
    return Curves(
        curves.seen + len(snapshots),
        np.append(curves.travel_um, travel[pulled] * 1e6),
        np.append(curves.shear_n, shear[pulled]),
        np.append(curves.stick_shear_n, shear[stuck]),
        np.append(curves.stick_mm, stick[stuck] * 1e3),
        np.append(curves.stick_sd_mm, np.nan_to_num(stick_sd[stuck] * 1e3)),
        np.append(curves.peak_shear_n, shear[peaked]),
        np.append(curves.peak_mm, peak[peaked] * 1e3),
        start,
        newest,
        fields[-1] if fields else curves.newest_field,
    )


def image_view(full: Image) -> ImageView:
    """`full` thinned for the screen, with black and white at the 0.5 and 99.8 % of its grey levels."""
    every = max(1, math.ceil(full.shape[1] / LARGEST_DISPLAY_PX))
    pixels = full[::every, ::every].copy()
    rows, cols = pixels.shape
    rect = (-every / 2, -every / 2, float(every * cols), float(every * rows))
    low, high = np.percentile(pixels[::4, ::4].astype(np.float32), (0.5, 99.8))
    caption = "display 1:1" if every == 1 else f"display 1:{every}, data full"
    return ImageView(pixels, rect, (float(low), float(max(high, low + 1))), caption, full)


def symmetric_limit(values: F32) -> float:
    """The round number (1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten) at or above 99 % of
    |values|, ignoring NaN; at least 1.
    """
    finite = np.abs(values[np.isfinite(values)])
    top = float(np.percentile(finite, 99)) if finite.size else 0.0
    decade = 10.0 ** math.floor(math.log10(max(top, 1.0)))
    return next(
        step * decade
        for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
        if max(top, 1.0) <= step * decade
    )


def field_view(snapshot: Snapshot, scene: Scene) -> FieldView | None:
    """u_x of `snapshot` in micrometres, the motion of the lens taken off; None where it has no
    field.
    """
    if snapshot.field is None or snapshot.motion is None:
        return None
    lens_um = np.float32(snapshot.motion.lens_m * 1e6)
    ux_um = snapshot.field.ux_px * np.float32(scene.pixel_um) - lens_um
    return _field_view(ux_um, "uₓ", "µm", snapshot, scene)


def stress_field_view(snapshot: Snapshot, scene: Scene) -> FieldView | None:
    """The shear traction of `snapshot` in kilopascals; None where the settings do not ask for it."""
    if snapshot.stress_field_pa is None:
        return None
    kpa = snapshot.stress_field_pa * np.float32(1e-3)
    return _field_view(kpa, "σₓ", "kPa", snapshot, scene)


def _field_view(values: F32, symbol: str, unit: str, snapshot: Snapshot, scene: Scene) -> FieldView:
    limit = symmetric_limit(values)
    caption = f"{symbol} of frame {snapshot.frame}"
    if math.isfinite(snapshot.conditions.time_s):
        caption += f", t = {snapshot.conditions.time_s:.2f} s"
    return FieldView(values, scene.field_rect_px, limit, symbol, unit, caption, snapshot.frame)


def stress_view(snapshot: Snapshot, config: Config) -> StressView | None:
    """The profile of the shear traction of `snapshot`; None where it was not inverted."""
    stress, traction, stick = snapshot.stress, snapshot.traction, snapshot.stick
    if stress is None or traction is None:
        return None
    model = np.full(stress.radius_m.shape, np.nan)
    P, sample = snapshot.conditions.normal_force_n, config.sample
    if P > 0 and stick is not None:
        a = hertz.contact_radius(
            P, sample.young_modulus * 1e6, sample.poisson, sample.lens_radius * 1e-3
        )
        mu = stick.full_slip_pa / hertz.peak_pressure(P, a)
        sheared = mu * P * (1 - min(1.0, stick.stick_radius_m / a) ** 3)
        model = cattaneo_mindlin.traction(stress.radius_m, sheared, mu, P, a)
    force = measured("∫σ dA", traction.stress_force_n, traction.stress_force_sd_n, 3, "N")
    return StressView(
        stress.radius_m * 1e3,
        stress.stress_pa * 1e-3,
        stress.sd_pa * 1e-3,
        model * 1e-3,
        stick.stick_radius_m * 1e3 if stick is not None else math.nan,
        traction.peak_radius_m * 1e3,
        f"∫σ dA = {force.value}{force.detail and ' ' + force.detail} N, Q ="
        f" {number(snapshot.conditions.shear_force_n, 3)} N",
    )


def force_view(forces: tuple[NDArray[Any], F64, F64], curves: Curves, scene: Scene) -> ForceView:
    """The force strips; time counts from the start of the drive as soon as that is known."""
    samples, normal, shear = forces
    time_s = np.asarray(samples, float) / scene.sample_rate_hz
    if math.isfinite(curves.drive_start_s):
        return ForceView(
            time_s - curves.drive_start_s, normal, shear, "time t from the start of the drive (s)"
        )
    return ForceView(time_s, normal, shear, "time from the first sample (s)")


def resolve(scene: Scene, reading: Reading, previous: ViewState | None) -> ViewState:
    """Everything the window shows after `reading`, which came after `previous`; parts that did not
    change are the same objects.
    """
    health, outcome, config = reading.health, reading.outcome, scene.config
    curves = extended(previous.curves if previous else no_curves(), reading.snapshots, scene)
    forces = force_view(reading.forces, curves, scene)
    normal_n, shear_n = (
        float(force[-1]) if len(force) else math.nan for force in reading.forces[1:]
    )
    shown, browsed = curves, reading.browsed
    if browsed is not None:  # an older frame takes the place of the newest; the curves stay
        normal_n, shear_n = browsed.conditions.normal_force_n, browsed.conditions.shear_force_n
        shown = replace(curves, newest=browsed, newest_field=browsed if browsed.field else None)
    summary = outcome.summary if outcome else None
    state = outcome.state if outcome else health.state
    return ViewState(
        state=state,
        tone=state_tone(state),
        phase=str(Phase.END) if outcome else health.phase,
        sentence=operator_sentence(health, outcome, normal_n, curves.newest, config),
        progress=min(1.0, max(0.0, health.progress)),
        health=health_cells(health.counts),
        queue_fill=min(1.0, max(0.0, health.queue_fill)),
        queue=queue_cell(health),
        disk=disk_cell(health, config),
        image=_newest_image(reading.image, previous),
        **_newest_fields(shown, scene, previous, is_browsing=browsed is not None),
        curves=curves,
        forces=forces,
        readouts=readouts(normal_n, shear_n, shown.newest),
        result=result_cells(summary) if outcome else setting_cells(config),
        notes=" · ".join(summary.notes) if summary else "",
        summary=summary,
        outcome=outcome,
        **_circles(reading.contact, shown, scene),
    )


def _circles(contact: ContactResult | None, curves: Curves, scene: Scene) -> dict[str, Any]:
    stick = curves.newest.stick if curves.newest else None
    stick_um = stick.stick_radius_m * 1e6 if stick else math.nan
    apparent_um = contact.apparent_radius_m * 1e6 if contact else math.nan
    centre = contact.centre_px if contact and all(map(math.isfinite, contact.centre_px)) else None
    return {
        "centre_px": centre,
        "apparent_px": apparent_um / scene.pixel_um,
        "stick_px": stick_um / scene.pixel_um,
        "apparent_mm": apparent_um / 1e3,
    }


def _newest_image(image: Image | None, previous: ViewState | None) -> ImageView | None:
    shown = previous.image if previous else None
    if image is None or (shown is not None and shown.full is image):
        return shown
    return image_view(image)


def _newest_fields(
    curves: Curves, scene: Scene, previous: ViewState | None, *, is_browsing: bool
) -> dict[str, Any]:
    snapshot, shown = curves.newest_field, previous.field if previous else None
    if previous is not None and (
        (snapshot is None and not is_browsing)
        or (shown and snapshot and shown.frame == snapshot.frame)
    ):
        return {"field": shown, "stress_field": previous.stress_field, "stress": previous.stress}
    if snapshot is None:
        return {"field": None, "stress_field": None, "stress": None}
    return {
        "field": field_view(snapshot, scene),
        "stress_field": stress_field_view(snapshot, scene),
        "stress": stress_view(snapshot, scene.config),
    }
