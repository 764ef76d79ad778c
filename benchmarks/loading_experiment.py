"""A loading experiment on the simulated bench, compared with what the simulated world knows: its
accuracy, losses and cost. The world's truth is read after the run; the analysis never sees it.
mu p0 is the largest traction of full sliding, a_H Hertz's contact radius. The images of the fast
renderer are off by less than 0.0001 px rms (`python -m benchmarks render`), which depends on the
fraction of a pixel and adds to the error of the integral of the traction at small Q; `--set
sim.renderer=exact` is free of it, and slower.

    python -m benchmarks loading_experiment [--pace 1|max] [--set key=value]...
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks import simulated
from benchmarks.report import Report
from benchmarks.simulated import lens_centre_px, middle_of_exposure
from drivers.sim.truth import TrueState
from drivers.sim.world import World
from slipscope import Session

SUBJECT = "Loading experiment"
MEASURES = ("analysis", "app.evaluation", "drivers.sim")
SHARES = ((0.25, 0.35), (0.55, 0.65), (0.85, 0.95), (0.99, 1.1))


class Recorded:
    """The drive of a recorded session, each frame beside the state of the world that it shows."""

    def __init__(self, session: Session, world: World) -> None:
        self.session, self.world = session, world
        samples = [e.sample for e in session.events if e.kind == "reference"]
        self.reference = middle_of_exposure(world, samples[0])
        self.rows = np.flatnonzero(session.results["phase"] == "drive")
        self.results = session.results[self.rows]

    @property
    def samples(self) -> np.ndarray:
        """Middle of the exposure of each frame."""
        return middle_of_exposure(self.world, self.results["sample"])

    def states(self) -> Iterator[tuple[Any, TrueState]]:
        """The results of each frame and the state of the world."""
        for result, sample in zip(self.results, self.samples, strict=True):
            yield result, self.world.state(int(sample))


def compare_displacement(report: Report, recorded: Recorded) -> None:
    """u_x at all points of the contact against the truth."""
    world, pixel_m = recorded.world, recorded.session.pixel_m
    rms, lost, total = [], 0, 0
    for row, sample in zip(recorded.rows, recorded.samples, strict=True):
        field, truth = recorded.session.fields[row], world.truth(int(sample))
        x, y = np.meshgrid(field.x_m / pixel_m, field.y_m / pixel_m)
        ux, uy = truth.displacement_px(x, y, recorded.reference)
        centre = lens_centre_px(world, truth.state)
        distance = np.hypot(x + ux - centre[0], y + uy - centre[1])
        error = (field.ux_m / pixel_m - ux)[distance < truth.state.apparent_radius_m / pixel_m]
        good = error[np.isfinite(error)]
        lost, total = lost + error.size - good.size, total + error.size
        rms.append((good.size, np.sqrt(np.mean(good**2))))
    count, each = np.array(rms).T
    overall = np.sqrt(np.average(each**2, weights=count))
    report.add("rms error", overall, "px", at_most=0.033, digits=2)
    report.add("rms error in length", overall * pixel_m * 1e9, "nm")
    report.add("rms error of the worst frame", each.max(), "px", digits=2)
    report.add("points lost", lost, at_most=0)
    report.add("points measured", total - lost)


def compare_radii(report: Report, recorded: Recorded) -> None:
    """The stick radius c of each frame against the world's.

    Only Cattaneo and Mindlin's contact has the sharp stick radius that the profile of u_x is fitted
    with; under the other laws the radius of the largest traction is compared alone. The cusp of
    its traction is beyond the resolution of the inversion, so that no bound is held there.
    """
    found = []
    for result, state in recorded.states():
        r, true = np.linspace(0, state.hertz_radius_m, 2000), state.stick_radius_m
        peak = r[np.argmax(state.traction(r))]
        stick = result["stick_radius_m"] - true, result["stick_radius_sd_m"]
        found.append((true, *stick, result["peak_radius_m"] - peak, result["peak_radius_sd_m"]))
    hertz_m = recorded.world.state(recorded.reference).hertz_radius_m
    share, error, stated, peak_error, peak_stated = np.array(found).T / hertz_m
    report.table("Stick radius c as a share of a_H")
    has_cusp = recorded.world.scenario.sim.law == "cattaneo-mindlin"
    if has_cusp:
        chosen, name = (share >= 0.3) & (share <= 0.9), "from u_x, c/a_H from 0.3 to 0.9"
        tell_radii(report, name, error[chosen], stated[chosen], 0.05)
    chosen = (share >= 0.2) & (share <= 0.9) & np.isfinite(peak_error)
    if chosen.any():
        name = "from the largest traction, c/a_H from 0.2 to 0.9"
        bound = None if has_cusp else 0.02
        tell_radii(report, name, peak_error[chosen], peak_stated[chosen], bound)


def tell_radii(
    report: Report, name: str, error: np.ndarray, stated: np.ndarray, at_most: float | None
) -> None:
    """Report the errors of some estimates of c, and their stated uncertainty."""
    report.row(
        name,
        digits=2,
        frames=len(error),
        bias=np.nanmean(error),
        scatter=np.nanstd(error),
        stated_uncertainty=np.nanmedian(stated),
        largest_error=(np.nanmax(abs(error)), "", at_most),
    )


def compare_traction(report: Report, recorded: Recorded, profiles: list[np.ndarray]) -> None:
    """sigma(r), its integral and the displacement D of the block, by Q/(mu P)."""
    at_rest, lines = recorded.world.state(recorded.reference), []
    for (result, state), (radius, stress) in zip(recorded.states(), profiles, strict=True):
        if not radius.size:
            continue
        sliding = state.friction * state.normal_force_n
        largest = 1.5 * sliding / np.pi / state.hertz_radius_m**2
        far = state.block_m - state.lens_m - at_rest.block_m + at_rest.lens_m
        excess = result["stress_force_n"] - state.shear_force_n
        error = (stress - state.traction(radius)) / largest
        integral = 100 * excess / state.shear_force_n, excess / result["stress_force_sd_n"]
        far = 1e9 * (result["block_m"] - far)
        lines.append((state.shear_force_n / sliding, np.mean(error**2), *integral, far))
    if not lines:
        return
    share, square, force, score, far = np.array(lines).T
    report.table("Shear traction sigma(r), by Q/(mu P)")
    for low, high in SHARES:
        at = (share > low) & (share < high)
        if at.any():
            report.row(
                f"{low:.2f} to {high:.2f}",
                digits=2,
                rms_error=(np.sqrt(square[at].mean()), "mu p0", 0.014),
                integral_against_Q=(force[at].mean(), "%", 0.2),
                rms_error_over_uncertainty=np.sqrt(np.mean(score[at] ** 2)),
                error_of_D=(far[at].mean(), "nm", 50),
            )


def true_values(recorded: Recorded) -> dict[str, float]:
    """What the world knows of the quantities of the summary, by their names there, in SI units."""
    session, world = recorded.session, recorded.world
    at_rest, truth = world.state(recorded.reference), world.truth(int(recorded.samples[-1]))
    start = np.median(recorded.samples - recorded.results["time_s"] * session.sample_rate_hz)
    onset = truth.onset_sample or math.nan
    return {
        "apparent_radius_m": at_rest.apparent_radius_m,
        "onset_time_s": (onset - start) / session.sample_rate_hz,
        "static_force_n": truth.mu_s * truth.state.normal_force_n,
        "mu_s": truth.mu_s,
        "mu_d": truth.state.friction,
        "law_mu": truth.state.friction,
        "law_length_m": world.scenario.sim.slip_length,
        "young_modulus_pa": world.scenario.sample.young_modulus,
    }


def compare_summary(report: Report, recorded: Recorded) -> None:
    """The quantities of the summary against the truth; an error in % is relative."""
    session, contact, true = recorded.session, recorded.session.contact, true_values(recorded)
    s = session.summary
    assert s is not None
    assert contact is not None
    radius = contact.apparent_radius_m, contact.apparent_radius_sd_m, true["apparent_radius_m"]
    onset = s.onset_time_s, s.onset_time_sd_s, true["onset_time_s"]
    length = s.law_length_m, s.law_length_sd_m, true["law_length_m"]
    modulus = s.young_modulus_pa, s.young_modulus_sd_pa, true["young_modulus_pa"]
    has_law = recorded.world.scenario.sim.law == "elasto-plastic"
    report.table("Summary of the experiment")
    for name, unit, scale, (measured, sd, value), error_unit, at_most in (
        ("apparent radius a", "um", 1e6, radius, "um", 45),
        ("onset of sliding t_s", "s", 1, onset, "s", None),
        ("Q_s", "N", 1, (s.static_force_n, math.nan, true["static_force_n"]), "%", 2),
        ("mu_s", "", 1, (s.mu_s, s.mu_s_sd, true["mu_s"]), "%", 0.5),
        ("mu_d", "", 1, (s.mu_d, math.nan, true["mu_d"]), "%", 2),
        ("mu of the local law", "", 1, (s.law_mu, s.law_mu_sd, true["law_mu"]), "%", 1),
        ("L of the local law", "um", 1e6, length, "%", 8),
        ("Young's modulus", "MPa", 1e-6, modulus, "%", 1.5),
    ):
        if "local law" in name and not has_law:
            continue
        error = 100 * (measured / value - 1) if error_unit == "%" else scale * (measured - value)
        report.row(name, digits=5, measured=(scale * measured, unit), truth=(scale * value, unit))
        if math.isfinite(sd):
            report.row(name, digits=2, uncertainty=(scale * sd, unit))
        report.row(name, digits=2, error=(error, error_unit, at_most))


def compare_pressure(report: Report, recorded: Recorded) -> None:
    """The measured pressure p(r) against the world's, and what cycles dissipate."""
    summary, state = recorded.session.summary, recorded.world.state(int(recorded.samples[-1]))
    if summary is None or not summary.pressure_pa:
        return
    r, p = (np.array(v) for v in (summary.pressure_radius_m, summary.pressure_pa))
    peak = float(state.pressure(0.0))
    error = (p - state.pressure(r)) / peak
    report.table("Pressure p(r), as a share of p0")
    report.row(
        "measured pressure",
        digits=2,
        rms_error=np.sqrt(np.mean(error**2)),
        largest_error=(np.abs(error).max(), "", 0.05),
        stated_uncertainty=np.median(np.array(summary.pressure_sd_pa)) / peak,
    )


