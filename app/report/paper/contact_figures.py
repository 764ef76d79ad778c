"""Pictures of the contact and what they tell: Figs 2, 3 and 4d.

References
----------
Prevost et al. 2013, sections 2.3.1 and 2.3.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.contact.apparent import background_difference
from analysis.mechanics import hertz
from app.report.figures import BLUE, GREY, RED
from app.report.paper.published import BOX_PX, LIGHTEST, SIGMA_PX
from app.report.paper.runs import FigureRun, load_text, nearest
from app.report.paper.style import (
    SINGLE,
    WIDE,
    Drawn,
    NotDrawn,
    draw_columns,
    new_figure,
    plain_logs,
    stacked,
)

MM = 1e3
SHOWN_PX = 800  # a picture is averaged down to about this width
BAR_M = 1e-3


def interface_image(runs: Sequence[FigureRun]) -> Drawn:
    """Fig. 2: the interface under the lightest load, and what the contact changed in it."""
    run = nearest(runs, LIGHTEST)
    pictures, contact = run.run.pictures, run.contact
    if not pictures.reference.size or contact is None:
        raise NotDrawn("the results hold no picture of the contact")
    image = pictures.reference.astype(np.float32)
    brightest = float(np.percentile(image[::4, ::4], 99.5))
    shapes = [("(a) the interface", image, (0.0, brightest))]
    if pictures.background.shape == pictures.reference.shape:
        difference = background_difference(
            pictures.background, pictures.reference, contact.shift_px
        )[0]
        spread = float(np.percentile(np.abs(difference), 99.7))
        shapes.append(("(b) less the free block", difference, (-spread / 2, spread)))
    figure = new_figure(WIDE, 3.0 if len(shapes) > 1 else 5.0)
    panels = figure.subplots(1, len(shapes), squeeze=False)[0]
    pixel_mm = pictures.pixel_m * MM
    rows, columns = pictures.reference.shape
    x0, y0 = contact.centre_px
    extent = tuple(
        v * pixel_mm for v in (-0.5 - x0, columns - 0.5 - x0, rows - 0.5 - y0, -0.5 - y0)
    )
    for panel, (title, image, (low, high)) in zip(panels, shapes, strict=True):
        panel.imshow(_reduced(image), cmap="gray", vmin=low, vmax=high, extent=extent)
        panel.set_title(title, loc="left")
        panel.set_axis_off()
        panel.set(xlim=extent[:2], ylim=extent[2:])
        left, bottom = (
            extent[0] + 0.05 * (extent[1] - extent[0]),
            extent[2] - 0.06 * (extent[2] - extent[3]),
        )
        panel.plot([left, left + BAR_M * MM], [bottom, bottom], color="white", lw=3)
    if len(shapes) > 1:
        _draw_axes(panels[1], min(1.35 * run.apparent_radius * MM, 0.8 * min(extent[1:3])))
    row = int(np.clip(round(y0), 0, rows - 1))
    x_mm = (np.arange(columns) - x0) * pixel_mm
    table: dict[str, Any] = {"x_mm": x_mm, "image_counts": shapes[0][1][row]}
    if len(shapes) > 1:
        table["difference_counts"] = shapes[1][1][row]
    missing = "" if len(shapes) > 1 else " There was no picture of the free block to subtract."
    return Drawn(
        figure,
        {"": table},
        f"(a) Image of the interface at {load_text(run, LIGHTEST)}. (b) Difference between image"
        " (a) and the picture of the free block, moved by as much as the block has moved. The white"
        f" bars are 1 mm long.{missing} The table holds the row of pixels through the centre.",
    )


def _reduced(image: np.ndarray) -> np.ndarray:
    """A picture averaged over squares of pixels."""
    k = max(1, image.shape[1] // SHOWN_PX)
    rows, columns = (n // k * k for n in image.shape)
    cut = image[:rows, :columns]
    return np.asarray(cut.reshape(rows // k, k, columns // k, k).mean(axis=(1, 3)))


def _draw_axes(panel: Any, far: float) -> None:
    """Draw x and y, of that length (mm), r and theta about the contact's centre."""
    arrow = {"arrowstyle": "->", "color": "white", "lw": 1.0}
    angle = math.radians(40)
    for (x, y), name in (((far, 0), "$x$"), ((0, far), "$y$")):
        panel.annotate("", (x, y), (0, 0), arrowprops=arrow)
        panel.text(1.12 * x, 1.12 * y, name, color="white", ha="center", va="center")
    x, y = 0.67 * far * math.cos(angle), 0.67 * far * math.sin(angle)
    panel.annotate("", (x, y), (0, 0), arrowprops={**arrow, "color": "#ffd75e"})
    panel.text(1.15 * x, 1.15 * y, "$r$", color="#ffd75e", ha="center", va="center")
    turn = np.linspace(0, angle, 30)
    panel.plot(0.33 * far * np.cos(turn), 0.33 * far * np.sin(turn), color="#ffd75e", lw=0.8)
    middle = angle / 2
    panel.text(
        0.46 * far * math.cos(middle), 0.46 * far * math.sin(middle), r"$\theta$",
        color="#ffd75e", ha="center", va="center",
    )  # fmt: skip


