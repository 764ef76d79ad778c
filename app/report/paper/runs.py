"""One run of the results, as the figures need it: its first loading, its radii and moduli, profiles
at any radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_smoothing_spline

from analysis.arrays import F64, floats
from analysis.mechanics import cattaneo_mindlin, hertz
from app.records.legs import first_loading_rows, stage_travel
from app.records.record_types import Phase
from app.records.study_results import RunResult, StudyResults
from app.report.paper.style import NotDrawn, load_colours
from app.settings.config import from_record
from app.settings.sections import Config

FEWEST_SMOOTHED = 10  # frames from which Q can be smoothed
SAME_LOAD = 0.05  # loads that differ by a smaller share count as the paper's


class FigureRun:
    """A run with the quantities that follow from its results; SI units.

    Attributes
    ----------
    run : RunResult
    colour
        That of its load.
    """

    def __init__(self, run: RunResult, colour: object) -> None:
        self.run, self.summary, self.contact = run, run.summary, run.contact
        self.colour = colour
        self.P = run.summary.normal_force_n

    @cached_property
    def config(self) -> Config:
        """The settings of its analysis."""
        return from_record(self.run.origin.config_toml, f"{self.run.origin.session}: settings")

    @property
    def name(self) -> str:
        """Its load, for a legend."""
        return f"{self.P:.2g} N"

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows of the first loading among the frames of the run."""
        frames = self.run.frames
        drive = np.flatnonzero((frames["phase"] == Phase.DRIVE) & np.isfinite(frames["time_s"]))
        return drive[first_loading_rows(frames["travel_m"][drive], frames["step"][drive])]

    def series(self, name: str) -> F64:
        """One number of each frame of the first loading, by its name."""
        return floats(self.run.frames[name][self.rows])

    @property
    def delta(self) -> F64:
        """Displacement of the stage at each frame of the first loading; see `stage_travel`."""
        return self._travel[0]

    @property
    def is_steady(self) -> bool:
        """Whether `delta` is v t, because nothing read the stage."""
        return self._travel[1]

    @cached_property
    def _travel(self) -> tuple[F64, bool]:
        velocity, step = self.summary.sliding_velocity_m_s, self.series("step")
        return stage_travel(self.series("travel_m"), self.time, step, velocity)

    @cached_property
    def time(self) -> F64:
        """Of each frame, from the start of the drive."""
        return self.series("time_s")

    @cached_property
    def Q(self) -> F64:
        """Shear force of each frame."""
        return self.series("shear_force_n")

    @cached_property
    def steady_Q(self) -> F64:
        """Q of each frame by a smoothing spline through the first loading (cross-validated): what
        is predicted of it. The noise of the few samples of an exposure would make a prediction jump
        where it is steep: c(Q) near mu P.
        """
        Q, known = self.Q.copy(), np.isfinite(self.Q) & np.isfinite(self.time)
        time = self.time[known]
        if known.sum() >= FEWEST_SMOOTHED and (np.diff(time) > 0).all():
            Q[known] = make_smoothing_spline(time, Q[known])(time)
        return Q

    @property
    def E(self) -> float:
        """Young's modulus of the balance with Q; that of the settings where there is none."""
        found = self.summary.young_modulus_pa
        return found if math.isfinite(found) else self.config.sample.young_modulus

    @property
    def hertz_radius(self) -> float:
        """a_H by the modulus of the settings."""
        return hertz.contact_radius(self.P, *self.config.sample.bodies)

    @property
    def own_hertz_radius(self) -> float:
        """a_H by the modulus of the run."""
        return hertz.contact_radius(self.P, self.E, *self.config.sample.bodies[1:])

    @property
    def apparent_radius(self) -> float:
        """a, or a_H + sqrt(R h) where it was not measured."""
        a = self.summary.apparent_radius_m
        return a if math.isfinite(a) else self.hertz_radius + self.config.sample.rim

    @cached_property
    def mu(self) -> float:
        """<mu_d>, the mean of Q/P in sliding; where it did not slide, the greatest Q/P."""
        found = self.summary.mu_d
        return found if math.isfinite(found) else float(np.nanmax(self.Q, initial=0.0)) / self.P

    @property
    def slides(self) -> np.ndarray:
        """Which frames of the first loading come after t_s."""
        return self.time >= self.summary.onset_time_s

    @property
    def loading(self) -> np.ndarray:
        """Which of them come before t_s; all where there is none."""
        return ~self.slides

    @property
    def box(self) -> float:
        """Side of the box over which the correlation averages u_x, metres."""
        return self.config.dic.averaging_box_px * self.run.pictures.pixel_m

    @property
    def noise_px(self) -> float:
        """Standard deviation of u_x for the box of the settings, pixels; NaN where no box as large,
        or as small, was measured.
        """
        noise, box = self.run.noise, self.config.dic.box
        if not (noise.box_px.size and noise.box_px[0] <= box <= noise.box_px[-1]):
            return math.nan
        power = np.interp(math.log(box), np.log(noise.box_px), np.log(noise.sigma_px))
        return math.exp(power)

    @cached_property
    def radius(self) -> F64:
        """Mean radii of the rings, shape (rings,)."""
        return _usual(self.run.rings.radius_m[self.rows])

    @cached_property
    def ux(self) -> F64:
        """Ring means of u_x, shape (frames of the first loading, rings)."""
        return np.asarray(self.run.rings.ux_m[self.rows])

    @cached_property
    def stress_radius(self) -> F64:
        """Radii of sigma_xz, shape (radii,)."""
        return _usual(self.run.rings.stress_radius_m[self.rows])

    @cached_property
    def stress(self) -> F64:
        """sigma_xz by the modulus of the run, shape (frames of the first loading, radii)."""
        return np.asarray(self.run.rings.stress_pa[self.rows] * self.stress_scale)

    @property
    def stress_scale(self) -> float:
        """What turns tractions by the modulus of the settings into those by the run's."""
        return self.E / self.config.sample.young_modulus

    def ux_at(self, r: ArrayLike) -> F64:
        """u_x at the radii r, shape (frames of the first loading, radii asked for)."""
        return between(self.radius, self.ux, r)

    def stress_at(self, r: ArrayLike) -> F64:
        """sigma_xz at the radii r, likewise."""
        return between(self.stress_radius, self.stress, r)

    def every(self, seconds: float) -> np.ndarray:
        """Rows of the first loading, before t_s, that come next to every so many seconds."""
        rows = np.flatnonzero(self.loading & np.isfinite(self.Q))
        if not len(rows):
            return rows
        time = self.time[rows]
        wanted = np.arange(time[0], time[-1] + seconds / 2, seconds)
        return np.asarray(rows[np.unique([np.argmin(np.abs(time - t)) for t in wanted])])

    def cattaneo_mindlin_ux(self, r: F64, Q: float) -> F64:
        """u_x as the lens sees it, after Cattaneo and Mindlin with the modulus of the settings and
        no parameter adjusted; NaN for a Q that would slide.
        """
        sample = self.config.sample
        about = (self.mu, self.P, self.hertz_radius, sample.young_modulus, sample.poisson)
        if not abs(Q) < self.mu * self.P:
            return np.full(np.shape(r), np.nan)
        moved = cattaneo_mindlin.radial_displacement(r, Q, *about)[0]
        return cattaneo_mindlin.shift(Q, *about) - moved


