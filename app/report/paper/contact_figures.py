"""Pictures of the contact and what they tell: Figs 2, 3 and 4.

References
----------
Prevost et al. 2013, sections 2.3.1 and 2.3.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from analysis.contact.apparent import background_difference
from app.records.study_results import BoxSearch
from app.report.figures import BLUE, GREY, RED
from app.report.paper.published import BOX_PX, FIELDS_AT, LIGHTEST, SIGMA_PX
from app.report.paper.runs import Runs, load_text, nearest, of_each, those
from app.report.paper.style import (
    Drawn,
    NotDrawn,
    draw_columns,
    draw_letters,
    new_panels,
    palette,
    plain_logs,
    stacked,
)

MM = 1e3
BAR_MM = 1.0
SMOOTHED = 5  # rings over which I(r) is drawn as a running mean, beside what was measured
ON_A_PICTURE = [withStroke(linewidth=1.6, foreground="black")]


def interface_image(runs: Runs) -> Drawn:
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
        spread = float(np.percentile(np.abs(difference), 99.7)) or 1.0
        shapes.append(("(b) difference from the free block", difference, (-spread, spread)))
    pixel_mm = pictures.pixel_m * MM
    rows, columns = pictures.reference.shape
    x0, y0 = contact.centre_px
    extent = tuple(
        v * pixel_mm for v in (-0.5 - x0, columns - 0.5 - x0, rows - 0.5 - y0, -0.5 - y0)
    )
    figure, panels = new_panels(len(shapes), 5, len(shapes), aspect=0.98 * rows / columns)
    for panel, (title, image, (low, high)) in zip(panels, shapes, strict=True):
        panel.imshow(image, cmap="gray", vmin=low, vmax=high, extent=extent)
        panel.set_title(title, loc="left")
        panel.set_axis_off()
        panel.set(xlim=extent[:2], ylim=extent[2:])
        _draw_bar(panel, extent)
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


def _draw_bar(panel: Any, extent: Sequence[float]) -> None:
    """Draw the bar of 1 mm with its length into the lower left corner."""
    left = extent[0] + 0.05 * (extent[1] - extent[0])
    bottom = extent[2] - 0.06 * (extent[2] - extent[3])
    edge = [withStroke(linewidth=4, foreground="black")]
    panel.plot([left, left + BAR_MM], [bottom, bottom], color="white", lw=3, path_effects=edge)
    panel.annotate(
        f"{BAR_MM:g} mm", (left + BAR_MM / 2, bottom), (0, 4), textcoords="offset points",
        color="white", ha="center", va="bottom", path_effects=ON_A_PICTURE,
    )  # fmt: skip


def _draw_axes(panel: Any, far: float) -> None:
    """Draw x and y, of that length (mm), r and theta about the contact's centre."""
    arrow = {"arrowstyle": "->", "color": "white", "lw": 1.0, "path_effects": ON_A_PICTURE}
    written = {"ha": "center", "va": "center", "path_effects": ON_A_PICTURE}
    angle = math.radians(40)
    for (x, y), name in (((far, 0), "$x$"), ((0, far), "$y$")):
        panel.annotate("", (x, y), (0, 0), arrowprops=arrow)
        panel.text(1.12 * x, 1.12 * y, name, color="white", **written)
    x, y = 0.67 * far * math.cos(angle), 0.67 * far * math.sin(angle)
    panel.annotate("", (x, y), (0, 0), arrowprops={**arrow, "color": "#ffd75e"})
    panel.text(1.15 * x, 1.15 * y, "$r$", color="#ffd75e", **written)
    turn = np.linspace(0, angle, 30)
    panel.plot(0.33 * far * np.cos(turn), 0.33 * far * np.sin(turn), color="#ffd75e", lw=0.8)
    middle = angle / 2
    panel.text(
        0.46 * far * math.cos(middle), 0.46 * far * math.sin(middle), r"$\theta$",
        color="#ffd75e", **written,
    )  # fmt: skip


