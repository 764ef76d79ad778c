"""The local friction law: Fig. 15.

References
----------
Prevost et al. 2013, section 5; Bureau et al. 2003.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.friction.local_law import law_of
from analysis.mechanics import hertz
from app.report.paper.published import LAW_AT
from app.report.paper.runs import Runs, between, load_text, nearest, those
from app.report.paper.style import Drawn, NotDrawn, Table, blue_to_red, new_panels, stacked

STEP_M = 70e-6
RESIDUAL = 0.15  # from the master curve, of the inset
FURTHEST = 8.0  # u_x/(mu L) that is shown


def local_law(runs: Runs) -> Drawn:
    """Fig. 15: local traction over pressure against the displacement, and the master curve."""
    known = those(
        runs,
        lambda run: (
            math.isfinite(run.summary.law_length_m)
            and np.isfinite(run.run.law.ratio[run.rows]).any()
        ),
        "no run has a local friction law",
    )
    run = nearest(known, LAW_AT)
    s, law, a = run.summary, run.run.law, run.own_hertz_radius
    r = np.arange(0.0, run.hertz_radius - run.config.sample.rim, STEP_M)
    r = r[r < a]
    if not len(r):
        raise NotDrawn(f"the contact at {run.name} is not wider than its rough rim")
    pressure = hertz.pressure(r, run.P, a)
    ux, ratio = run.ux_at(r) * 1e6, run.stress_at(r) / pressure
    at = np.asarray(s.pressure_radius_m)
    soft = s.law_mu * s.law_length_m
    alpha = between(at, law.slip_m[run.rows], r) / soft
    master = between(at, law.ratio[run.rows], r)
    figure, (left, right) = new_panels(2, 72, 2)
    inset = right.inset_axes((0.55, 0.34, 0.42, 0.3))
    tables: dict[str, list[Table]] = {"a": [], "b": []}
    for k, colour in enumerate(blue_to_red(np.linspace(0, 1, len(r)))):
        left.plot(ux[:, k], ratio[:, k], color=colour, lw=0.6)
        right.plot(alpha[:, k], master[:, k], ".", ms=2.4, mew=0, color=colour)
        off = master[:, k] - law_of(alpha[:, k], 1.0, 1.0)
        inset.plot(alpha[:, k], off, ".", ms=1.6, mew=0, color=colour)
        here = {"time_s": run.time, "r_mm": r[k] * 1e3}
        tables["a"].append({**here, "ux_um": ux[:, k], "sigma_over_p": ratio[:, k]})
        tables["b"].append({**here, "s_over_muL": alpha[:, k], "sigma_over_mu_p": master[:, k]})
    fine = np.linspace(0, FURTHEST, 200)
    right.plot(fine, law_of(fine, 1.0, 1.0), color="black", lw=1.0, zorder=3,
               label=r"$1-e^{-\alpha}$")  # fmt: skip
    inset.axhline(0, color="black", lw=0.6)
    inset.set(xlim=(0, 0.99 * FURTHEST), ylim=(-RESIDUAL, RESIDUAL), title="less the curve")
    left.set(xlabel="$u_x$ (µm)", ylabel=r"$\sigma_{xz}/\sigma_{zz}$")
    left.set_xlim(0, FURTHEST * soft * 1e6)
    left.set_ylim(0, 1.2 * s.law_mu)
    left.set_title(f"(a)  $P$ = {run.P:.3g} N", loc="left")
    right.set(xlabel=r"$u_x/(\mu L)$", ylabel=r"$\sigma_{xz}/(\mu\sigma_{zz})$")
    right.set_xlim(0, min(FURTHEST, 1.05 * float(np.nanmax(alpha))))
    right.set_ylim(0, 1.2)
    right.set_title("(b)", loc="left")
    right.legend(loc="lower right")
    bar = figure.colorbar(_scale(r[-1] * 1e3), ax=[left, right], pad=0.02, aspect=30)
    bar.set_label("$r$ (mm)")
    last = {letter: stacked(rows) for letter, rows in tables.items()}
    return Drawn(
        figure,
        last,
        f"(a) sigma_xz/sigma_zz against u_x at {load_text(run, LAW_AT)} for radii every 70 µm from"
        " 0 to a_H - sqrt(R h), dark blue to dark red; sigma_zz is Hertz's pressure by the modulus"
        " of the run, u_x the ring means. (b) The traction over that of sliding, which is mu"
        f" sigma_zz, against the local slip over mu L, with mu = {s.law_mu:.3f} and L ="
        f" {s.law_length_m * 1e6:.3f} µm of this run; slip and traction are those of one inversion,"
        " the averaging over boxes undone. Black: 1 - exp(-alpha); inset: the points less this"
        " curve.",
    )


def _scale(largest: float) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colours = ListedColormap(blue_to_red(np.linspace(0, 1, 256)))
    return ScalarMappable(Normalize(0, largest), colours)
