"""Every number of an analysis of sessions, of each run and of all together, with its uncertainty by
noise and by the operator's inputs, what each input costs, and what the paper states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.friction.joint import stiffness_length
from app.records.quantities import (
    Measurement,
    further_quantities,
    joint_quantities,
    local_quantities,
    summary_quantities,
)
from app.records.study_results import StudyResults
from app.records.summary import Summary
from app.report.paper.beyond import checked_pressure, work_of
from app.report.paper.published import PUBLISHED, TYPICAL_PRESSURE, Published
from app.report.paper.runs import SAME_LOAD, FigureRun, Runs, experiments
from app.settings.sections import Config


@dataclass(frozen=True)
class RunFindings:
    """The numbers of one run under its load, and what its analysis noted."""

    session: str
    load: float
    about: dict[str, str]
    numbers: tuple[Measurement, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Findings:
    """All numbers of the results.

    Attributes
    ----------
    inputs : tuple of Measurement
        What the operator gave, by the settings of the first run.
    differing : dict
        Setting that matters and differs from run to run -> its values.
    """

    runs: tuple[RunFindings, ...]
    joint: tuple[Measurement, ...]
    notes: tuple[str, ...]
    inputs: tuple[Measurement, ...]
    differing: dict[str, tuple[str, ...]]


def paper_of(measured: Measurement, load: float = math.nan) -> Published | None:
    """What the paper states of a number; None where that belongs to another load."""
    published = PUBLISHED.get(measured.key)
    if published and abs(load / published.load - 1) > SAME_LOAD:  # False where it belongs to all
        return None
    return published


def findings(results: StudyResults) -> Findings:
    """All numbers of the results."""
    runs = experiments(results)
    return Findings(
        tuple(_of_run(run) for run in runs),
        _of_all(results, runs),
        results.joint.notes,
        _inputs(runs[0].config) if runs else (),
        _differing(runs),
    )


def _of_run(run: FigureRun) -> RunFindings:
    s, origin = run.summary, run.run.origin
    numbers = [
        *summary_quantities(s),
        *further_quantities(s),
        *local_quantities(s),
        *_of_interface(run),
        *_of_work(run),
        *_of_slides(s),
        Measurement(f"noise of u_x, box {run.config.dic.box} px", "sigma", run.noise_px, unit="px",
                    key="noise_px"),
    ]  # fmt: skip
    names = ("started", "state", "reason", "sample", "operator", "note")
    about = {name: getattr(origin, name) for name in names}
    return RunFindings(origin.session, run.P, about, tuple(numbers), s.notes)


def _of_interface(run: FigureRun) -> list[Measurement]:
    check, s = checked_pressure(run), run.summary
    shares = s.shares("agreement")
    by_inputs = check.ratio * math.hypot(*shares.values()) if shares else math.nan
    return [
        _stiffness(*stiffness_at(run, TYPICAL_PRESSURE)),
        Measurement("E from the width of p(r)", "E_w", check.E, check.E_sd, "MPa",
                    key="young_modulus_of_width_pa"),
        Measurement("E over that from the width", "E/E_w", check.ratio, check.ratio_sd,
                    systematic=by_inputs, key="agreement", budget=shares),
        Measurement("chi2 of p(r) from Hertz's", "", check.hertz_chi2, key="pressure_chi2_hertz"),
        Measurement("chi2 of p(r) from Greenwood and Tripp's", "", check.rough_chi2,
                    key="pressure_chi2_rough"),
    ]  # fmt: skip


def _stiffness(k: float, sd: float) -> Measurement:
    name, key = "stiffness of the interface at 25 kPa", "stiffness_at_25_kpa_pa_m"
    return Measurement(name, "k", k, sd, "kPa/um", key=key)


def stiffness_at(run: FigureRun, pressure: float) -> tuple[float, float]:
    """Stiffness k = p/L of the interface of a run at a pressure, and its uncertainty; NaN where no
    ring tells L.
    """
    s = run.summary
    length = stiffness_length(s.pressure_pa, s.pressure_sd_pa, s.interface_stiffness_pa_m,
                              s.interface_stiffness_sd_pa_m)  # fmt: skip
    return _at_length(pressure, *length)


def _at_length(pressure: float, length: float, sd: float) -> tuple[float, float]:
    """The stiffness p/L and its uncertainty."""
    return pressure / length, pressure * sd / length**2


def _of_slides(s: Summary) -> Iterator[Measurement]:
    """Each slide of a protocol."""
    for i, step in enumerate(s.slide_step):
        after = f" after {s.slide_hold_s[i]:.4g} s" if s.slide_hold_s[i] > 0 else ""
        key, name = f"slide_{step}", f"step {step}{after}"
        peak, mu_d = (s.slide_peak[i], s.slide_peak_sd[i]), (s.slide_mu_d[i], s.slide_mu_d_sd[i])
        yield Measurement(f"{name}: greatest Q/P", "mu_s", *peak, key=f"{key}_peak")
        yield Measurement(f"{name}: Q/P at its end", "mu_d", *mu_d, key=f"{key}_mu_d")


def _of_work(run: FigureRun) -> Iterator[Measurement]:
    if (work := work_of(run)) is not None:
        yield Measurement("work of friction, by the traction", "W", float(work.local[-1]),
                          unit="uJ", key="work_of_traction_j")  # fmt: skip
        yield Measurement("work of friction, by Q(delta)", "W_Q", float(work.of_forces[-1]),
                          unit="uJ", key="work_of_forces_j")  # fmt: skip


def _of_all(results: StudyResults, runs: Runs) -> tuple[Measurement, ...]:
    j = results.joint
    keys = {"mu": "law_mu", "length_m": "law_length_m", "roughness_length_m": "bureau_length_m"}
    found = [replace(one, key=keys.get(one.key, one.key)) for one in joint_quantities(j)]
    if j.stiffness_length_m > 0:
        k, sd = _at_length(TYPICAL_PRESSURE, j.stiffness_length_m, j.stiffness_length_sd_m)
        found.append(replace(_stiffness(k, math.nan), combined=sd))
    if runs:
        sample, stated = runs[0].config.sample, runs[0].config.uncertainty
        rim_sd = sample.rim * math.hypot(stated.roughness / 2, stated.lens_radius / 2)
        found.append(Measurement("excess of a over a_H, by the roughness", "sqrt(R h)", sample.rim,
                                 unit="um", systematic=rim_sd, key="sqrt_rh_m"))  # fmt: skip
        excess = np.array([r.summary.apparent_radius_m - r.hertz_radius for r in runs])
        if np.isfinite(excess).any():
            known = excess[np.isfinite(excess)]
            sd = float(known.std(ddof=1)) / math.sqrt(len(known)) if len(known) > 1 else math.nan
            found.append(Measurement("mean excess of a over a_H, measured", "a - a_H",
                                     float(known.mean()), sd, "um", is_signed=True,
                                     key="excess_radius_m"))  # fmt: skip
    return tuple(found)


def _inputs(config: Config) -> tuple[Measurement, ...]:
    """What the results rest on, with the stated uncertainties."""
    sample, forces, camera = config.sample, config.forces, config.camera
    stated, dic = config.uncertainty, config.dic
    k_N, K_T = forces.stiffness
    k_sd, K_sd = forces.stiffness_uncertainty
    E, h, C = sample.young_modulus, sample.roughness, sample.lens_compliance
    given = [
        ("young_modulus_pa", "Young's modulus", "E", E, E * stated.young_modulus, "MPa"),
        ("poisson", "Poisson's ratio", "nu", sample.poisson, stated.poisson, ""),
        ("lens_radius_m", "radius of the lens", "R", sample.lens_radius,
         sample.lens_radius * stated.lens_radius, "mm"),
        ("roughness_m", "standard deviation of the heights", "h", h, h * stated.roughness, "um"),
        ("thickness_m", "thickness of the block, 0 for a half-space", "H", sample.thickness,
         sample.thickness * stated.thickness, "mm"),
        ("lens_compliance_m_n", "compliance of the lens holder", "", C, C * stated.lens_compliance,
         "um/N"),
        ("stiffness_normal_n_m", "normal cantilever", "k_N", k_N, k_sd, "N/m"),
        ("stiffness_shear_n_m", "tangential cantilever", "K_T", K_T, K_sd, "N/m"),
        ("pixel_m", "pixel on the interface", "", camera.pixel, camera.pixel * stated.pixel, "um"),
        ("frame_rate_hz", "images per second", "", config.frame_rate_hz, math.nan, "Hz"),
        ("box_px", "correlation box", "lambda", float(dic.box), math.nan, "px"),
        ("step_px", "pitch of the boxes", "", float(dic.step), math.nan, "px"),
        ("velocity_m_s", "velocity that was prescribed", "v", config.run.velocity, math.nan,
         "um/s"),
    ]  # fmt: skip
    return tuple(
        Measurement(name, symbol, value, unit=unit, systematic=sd, key=key)
        for key, name, symbol, value, sd, unit in given
    )


def _differing(runs: Runs) -> dict[str, tuple[str, ...]]:
    """Inputs that are not the same in all runs."""
    rows = [_inputs(run.config) for run in runs]
    return {
        column[0].key: tuple(map(str, column))
        for column in zip(*rows, strict=True)
        if len({one.value for one in column}) > 1
    }
