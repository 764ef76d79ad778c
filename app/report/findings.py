"""Every number of an analysis of sessions, of each run and of all together, with its uncertainty by
noise and by the operator's inputs, what each input costs, and what the paper states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.mechanics.interface import elastic_length
from app.records.quantities import KEYS, Measurement, summary_quantities
from app.records.study_results import StudyResults
from app.records.summary import Summary
from app.report.paper.beyond import checked_pressure, work_of
from app.report.paper.published import PUBLISHED, TYPICAL_PRESSURE, Published
from app.report.paper.runs import SAME_LOAD, FigureRun, experiments
from app.settings.sections import Config

CENTRAL = 3  # rings whose mean is told for the centre


@dataclass(frozen=True)
class Finding:
    """One number: its key in `summary.json`, which names its SI unit; what each input costs it,
    relative and with its sign; the paper's number.
    """

    key: str
    measured: Measurement
    budget: dict[str, float] = field(default_factory=dict)
    paper: Published | None = None

    def at(self, load: float) -> Finding:
        """Without the paper's number where that belongs to another load."""
        told = self.paper
        if told and abs(load / told.load - 1) > SAME_LOAD:  # False where it belongs to all
            return replace(self, paper=None)
        return self


@dataclass(frozen=True)
class RunFindings:
    """The numbers of one run, and what its analysis noted."""

    session: str
    about: dict[str, str]
    numbers: tuple[Finding, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Findings:
    """All numbers of the results.

    Attributes
    ----------
    inputs : tuple of Finding
        What the operator gave, by the settings of the first run.
    differing : dict
        Setting that matters and differs from run to run -> its values.
    """

    runs: tuple[RunFindings, ...]
    joint: tuple[Finding, ...]
    notes: tuple[str, ...]
    inputs: tuple[Finding, ...]
    differing: dict[str, tuple[str, ...]]


def _finding(
    key: str,
    name: str,
    symbol: str,
    value: float,
    sd: float = math.nan,
    unit: str = "",
    systematic: float = math.nan,
    is_signed: bool = False,
) -> Finding:
    measured = Measurement(
        name, symbol, value, sd, unit, systematic=systematic, is_signed=is_signed
    )
    return Finding(key, measured, paper=PUBLISHED.get(key))


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
    numbers = []
    for measured in summary_quantities(s):
        key, budget = KEYS[measured.symbol]
        told = Finding(key, measured, s.shares(budget), PUBLISHED.get(key)).at(run.P)
        numbers.append(told)
    numbers += [
        _finding("mu_d_least", "least Q/P while it slides", "", s.mu_d_range[0]),
        _finding("mu_d_greatest", "greatest Q/P while it slides", "", s.mu_d_range[1]),
        _finding("law_chi2", "reduced chi2 of the local law", "chi2", s.law_chi2),
        _finding("calibration_sd", "calibration, relative, of every mu", "u(mu)",
                 s.calibration_sd),
        *_of_interface(run),
        *_of_width(run),
        *_of_work(run),
        *_of_slides(run.summary),
    ]  # fmt: skip
    box = f"noise of u_x, box {run.config.dic.box} px"
    numbers.append(_finding("noise_px", box, "sigma", run.noise_px, unit="px"))
    about = {
        "started": origin.started,
        "state": origin.state,
        "reason": origin.reason,
        "sample": origin.sample,
        "operator": origin.operator,
        "note": origin.note,
    }
    return RunFindings(origin.session, about, tuple(numbers), s.notes)


def _centre(values: Sequence[float]) -> float:
    known = [v for v in values[:CENTRAL] if math.isfinite(v)]
    return math.fsum(known) / len(known) if known else math.nan


def _of_interface(run: FigureRun) -> list[Finding]:
    s = run.summary
    p0 = _centre(s.pressure_pa)
    by_inputs = abs(p0) * s.systematic("pressure")
    pressure = _finding("pressure_pa", "pressure at the centre", "p(0)", p0,
                        _centre(s.pressure_sd_pa), "kPa", by_inputs)  # fmt: skip
    k, k_sd = stiffness_at(run, TYPICAL_PRESSURE)
    return [
        replace(pressure, budget=s.shares("pressure")),
        _finding(
            "interface_stiffness_pa_m", "stiffness of the interface, centre", "k(0)",
            _centre(s.interface_stiffness_pa_m), _centre(s.interface_stiffness_sd_pa_m), "kPa/um",
        ),
        _finding("stiffness_at_25_kpa_pa_m", "stiffness of the interface at 25 kPa", "k", k, k_sd,
                 "kPa/um"),
        _finding("precursor_slip_m", "slip at the centre at t_s", "s_0",
                 _centre(s.precursor_slip_m), unit="um"),
    ]  # fmt: skip


def stiffness_at(run: FigureRun, pressure: float) -> tuple[float, float]:
    """Stiffness k at a pressure, of a line k = p/L through all rings of a run, and its
    uncertainty, widened where they scatter by more than theirs.
    """
    s = run.summary
    p, k, sd = (
        np.asarray(v)
        for v in (s.pressure_pa, s.interface_stiffness_pa_m, s.interface_stiffness_sd_pa_m)
    )
    if not len(p) == len(k) == len(sd):
        return math.nan, math.nan
    good = np.isfinite(p) & np.isfinite(k) & (sd > 0)
    power = float(((p[good] / sd[good]) ** 2).sum())
    if not power > 0:
        return math.nan, math.nan
    slope = float((p[good] * k[good] / sd[good] ** 2).sum()) / power
    chi2 = float((((k - slope * p)[good] / sd[good]) ** 2).sum()) / max(int(good.sum()) - 1, 1)
    return pressure * slope, pressure * math.sqrt(max(chi2, 1.0) / power)


def _of_slides(s: Summary) -> list[Finding]:
    """Each slide of a protocol, and the ageing of the contact while it is held."""
    found = [
        _finding("ageing_rate", "rise of mu_s per e-fold of a hold", "beta", s.ageing_rate,
                 s.ageing_rate_sd, is_signed=True),
        _finding("ageing_time_s", "time from which it ages", "t_0", s.ageing_time_s,
                 s.ageing_time_sd_s, "s"),
    ]  # fmt: skip
    for i, step in enumerate(s.slide_step):
        after = f" after {s.slide_hold_s[i]:.4g} s" if s.slide_hold_s[i] > 0 else ""
        key, name = f"slide_{step}", f"step {step}{after}"
        peak, mu_d = (s.slide_peak[i], s.slide_peak_sd[i]), (s.slide_mu_d[i], s.slide_mu_d_sd[i])
        found += [
            _finding(f"{key}_peak", f"{name}: greatest Q/P", "mu_s", *peak),
            _finding(f"{key}_mu_d", f"{name}: Q/P at its end", "mu_d", *mu_d),
        ]
    return found


def _of_width(run: FigureRun) -> list[Finding]:
    check, s = checked_pressure(run), run.summary
    return [
        _finding("young_modulus_of_width_pa", "E from the width of p(r)", "E_w", check.E,
                 check.E_sd, "MPa"),
        replace(
            _finding("agreement", "E over that from the width", "E/E_w", check.ratio,
                     check.ratio_sd),
            budget=s.shares("agreement"),
        ),
        _finding("pressure_chi2_hertz", "chi2 of p(r) from Hertz's", "", check.hertz_chi2),
        _finding("pressure_chi2_rough", "chi2 of p(r) from Greenwood and Tripp's", "",
                 check.rough_chi2),
    ]  # fmt: skip


def _of_work(run: FigureRun) -> list[Finding]:
    s, found = run.summary, []
    if (work := work_of(run)) is not None:
        found = [
            _finding("work_of_traction_j", "work of friction, by the traction", "W",
                     float(work.local[-1]), unit="uJ"),
            _finding("work_of_forces_j", "work of friction, by Q(delta)", "W_Q",
                     float(work.of_forces[-1]), unit="uJ"),
        ]  # fmt: skip
    for number, loop in enumerate(s.loop_work_j, 1):
        local = s.local_work_j[number - 1] if s.local_work_j else math.nan
        found += [
            _finding(f"loop_work_{number}_j", f"work of cycle {number}", "W", loop, unit="uJ"),
            _finding(
                f"local_work_{number}_j",
                f"work of cycle {number}, by the local slip",
                "W",
                local,
                unit="uJ",
            ),
        ]
    if s.masing:
        found.append(_finding("masing", "distance from Masing's rule, at most", "", max(s.masing)))
    return found


def _of_all(results: StudyResults, runs: Sequence[FigureRun]) -> tuple[Finding, ...]:
    j = results.joint
    found = [
        _finding("young_modulus_pa", "Young's modulus, all loads", "E", j.young_modulus_pa,
                 j.young_modulus_sd_pa, "MPa"),
        _finding("law_length_m", "length of the local law, all loads", "L", j.length_m,
                 j.length_sd_m, "um"),
        _finding("law_mu", "mu of the local law at 1 N", "mu_1", j.mu, j.mu_sd),
        _finding("decay", "exponent of the fall of mu with P", "", j.decay, j.decay_sd,
                 is_signed=True),
        _finding("stiffness_length_m", "L by the stiffness of all rings, p/k", "L_k",
                 j.stiffness_length_m, j.stiffness_length_sd_m, "um"),
    ]  # fmt: skip
    if j.stiffness_length_m > 0:
        k = TYPICAL_PRESSURE / j.stiffness_length_m
        sd = k * j.stiffness_length_sd_m / j.stiffness_length_m
        found.append(_finding("stiffness_at_25_kpa_pa_m", "stiffness of the interface at 25 kPa",
                              "k", k, sd, "kPa/um"))  # fmt: skip
    if runs:
        sample, told = runs[0].config.sample, runs[0].config.uncertainty
        length = elastic_length(sample.roughness, sample.poisson)
        found += [
            _finding("bureau_length_m", "L after Bureau et al., by the roughness", "L(h)", length,
                     unit="um", systematic=length * told.roughness),
            _finding("sqrt_rh_m", "excess of a over a_H, by the roughness", "sqrt(R h)", sample.rim,
                     unit="um", systematic=sample.rim * math.hypot(told.roughness / 2,
                                                                   told.lens_radius / 2)),
        ]  # fmt: skip
        excess = np.array([r.summary.apparent_radius_m - r.hertz_radius for r in runs])
        if np.isfinite(excess).any():
            known = excess[np.isfinite(excess)]
            sd = float(known.std(ddof=1)) / math.sqrt(len(known)) if len(known) > 1 else math.nan
            found.append(_finding("excess_radius_m", "mean excess of a over a_H, measured",
                                  "a - a_H", float(known.mean()), sd, "um",
                                  is_signed=True))  # fmt: skip
    return tuple(found)


def _inputs(config: Config) -> tuple[Finding, ...]:
    """What the results rest on, with the stated uncertainties."""
    sample, forces, camera = config.sample, config.forces, config.camera
    told, dic = config.uncertainty, config.dic
    k_N, K_T = forces.stiffness
    k_sd, K_sd = forces.stiffness_uncertainty
    E, h, C = sample.young_modulus, sample.roughness, sample.lens_compliance
    given = [
        ("young_modulus_pa", "Young's modulus", "E", E, E * told.young_modulus, "MPa"),
        ("poisson", "Poisson's ratio", "nu", sample.poisson, told.poisson, ""),
        ("lens_radius_m", "radius of the lens", "R", sample.lens_radius,
         sample.lens_radius * told.lens_radius, "mm"),
        ("roughness_m", "standard deviation of the heights", "h", h, h * told.roughness, "um"),
        ("thickness_m", "thickness of the block, 0 for a half-space", "H", sample.thickness,
         sample.thickness * told.thickness, "mm"),
        ("lens_compliance_m_n", "compliance of the lens holder", "", C, C * told.lens_compliance,
         "um/N"),
        ("stiffness_normal_n_m", "normal cantilever", "k_N", k_N, k_sd, "N/m"),
        ("stiffness_shear_n_m", "tangential cantilever", "K_T", K_T, K_sd, "N/m"),
        ("pixel_m", "pixel on the interface", "", camera.pixel, camera.pixel * told.pixel, "um"),
        ("frame_rate_hz", "images per second", "", config.frame_rate_hz, math.nan, "Hz"),
        ("box_px", "correlation box", "lambda", float(dic.box), math.nan, "px"),
        ("step_px", "pitch of the boxes", "", float(dic.step), math.nan, "px"),
        ("velocity_m_s", "velocity that was prescribed", "v", config.run.velocity, math.nan,
         "um/s"),
    ]  # fmt: skip
    return tuple(
        _finding(key, name, symbol, value, unit=unit, systematic=sd)
        for key, name, symbol, value, sd, unit in given
    )


def _differing(runs: Sequence[FigureRun]) -> dict[str, tuple[str, ...]]:
    """Inputs that are not the same in all runs."""
    rows = [_inputs(run.config) for run in runs]
    return {
        column[0].key: tuple(str(one.measured) for one in column)
        for column in zip(*rows, strict=True)
        if len({one.measured.value for one in column}) > 1
    }
