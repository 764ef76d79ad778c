"""Fields at the numbered instants: Figs 6a, 6b and 10.

References
----------
Prevost et al. 2013, sections 3 and 4.
"""

from __future__ import annotations

import numpy as np
from matplotlib.patheffects import withStroke

from app.report.figures import draw_circle, draw_field, field_limits
from app.report.paper.published import FIELDS_AT
from app.report.paper.runs import FigureRun, Runs, load_text, nearest, those
from app.report.paper.style import Drawn, NotDrawn, new_panels, palette

ON_FIELD, ON_SIGNED = "#ff9d94", "black"  # of the circle of the apparent contact
EDGE = [withStroke(linewidth=1.9, foreground="#404040")]  # seen on light and dark


def ux_fields(runs: Runs) -> Drawn:
    """Fig. 6a: u_x at the numbered instants."""
    run = _shown(runs)
    return _drawn(
        run,
        np.float64(1e6) * run.run.instants.ux_m,
        "ux_um",
        "$u_x$ (µm)",
        f"(a) u_x displacement fields at {load_text(run, FIELDS_AT)}, at the instants numbered in"
        " Fig. 5; x is that of the picture. Dashed: the apparent contact of radius a; dotted: the"
        " stick radius c. White curves: cuts along y = 0, means of five rows, read on the colour"
        " bar, which belongs to its row.",
    )


def uy_fields(runs: Runs) -> Drawn:
    """Fig. 6b: u_y at the numbered instants."""
    run = _shown(runs)
    return _drawn(
        run,
        np.float64(1e6) * run.run.instants.uy_m,
        "uy_um",
        "$u_y$ (µm)",
        f"(b) u_y displacement fields at {load_text(run, FIELDS_AT)}, at the instants numbered in"
        " Fig. 5. Dashed: the apparent contact of radius a; dotted: the stick radius c. Each row"
        " of fields has one scale.",
    )


def stress_fields(runs: Runs) -> Drawn:
    """Fig. 10: sigma_xz at the numbered instants."""
    run = _shown(runs)
    return _drawn(
        run,
        np.float64(1e-3) * run.run.instants.stress_pa,
        "sigma_kPa",
        r"$\sigma_{xz}$ (kPa)",
        f"Stress fields sigma_xz at {load_text(run, FIELDS_AT)}, at the instants numbered in Fig."
        f" 5, with the modulus of the run, E = {run.E * 1e-6:.3f} MPa. Dashed: the apparent"
        " contact; dotted: the stick radius c. White curves: cuts along y = 0, means of five rows,"
        " read on the colour bar, which belongs to its row.",
    )


def _shown(runs: Runs) -> FigureRun:
    with_fields = those(
        runs, lambda run: len(run.run.instants.frame), "no run has fields at numbered instants"
    )
    return nearest(with_fields, FIELDS_AT)


def _drawn(run: FigureRun, fields: np.ndarray, key: str, label: str, caption: str) -> Drawn:
    instants = run.run.instants
    if not np.isfinite(fields).any():
        raise NotDrawn(f"{run.run.origin.session} holds no such field")
    x_mm, y_mm = instants.x_m * 1e3, instants.y_m * 1e3
    count = len(instants.frame)
    shape = abs((y_mm[-1] - y_mm[0]) / (x_mm[-1] - x_mm[0]))
    figure, panels = new_panels(count, 9 - 10 * shape, 3, aspect=shape, sharex=True, sharey=True)
    columns = panels[0].get_subplotspec().get_gridspec().ncols
    frames, is_signed = run.run.frames, key == "uy_um"
    for number, (panel, values, frame) in enumerate(
        zip(panels, fields, instants.frame, strict=False), 1
    ):
        begins = (number - 1) // columns * columns
        is_last = number % columns == 0 or number == count
        draw_field(
            panel, values, x_mm, y_mm,
            label=label if is_last else None, cut="" if is_signed else "white",
            cmap=palette().signed if is_signed else palette().field,
            limits=field_limits(fields[begins : begins + columns], is_signed=is_signed),
        )  # fmt: skip
        colour = ON_SIGNED if is_signed else ON_FIELD
        draw_circle(panel, run.apparent_radius, ec=colour, ls="--", path_effects=EDGE)
        for now in frames[frames["frame"] == frame]:
            draw_circle(panel, now["peak_radius_m"], ec=colour, ls=":", path_effects=EDGE)
            title = f"{number}:  {now['time_s']:.1f} s,  $Q$ = {now['shear_force_n']:.3f} N"
            panel.set_title(title, pad=3)
        panel.label_outer()
    instant, y, x = np.meshgrid(np.arange(1, len(fields) + 1), y_mm, x_mm, indexing="ij")
    table = {"instant": instant, "x_mm": x, "y_mm": y, key: fields}
    return Drawn(figure, {"": {name: values.ravel() for name, values in table.items()}}, caption)