def apparent_radii(runs: Sequence[FigureRun]) -> Drawn:
    """Fig. 3: I(r) of all loads, and the apparent radius over the load."""
    seen = [r for r in runs if r.contact is not None and r.contact.profile_grey.size]
    if not seen:
        raise NotDrawn("no run has a picture of the free block, from which I(r) is told")
    figure = new_figure(WIDE, 3.3)
    left, right = figure.subplots(1, 2)
    profiles, points = [], []
    for run in seen:
        assert run.contact is not None
        r_mm = run.contact.profile_radius_px * run.run.pictures.pixel_m * MM
        profiles.append({"P_N": run.P, "r_mm": r_mm, "I_counts": run.contact.profile_grey})
        draw_columns(left, profiles[-1], "r_mm", "I_counts", color=run.colour, label=run.name)
    left.axhline(0, color="black", lw=0.6)
    widest = max(r.apparent_radius for r in seen) * MM
    left.set_xlim(0, 1.6 * widest)
    left.set_title("(a)", loc="left")
    left.legend(title="$P$")
    right.set_title("(b)", loc="left")
    inset = right.inset_axes((0.56, 0.13, 0.41, 0.4))
    sample = seen[0].config.sample
    loads = np.linspace(0, 1.08 * max(r.P for r in seen), 200)
    curve = np.array([_hertz(load, sample) for load in loads])
    right.plot(loads, curve * MM, color="black", lw=0.7, label="$a_H$")
    known = [r for r in seen if math.isfinite(r.summary.apparent_radius_m)]
    for run in known:
        s, rim = run.summary, run.config.sample.rim * MM
        a_H = run.hertz_radius * MM
        right.annotate(
            "", (run.P, a_H + rim), (run.P, a_H),
            arrowprops={"arrowstyle": "->", "lw": 0.7, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        points.append(
            {
                "P_N": run.P,
                "a_mm": s.apparent_radius_m * MM,
                "a_sd_mm": s.apparent_radius_sd_m * MM,
                "a_H_mm": a_H,
                "sqrt_Rh_mm": rim,
            }
        )
    if points:
        P, a, sd = (np.array([p[k] for p in points]) for k in ("P_N", "a_mm", "a_sd_mm"))
        right.errorbar(P, a, sd, fmt="o", mfc="none", color=RED, ms=4.5, elinewidth=0.7,
                       label="$a$ measured")  # fmt: skip
        inset.plot(P, a, "o", mfc="none", color=RED, ms=3)
    right.plot([], [], color="black", marker=r"$\uparrow$", ls="", label=r"$\sqrt{Rh}$")
    few = np.geomspace(0.8 * seen[0].P, 1.25 * seen[-1].P, 50)
    inset.plot(few, [_hertz(load, sample) * MM for load in few], color="black", lw=1.0)
    inset.set(xscale="log", yscale="log")
    inset.set_title("(c) slope 1/3", fontsize=6.5, pad=2)
    inset.tick_params(which="both", labelsize=6)
    plain_logs(inset)
    right.set(xlim=(0, loads[-1]), xlabel="normal load $P$ (N)", ylabel="contact radius (mm)")
    right.set_ylim(0, 1.12 * widest)
    right.legend(loc="upper left")
    tables = {"a": stacked(profiles)}
    if points:
        tables["b"] = stacked(points)
    return Drawn(
        figure,
        tables,
        "(a) Angularly averaged intensity profiles I(r) for increasing loads P, r = 0 at the centre"
        " of the apparent contact; the lowest load is cyan, the highest pink, here and in all"
        " figures. (b) Apparent contact radius a over P (red circles, with standard uncertainties)."
        f" Thin line: Hertz's a_H with E = {sample.young_modulus * 1e-6:.3g} MPa; the arrows have"
        " the length sqrt(R h). (c) The same on a log-log scale; the line has the slope 1/3.",
    )


def _hertz(P: float, sample: Any) -> float:
    return hertz.contact_radius(P, sample.young_modulus, sample.poisson, sample.lens_radius)


def noise_over_box(runs: Sequence[FigureRun]) -> Drawn:
    """Fig. 4d: standard deviation of the displacements against the box."""
    known = [r for r in runs if r.run.noise.box_px.size]
    if not known:
        raise NotDrawn("the results hold no noise of the correlation against its box")
    figure = new_figure(SINGLE, 3.2)
    axes = figure.subplots()
    tables = []
    for run in known:
        noise = run.run.noise
        tables.append({"P_N": run.P, "box_px": noise.box_px, "sigma_px": noise.sigma_px,
                       "floor_px": noise.floor_px})  # fmt: skip
        axes.plot(noise.box_px, noise.sigma_px, "o-", ms=3, color=run.colour, label=run.name)
    least = known[0].run.noise
    axes.plot(least.box_px, least.floor_px, "--", color=GREY, lw=0.8, label="Cramér-Rao bound")
    axes.plot(BOX_PX, SIGMA_PX, "*", color="black", ms=8, ls="", label="Prevost et al. 2013")
    box = known[0].config.dic.box
    axes.axvline(box, color=BLUE, lw=0.7, ls=":", label=f"box of this analysis, {box} px")
    axes.set(xscale="log", yscale="log", xlabel=r"box size $\lambda$ (px)", ylabel=r"$\sigma$ (px)")
    plain_logs(axes)
    axes.margins(y=0.1)
    axes.legend(ncols=2, loc="best")
    return Drawn(
        figure,
        {"": stacked(tables)},
        "(d) Log-log plot of the standard deviation sigma of the displacements against the box size"
        " lambda, for the texture and the noise of each run's pictures. Dashed: the least that any"
        " unbiased measurement of such a box can have. Star: the paper, 0.033 px at 20 px.",
    )