def apparent_radii(runs: Runs) -> Drawn:
    """Fig. 3: I(r) of all loads, and the apparent radius over the load."""
    seen = those(
        runs,
        lambda r: r.contact is not None and r.contact.profile_grey.size,
        "no run has a picture of the free block, from which I(r) is computed",
    )
    figure, (left, right) = new_panels(2, 72, 2)
    profiles = []
    for run in seen:
        assert run.contact is not None
        r_mm = run.contact.profile_radius_px * run.run.pictures.pixel_m * MM
        profiles.append({"P_N": run.P, "r_mm": r_mm, "I_counts": run.contact.profile_grey})
        draw_columns(left, profiles[-1], "r_mm", "I_counts", color=run.colour, lw=0.5, alpha=0.35)
        left.plot(*_running_mean(r_mm, run.contact.profile_grey), color=run.colour, label=run.name)
    left.axhline(0, color="black", lw=0.6)
    widest = max(r.apparent_radius for r in seen) * MM
    left.set_xlim(0, 1.6 * widest)
    left.legend(title="$P$")
    draw_letters((left, right))
    inset = right.inset_axes((0.56, 0.15, 0.41, 0.36))
    sample = seen[0].config.sample
    loads = np.linspace(0, 1.08 * max(r.P for r in seen), 200)
    hertz_mm = seen[0].hertz_radius * MM / np.cbrt(seen[0].P)  # at 1 N
    right.plot(loads, hertz_mm * np.cbrt(loads), color="black", lw=0.7, label="$a_H$")
    tables = {"a": stacked(profiles)}
    if known := [r for r in seen if math.isfinite(r.summary.apparent_radius_m)]:
        P, a, sd = of_each(known, "normal_force_n", "apparent_radius_m", "apparent_radius_sd_m")
        a_H, rim = MM * np.array([(run.hertz_radius, run.config.sample.rim) for run in known]).T
        a, sd = a * MM, sd * MM
        for load, low, high in zip(P, a_H, a_H + rim, strict=True):
            right.annotate(
                "", (load, high), (load, low),
                arrowprops={"arrowstyle": "-|>", "mutation_scale": 5, "fc": "black", "lw": 0.6,
                            "shrinkA": 0, "shrinkB": 3},
            )  # fmt: skip
        tables["b"] = {"P_N": P, "a_mm": a, "a_sd_mm": sd, "a_H_mm": a_H, "sqrt_Rh_mm": rim}
        right.errorbar(P, a, sd, fmt="o", mfc="none", mew=0.6, color=RED, ms=4, elinewidth=0.7,
                       capsize=3, capthick=0.7, label="$a$ measured")  # fmt: skip
        inset.plot(P, a, "o", mfc="none", color=RED, ms=3)
    right.plot([], [], color="black", marker=r"$\uparrow$", ls="", label=r"$\sqrt{Rh}$")
    few = np.geomspace(0.8 * seen[0].P, 1.25 * seen[-1].P, 50)
    inset.plot(few, hertz_mm * np.cbrt(few), color="black", lw=1.0)
    inset.set(xscale="log", yscale="log")
    inset.set_title("(c) slope 1/3", pad=2)
    plain_logs(inset.xaxis, inset.yaxis)
    inset.yaxis.set_major_locator(MaxNLocator(3, steps=(1, 2, 5, 10)))
    inset.set_xlabel("$P$ (N)", labelpad=1)
    inset.set_ylabel("$a$ (mm)", labelpad=2)
    right.set(xlim=(0, loads[-1]), xlabel="normal load $P$ (N)", ylabel="contact radius (mm)")
    right.set_ylim(0, 1.12 * widest)
    right.legend(loc="upper left")
    return Drawn(
        figure,
        tables,
        "(a) Angularly averaged intensity profiles I(r) for increasing loads P, r = 0 at the centre"
        f" of the apparent contact (thin), and running means of {SMOOTHED} rings; the colours of"
        " the loads are the same in all figures. (b) Apparent contact radius a over P (red circles,"
        " with standard uncertainties). Thin line: Hertz's a_H with E ="
        f" {sample.young_modulus * 1e-6:.3g} MPa; the arrows have the length sqrt(R h)."
        " (c) The same on a log-log scale; the line has the slope 1/3.",
    )


