"""The charts of a run: what is drawn of its curves, beside what theory and settings say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.mechanics import cattaneo_mindlin
from app.evaluation.setup import hertz_radius_m
from app.gui.cells import number
from app.gui.charts import Chart, ChartMark, Guide, Line, Span
from app.gui.frame_results import FrameResults, Profile
from app.gui.run_curves import Curves, ForceStrips, time_axis
from app.gui.source import Setup
from app.records.legs import stage_travel
from app.records.quantities import measured_text
from app.records.record_types import F64
from app.records.summary import Summary
from app.settings.protocol_steps import Approach, reach

MOST_OF_NOTE = 24  # characters beside its line; the time line has all
TITLES = {
    "loading": "Loading curve Q(δ)",
    "sticking": "Stick radius c",
    "traction": "Shear traction σ(r)",
    "forces": "Forces P, Q",
    "displacement": "Displacement uₓ(r)",
    "sliding": "Slip in time",
    "point": "Point uₓ(t)",
    "noise": "Noise of uₓ",
}
HINTS = {
    "loading": "Q against the travel δ, from the start of the drive; where nothing read the stage,"
    " against v t once the velocity of sliding is known",
    "sticking": "The stick radius c of each frame, from the start of the drive",
    "traction": "Mean traction at each radius, of the frame that is shown",
    "forces": "P and Q in time, from the start of the run",
    "displacement": "Mean displacement at each radius, of the frame that is shown",
    "sliding": "uₓ at four radii in time, from the start of the drive",
    "point": "uₓ of a place in time: click on the field in the picture",
    "noise": "Noise of uₓ beside the least that the images allow, from the reference on",
}
NAMES_OF_SHARES = ("r = 0", "a/2", "3a/4", "a")
ROLES_OF_SHARES = ("shear", "stick", "normal", "model")
TRAVEL_Q, STEADY_Q = ("travel_um", "Q_N"), ("v_t_um", "Q_N")  # read, or of a steady drive
MODEL_POINTS = 200
LATELY = 10  # looks within which all charts in view are drawn


def no_chart(key: str) -> Chart:
    """A chart before the first run."""
    return Chart(TITLES[key], "", "", hint=HINTS[key])


@dataclass(frozen=True, slots=True)
class Cursor:
    """The frame of a recorded run that is shown, on the axes of the curves; NaN: not known.

    `time_s` is the time of the force strips, `frame` the number as recorded.
    """

    frame: int
    time_s: float
    travel_um: float
    shear_n: float


@dataclass(frozen=True, eq=False)
class RunCharts:
    """All charts of the run as of now, by the keys of `TITLES`; each is made when it is asked for.
    `cursor` is the place of the frame that is shown, None in a live run, whose newest one is.
    """

    setup: Setup
    curves: Curves
    frame: FrameResults | None
    forces: ForceStrips
    summary: Summary | None
    point: Chart
    cursor: Cursor | None = None

    def __getitem__(self, key: str) -> Chart:
        self._asked.pop(key, None)
        self._asked[key] = 0  # behind all others
        return self._of(key)

    def _of(self, key: str) -> Chart:
        if key not in self._made:
            self._made[key] = replace(self._chart(key), title=TITLES[key], hint=HINTS[key])
        return self._made[key]

    def prepare(self, before: RunCharts) -> None:
        """Make that which is drawn next, with its extents: of those that were asked for lately the
        one that has waited longest, for they are drawn in turn.
        """
        asked = tuple(before._asked.copy().items())  # another thread may ask for one now
        self._asked.update((key, looks + 1) for key, looks in asked if looks < LATELY)
        for key in tuple(self._asked)[:1]:
            _ = self._of(key).extents

    @cached_property
    def _made(self) -> dict[str, Chart]:
        return {}

    @cached_property
    def _asked(self) -> dict[str, int]:
        """How many looks ago each was asked for, the longest ago first."""
        return {}

    def _chart(self, key: str) -> Chart:
        frame, at = self.frame, self.cursor
        match key:
            case "loading":
                return _loading(self.setup, self.curves, self.summary, at)
            case "sticking":
                return _sticking(self.setup, self.curves, self.summary)
            case "traction":
                sheared = frame.traction_kpa if frame else None
                chart = _radial(frame, sheared, "shear", "sigma_kPa", "σ (kPa)")
                return replace(chart, caption=frame.balance if frame else "")
            case "forces":
                noted = _noted(self.setup, self.curves)
                chart = _forces(self.setup, self.forces, self.summary, noted)
                here = () if at is None else (Guide(at.time_s, str(at.frame), is_upright=True),)
                return replace(chart, guides=(*chart.guides, *here))
            case "displacement":
                moved = frame.displacement_um if frame else None
                return _radial(frame, moved, "displacement", "ux_um", "uₓ (µm)")
            case "sliding":
                return _sliding(self.curves, self.summary)
            case "noise":
                return _noise(self.curves)
        return self.point


def _loading(setup: Setup, curves: Curves, summary: Summary | None, at: Cursor | None) -> Chart:
    """Q over the travel of the stage, or over v t where nothing read it; see `stage_travel`."""
    low, high = reach(setup.config.run.protocol)
    guides = (Guide(summary.static_force_n, "Qₛ"),) if summary else ()
    furthest = max(high, -low) * 1e6  # along the drive, as it is plotted
    read_um, shear_n, time_s, step = curves.loading.T
    velocity_um_s = 1e6 * summary.sliding_velocity_m_s if summary else math.nan
    travel, is_steady = stage_travel(1e-6 * read_um, time_s, step, 1e-6 * velocity_um_s)
    is_known = np.isfinite(travel)
    behind = 1e6 * float(travel[is_known].min(initial=0.0))
    columns = STEADY_Q if is_steady else TRAVEL_Q
    line = Line("", 1e6 * travel[is_known], shear_n[is_known], "shear", columns)
    marks: tuple[ChartMark, ...] = ()
    if at is not None:
        here_um, sample_s = at.travel_um, 1 / setup.config.forces.sample_rate
        if is_steady and 0 <= at.time_s < time_s[is_known].max() + sample_s:
            here_um = velocity_um_s * at.time_s
        if math.isfinite(here_um):  # v t is known in the first loading only
            marks = (ChartMark(here_um, at.shear_n, str(at.frame)),)
    return Chart(
        "",
        f"travel δ{' = v t' * is_steady} (µm)",
        "Q (N)",
        (line,),
        guides,
        marks=marks,
        x_range=None if is_steady else (min(behind, 0.0), furthest),
    )


def _sticking(setup: Setup, curves: Curves, summary: Summary | None) -> Chart:
    """c/a_H against Q/(mu P); against Q/P as long as no friction coefficient is known."""
    fitted, largest = curves.sticking, curves.peaks
    mu, said = curves.full_slip, ""
    if summary is not None and math.isfinite(summary.mu_s):
        mu, said = summary.mu_s, f"μ = Qₛ/P = {number(summary.mu_s, 3)}"
    elif math.isfinite(mu):
        said = f"μ = {number(mu, 3)}, of the newest profile"
    known = mu if math.isfinite(mu) and mu > 0 else 1.0
    columns = ("Q_over_mu_P" if said else "Q_over_P", "c_over_aH")
    Q, c, sd, P = fitted[np.argsort(fitted[:, 0] / fitted[:, 3], kind="stable")].T
    x, y, sd = Q / (known * P), c / _hertz_mm(setup, P), sd / _hertz_mm(setup, P)
    fit = Line("fitted profile", x, y, "stick", columns, sd=sd, style="dots")
    Q, c, P = largest.T
    x, y = Q / (known * P), c / _hertz_mm(setup, P)
    peaks = Line("largest σ", x, y, "stick", columns, style="squares", width=1.2)
    ratio = 1 - np.linspace(1.0, 0.0, MODEL_POINTS if said else 0) ** 3
    c_over_a = cattaneo_mindlin.stick_radius(ratio, 1.0, 1.0)
    model = Line("Cattaneo–Mindlin", ratio, c_over_a, "model", columns)
    return Chart(
        "",
        "Q/(μP)" if said else "Q/P",
        "c/a_H",
        (peaks, fit, model),
        caption=said,
        x_range=(0.0, 1.1) if said else None,
        y_least=(0.0, 1.2),
    )


def _hertz_mm(setup: Setup, normal_n: F64) -> F64:
    """a_H for each load: it grows with the cube root."""
    return 1e3 * hertz_radius_m(setup.config, 1.0) * np.cbrt(normal_n)


def _radial(
    frame: FrameResults | None, profile: Profile | None, role: str, column: str, label: str
) -> Chart:
    """A profile of a frame, with upright lines at the radii of the contact."""
    chart = Chart("", "r (mm)", label, y_least=(0.0, 1.0))
    if frame is None:
        return chart
    mm, around = frame.setup.pixel_um * 1e-3, frame.circles
    radii = (
        Guide(around.apparent_px * mm, "a", is_upright=True),
        Guide(around.hertz_px * mm, "a_H", is_upright=True, role="muted"),
        Guide(frame.stick_mm, "c fitted", is_upright=True, role="stick"),
        Guide(frame.peak_mm, "c", is_upright=True, role="stick"),
    )
    if profile is None:
        return replace(chart, guides=radii)
    r, sd, columns = profile.radius_mm, np.nan_to_num(profile.sd), ("r_mm", column)
    lines = (
        Line("measured", r, profile.values, role, columns, sd=sd),
        Line("Cattaneo–Mindlin, for c fitted", r, profile.model, "model", columns, style="dashed"),
    )
    return replace(chart, lines=lines, guides=radii)


def _noted(setup: Setup, curves: Curves) -> list[Guide]:
    """The notes of a recorded run, at their times."""
    line, (begins_s, _) = setup.timeline, time_axis(curves.drive_start_s)
    if line is None:
        return []
    return [
        Guide(
            one.sample / line.sample_rate_hz - begins_s,
            one.text[:MOST_OF_NOTE],
            is_upright=True,
            role="muted",
        )
        for one in line.notes
    ]


def _forces(
    setup: Setup, forces: ForceStrips, summary: Summary | None, noted: list[Guide]
) -> Chart:
    config = setup.config
    limits, tolerance = config.limits, config.run.settle_tolerance
    loads = {step.normal_force for step in config.run.protocol if isinstance(step, Approach)}
    spans = [Span(load * (1 - tolerance), load * (1 + tolerance), "normal") for load in loads]
    onset = summary.onset_time_s if summary else math.nan
    ends = (
        [Guide(limits.normal_force, "limit of P and Q", role="saturated")]
        if limits.normal_force == limits.shear_force
        else [
            Guide(limits.normal_force, "limit of P", role="saturated"),
            Guide(limits.shear_force, "limit of Q", role="saturated"),
        ]
    )
    return Chart(
        "",
        forces.time_label,
        "P, Q (N)",
        (
            Line("P", forces.time_s, forces.normal_n, "normal", ("time_s", "P_N"), width=1.0),
            Line("Q", forces.time_s, forces.shear_n, "shear", ("time_s", "Q_N"), width=1.0),
        ),
        (
            *ends,
            *noted,
            Guide(-limits.shear_force, "limit of −Q", role="saturated"),
            Guide(onset, "tₛ", is_upright=True),
        ),
        tuple(spans),
        y_least=(0.0, max(loads, default=0.1)),
    )


def _sliding(curves: Curves, summary: Summary | None) -> Chart:
    time_s, *moved_um = curves.sliding.T
    lines = tuple(
        Line(name, time_s, ux_um, role, ("time_s", "ux_um"), width=1.4)
        for name, role, ux_um in zip(NAMES_OF_SHARES, ROLES_OF_SHARES, moved_um, strict=True)
    )
    onset = (Guide(summary.onset_time_s, "tₛ", is_upright=True),) if summary else ()
    caption = ""
    if summary is not None and math.isfinite(summary.onset_time_s):
        onset_text = measured_text(summary.onset_time_s, summary.onset_time_sd_s)
        caption = f"sliding begins at tₛ = {onset_text} s"
    _, label = time_axis(0.0)
    return Chart("", label, "uₓ (µm)", lines, onset, caption=caption, y_least=(0.0, 1.0))


def _noise(curves: Curves) -> Chart:
    begins, label = time_axis(curves.drive_start_s)
    time_s, measured, floor = curves.noise.T
    mine = Line("measured", time_s - begins, measured, "normal", ("time_s", "noise_px"), width=1.2)
    least = Line("floor of the images", time_s - begins, floor, "model", ("time_s", "noise_px"))
    caption = ""
    if len(measured):
        caption = f"now {number(measured[-1], 4)} px"
        if floor[-1] > 0:
            caption += f", {number(measured[-1] / floor[-1], 2)} times the floor"
    return Chart(
        "", label, "noise of uₓ (px)", (mine, least), caption=caption, y_least=(0.0, 0.002)
    )
