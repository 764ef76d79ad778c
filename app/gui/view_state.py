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
from app.results import F32, F64, ContactResult, Health, Outcome, Phase, Snapshot, Summary
from app.settings import Config

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
    loaded = [s for s in snapshots if s.phase not in (Phase.BACKGROUND, Phase.CONTACT)]
    pulled = [s for s in loaded if math.isfinite(s.travel_m) and math.isfinite(s.shear_force_n)]
    stuck = [
        s for s in loaded if math.isfinite(s.stick_radius_m) and math.isfinite(s.shear_force_n)
    ]
    peaked = [s for s in loaded if s.peak_radius_sd_m < MOST_UNCERTAIN * s.peak_radius_m]
    fields = [s for s in snapshots if s.ux_px.size]
    newest = snapshots[-1]
    start = curves.drive_start_s
    if math.isfinite(newest.time_s):
        start = (
            newest.sample + scene.config.exposure_samples / 2
        ) / scene.sample_rate_hz - newest.time_s
    return Curves(
        curves.seen + len(snapshots),
        np.append(curves.travel_um, [s.travel_m * 1e6 for s in pulled]),
        np.append(curves.shear_n, [s.shear_force_n for s in pulled]),
        np.append(curves.stick_shear_n, [s.shear_force_n for s in stuck]),
        np.append(curves.stick_mm, [s.stick_radius_m * 1e3 for s in stuck]),
        np.append(curves.stick_sd_mm, [np.nan_to_num(s.stick_radius_sd_m * 1e3) for s in stuck]),
        np.append(curves.peak_shear_n, [s.shear_force_n for s in peaked]),
        np.append(curves.peak_mm, [s.peak_radius_m * 1e3 for s in peaked]),
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


def field_view(snapshot: Snapshot, scene: Scene) -> FieldView:
    """u_x of `snapshot` in micrometres, the motion of the lens taken off."""
    ux_um = snapshot.ux_px * np.float32(scene.pixel_um) - np.float32(snapshot.lens_m * 1e6)
    return FieldView(
        ux_um,
        scene.field_rect_px,
        symmetric_limit(ux_um),
        "uₓ",
        "µm",
        f"uₓ of {_when(snapshot)}",
        snapshot.frame,
    )


def stress_field_view(snapshot: Snapshot, scene: Scene) -> FieldView | None:
    """The shear traction of `snapshot` in kilopascals; None where it was not asked for."""
    if not snapshot.stress_field_pa.size:
        return None
    kpa = snapshot.stress_field_pa * np.float32(1e-3)
    return FieldView(
        kpa,
        scene.field_rect_px,
        symmetric_limit(kpa),
        "σₓ",
        "kPa",
        f"σₓ of {_when(snapshot)}",
        snapshot.frame,
    )


def stress_view(snapshot: Snapshot, config: Config) -> StressView | None:
    """The profile of the shear traction of `snapshot`; None where it was not inverted."""
    if not snapshot.stress_radius_m.size:
        return None
    model, P, c, sample = (
        np.full(snapshot.stress_radius_m.shape, np.nan),
        snapshot.normal_force_n,
        snapshot.stick_radius_m,
        config.sample,
    )
    if P > 0 and math.isfinite(c):
        a = hertz.contact_radius(P, sample.young_modulus, sample.poisson, sample.lens_radius)
        mu = snapshot.full_slip_pa / hertz.peak_pressure(P, a)
        model = cattaneo_mindlin.traction(
            snapshot.stress_radius_m, mu * P * (1 - min(1.0, c / a) ** 3), mu, P, a
        )
    force = measured("∫σ dA", snapshot.stress_force_n, snapshot.stress_force_sd_n, 3, "N")
    return StressView(
        snapshot.stress_radius_m * 1e3,
        snapshot.stress_pa * 1e-3,
        snapshot.stress_sd_pa * 1e-3,
        model * 1e-3,
        snapshot.stick_radius_m * 1e3,
        snapshot.peak_radius_m * 1e3,
        f"∫σ dA = {force.value}{force.detail and ' ' + force.detail} N, Q ="
        f" {number(snapshot.shear_force_n, 3)} N",
    )


def _when(snapshot: Snapshot) -> str:
    return f"frame {snapshot.frame}" + (
        f", t = {snapshot.time_s:.2f} s" if math.isfinite(snapshot.time_s) else ""
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
        normal_n, shear_n = browsed.normal_force_n, browsed.shear_force_n
        shown = replace(
            curves, newest=browsed, newest_field=browsed if browsed.ux_px.size else None
        )
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
    stick_um = curves.newest.stick_radius_m * 1e6 if curves.newest else math.nan
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
