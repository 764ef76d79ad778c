"""The picture of a loading experiment: Q(delta), c(Q), u_x(t), and the u_x field at six instants.

References
----------
Prevost et al. 2013, Figs 5, 6, 7 and 14.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from analysis.arrays import F64
from app.records.legs import first_loading, numbered_instants, stage_travel
from app.records.lens_motion import lens_xy_m
from app.records.quantities import resolved
from app.records.record_types import ContactResult, Phase, Snapshot
from app.records.snapshot_numbers import RADII, ring_displacements, series_of
from app.records.summary import Summary

RADII_NAMES = ("0", "0.5a", "0.75a", "a")
RADII_COLOURS = ("#000000", "#1f5fa8", "#2e8b57", "#c0392b")
RADII_DASHES = ("-", (0, (7, 1.2)), (0, (3.5, 1.2)), (0, (1.2, 1.2)))  # told apart in grey, too
HEADROOM = 1.1  # of the colours of a field above its largest value
CUT_HALF_ROWS = 2  # the cut along y = 0 is the mean of this many rows on either side of it
DPI = 300  # of a figure in a file
BLUE, RED, GREY = "#1f5fa8", "#c0392b", "#777777"
FIT = "#e67e00"  # a line that is fitted to a curve, and lies upon it
STYLE = {  # sizes in points, of a figure that is printed as wide as it is drawn
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 7.5),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.title_fontsize"), 6.5),
    **dict.fromkeys(("xtick.direction", "ytick.direction"), "in"),
    **dict.fromkeys(("xtick.major.size", "ytick.major.size"), 2.5),
    **dict.fromkeys(("xtick.major.width", "ytick.major.width", "axes.linewidth"), 0.6),
    "axes.titley": 1.0,  # nothing lies above, which takes long to find out
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "svg.fonttype": "none",
    **dict.fromkeys(("pdf.fonttype", "ps.fonttype"), 42),  # TrueType, as journals ask for
}


def experiment_figure(
    snapshots: Sequence[Snapshot],
    contact: ContactResult | None,
    summary: Summary | None,
    grid_x_px: F64,
    grid_y_px: F64,
    pixel_m: float,
    *,
    title: str = "",
) -> Figure:
    """The figure of one loading experiment.

    Parameters
    ----------
    snapshots : sequence of Snapshot
        In order; fields are needed of those at `numbered_instants` only.
    contact, summary : optional
        What was not measured (None or NaN) is not drawn.
    grid_x_px, grid_y_px : ndarray, shapes (nx,) and (ny,)
        Box centres.
    pixel_m : float
        Size of a pixel on the interface.
    """
    numbered = [snapshots[i] for i in numbered_instants(snapshots, summary)]
    drive = [s for s in snapshots if s.conditions.phase is Phase.DRIVE]
    centre = contact.centre_px if contact else (grid_x_px.mean(), grid_y_px.mean())
    x_mm, y_mm = (
        (px - middle) * pixel_m * 1e3
        for px, middle in zip((grid_x_px, grid_y_px), centre, strict=True)
    )
    apparent_m = contact.apparent_radius_m if contact else math.nan
    hertz_m = summary.hertz_radius_m if summary else math.nan
    with matplotlib.rc_context(STYLE):
        rows = 1 if len(numbered) <= 3 else 2
        layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05, wspace=0.02, hspace=0.03)
        figure = Figure(figsize=(180 / 25.4, 2.8 + 1.9 * rows), layout=layout)
        FigureCanvasAgg(figure)
        halves: Any = figure.subfigures(2, 1, height_ratios=(1.0, 0.1 + 0.75 * rows))
        curves, fields = halves
        left, middle, right = curves.subplots(1, 3)
        draw_force(left, drive, numbered, summary)
        loading = first_loading(drive)
        _draw_stick_radius(middle, loading, summary)
        radius_m = apparent_m if math.isfinite(apparent_m) else hertz_m
        _draw_ring_displacements(right, loading, radius_m, summary)
        fields.suptitle(
            "(d) $u_x$ at the numbered instants. Dashed: $a$; circle: $c$; curve: cut along $y=0$"
            " (mean of 5 rows), read on the colour bar",
            fontsize=8,
        )
        panels = fields.subplots(rows, 3, sharex=True, sharey=True).ravel()
        for panel in panels[len(numbered) :]:
            panel.set_visible(False)
        for number, (panel, shot) in enumerate(zip(panels, numbered, strict=False), 1):
            if shot.field and shot.motion:
                ux_m = shot.field.ux_px * np.float64(pixel_m) - lens_xy_m(shot.motion)[0]
                label = "$u_x$ (µm)" if number % 3 == 0 else ""
                draw_field(panel, ux_m * 1e6, x_mm, y_mm, label=label)
            now = shot.conditions
            when = f"$t$ = {now.time_s:.1f} s,  $Q$ = {now.shear_force_n:.3f} N"
            panel.set_title(f"{number}:  {when}", pad=3)
            draw_circle(panel, apparent_m, ec="#ff5a4d", ls="--")
            if shot.traction or shot.stick:
                draw_circle(panel, resolved(*shot.stick_radius), ec="white")
            panel.label_outer()
        if title:
            figure.suptitle(title, fontsize=8, color=GREY)
    return figure


def write_picture(figure: Figure, path: Path) -> None:
    """Write a figure of this module to `path`, whose ending says how: .png, .pdf or .svg."""
    with matplotlib.rc_context(STYLE):
        lay_out(figure)
        figure.savefig(path, dpi=DPI)


def lay_out(figure: Figure) -> None:
    """Give all parts of a figure their places, the same in files of every kind; `savefig` would
    draw the figure once more for this.
    """
    figure.set_dpi(DPI)
    if engine := figure.get_layout_engine():
        engine.execute(figure)
        figure.set_layout_engine(None)


def draw_force(
    axes: Any, drive: Sequence[Snapshot], numbered: Sequence[Snapshot], summary: Summary | None
) -> None:
    """Draw Q(delta) with the numbered instants (Fig. 5)."""
    velocity = summary.sliding_velocity_m_s if summary else math.nan
    read = series_of(drive, "travel_m")
    steps = [s.conditions.step for s in drive]
    travel_m, is_steady = stage_travel(read, series_of(drive, "time_s"), steps, velocity)
    travel_um = travel_m * 1e6
    axes.plot(travel_um, series_of(drive, "shear_force_n"), c=BLUE)
    if summary and math.isfinite(summary.static_force_n):
        axes.axhline(summary.static_force_n, color=GREY, lw=0.7, ls=":")
        place = (0.02, summary.static_force_n)
        axes.annotate(
            "$Q_s$", place, (0, 2), ("axes fraction", "data"), "offset points", color=GREY
        )
    places = zip(drive, travel_um.tolist(), strict=True)
    shown = {s.frame for s in numbered}
    draw_numbers(axes, [(x, s.conditions.shear_force_n) for s, x in places if s.frame in shown])
    axes.margins(y=0.12)
    delta = r"$\delta = v\,t$" if is_steady else r"$\delta$"
    axes.set(
        xlabel=rf"stage displacement {delta} (µm)",
        ylabel=r"shear force $Q$ (N)",
        title=r"(a) $Q(\delta)$",
    )


def _draw_stick_radius(axes: Any, drive: Sequence[Snapshot], summary: Summary | None) -> None:
    """Draw where the traction is largest against Q (Fig. 14), the radius of the Cattaneo-Mindlin
    profile that fits each frame with its median chi2, and Cattaneo and Mindlin's.
    """
    seen = [s for s in drive if s.traction and math.isfinite(s.traction.peak_radius_m)]
    fitted = [s for s in drive if s.stick]
    chi2 = series_of(fitted, "reduced_chi2")
    known = chi2[np.isfinite(chi2)]
    misfit = rf", $\chi^2$ = {np.median(known):.2g}" if len(known) else ""
    if seen:
        force, c_mm = series_of(fitted, "shear_force_n"), series_of(fitted, "stick_radius_m") * 1e3
        axes.plot(force, c_mm, "-", color=GREY, lw=0.9, label=f"fitted profile{misfit}", zorder=2)
    shown, name = (seen, "peak_radius") if seen else (fitted, "stick_radius")
    axes.errorbar(
        series_of(shown, "shear_force_n"),
        series_of(shown, f"{name}_m") * 1e3,
        np.nan_to_num(series_of(shown, f"{name}_sd_m") * 1e3),
        fmt="o",
        ms=2,
        color=BLUE,
        ecolor="#9dbbe0",
        elinewidth=0.6,
        label="largest traction" if seen else f"fitted profile{misfit}",
        zorder=3,
    )
    limit = summary.mu_d * summary.normal_force_n if summary else 0.0
    if summary and limit > 0 and math.isfinite(summary.hertz_radius_m):
        share = np.linspace(1, 0, 200)  # c/a_H
        q, c_mm = limit * (1 - share**3), share * summary.hertz_radius_m * 1e3
        axes.plot(q, c_mm, "--", color=RED, label=r"$a_H\,(1-Q/\mu_d P)^{1/3}$", zorder=2)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower left")
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    axes.set_ylim(bottom=-0.04 * axes.get_ylim()[1])
    axes.set(xlabel=r"shear force $Q$ (N)", ylabel=r"stick radius $c$ (mm)", title=r"(b) $c(Q)$")


def _draw_ring_displacements(
    axes: Any, drive: Sequence[Snapshot], radius_m: float, summary: Summary | None
) -> None:
    """Draw u_x at r = 0, a/2, 3a/4 and a against time (Fig. 7)."""
    radii = np.array(RADII) * radius_m
    ux = np.array([ring_displacements(s, radii) for s in drive]).reshape(-1, len(RADII))
    ux[:, 0] = series_of(drive, "centre_ux_m")
    draw_sliding(axes, series_of(drive, "time_s"), 1e6 * ux.T, summary)
    axes.set(xlabel=r"time $t$ (s)", ylabel=r"$u_x(r)$ (µm)", title=r"(c) $u_x(r)$ in time")


def draw_sliding(axes: Any, time_s: F64, ux_um: F64, summary: Summary | None) -> None:
    """Draw u_x at `RADII` against time, and how t_s follows from it: the line through u_x(r = 0) at
    long times meets 0.
    """
    axes.axhline(0, color="black", lw=0.6, ls=":")
    looks = zip(ux_um, RADII_NAMES, RADII_COLOURS, RADII_DASHES, strict=True)
    for values, name, colour, dashes in looks:
        if np.isfinite(values).any():
            axes.plot(time_s, values, color=colour, ls=dashes, label=f"$r = {name}$")
    if (
        summary
        and len(time_s)
        and math.isfinite(summary.onset_time_s * summary.sliding_velocity_m_s)
    ):
        onset, last, velocity = summary.onset_time_s, time_s[-1], summary.sliding_velocity_m_s * 1e6
        label = rf"$\Delta u_x/\Delta t$ = {velocity:.3g} µm/s"
        slid = velocity * (last - onset)
        axes.plot([onset, last], [0, slid], "-.", color=FIT, lw=1.2, zorder=3, label=label)
        low = axes.get_ylim()[1] * -0.16
        arrow = {"arrowstyle": "->", "lw": 0.8}
        axes.annotate("$t_s$", (onset, 0), (onset, low), ha="center", va="bottom", arrowprops=arrow)
        axes.set_ylim(bottom=1.15 * low)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left")


def draw_numbers(axes: Any, points: Sequence[tuple[float, float]], colour: Any = BLUE) -> None:
    """Draw the numbered disks, 1 upwards."""
    for number, point in enumerate(points, 1):
        axes.plot(*point, "o", ms=7.5, mfc="white", mec=colour, mew=0.7, zorder=3)
        axes.annotate(str(number), point, ha="center", va="center_baseline", fontsize=6, zorder=4)


def draw_field(
    axes: Any,
    values: F64,
    x_mm: F64,
    y_mm: F64,
    *,
    label: str | None = "",
    cut: str = "white",
    cmap: str = "viridis",
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw one field, with a colour bar of that label (None: without a bar), and its cut along
    y = 0 in the colour `cut`, which is read on the colour bar (Fig. 6a); a `cut` of "" draws none.
    The colours go from one of the `limits` to the other, by default those of the field.
    """
    low, high = limits or field_limits(values, is_signed=not cut)
    half_x, half_y = abs(x_mm[1] - x_mm[0]) / 2, abs(y_mm[1] - y_mm[0]) / 2
    extent = (x_mm[0] - half_x, x_mm[-1] + half_x, y_mm[-1] + half_y, y_mm[0] - half_y)
    axes.set_facecolor("#d9d9d9")
    shown = axes.imshow(
        values, extent=extent, vmin=low, vmax=high, cmap=cmap, interpolation="nearest"
    )
    if label is not None:
        # the bar is as high as the panel, so that the cut can be read on it
        bar = axes.figure.colorbar(shown, cax=axes.inset_axes((1.03, 0, 0.05, 1)))
        bar.outline.set_linewidth(0.5)
        bar.locator = MaxNLocator(5, steps=(1, 2, 5, 10))
        bar.ax.tick_params(length=2)
        bar.set_label(label, labelpad=1)
    if cut:
        middle = int(np.argmin(np.abs(y_mm)))
        rows = np.ma.masked_invalid(
            values[max(0, middle - CUT_HALF_ROWS) : middle + CUT_HALF_ROWS + 1]
        )
        along = rows.mean(axis=0).filled(np.nan)
        heights = extent[2] + (along - low) / (high - low) * (extent[3] - extent[2])
        edge = [withStroke(linewidth=2.0, foreground="white" if cut == "black" else "black")]
        axes.plot(x_mm, heights, color=cut, lw=1.0, path_effects=edge, label="cut", zorder=4)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.set_xlabel("$x$ (mm)")
    axes.set_ylabel("$y$ (mm)", labelpad=1)


def field_limits(values: F64, *, is_signed: bool) -> tuple[float, float]:
    """Where the colours of some fields begin and end: all but the outermost of their values, with
    room for a cut that is read on the bar; about 0 for those of either sign.
    """
    good = values[np.isfinite(values)]
    low, high = (float(v) for v in np.percentile(good, (0.5, 99.5))) if good.size else (0.0, 1.0)
    low, high = min(0.0, low), max(HEADROOM * high, low + 0.1)
    return (-max(-low, high), max(-low, high)) if is_signed else (low, high)


def draw_circle(axes: Any, radius_m: float, **style: Any) -> None:
    """Draw a circle about the contact's centre, if it has a radius."""
    if radius_m > 0:
        axes.add_patch(Circle((0, 0), radius_m * 1e3, fill=False, lw=1.1, zorder=3, **style))
