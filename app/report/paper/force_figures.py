"""Forces, the onset of sliding and friction coefficients: Figs 5, 7 and 8.

References
----------
Prevost et al. 2013, section 3.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from app.records.snapshot_numbers import RADII
from app.report.figures import GREY, RADII_NAMES, RED, draw_numbers, draw_sliding
from app.report.paper.published import FIELDS_AT
from app.report.paper.runs import FigureRun, Runs, load_text, nearest, of_delta, of_each, those
from app.report.paper.style import (
    Drawn,
    Table,
    draw_columns,
    name_axes,
    new_panels,
    stacked,
)


def shear_forces(runs: Runs) -> Drawn:
    """Fig. 5: Q over the displacement, all loads."""
    driven = those(runs, lambda run: len(run.rows), "no run was driven")
    figure, (axes,) = new_panels(1, 70)
    shown = nearest(driven, FIELDS_AT)
    tables = [
        {
            "P_N": run.P,
            "time_s": run.time,
            "delta_um": run.delta * 1e6,
            "Q_N": run.Q,
            "instant": _numbers(run, run is shown),
        }
        for run in driven
    ]
    for run, table in zip(driven, tables, strict=True):
        draw_columns(axes, table, "delta_um", "Q_N", color=run.colour)
        _name_curve(axes, run, table)
    frames = shown.run.frames["frame"][shown.rows]
    rows = [int(i) for n in shown.run.instants.frame for i in np.flatnonzero(frames == n)]
    draw_numbers(axes, [(shown.delta[i] * 1e6, shown.Q[i]) for i in rows], shown.colour)
    axes.margins(y=0.08)
    axes.set_ylim(bottom=0)
    axes.set_xlim(0, 1.2 * axes.get_xlim()[1])  # room for the loads
    return Drawn(
        figure,
        {"": stacked(tables)},
        "Shear force Q against the displacement delta of the stage, for the loads"
        f" {', '.join(run.name for run in driven)} (bottom to top), first loading. Disks: the"
        " instants at which the fields of Figs 6 and 10 are shown, at"
        f" {load_text(shown, FIELDS_AT)}.{of_delta(driven)}",
    )


def _name_curve(axes: Any, run: FigureRun, table: Table) -> None:
    """Write the load beside the end of its curve."""
    known = np.flatnonzero(np.isfinite(table["delta_um"]) & np.isfinite(table["Q_N"]))
    if len(known):
        last = known[-1]
        axes.annotate(
            f"$P$ = {run.name}", (table["delta_um"][last], table["Q_N"][last]), (6, 0),
            textcoords="offset points", ha="left", va="center", fontsize=6.5,
        )  # fmt: skip


def _numbers(run: FigureRun, is_shown: bool) -> np.ndarray:
    """The number of the instant of each frame, 0 for none."""
    frame = run.run.frames["frame"][run.rows]
    of = {int(n): k for k, n in enumerate(run.run.instants.frame, 1)} if is_shown else {}
    return np.array([of.get(int(n), 0) for n in frame], np.int64)


def ring_displacements(runs: Runs) -> Drawn:
    """Fig. 7: u_x(r) in time at four radii, and the construction of t_s."""
    run = nearest(those(runs, lambda run: len(run.rows), "no run was driven"), FIELDS_AT)
    s, time = run.summary, run.time
    a = run.apparent_radius
    at = run.ux_at(np.array(RADII) * a) * 1e6
    at[:, 0] = run.series("centre_ux_m") * 1e6
    figure, (axes,) = new_panels(1, 70)
    table: Table = {"time_s": time, "Q_N": run.Q}
    table |= {f"ux_{name}_um": ux for name, ux in zip(RADII_NAMES, at.T, strict=True)}
    draw_sliding(axes, time, at.T, s)
    name_axes(axes, "time_s", "ux_0_um")
    slope = ""
    if math.isfinite(s.onset_time_s * s.sliding_velocity_m_s):
        slope = (
            " Dash-dotted: linear fit of u_x(r = 0) at long times, slope"
            f" {s.sliding_velocity_m_s * 1e6:.3g} µm/s; its intersection with u_x = 0 (arrow) is"
            f" t_s = {s.onset_time_s:.2f} s."
        )
    axes.set_xlim(0, float(time[-1]))
    return Drawn(
        figure,
        {"": table},
        f"Angularly averaged displacement u_x(r) for r = 0, 0.5a, 0.75a and a = {a * 1e3:.3f} mm at"
        f" {load_text(run, FIELDS_AT)}. Dotted: u_x = 0.{slope}",
    )


def friction_coefficients(runs: Runs) -> Drawn:
    """Fig. 8: mu_s and mu_d over the load, with Q_s(P) as an inset."""
    slid = those(
        runs,
        lambda run: math.isfinite(run.summary.mu_s + run.summary.mu_d),
        "no run reached steady sliding, so that there is no mu_s and no mu_d",
    )
    figure, (axes,) = new_panels(1, 76)
    P, mu_s, mu_s_sd, mu_d, mu_d_sd = of_each(
        slid, "normal_force_n", "mu_s", "mu_s_sd", "mu_d", "mu_d_sd"
    )
    Q_s, Q_s_sd, ranges = of_each(slid, "static_force_n", "static_force_sd_n", "mu_d_range")
    low, high = ranges.T
    bars = np.nan_to_num([mu_d - low, high - mu_d], posinf=0.0, neginf=0.0)
    axes.errorbar(P, mu_d, np.maximum(bars, 0), fmt="o", color="black", ms=4, elinewidth=0.8,
                  capsize=2, label=r"$\mu_d$")  # fmt: skip
    mu_s_by_inputs = mu_s * [run.summary.systematic("mu_s") for run in slid]
    mu_d_by_inputs = mu_d * [run.summary.systematic("mu_d") for run in slid]
    whole = np.hypot(np.nan_to_num(mu_s_sd), np.nan_to_num(mu_s_by_inputs))
    axes.errorbar(P, mu_s, whole, fmt="none", ecolor=GREY, elinewidth=0.8, capsize=3, capthick=0.8)
    axes.errorbar(P, mu_s, np.nan_to_num(mu_s_sd), fmt="o", color=RED, ms=4, elinewidth=1.6,
                  label=r"$\mu_s$")  # fmt: skip
    bottom, top = axes.get_ylim()
    axes.set(xlabel="normal load $P$ (N)", ylabel=r"friction coefficients $\mu_s$, $\mu_d$")
    axes.set_xlim(0, 1.08 * P[-1])
    axes.set_ylim(bottom - 0.1 * (top - bottom), top + 0.75 * (top - bottom))
    axes.legend(loc="upper left")  # the room above the data
    inset = axes.inset_axes((0.53, 0.63, 0.44, 0.34))
    inset.errorbar(P, Q_s, np.nan_to_num(Q_s_sd), fmt="o", color=RED, ms=2.5)
    inset.set(xlim=(0, 1.08 * P[-1]), ylim=(0, 1.12 * float(Q_s.max())))
    inset.set_xlabel("$P$ (N)", labelpad=2)
    inset.set_ylabel("$Q_s$ (N)", labelpad=3)
    table = {
        "P_N": P,
        "mu_s": mu_s,
        "mu_s_sd": mu_s_sd,
        "mu_s_sd_inputs": mu_s_by_inputs,
        "mu_d": mu_d,
        "mu_d_least": low,
        "mu_d_greatest": high,
        "mu_d_sd": mu_d_sd,
        "mu_d_sd_inputs": mu_d_by_inputs,
        "Q_s_N": Q_s,
        "Q_s_sd_N": Q_s_sd,
    }
    return Drawn(
        figure,
        {"": table},
        "Friction coefficients mu_s (red disks) and mu_d (black disks) against P. mu_s = Q_s/P with"
        " its standard uncertainty by noise (thick) and by noise and inputs together (grey), Q_s"
        " (inset) being the force at t_s of Fig. 7; mu_d is"
        " the mean of Q/P in sliding, its error bars the least and greatest Q/P there.",
    )
