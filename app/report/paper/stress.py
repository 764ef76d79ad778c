"""Shear tractions, their balance with Q, and their profiles: Figs 9 and 13.

References
----------
Prevost et al. 2013, sections 3 and 4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.arrays import F64
from analysis.mechanics import cattaneo_mindlin, hertz
from app.report.figures import GREY
from app.report.paper.published import BALANCES_AT, STRESSES_AT
from app.report.paper.runs import (
    FigureRun,
    Runs,
    box_mean,
    loads_text,
    nearest_of,
    of_delta,
    of_each,
    those,
)
from app.report.paper.style import (
    Drawn,
    Table,
    blue_to_red,
    draw_columns,
    name_axes,
    new_panels,
    stacked,
)

FEWER = 10  # one measured point of so many is shown (Fig. 9)
EVERY_S = 1.25  # a profile (Fig. 13)
FINE = 200  # radii at which the model is drawn: the rings would cut its peaks


def force_balance(runs: Runs) -> Drawn:
    """Fig. 9: Q by the sensor and by the sum of the traction; inset E(P)."""
    summed = those(
        runs,
        lambda r: np.isfinite(r.series("stress_force_n") * r.Q).any(),
        "no run has a shear traction that could be summed",
    )
    shown = nearest_of(summed, BALANCES_AT)
    figure, (axes,) = new_panels(1, 76)
    tables = []
    for run in shown:
        table: Table = {
            "P_N": run.P,
            "delta_um": run.delta * 1e6,
            "Q_N": run.Q,
            "Q_of_stress_N": run.series("stress_force_n") * run.stress_scale,
            "Q_of_stress_sd_N": run.series("stress_force_sd_n") * run.stress_scale,
        }
        draw_columns(axes, table, "delta_um", "Q_N", color="black", lw=1.0)
        axes.plot(table["delta_um"], table["Q_of_stress_N"], "o", ms=4, color=run.colour,
                  mec="black", mew=0.4, markevery=FEWER,
                  label=f"sum of the traction, {run.name}")  # fmt: skip
        tables.append(table)
    axes.plot([], [], color="black", label="force sensor")
    axes.set_xlim(left=0)
    top = max(float(np.nanmax(run.Q)) for run in shown)
    axes.set_ylim(0, 1.15 * top)
    axes.legend(loc="upper left")
    moduli = _moduli(axes, runs)
    tables_of = {"": stacked(tables)} | ({"_inset": moduli} if moduli else {})
    sample = runs[0].config.sample
    return Drawn(
        figure,
        tables_of,
        "Q against delta as measured by the force sensor (black) and by the sum of the shear"
        f" traction over the contact (disks, one point of {FEWER}) at"
        f" {loads_text(shown, BALANCES_AT)}. Inset: the modulus E of the balance against"
        f" P; shaded: E = {sample.young_modulus * 1e-6:.3g} MPa of the settings with its"
        f" uncertainty.{of_delta(shown)}",
    )


def _moduli(axes: Any, runs: Runs) -> Table:
    """Draw E(P) into a corner; its table, empty where there is none."""
    known = [run for run in runs if math.isfinite(run.summary.young_modulus_pa)]
    if not known:
        return {}
    inset = axes.inset_axes((0.56, 0.13, 0.42, 0.36))
    P, E, sd = of_each(known, "normal_force_n", "young_modulus_pa", "young_modulus_sd_pa")
    E, sd = E * 1e-6, sd * 1e-6
    by_inputs = E * [run.summary.systematic("young_modulus") for run in known]
    config = known[0].config
    stated = config.sample.young_modulus * 1e-6
    spread = stated * config.uncertainty.young_modulus
    inset.axhspan(stated - spread, stated + spread, color="#d9d9d9", lw=0)
    inset.errorbar(P, E, np.nan_to_num(sd), fmt="none", ecolor="black", elinewidth=1.2)
    inset.errorbar(P, E, np.hypot(np.nan_to_num(sd), np.nan_to_num(by_inputs)), fmt="none",
                   ecolor=GREY, elinewidth=0.6, capsize=1.5)  # fmt: skip
    for run, value in zip(known, E, strict=True):
        inset.plot(run.P, value, "o", ms=3.5, color=run.colour, mec="black", mew=0.4)
    wide = max(1.6 * spread, 1.4 * float(np.abs(E - stated).max()))
    inset.set(xlim=(0, 1.1 * P[-1]), ylim=(stated - wide, stated + wide))
    inset.set_xlabel("$P$ (N)", labelpad=2)
    inset.set_ylabel("$E$ (MPa)", labelpad=3)
    return {"P_N": P, "E_MPa": E, "E_sd_MPa": sd, "E_sd_inputs_MPa": by_inputs}


def stress_profiles(runs: Runs) -> Drawn:
    """Fig. 13: sigma_xz(r) at two loads beside Cattaneo and Mindlin's, and at two radii over Q."""
    known = those(
        runs,
        lambda run: run.stress_radius.size and len(run.every(EVERY_S)),
        "no run has profiles of the shear traction before it slides",
    )
    shown = nearest_of(known, STRESSES_AT)
    figure, panels = new_panels(2 * len(shown), 62, 2)
    tables: dict[str, Table] = {}
    for column, run in enumerate(shown):
        for row, draw in enumerate((_draw_profiles, _draw_over_force)):
            panel, letter = panels[row * len(shown) + column], "abcd"[2 * row + column]
            panel.set_title(f"({letter})  $P$ = {run.P:.3g} N", loc="left")
            tables[letter] = draw(panel, run)
    above, below = ("(a), (b)", "(c), (d)") if len(shown) > 1 else ("(a)", "(c)")
    return Drawn(
        figure,
        dict(sorted(tables.items())),
        f"{above} Angularly averaged stress sigma_xz(r) at"
        f" {loads_text(shown, STRESSES_AT)}, every {EVERY_S:g} s: small Q in blue, high Q"
        " in red, with the modulus of the run. Thin dashed: Cattaneo and Mindlin's profiles for the"
        " same Q, with <mu_d> and a_H by that modulus, smoothed by the box of the correlation,"
        f" {shown[0].box * 1e6:.0f} µm; thick dashed: mu_s times Hertz's pressure. {below} sigma_xz"
        " at r = 0 and at r = 0.5 a"
        " against Q; lines: Cattaneo and Mindlin.",
    )