Runs = Sequence[FigureRun]


def of_delta(runs: Runs) -> str:
    """What a caption adds on the displacement of the stage."""
    steady = [run.name for run in runs if run.is_steady]
    if not steady:
        return ""
    which = "" if len(steady) == len(runs) else f" at {', '.join(steady)}"
    return f" Nothing read the stage{which}: delta is v t, with the velocity v of sliding."


def _usual(rows: F64) -> F64:
    """The radii that the frames share."""
    if not np.isfinite(rows).any():
        return np.empty(0)
    first = rows[np.isfinite(rows).sum(axis=1).argmax()]
    return np.asarray(first[np.isfinite(first)])


def between(radius: F64, profiles: F64, r: ArrayLike) -> F64:
    """Profiles (frames, radii) at other radii, linear between the rings; the centre is the first
    ring's.
    """
    r = np.atleast_1d(floats(r))
    if len(radius) < 2:
        return np.full((len(profiles), len(r)), np.nan)
    found = [np.interp(r, radius, profile, right=np.nan) for profile in profiles]
    return np.reshape(found, (len(profiles), len(r)))


def box_mean(profile: Callable[[F64], F64], r: F64, side: float) -> F64:
    """A profile over the distance from the centre as the correlation sees it: its mean over a box
    of that side, and over the azimuth; shape of `r`.
    """
    t, w = np.polynomial.legendre.leggauss(6)
    angle = np.pi / 4 * (np.arange(6) + 0.5) / 6
    x = r[:, None, None, None] * np.cos(angle)[:, None, None] + side / 2 * t[:, None]
    y = r[:, None, None, None] * np.sin(angle)[:, None, None] + side / 2 * t
    values = profile(np.hypot(x, y))
    return np.asarray(np.einsum("raij,i,j->r", values, w, w) / 4 / len(angle))


def experiments(results: StudyResults) -> list[FigureRun]:
    """All runs that have a normal force, by that force, each with its colour."""
    loaded = [run for run in results.runs if run.summary.normal_force_n > 0]
    loaded.sort(key=lambda run: run.summary.normal_force_n)
    return [FigureRun(*pair) for pair in zip(loaded, load_colours(len(loaded)), strict=True)]


def of_each(runs: Runs, *names: str) -> list[F64]:
    """Numbers in the summaries of runs, an array of shape (runs,) for each name."""
    return [floats([getattr(run.summary, name) for run in runs]) for name in names]


def those(runs: Runs, have: Callable[[FigureRun], object], missing: str) -> list[FigureRun]:
    """The runs that have what a figure shows; `NotDrawn`, which says what is missing, for none."""
    found = [run for run in runs if have(run)]
    if not found:
        raise NotDrawn(missing)
    return found


def nearest(runs: Runs, load: float) -> FigureRun:
    """The run whose normal force is nearest to one of the paper's, newtons."""
    if not runs:
        raise NotDrawn("no run has a normal force")
    return min(runs, key=lambda run: (abs(math.log(run.P / load)), run.P))


def nearest_of(runs: Runs, loads: Sequence[float]) -> list[FigureRun]:
    """The runs nearest to some loads of the paper, each once."""
    return list(dict.fromkeys(nearest(runs, load) for load in loads))


def load_text(run: FigureRun, load: float) -> str:
    """The load of a run, and the paper's where it is another."""
    paper = "" if abs(run.P / load - 1) < SAME_LOAD else f" (in the paper {load:g} N)"
    return f"P = {run.P:.3g} N{paper}"


def loads_text(runs: Runs, loads: Sequence[float]) -> str:
    """The loads of runs that `nearest_of` chose."""
    return " and ".join(
        load_text(run, loads[int(np.argmin(np.abs(np.log(np.divide(run.P, loads)))))])
        for run in runs
    )
