"""Figures that the paper could not have: the measured pressure, what the inputs cost, what friction
dissipates where, the stiffness of the interface, the law over the loads.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from analysis.arrays import F64, all_floats
from analysis.friction.local_law import LocalLaw
from analysis.friction.pressure import PressureCheck, check_pressure
from analysis.mechanics import hertz
from analysis.mechanics.interface import elastic_length
from app.records.quantities import with_uncertainty
from app.records.study_results import Joint
from app.report.figures import BLUE, GREY, RED
from app.report.grey import LIGHTNESS
from app.report.paper import published
from app.report.paper.published import FIELDS_AT
from app.report.paper.runs import (
    FigureRun,
    Runs,
    load_text,
    nearest,
    of_delta,
    of_each,
    those,
)
from app.report.paper.style import (
    Drawn,
    NotDrawn,
    Table,
    draw_bars,
    draw_columns,
    draw_letters,
    new_panels,
    palette,
    stacked,
)

SYMBOLS = {  # of the results that have a budget, as text of a figure
    "apparent_radius": "$a$",
    "hertz_radius": "$a_H$",
    "onset_time": "$t_s$",
    "static_force": "$Q_s$",
    "mu_s": r"$\mu_s$",
    "mu_d": r"$\mu_d$",
    "law_mu": r"$\mu$",
    "law_length": "$L$",
    "young_modulus": "$E$",
    "sliding_velocity": "$v$",
    "pressure": "$p(0)$",
    "stress": r"$\sigma_{xz}$",
    "block_displacement": "$D$",
    "peak_radius": "$c$",
    "agreement": "$E/E_w$",
}
SPREAD_COLOUR = "#9dbbe0"
CAPS = {"elinewidth": 0.7, "capsize": 2, "capthick": 0.7}


def checked_pressure(run: FigureRun) -> PressureCheck:
    """The measured pressure of a run beside its models, with uncertainties by noise."""
    s, sample = run.summary, run.config.sample
    law = LocalLaw(
        E=s.young_modulus_pa,
        E_sd=s.young_modulus_sd_pa,
        radius=np.asarray(s.pressure_radius_m),
        pressure=np.asarray(s.pressure_pa),
        pressure_sd=np.asarray(s.pressure_sd_pa),
    )
    return check_pressure(law, run.P, sample.poisson, sample.lens_radius, sample.roughness)


def pressures(runs: Runs) -> Drawn:
    """p(r) as measured, beside Hertz's and Greenwood and Tripp's."""
    known = [(run, check) for run in runs if (check := checked_pressure(run)).hertz.size]
    if not known:
        raise NotDrawn("no run has a measured pressure: none gave a local law")
    figure, panels = new_panels(len(known), 56, 3)
    tables = []
    for panel, (run, check) in zip(panels, known, strict=False):
        s = run.summary
        r, p, sd = all_floats(s.pressure_radius_m, s.pressure_pa, s.pressure_sd_pa)
        table: Table = {"P_N": run.P, "r_mm": r * 1e3, "p_kPa": p * 1e-3, "p_sd_kPa": sd * 1e-3,
                 "p_hertz_kPa": check.hertz * 1e-3,
                 "p_greenwood_tripp_kPa": check.rough * 1e-3}  # fmt: skip
        tables.append(table)
        at, low, high = table["r_mm"], (p - sd) * 1e-3, (p + sd) * 1e-3
        panel.fill_between(at, low, high, color=SPREAD_COLOUR, lw=0, label="± by noise")
        draw_columns(panel, table, "r_mm", "p_kPa", ".", ms=3, color=BLUE, label="measured")
        panel.plot(*_hertz_profile(run, check, at), "--", color=RED, label="Hertz")
        panel.plot(at, table["p_greenwood_tripp_kPa"], color="black", lw=0.9,
                   label="Greenwood-Tripp")  # fmt: skip
        panel.set_title(f"$P$ = {run.P:.3g} N", loc="left")
        panel.set(xlim=(0, at[-1]), ylim=(min(0.0, float(np.nanmin(low))), None))
        far = (f"{chi2:.2g}" if chi2 < 99.5 else f"{chi2:.0f}"
               for chi2 in (check.hertz_chi2, check.rough_chi2))  # fmt: skip
        panel.set_title(rf"$\chi^2$: {', '.join(far)}", loc="right")
        if not panel.get_subplotspec().is_first_col():
            panel.set_ylabel("")
    panels[0].legend(loc="lower left", handlelength=1.4)
    return Drawn(
        figure,
        {"": stacked(tables)},
        "Pressure p(r) measured without a model: the shear traction of steady sliding over mu, with"
        " its standard uncertainty by noise (band), beside Hertz's and Greenwood and Tripp's for"
        " the modulus of the run and the roughness of the settings. chi2: the mean square distance"
        " from Hertz's and from Greenwood and Tripp's in that uncertainty.",
    )


def _hertz_profile(run: FigureRun, check: PressureCheck, at: F64) -> tuple[F64, F64]:
    """Hertz's pressure between the rings at `at` (mm), kPa: their corners would slant its end."""
    a = run.own_hertz_radius
    fine = a * np.sqrt(1 - np.linspace(1, 0, 200) ** 2)
    return np.append(fine, at[-1] * 1e-3) * 1e3, np.append(
        hertz.pressure(fine, run.P, a), 0.0
    ) * 1e-3


