"""What the window shows, as plain values.

Everything is decided here, without Qt; the widgets only draw. `read` takes the newest data from a
source, and `resolve` turns them into a frozen `ViewState`. Lengths on the image are pixels (x, y),
with (0, 0) the centre of the top-left pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mechanics import cattaneo_mindlin, hertz
from app.gui import cells
from app.gui.cells import Cell, Tone
from app.gui.source import Image, PlaybackSource, RunSource
from app.report.quantities import measured_text
from app.results import F32, F64, ContactResult, Health, Outcome, Phase, Snapshot, Summary
from app.settings import Config

Rect = tuple[float, float, float, float]  # left, top, width, height in px
LARGEST_DISPLAY_PX = 1000  # of wider images every second, third ... pixel is shown
FORCE_POINTS = 2000  # points of a force strip, more than the screen has columns
MOST_UNCERTAIN = (
    0.2  # radii of the largest traction with a larger relative uncertainty are left out
)
LIMITS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # times a power of ten: ends of a scale


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """What does not change during a run; the rectangle is that of the grid of boxes."""

    title: str
    pixel_um: float
    grid_rect_px: Rect
    sample_rate_hz: float
    config: Config


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The newest data of a source; `browsed` is the recorded frame that is shown in their place."""

    health: Health
    image: Image | None
    snapshots: tuple[Snapshot, ...]
    contact: ContactResult | None
    forces: tuple[NDArray[Any], F64, F64]
    outcome: Outcome | None
    browsed: Snapshot | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The run so far, one point per analysed frame on which the quantity could be measured.

    Attributes
    ----------
    seen : int
        Snapshots up to now.
    loading : ndarray, shape (n, 2)
        Travel (um) and Q (N).
    sticking : ndarray, shape (n, 3)
        Q (N), and the stick radius c with its standard uncertainty (mm).
    peaks : ndarray, shape (n, 2)
        Q (N), and the radius of the largest shear traction (mm).
    drive_start_s : float
        On the sample clock; NaN until the drive begins.
    newest, newest_field : Snapshot or None
        The newest snapshot, and the newest one with a displacement field.
    """

    seen: int
    loading: F64
    sticking: F64
    peaks: F64
    drive_start_s: float
    newest: Snapshot | None
    newest_field: Snapshot | None


NO_CURVES = Curves(0, np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 2)), math.nan, None, None)


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
    rect_px: Rect
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


@dataclass(frozen=True, slots=True, eq=False)
class ForceStrips:
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
    counts: tuple[Cell, ...]
    queue_fill: float
    queue: Cell
    disk: Cell
    image: ShownImage | None
    frame: FrameResults | None
    circles: Circles
    curves: Curves
    forces: ForceStrips
    readouts: tuple[Cell, ...]
    result: tuple[Cell, ...]
    outcome: Outcome | None

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self.state in ("done", "failed")

    @property
    def summary(self) -> Summary | None:
        """What the experiment came down to, once it has ended well."""
        return self.outcome.summary if self.outcome else None


def setup_of(source: RunSource) -> Setup:
    """What does not change during the run of `source`."""
    x, y, config = source.grid_x_px, source.grid_y_px, source.config
    step = float(config.dic.step)
    rect = (float(x[0]) - step / 2, float(y[0]) - step / 2, step * len(x), step * len(y))
    rate_hz = float(config.forces.sample_rate)
    return Setup(source.title, config.camera.pixel * 1e6, rect, rate_hz, config)


def read(source: RunSource, seen: int) -> Reading:
    """The newest data of `source`; of the snapshots, those after the first `seen`."""
    outcome = source.outcome()  # first, so that all that is read after an outcome is complete
    return Reading(
        source.health(),
        source.latest_image(),
        tuple(source.snapshots_since(seen)),
        source.contact(),
        source.force_history(FORCE_POINTS),
        outcome,
        source.browsed() if isinstance(source, PlaybackSource) else None,
    )


def resolve(setup: Setup, reading: Reading, previous: ViewState | None) -> ViewState:
    """Everything that the window shows after `reading`, which came after `previous`.

    Parts that did not change are the same objects. While an older frame is browsed it takes the
    place of the newest one, but for the curves and the sentence.
    """
    health, outcome, config = reading.health, reading.outcome, setup.config
    curves = extended(previous.curves if previous else NO_CURVES, reading.snapshots, setup)
    shown, shown_field = curves.newest, curves.newest_field
    normal_n, shear_n = (float(f[-1]) if len(f) else math.nan for f in reading.forces[1:])
    sentence = cells.operator_sentence(
        health, outcome, normal_n, shown.travel_m if shown else math.nan, config
    )
    if reading.browsed is not None:
        shown = reading.browsed
        shown_field = shown if shown.ux_px.size else None
        normal_n, shear_n = shown.normal_force_n, shown.shear_force_n
    travel_m, stick_m = (shown.travel_m, shown.stick_radius_m) if shown else (math.nan, math.nan)
    state = outcome.state if outcome else health.state
    return ViewState(
        state=state,
        tone=cells.state_tone(state),
        phase=str(Phase.END) if outcome else health.phase,
        sentence=sentence,
        progress=min(1.0, max(0.0, health.progress)),
        counts=cells.count_cells(health.counts),
        queue_fill=min(1.0, max(0.0, health.queue_fill)),
        queue=cells.queue_cell(health),
        disk=cells.disk_cell(health, config),
        image=_image(reading.image, previous),
        frame=_frame(shown_field, previous, setup),
        circles=_circles(reading.contact, stick_m, setup),
        curves=curves,
        forces=force_strips(reading.forces, curves.drive_start_s, setup),
        readouts=cells.readouts(normal_n, shear_n, travel_m, stick_m),
        result=cells.result_cells(outcome.summary) if outcome else cells.setting_cells(config),
        outcome=outcome,
    )


def extended(curves: Curves, snapshots: tuple[Snapshot, ...], setup: Setup) -> Curves:
    """`curves` with the points of newer `snapshots`; the same object if there are none."""
    if not snapshots:
        return curves
    loaded = [s for s in snapshots if s.phase not in (Phase.BACKGROUND, Phase.CONTACT)]
    loading = [(s.travel_m * 1e6, s.shear_force_n) for s in loaded]
    sticking = [
        (s.shear_force_n, s.stick_radius_m * 1e3, np.nan_to_num(s.stick_radius_sd_m * 1e3))
        for s in loaded
    ]
    peaks = [
        (s.shear_force_n, s.peak_radius_m * 1e3)
        for s in loaded
        if s.peak_radius_sd_m < MOST_UNCERTAIN * s.peak_radius_m
    ]
    newest, start_s = snapshots[-1], curves.drive_start_s
    if math.isfinite(newest.time_s):
        middle = newest.sample + setup.config.exposure_samples / 2
        start_s = middle / setup.sample_rate_hz - newest.time_s
    return Curves(
        curves.seen + len(snapshots),
        _with_points(curves.loading, loading),
        _with_points(curves.sticking, sticking),
        _with_points(curves.peaks, peaks),
        start_s,
        newest,
        next((s for s in reversed(snapshots) if s.ux_px.size), curves.newest_field),
    )


def _with_points(curve: F64, points: Sequence[tuple[float, ...]]) -> F64:
    """`curve` with those of `points` that have no NaN."""
    new = np.reshape(np.array(points, dtype=np.float64), (-1, curve.shape[1]))
    return np.concatenate([curve, new[np.isfinite(new).all(axis=1)]])


def _image(image: Image | None, previous: ViewState | None) -> ShownImage | None:
    shown = previous.image if previous else None
    if image is None or (shown is not None and shown.full is image):
        return shown
    return shown_image(image)


def shown_image(full: Image) -> ShownImage:
    """`full` thinned for the screen; black and white are 0.5 and 99.8 % of its grey levels."""
    every = max(1, math.ceil(full.shape[1] / LARGEST_DISPLAY_PX))
    pixels = full[::every, ::every].copy()
    rows, cols = pixels.shape
    rect = (-every / 2, -every / 2, float(every * cols), float(every * rows))
    low, high = np.percentile(pixels[::4, ::4].astype(np.float32), (0.5, 99.8))
    caption = "display 1:1" if every == 1 else f"display 1:{every}, data full"
    return ShownImage(pixels, rect, (float(low), float(max(high, low + 1))), caption, full)


def _frame(
    snapshot: Snapshot | None, previous: ViewState | None, setup: Setup
) -> FrameResults | None:
    shown = previous.frame if previous else None
    if snapshot is None or (shown and shown.frame == snapshot.frame):
        return shown if snapshot else None
    # the motion of the lens is taken off
    ux_um = snapshot.ux_px * np.float32(setup.pixel_um) - np.float32(snapshot.lens_m * 1e6)
    has_traction = snapshot.stress_field_pa.size
    return FrameResults(
        snapshot.frame,
        _overlay(ux_um, "uₓ", "µm", snapshot, setup),
        _overlay(snapshot.stress_field_pa * np.float32(1e-3), "σₓ", "kPa", snapshot, setup)
        if has_traction
        else None,
        traction_profile(snapshot, setup.config) if snapshot.stress_radius_m.size else None,
    )


def _overlay(values: F32, symbol: str, unit: str, snapshot: Snapshot, setup: Setup) -> Overlay:
    when = f", t = {snapshot.time_s:.2f} s" if math.isfinite(snapshot.time_s) else ""
    caption = f"{symbol} of frame {snapshot.frame}{when}"
    return Overlay(values, setup.grid_rect_px, symmetric_limit(values), symbol, unit, caption)


def symmetric_limit(values: F32) -> float:
    """The least round number (`LIMITS` times a power of ten) above 99 % of |values|; at least 1."""
    finite = np.abs(values[np.isfinite(values)])
    top = max(1.0, float(np.percentile(finite, 99)) if finite.size else 0.0)
    decade = 10.0 ** math.floor(math.log10(top))
    return next(step * decade for step in LIMITS if top <= step * decade)


def traction_profile(snapshot: Snapshot, config: Config) -> TractionProfile:
    """The profile of the shear traction, beside that of Cattaneo and Mindlin for the same c."""
    radius_m, P, c = snapshot.stress_radius_m, snapshot.normal_force_n, snapshot.stick_radius_m
    model = np.full(radius_m.shape, math.nan)
    if P > 0 and math.isfinite(c):
        sample = config.sample
        a = hertz.contact_radius(P, sample.young_modulus, sample.poisson, sample.lens_radius)
        mu = snapshot.full_slip_pa / hertz.peak_pressure(P, a)
        Q = mu * P * (1 - min(1.0, c / a) ** 3)
        model = cattaneo_mindlin.traction(radius_m, Q, mu, P, a)
    force = cells.typeset(measured_text(snapshot.stress_force_n, snapshot.stress_force_sd_n))
    return TractionProfile(
        radius_m * 1e3,
        snapshot.stress_pa * 1e-3,
        snapshot.stress_sd_pa * 1e-3,
        model * 1e-3,
        c * 1e3,
        snapshot.peak_radius_m * 1e3,
        f"∫σ dA = {force} N, Q = {cells.number(snapshot.shear_force_n, 3)} N",
    )


def _circles(contact: ContactResult | None, stick_m: float, setup: Setup) -> Circles:
    centre = contact.centre_px if contact and all(map(math.isfinite, contact.centre_px)) else None
    apparent_um = contact.apparent_radius_m * 1e6 if contact else math.nan
    return Circles(
        centre,
        apparent_um / setup.pixel_um,
        stick_m * 1e6 / setup.pixel_um,
        apparent_um * 1e-3,
    )


def force_strips(
    forces: tuple[NDArray[Any], F64, F64], drive_start_s: float, setup: Setup
) -> ForceStrips:
    """P and Q against time, which counts from the start of the drive once that is known."""
    samples, normal, shear = forces
    time_s = np.asarray(samples, float) / setup.sample_rate_hz
    if math.isfinite(drive_start_s):
        label = "time t from the start of the drive (s)"
        return ForceStrips(time_s - drive_start_s, normal, shear, label)
    return ForceStrips(time_s, normal, shear, "time from the first sample (s)")


def model_curve(summary: Summary, points: int = 200) -> tuple[F64, F64]:
    """Q (N) and stick radius c (mm) of Cattaneo and Mindlin's contact that slides at Q_s.

    The points are evenly spaced in c; there are none where Q_s is not known.
    """
    limit, a = summary.static_force_n, summary.hertz_radius_m
    if not (limit > 0 and a > 0):
        return np.empty(0), np.empty(0)
    Q = limit * (1 - np.linspace(1.0, 0.0, points) ** 3)
    return Q, 1e3 * cattaneo_mindlin.stick_radius(Q, limit, a)