def _running_mean(r: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of `SMOOTHED` neighbours, and where they lie."""
    kernel = np.full(min(SMOOTHED, len(r)), 1 / min(SMOOTHED, len(r)))
    return np.convolve(r, kernel, "valid"), np.convolve(values, kernel, "valid")


def correlation_of_a_box(runs: Runs) -> Drawn:
    """Figs 4a to 4c: a box of the reference, where it is looked for, and the correlation."""
    known = those(
        runs,
        lambda r: r.run.search is not None,
        "the results hold no box that was found in a later picture",
    )
    run = nearest(known, FIELDS_AT)
    search = run.run.search
    assert search is not None
    figure, panels = new_panels(3, 12, 3, aspect=0.8)
    draw_search(panels, search)
    pixel_um, reach = run.run.pictures.pixel_m * 1e6, search.tau_x_px[-1]
    rows = run.run.frames[run.run.frames["frame"] == search.frame]
    when = f"at t = {rows['time_s'][0]:.1f} s" if len(rows) else f"of frame {search.frame}"
    ux, uy = search.ux_px, search.uy_px
    middle = [first + (search.box_px - 1) / 2 for first in (search.x_px, search.y_px)]
    return Drawn(
        figure,
        _tables_of(search),
        f"(a) Reference at {load_text(run, FIELDS_AT)}, with a box of {search.box_px} px"
        f" ({search.box_px * pixel_um:.0f} µm) at the contact's centre, x = {middle[0]:g} px and"
        f" y = {middle[1]:g} px of the picture, y down. (b) Picture {when}."
        f" Dashed: the window in which the box is looked for, {reach:g} px to each side; solid:"
        " where it is. (c) Normalised correlation C of box (a) with the boxes of picture (b) that"
        " are displaced by tau_x and tau_y. Dot: its maximum, by a two-dimensional Gaussian"
        " through the highest value and its eight neighbours. Arrow: the displacement u_x ="
        f" {ux:.2f} px = {ux * pixel_um:.2f} µm, u_y = {uy:.2f} px = {uy * pixel_um:.2f} µm. The"
        f" highest value of C is {search.correlation.max():.3f}.",
    )


def draw_search(panels: Sequence[Any], search: BoxSearch) -> None:
    """Draw into three panels the box in the reference, the window in the later picture and the
    correlation with its top, lengths in pixels of the picture, y down.
    """
    box, reach, u = search.box_px, search.tau_x_px[-1], (search.ux_px, search.uy_px)
    rows, columns = search.reference.shape
    x0, y0 = search.left_px - 0.5, search.top_px - 0.5
    brightest = max(float(np.percentile(search.reference, 99.5)), 1.0)
    for panel, image in zip(panels, (search.reference, search.later), strict=False):
        panel.imshow(
            image, cmap="gray", vmin=0, vmax=brightest, extent=(x0, x0 + columns, y0 + rows, y0)
        )
        panel.set(xlabel="$x$ (px)", ylabel="$y$ (px)")
    edge: dict[str, Any] = {"fill": False, "ec": "white", "lw": 1.1, "path_effects": ON_A_PICTURE}
    x, y, window = search.x_px - 0.5, search.y_px - 0.5, box + 2 * reach
    panels[0].add_patch(Rectangle((x, y), box, box, **edge))
    panels[1].add_patch(Rectangle((x - reach, y - reach), window, window, ls="--", **edge))
    panels[1].add_patch(Rectangle((x + u[0], y + u[1]), box, box, **edge))
    left, right = -reach - 0.5, reach + 0.5
    shown = panels[2].imshow(
        search.correlation, cmap=palette().field, extent=(left, right, right, left)
    )
    bar = panels[2].figure.colorbar(shown, cax=panels[2].inset_axes((1.03, 0, 0.05, 1)))
    bar.set_label("$C$", labelpad=1)
    arrow = {"arrowstyle": "->", "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    outline = [withStroke(linewidth=2.2, foreground="white")]
    panels[2].annotate("", u, (0, 0), arrowprops={**arrow, "path_effects": outline})
    panels[2].plot(*u, "o", color=RED, ms=3.5, mec="white", mew=0.5)
    panels[2].set(xlabel=r"$\tau_x$ (px)", ylabel=r"$\tau_y$ (px)")
    draw_letters(panels)


def _tables_of(search: BoxSearch) -> dict[str, dict[str, Any]]:
    """The pixels of both cuts, the box with its displacement, and the correlation."""
    rows, columns = np.indices(search.reference.shape)
    tau_y, tau_x = np.meshgrid(search.tau_y_px, search.tau_x_px, indexing="ij")
    pictures = {
        "x_px": (columns + search.left_px).ravel(), "y_px": (rows + search.top_px).ravel(),
        "reference_counts": search.reference.ravel(), "later_counts": search.later.ravel(),
    }  # fmt: skip
    half = (search.box_px - 1) / 2
    vector = {
        "x_px": [search.x_px + half], "y_px": [search.y_px + half],
        "ux_px": [search.ux_px], "uy_px": [search.uy_px],
    }  # fmt: skip
    correlation = {"tau_x_px": tau_x.ravel(), "tau_y_px": tau_y.ravel()}
    return {"a": pictures, "b": vector, "c": correlation | {"C_1": search.correlation.ravel()}}


def noise_over_box(runs: Runs) -> Drawn:
    """Fig. 4d: standard deviation of the displacements against the box."""
    known = those(
        runs,
        lambda r: r.run.noise.box_px.size,
        "the results hold no noise of the correlation against its box",
    )
    figure, (axes,) = new_panels(1, 72)
    tables = []
    for run, marker in zip(known, cycle("os^vDP"), strict=False):
        noise = run.run.noise
        tables.append({"P_N": run.P, **asdict(noise)})
        axes.plot(noise.box_px, noise.sigma_px, marker, ls="-", lw=0.7, ms=3.5, mfc="none",
                  color=run.colour, label=run.name)  # fmt: skip
    least = known[0].run.noise
    axes.plot(least.box_px, least.floor_px, "--", color=GREY, lw=0.8, label="Cramér-Rao bound")
    direct = ""
    if known[0].config.dic.method != "direct" and np.isfinite(least.direct_px).any():
        direct = " Dash-dotted: the direct method, the paper's."
        axes.plot(least.box_px, least.direct_px, "-.", color="black", lw=0.8,
                  label=f"direct method, {known[0].name}")  # fmt: skip
    axes.plot(BOX_PX, SIGMA_PX, "*", color="black", ms=8, ls="", label="Prevost et al. 2013")
    box = known[0].config.dic.box
    axes.axvline(box, ymax=0.7, color=BLUE, lw=0.7, ls=":", label=f"box of this analysis, {box} px")
    axes.set(xscale="log", yscale="log", xlabel=r"box size $\lambda$ (px)", ylabel=r"$\sigma$ (px)")
    axes.margins(y=0.1)
    low, high = axes.get_ylim()
    axes.set_ylim(top=high * (high / low) ** 0.4)  # room for the legend above
    plain_logs(axes.xaxis, axes.yaxis)
    axes.legend(ncols=2, loc="upper right")
    return Drawn(
        figure,
        {"": stacked(tables)},
        "(d) Log-log plot of the standard deviation sigma of the displacements against the box size"
        " lambda, for the texture and the noise of each run's pictures. Dashed: the least that any"
        f" unbiased measurement of such a box can have.{direct} Star: the paper, 0.033 px at"
        " 20 px.",
    )