def error_budget(runs: Runs) -> Drawn:
    """What the uncertainty of each input costs each result."""
    known = those(
        runs, lambda run: run.summary.budget_inputs, "no run has a budget of its uncertainties"
    )
    run = nearest(known, FIELDS_AT)
    s = run.summary
    quantities = list(s.budget_quantities)
    shares = np.array([list(s.shares(q).values()) for q in quantities]) * 100
    whole = np.array([s.systematic(q) for q in quantities]) * 100
    numbers = np.column_stack([shares, whole])
    values = np.abs(numbers)
    figure, (axes,) = new_panels(1, 23 + 6 * len(quantities), wide=True)
    narrow = figure.get_figwidth() < 6
    size = min(6.5, 14.0 * figure.get_figwidth() / (len(s.budget_inputs) + 1))
    top = max(float(np.nanmax(values)), 1e-6)
    cells = axes.imshow(
        np.sqrt(values), cmap=palette().amount, vmin=0, vmax=math.sqrt(top), aspect="auto"
    )
    light = cells.to_rgba(cells.get_array())[..., :3] @ LIGHTNESS
    for row, column in np.ndindex(*values.shape):
        if values[row, column] >= 0.005:
            ink = "black" if light[row, column] > 0.45 else "white"
            sign = "" if column == len(s.budget_inputs) else "+"
            text = _two_digits(float(numbers[row, column]), sign)
            axes.text(column, row, text, ha="center", va="center", fontsize=size, color=ink)
    names = [*s.budget_inputs, "all inputs"]
    axes.set_xticks(range(len(names)), names, rotation=35, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(quantities)), [SYMBOLS.get(q, q) for q in quantities])
    axes.tick_params(length=0)
    axes.axvline(len(names) - 1.5, color="black", lw=0.8)
    whose = "" if narrow else " by one standard uncertainty of each input"
    axes.set_title(f"change of each result{whose} (%), {run.name}")
    tables = [
        {
            "P_N": one.P,
            "quantity": quantity,
            "input": list(one.summary.budget_inputs),
            "relative_sd": list(one.summary.shares(quantity).values()),
        }
        for one in known
        for quantity in one.summary.budget_quantities
    ]
    return Drawn(
        figure,
        {"": stacked(tables)},
        "Relative change in per cent of each result (rows) by one standard uncertainty of each"
        f" input (columns) at {load_text(run, FIELDS_AT)}, and of all inputs together; less than"
        " 0.005 % is left empty. The table has all loads.",
    )


def _two_digits(number: float, sign: str) -> str:
    """A number with two significant digits and a true minus sign."""
    digits = max(0, 1 - math.floor(math.log10(abs(number))))
    return f"{number:{sign}.{digits}f}".replace("-", "\N{MINUS SIGN}")


class Work(NamedTuple):
    """Work of friction during a first loading: per area in the last frame before t_s
    (J/m^2, over `radius`); over the contact, and from the forces (J, over the frames `rows`).
    """

    radius: F64
    per_area: F64
    rows: np.ndarray
    local: F64
    of_forces: F64


def work_of(run: FigureRun) -> Work | None:
    """The work of the traction along the local displacement, and that of the stage less what the
    cantilever, the lens holder and the block store; None where there is no traction.

    The block stores ``(Q D - sum of sigma u_x)/2``, with the displacement u_x that the lens sees.
    """
    r = run.stress_radius
    if not r.size:
        return None
    of_frames = run.ux_at(r), run.stress, run.series("block_m"), run.Q, run.delta
    whole = np.column_stack(of_frames)
    rows = np.flatnonzero(np.isfinite(whole).all(axis=1))
    if len(rows) < 3:
        return None
    s, sigma, D, Q, x = (one[rows] for one in of_frames)
    area = np.pi * np.diff(np.append(r - r[0], r[-1] + r[0]) ** 2)
    density = _summed(s, sigma)
    stored = 0.5 * ((sigma @ area) * D - (sigma * s) @ area)
    soft = 1 / run.config.forces.stiffness_shear + run.config.sample.lens_compliance
    of_forces = _summed(x[:, None], Q[:, None])[:, 0] - 0.5 * soft * Q**2 - stored
    stuck = np.flatnonzero(run.loading[rows])
    last = density[stuck[-1]] if len(stuck) else np.full(len(r), np.nan)
    return Work(r, last, rows, density @ area, of_forces)