def stress_profiles(path: Path, rows: np.ndarray) -> list[np.ndarray]:
    """Radii (m) and shear traction (Pa) of some frames, each of shape (2, n)."""
    with h5py.File(path) as file:
        count = file["/entry/results/stress_count"][:]
        stress = file["/entry/stress"]
        return [
            np.array([stress[name][row, : count[row]] for name in ("radius", "stress")])
            for row in rows
        ]


def measure(
    report: Report, *, pace: str = "1", set_: Sequence[str] = (), keep: Path | None = None
) -> int:
    """Run and compare; 1 if the run failed."""
    with tempfile.TemporaryDirectory() as folder:
        path = keep or Path(folder) / "session.h5"
        made = simulated.experiment(path, set_, pace=None if pace == "max" else float(pace))
        outcome = made.outcome()
        simulated.account(report, outcome, simulated.NOTHING_LOST | {"frames not analysed live": 0})
        if outcome.state != "done":
            return 1
        with Session(path) as session:
            recorded = Recorded(session, made.bench.world)
            report.table("u_x over the contact")
            compare_displacement(report, recorded)
            compare_radii(report, recorded)
            compare_traction(report, recorded, stress_profiles(path, recorded.rows))
            compare_summary(report, recorded)
            compare_pressure(report, recorded)
    return 0
