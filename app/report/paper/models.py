"""Displacements and stick radii beside Cattaneo and Mindlin's: Figs 11, 12 and 14.

References
----------
Prevost et al. 2013, section 4; Johnson, Contact Mechanics, section 3.7.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.arrays import F64
from analysis.mechanics import cattaneo_mindlin, hertz
from app.report.figures import GREY
from app.report.paper.published import MODELS_AT, STRESSES_AT
from app.report.paper.runs import (
    FigureRun,
    Runs,
    box_mean,
    load_text,
    loads_text,
    nearest,
    nearest_of,
    those,
)
from app.report.paper.style import (
    Drawn,
    Table,
    blue_to_red,
    draw_bars,
    name_axes,
    new_panels,
    stacked,
)

EVERY_S = 1.0  # a profile: one image of 8 at 8 frames/s (Fig. 12)
MARKERS = (  # of a radius over a_H: its marker, its name, and its column
    (0.0, "o", "$r \\approx 0$", "dux_0_um"),
    (0.5, "s", "$r = 0.5a_H$", "dux_0.5a_H_um"),
    (1.0, "x", "$r = a_H$", "dux_a_H_um"),
    (1.5, "+", "$r = 1.5a_H$", "dux_1.5a_H_um"),
)
FEWER = 3  # one measured point of so many is shown (Fig. 14)


def sliding_displacements(runs: Runs) -> Drawn:
    """Fig. 11: the displacement in steady sliding, all loads on one curve."""
    known = those(
        runs,
        lambda run: run.mu > 0 and np.isfinite(_elastic(run)).any(),
        "no run slides with friction above 0 and a known t_s, so that there is no profile of steady"
        " sliding",
    )
    figure, (axes,) = new_panels(1, 70)
    tables: list[Table] = []
    widest = max(float(run.radius.max() / run.hertz_radius) for run in known)
    fine = np.linspace(0, widest, 200)
    for run in known:
        unit = run.mu * run.hertz_radius**2
        share = run.radius / run.hertz_radius
        measured, model = _elastic(run) / unit, johnson(run, run.radius) / unit
        axes.plot(share, measured, "o", ms=2.2, color=run.colour, label=run.name)
        curve = johnson(run, fine * run.hertz_radius) / unit
        axes.plot(fine, curve, "--", color="black", lw=0.7)
        tables.append(
            {"P_N": run.P, "r_mm": run.radius * 1e3, "r_over_a_H": share,
             "ux_over_mu_aH2_per_m": measured, "johnson_over_mu_aH2_per_m": model}
        )  # fmt: skip
    axes.plot([], [], "--", color="black", lw=0.7, label="Johnson")
    axes.set(xlabel="$r/a_H$", ylabel=r"$u_x/(\mu a_H^2)$  (m$^{-1}$)", xlim=(0, fine[-1]))
    axes.set_ylim(bottom=0)
    axes.legend(title="$P$")
    E = known[0].config.sample.young_modulus
    return Drawn(
        figure,
        {"": stacked(tables)},
        "u_x/(mu a_H^2) in steady sliding against r/a_H at all loads, mean of all frames from t_s"
        " on. u_x is counted from the block far away: the picture shows D - u_x, and D is fitted in"
        f" each frame. Dashed: Johnson's prediction with E = {E * 1e-6:.3g} MPa, averaged over the"
        " box of the correlation, for each load. mu is the mean of Q/P from t_s on.",
    )


def _elastic(run: FigureRun) -> F64:
    """Mean elastic displacement D - u_x of the frames that slide, at the rings."""
    bent = run.series("block_m")[:, None] - run.ux_at(run.radius)
    kept = bent[run.slides & np.isfinite(run.series("block_m"))]
    return kept.mean(axis=0) if len(kept) else np.full(len(run.radius), np.nan)


def johnson(run: FigureRun, r: F64) -> F64:
    """Displacement under mu times Hertz's pressure with the modulus of the settings, as the
    correlation sees it, metres.
    """
    sample, a = run.config.sample, run.hertz_radius
    G = hertz.shear_modulus(sample.young_modulus, sample.poisson)
    scale = hertz.peak_pressure(run.mu * run.P, a) / (2 * math.pi * G) * (1 - sample.poisson / 2)
    return box_mean(lambda at: scale * cattaneo_mindlin.phi0(at, a), r, run.box)


def loading_displacements(runs: Runs) -> Drawn:
    """Fig. 12: the displacement while the contact is loaded, and how far it is from the model."""
    known = those(
        runs,
        lambda run: run.radius.size and len(run.every(EVERY_S)),
        "no run has ring means of u_x before it slides",
    )
    run = nearest(known, MODELS_AT)
    figure, (left, right) = new_panels(2, 80, 2)
    top = run.mu * run.P
    tables = {"a": _draw_shifted(left, run, top), "b": _draw_deviations(right, run, top)}
    return Drawn(
        figure,
        tables,
        "(a) u_x/a_H against r/a_H during the loading phase at"
        f" {load_text(run, MODELS_AT)} (a_H = {run.hertz_radius * 1e3:.3f} mm), every {EVERY_S:g}"
        " s. Points: measured; lines: Cattaneo and Mindlin's prediction with E ="
        f" {run.config.sample.young_modulus * 1e-6:.3g} MPa, nothing adjusted. Each curve is"
        " shifted upwards by the same amount from the one before. (b) Deviation of the measured"
        " u_x(r) from the prediction against Q at four radii. Colours: Q, from blue to red.",
    )


def _draw_shifted(axes: Any, run: FigureRun, top: float) -> Table:
    a, rows = run.hertz_radius, run.every(EVERY_S)
    r = run.radius
    tall = float(np.nanmax(run.ux[rows][:, : len(r)])) / a
    step = 1.3 * tall / max(len(rows), 6)
    tables = []
    for n, row in enumerate(rows):
        Q, colour = float(run.Q[row]), blue_to_red(run.Q[row] / top)
        measured = run.ux[row, : len(r)] / a
        model = run.cattaneo_mindlin_ux(r, float(run.steady_Q[row])) / a
        axes.plot(r / a, 100 * (model + n * step), color=colour, lw=0.7)
        axes.plot(r / a, 100 * (measured + n * step), ".", ms=2, color=colour)
        tables.append(
            {"time_s": run.time[row], "Q_N": Q, "r_over_a_H": r / a, "ux_over_a_H": measured,
             "ux_CM_over_a_H": model, "shift": n * step}
        )  # fmt: skip
    axes.set(xlabel="$r/a_H$", ylabel=r"$100\,u_x/a_H$, shifted", xlim=(0, float(r[-1] / a)))
    axes.set_title(f"(a)  $P$ = {run.P:.3g} N", loc="left")
    return stacked(tables)


def _draw_deviations(axes: Any, run: FigureRun, top: float) -> Table:
    radii = np.array([share for share, *_ in MARKERS]) * run.hertz_radius
    radii[0] = run.radius[0]
    rows = np.flatnonzero(run.loading)
    Q = run.Q[rows]
    steady = run.steady_Q[rows].tolist()
    model = np.array([run.cattaneo_mindlin_ux(radii, q) for q in steady]).reshape(-1, len(radii))
    off = (run.ux_at(radii)[rows] - model) * 1e6
    colours = blue_to_red(Q / top)
    axes.axhline(0, color="black", lw=0.6)
    table = {"time_s": run.time[rows], "Q_N": Q}
    for (_, marker, name, column), values in zip(MARKERS, off.T, strict=True):
        is_open = marker == "s"
        ink = {"edgecolors": colours, "facecolors": "none"} if is_open else {"c": colours}
        axes.scatter(Q, values, s=14, marker=marker, linewidths=0.8, **ink)
        table[column] = values
        axes.plot([], [], marker, ms=4, mew=0.8, ls="", color="black",
                  mfc="none" if is_open else "black", label=name)  # fmt: skip
    name_axes(axes, "Q_N", "dux_0_um")
    axes.set_title("(b)", loc="left")
    axes.legend()
    return table


def stick_radii(runs: Runs) -> Drawn:
    """Fig. 14: the stick radius over Q, at two loads."""
    known = those(
        runs,
        lambda run: run.mu > 0 and np.isfinite(run.series("peak_radius_m")[run.loading]).any(),
        "no run with friction above 0 has a stick radius c from its shear traction",
    )
    shown = nearest_of(known, STRESSES_AT)
    figure, (axes,) = new_panels(1, 70)
    tables: list[Table] = []
    for run in shown:
        rows = run.loading & np.isfinite(run.series("peak_radius_m"))
        Q, c, sd = (
            run.series(name)[rows]
            for name in ("shear_force_n", "peak_radius_m", "peak_radius_sd_m")
        )
        limit = run.mu * run.P
        share = np.linspace(1, 0, 200)  # c/a_H
        c_mm = share * run.hertz_radius * 1e3
        axes.plot(limit * (1 - share**3), c_mm, color=run.colour, lw=0.9)
        tables.append(
            {"P_N": run.P, "Q_N": Q, "c_mm": c * 1e3, "c_sd_mm": sd * 1e3,
             "c_CM_mm": cattaneo_mindlin.stick_radius(Q, limit, run.hertz_radius) * 1e3}
        )  # fmt: skip
        draw_bars(axes, {k: v if np.ndim(v) == 0 else v[::FEWER] for k, v in tables[-1].items()},
                  "Q_N", "c_mm", fmt="o", ms=2.8, color=run.colour, elinewidth=0.6, capsize=1.5,
                  label=run.name)  # fmt: skip
        if np.isfinite(Q).any():
            reached = float(np.nanmax(Q))
            axes.axvspan(reached, limit, ymax=0.06, fc="none", ec=run.colour, hatch="////", lw=0)
    axes.plot([], [], color="black", lw=0.9, label=r"$a_H(1-Q/\mu P)^{1/3}$")
    axes.bar([0], [0], fc="none", ec=GREY, hatch="////", lw=0, label="$c$ not resolved")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(title="$P$")
    return Drawn(
        figure,
        {"": stacked(tables)},
        f"Stick radius c against Q at {loads_text(shown, STRESSES_AT)}. Disks, one of {FEWER}: the"
        " radius of the"
        " largest shear traction, between rings by a polynomial through its maximum, with its"
        " standard uncertainty. Lines: c = a_H (1 - Q/(mu P))^(1/3) of Cattaneo and"
        " Mindlin, with <mu_d>, whose rigid friction an interface that yields before it slips does"
        " not follow near Q_s. Hatched: forces at which no maximum is resolved.",
    )