def _summed(x: F64, force: F64) -> F64:
    """Work along each column from rest on, in which the first point is reached in a straight
    line.
    """
    force, x = (np.pad(one, ((1, 0), (0, 0))) for one in (force, x))
    return np.asarray(cumulative_trapezoid(force, x, axis=0))


def dissipation(runs: Runs) -> Drawn:
    """Where friction takes how much work, and whether it is the work of the forces."""
    known = [(run, work) for run in runs if (work := work_of(run)) is not None]
    if not known:
        raise NotDrawn("no run has a shear traction along a displacement")
    figure, (left, right) = new_panels(2, 70, 2)
    profiles, totals = [], []
    for run, work in known:
        profile = {"P_N": run.P, "r_mm": work.radius * 1e3, "work_J_per_m2": work.per_area}
        total = {"P_N": run.P, "delta_um": run.delta[work.rows] * 1e6,
                 "work_of_traction_uJ": work.local * 1e6,
                 "work_of_forces_uJ": work.of_forces * 1e6}  # fmt: skip
        draw_columns(left, profile, "r_mm", "work_J_per_m2", color=run.colour, label=run.name)
        right.plot(total["delta_um"], total["work_of_forces_uJ"], color="black", lw=0.8)
        draw_columns(right, total, "delta_um", "work_of_traction_uJ", "o", ms=3, color=run.colour,
                     markevery=max(1, len(work.local) // 16))  # fmt: skip
        profiles.append(profile)
        totals.append(total)
    draw_letters((left, right))
    left.set_xlim(left=0)
    left.legend(title="$P$")
    right.plot([], [], "o", ms=3, color=GREY, label=r"$\int\int\sigma_{xz}\,du_x\,dA$")
    right.plot([], [], color="black", lw=0.8, label=r"area under $Q(\delta)$, less what is stored")
    right.set_xlim(left=0)
    right.set_yscale("log")  # all loads begin alike
    most = max(float(np.nanmax(total["work_of_traction_uJ"])) for total in totals)
    right.set_ylim(1e-3 * most, 2 * most)
    right.legend(loc="lower right")
    return Drawn(
        figure,
        {"a": stacked(profiles), "b": stacked(totals)},
        "(a) Work of the shear traction along the local displacement, per area, from rest to"
        " the last frame before t_s. (b) The same over the whole contact as"
        " the loading goes on (disks), and from the forces (lines): the area under Q(delta) less"
        " what the cantilever, the holder of the lens and the block store elastically."
        + of_delta([run for run, _ in known]),
    )


def stiffnesses(runs: Runs, joint: Joint) -> Drawn:
    """Stiffness of the interface over r, and over the pressure."""
    known = those(
        runs,
        lambda run: np.isfinite(run.summary.interface_stiffness_pa_m).any(),
        "no run has a stiffness of the interface",
    )
    figure, (left, right) = new_panels(2, 70, 2)
    tables = []
    for run in known:
        s = run.summary
        r, p, k, sd = all_floats(
            s.pressure_radius_m,
            s.pressure_pa,
            s.interface_stiffness_pa_m,
            s.interface_stiffness_sd_pa_m,
        )
        table = {"P_N": run.P, "r_mm": r * 1e3, "p_kPa": p * 1e-3, "k_GPa_per_m": k * 1e-9,
                 "k_sd_GPa_per_m": sd * 1e-9}  # fmt: skip
        for axes, x, line, name in ((left, "r_mm", "o-", run.name), (right, "p_kPa", "o", None)):
            draw_bars(axes, table, x, "k_GPa_per_m", fmt=line, ms=2, lw=0.7, **CAPS,
                      color=run.colour, label=name)  # fmt: skip
        tables.append(table)
    sample = known[0].config.sample
    bureau = elastic_length(sample.roughness, sample.poisson)
    fine = np.linspace(0, right.get_xlim()[1], 2) * 1e3
    lines = [("--", RED, bureau, "Bureau et al.")]
    if math.isfinite(joint.stiffness_length_m):
        lines.append(("-", "black", joint.stiffness_length_m, "all rings"))
    for dash, colour, length, name in lines:
        if length > 0:
            right.plot(fine * 1e-3, fine / length * 1e-9, dash, color=colour, lw=1.0,
                       label=f"$p/L$, $L$ = {length * 1e6:.3g} µm ({name})")  # fmt: skip
    right.plot(
        published.TYPICAL_PRESSURE * 1e-3, published.TYPICAL_STIFFNESS * 1e-9, "*", ms=9,
        color="black", mec="white", mew=0.5, ls="", label="Prevost et al. 2013", zorder=4,
    )  # fmt: skip
    draw_letters((left, right))
    left.set_xlim(left=0)
    left.set_ylim(bottom=0)
    left.legend(title="$P$")
    right.set_xlim(0, fine[-1] * 1e-3)
    right.set_ylim(bottom=0)
    right.legend(loc="upper left")
    return Drawn(
        figure,
        {"": stacked(tables)},
        "Stiffness k of the interface: shear traction over small local slip, with its standard"
        " uncertainty by noise; (a) over r, (b) over the measured pressure, with p/L for L after"
        " Bureau et al. from the roughness of the settings and for that of all rings together."
        " Star: the paper's 30 kPa/µm at 25 kPa.",
    )


def law_over_loads(runs: Runs, joint: Joint) -> Drawn:
    """Mu and L of the local law over the load."""
    known = those(
        runs,
        lambda run: math.isfinite(run.summary.law_mu + run.summary.law_length_m),
        "no run has a local friction law",
    )
    (P,) = of_each(known, "normal_force_n")
    figure, (left, right) = new_panels(2, 68, 2)
    draw_letters((left, right))
    table: dict[str, Any] = {"P_N": P}
    band = {"color": "#e6e6e6", "lw": 0, "label": "Prevost et al. 2013"}
    mu, mu_sd, L, L_sd = published.MU, published.MU_SD, published.LENGTH, published.LENGTH_SD
    left.axhspan(mu - mu_sd, mu + mu_sd, **band)
    right.axhspan((L - L_sd) * 1e6, (L + L_sd) * 1e6, **band)
    for axes, name, end, unit, key in (
        (left, "law_mu", "", 1.0, "mu"),
        (right, "law_length", "_m", 1e6, "L_um"),
    ):
        value, sd = (one * unit for one in of_each(known, name + end, f"{name}_sd{end}"))
        by_inputs = value * [run.summary.systematic(name) for run in known]
        axes.errorbar(P, value, np.hypot(sd, np.nan_to_num(by_inputs)), fmt="none", ecolor=GREY,
                      label="by noise and inputs", **CAPS)  # fmt: skip
        for run, one in zip(known, value, strict=True):
            axes.plot(run.P, one, "o", ms=3.5, color=run.colour, mec="black", mew=0.4, zorder=3)
        axes.errorbar(P, value, sd, fmt="none", ecolor="black", label="by noise", zorder=4,
                      **{**CAPS, "capsize": 3.5})  # fmt: skip
        table |= {key: value, f"{key}_sd": sd, f"{key}_sd_inputs": by_inputs}
        axes.set_xlabel("normal load $P$ (N)")
        axes.set_xlim(0, 1.08 * P[-1])
    fine = np.linspace(0.05, 1.08, 100) * P[-1]
    if math.isfinite(joint.mu):
        known_decay = math.isfinite(joint.decay)
        name = rf"$\mu_1 P^{{-n}}$, $\mu_1$ = {joint.mu:.3f}"
        if known_decay:
            digits = with_uncertainty(joint.decay, joint.decay_sd)
            name += f"\n$n$ = {' '.join(digits)}".replace("-", "\N{MINUS SIGN}")
        decay = joint.decay if known_decay else 0.0
        left.plot(fine, joint.mu * fine**-decay, color=BLUE, lw=0.9, label=name)
    if math.isfinite(joint.length_m):
        right.axhline(joint.length_m * 1e6, color=BLUE, lw=0.9,
                      label=f"all loads, {joint.length_m * 1e6:.3f} µm")  # fmt: skip
    sample = known[0].config.sample
    bureau = elastic_length(sample.roughness, sample.poisson) * 1e6
    if bureau:
        right.axhline(bureau, color=RED, ls="--", lw=0.9, label=f"Bureau et al., {bureau:.3g} µm")
    left.set_ylabel(r"$\mu$ of the local law")
    right.set_ylabel("$L$ (µm)")
    for axes in (left, right):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.3 * (high - low))
        axes.legend(loc="upper left", ncols=2, columnspacing=1.0)
    return Drawn(
        figure,
        {"": table},
        "Friction coefficient mu (a) and length L (b) of the local law over P, with their standard"
        " uncertainties by noise (thick) and by noise and inputs together (thin); shaded: the"
        " paper's mu = 0.93 ± 0.08 and L = 0.80 ± 0.23 µm of all its loads.",
    )