def _model(run: FigureRun, r: F64, Q: float) -> F64:
    """Cattaneo and Mindlin's traction at the force Q, smoothed by the box."""
    a = run.own_hertz_radius
    if not abs(Q) < run.mu * run.P:
        return np.full(len(r), np.nan)
    return box_mean(lambda at: cattaneo_mindlin.traction(at, Q, run.mu, run.P, a), r, run.box)


def _draw_profiles(axes: Any, run: FigureRun) -> Table:
    r, rows, Q = run.stress_radius, run.every(EVERY_S), run.Q
    force = max(float(np.nanmax(Q[rows])), 1e-9)
    fine = np.linspace(0, r[-1], FINE)
    tables = []
    for row in rows:
        colour = blue_to_red(Q[row] / force)
        both = _model(run, np.append(r, fine), float(run.steady_Q[row])) * 1e-3
        model, smooth = both[: len(r)], both[len(r) :]
        tables.append(
            {"time_s": run.time[row], "Q_N": Q[row], "r_mm": r * 1e3,
             "sigma_kPa": run.stress[row] * 1e-3, "sigma_CM_kPa": model}
        )  # fmt: skip
        draw_columns(axes, tables[-1], "r_mm", "sigma_kPa", color=colour, lw=0.9)
        axes.plot(fine * 1e3, smooth, "--", color=colour, lw=0.7)
    a, mu_s = run.own_hertz_radius, run.summary.mu_s
    if math.isfinite(mu_s):
        fine = np.linspace(0, 1.05 * a, 300)
        p = mu_s * hertz.pressure(fine, run.P, a) * 1e-3
        axes.plot(fine * 1e3, p, "--", color="black", lw=1.4, label=r"$\mu_s\sigma_{zz}$, Hertz")
    axes.plot([], [], "--", color=GREY, lw=0.6, label="Cattaneo-Mindlin")
    axes.plot([], [], color=GREY, lw=0.9, label="measured")
    axes.set_xlim(0, r[-1] * 1e3)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend(loc="upper right")
    return stacked(tables)


def _draw_over_force(axes: Any, run: FigureRun) -> Table:
    radii = np.array([0.0, 0.5 * run.apparent_radius])
    rows = np.flatnonzero(run.loading)
    measured = run.stress_at(radii)[rows] * 1e-3
    own = np.array([_model(run, radii, float(q)) for q in run.steady_Q[rows]]) * 1e-3
    table = {
        "Q_N": run.Q[rows],
        "sigma_0_kPa": measured[:, 0],
        "sigma_0.5a_kPa": measured[:, 1],
        "sigma_CM_0_kPa": own[:, 0],
        "sigma_CM_0.5a_kPa": own[:, 1],
    }
    force = np.linspace(0, run.mu * run.P, 80)[1:-1]
    model = np.array([_model(run, radii, q) for q in force]) * 1e-3
    pairs = (("o", "0", "black"), ("s", "0.5a", "#1f5fa8"))
    for k, (marker, at, colour) in enumerate(pairs):
        axes.plot(table["Q_N"], table[f"sigma_{at}_kPa"], marker, ms=2.5, mfc="none", mew=0.7,
                  color=colour, label=f"$r = {at}$")  # fmt: skip
        axes.plot(force, model[:, k], color=colour, lw=0.9)
    axes.plot([], [], color=GREY, lw=0.9, label="Cattaneo-Mindlin")
    name_axes(axes, "Q_N", "sigma_kPa")
    axes.set_xlim(0, 1.03 * run.mu * run.P)
    axes.legend(loc="upper left")
    return table
