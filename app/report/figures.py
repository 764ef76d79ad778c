"""The picture of a loading experiment: Q(delta), c(Q), u_x(t), and the u_x field at six instants
(paper, Figs 5, 6, 7 and 14).
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
from numpy.typing import NDArray

from app.records import ContactResult, Phase, Snapshot, Summary, series_of

# of t_s: instants 1 to 5; the sixth slides, at 1.4 t_s or the end
LOADING_SHARES = (0.19, 0.38, 0.57, 0.76, 0.95)
SLIDING_SHARE = 1.4
RADII = (0.0, 0.5, 0.75, 1.0)  # of a, as in the paper's Fig. 7
CUT_HALF_ROWS = 2  # the cut along y = 0 is the mean of this many rows on either side of it
BLUE, RED, GREY = "#1f5fa8", "#c0392b", "#777777"
RADII_COLOURS = ("#000000", "#1f5fa8", "#2e8b57", "#c0392b")
STYLE = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "svg.fonttype": "none",
}


def numbered_instants(snapshots: Sequence[Snapshot], summary: Summary | None) -> list[int]:
    """Positions in `snapshots` of the six instants to be shown: five on the way to t_s, one in
    sliding.

    Where t_s is not known the instants share the drive evenly. Fewer than six come out of a drive
    of fewer frames.
    """
    drive = [
        (i, s.conditions.time_s)
        for i, s in enumerate(snapshots)
        if s.conditions.phase is Phase.DRIVE and math.isfinite(s.conditions.time_s)
    ]
    if not drive:
        return []
    last = drive[-1][1]
    onset = summary.onset_time_s if summary else math.nan
    if 0 < onset < last:
        wanted = [share * onset for share in LOADING_SHARES] + [min(last, SLIDING_SHARE * onset)]
    else:
        wanted = [last * k / 6 for k in range(1, 7)]
    nearest = (min(drive, key=lambda item: abs(item[1] - t))[0] for t in wanted)
    return sorted(set(nearest))


def stick_radius_cm(
    shear_force_n: NDArray[np.float64], hertz_radius_m: float, mu: float, normal_force_n: float
) -> NDArray[np.float64]:
    """Stick radius of a Cattaneo-Mindlin contact under Q: c = a_H (1 - Q/(mu P))^(1/3), 0 beyond mu
    P (paper, Eq. for c(Q)).
    """
    rest = np.clip(1 - np.asarray(shear_force_n) / (mu * normal_force_n), 0, None)
    return np.asarray(hertz_radius_m * np.cbrt(rest), dtype=np.float64)


def experiment_figure(
    snapshots: Sequence[Snapshot],
    contact: ContactResult | None,
    summary: Summary | None,
    grid_x_px: NDArray[np.float64],
    grid_y_px: NDArray[np.float64],
    pixel_m: float,
    *,
    title: str = "",
) -> Figure:
    """The figure of one loading experiment.

    Parameters
    ----------
    snapshots : sequence of Snapshot
        In order; those at `numbered_instants` with their fields, the others may go without.
    contact, summary : optional
        What was not measured (None, NaN) is not drawn.
    grid_x_px, grid_y_px : ndarray, shapes (nx,) and (ny,)
        Box centres.
    pixel_m : float
        Size of a pixel on the interface.
    """
    instants = numbered_instants(snapshots, summary)
    drive = [s for s in snapshots if s.conditions.phase is Phase.DRIVE]
    with matplotlib.rc_context(STYLE):
        rows = 1 if len(instants) <= 3 else 2
        figure = Figure(
            figsize=(7.2, 2.8 + 1.9 * rows),
            layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05, wspace=0.02, hspace=0.03),
        )
        FigureCanvasAgg(figure)
        halves: Any = figure.subfigures(2, 1, height_ratios=(1.0, 0.1 + 0.75 * rows))
        curves, fields = halves
        left, middle, right = curves.subplots(1, 3)
        _draw_force(left, drive, [snapshots[i] for i in instants], summary)
        _draw_stick_radius(middle, drive, summary)
        _draw_ring_displacements(right, drive, _contact_radius_m(contact, summary), summary)
        panels = fields.subplots(rows, 3, sharex=True, sharey=True).ravel()
        fields.suptitle(
            "(d) $u_x$ at the numbered instants. Dashed: $a$; circle: $c$; curve: cut along $y=0$"
            " (mean of 5 rows), read on the colour bar",
            fontsize=8,
        )
        centre = (
            contact.centre_px if contact else (float(grid_x_px.mean()), float(grid_y_px.mean()))
        )
        x_mm, y_mm = (
            (grid_x_px - centre[0]) * pixel_m * 1e3,
            (grid_y_px - centre[1]) * pixel_m * 1e3,
        )
        for number, panel in enumerate(panels, 1):
            shot = snapshots[instants[number - 1]] if number <= len(instants) else None
            if shot is None or shot.field is None or shot.motion is None:
                panel.set_visible(False)
                continue
            ux_m = np.asarray(shot.field.ux_px, np.float64) * pixel_m - shot.motion.lens_m
            _draw_field(fields, panel, ux_m * 1e6, x_mm, y_mm, number, shot)
            _draw_circles(panel, contact, shot)
            panel.label_outer()
        if title:
            figure.suptitle(title, fontsize=8, color=GREY)
    return figure


def experiment_picture(
    snapshots: Sequence[Snapshot],
    contact: ContactResult | None,
    summary: Summary | None,
    grid_x_px: NDArray[np.float64],
    grid_y_px: NDArray[np.float64],
    pixel_m: float,
    path: Path,
    *,
    title: str = "",
) -> None:
    """Write `experiment_figure` to `path` (the ending tells the format: .png, .pdf, .svg)."""
    figure = experiment_figure(
        snapshots, contact, summary, grid_x_px, grid_y_px, pixel_m, title=title
    )
    with matplotlib.rc_context(STYLE):
        figure.savefig(path, dpi=200)


def _contact_radius_m(contact: ContactResult | None, summary: Summary | None) -> float:
    """The measured apparent radius, or Hertz's where there is none."""
    if contact is not None and math.isfinite(contact.apparent_radius_m):
        return contact.apparent_radius_m
    return summary.hertz_radius_m if summary else math.nan


def _draw_force(
    axes: Any, drive: Sequence[Snapshot], numbered: Sequence[Snapshot], summary: Summary | None
) -> None:
    """Q(delta) with the six instants (Fig. 5)."""
    axes.plot(series_of(drive, "travel_m") * 1e6, series_of(drive, "shear_force_n"), color=BLUE)
    if summary and math.isfinite(summary.static_force_n):
        axes.axhline(summary.static_force_n, color=GREY, lw=0.7, ls=":")
        axes.annotate(
            "$Q_s$",
            (0.02, summary.static_force_n),
            (0, 2),
            ("axes fraction", "data"),
            "offset points",
            color=GREY,
        )
    for number, shot in enumerate(numbered, 1):
        x, y = shot.conditions.travel_m * 1e6, shot.conditions.shear_force_n
        axes.plot([x], [y], "o", ms=8.5, mfc="white", mec=BLUE, mew=0.8, zorder=3)
        axes.annotate(str(number), (x, y), ha="center", va="center_baseline", fontsize=6, zorder=4)
    axes.margins(y=0.12)
    axes.set(
        xlabel=r"stage displacement $\delta$ (µm)",
        ylabel=r"shear force $Q$ (N)",
        title=r"(a) $Q(\delta)$",
    )


def _draw_stick_radius(axes: Any, drive: Sequence[Snapshot], summary: Summary | None) -> None:
    """Stick radius against Q beside Cattaneo-Mindlin's (Fig. 14)."""
    c_m, sd_m, force = (
        series_of(drive, name) for name in ("stick_radius_m", "stick_radius_sd_m", "shear_force_n")
    )
    known = np.isfinite(c_m)
    error = np.where(np.isfinite(sd_m[known]), sd_m[known], 0.0)
    axes.errorbar(
        force[known],
        c_m[known] * 1e3,
        error * 1e3,
        fmt="o",
        ms=2,
        color=BLUE,
        ecolor="#9dbbe0",
        elinewidth=0.6,
        label="measured",
        zorder=3,
    )
    if summary and math.isfinite(summary.mu_d) and math.isfinite(summary.hertz_radius_m):
        limit = summary.mu_d * summary.normal_force_n
        q = limit * (1 - np.linspace(1, 0, 200) ** 3)
        c_cm = stick_radius_cm(q, summary.hertz_radius_m, summary.mu_d, summary.normal_force_n)
        axes.plot(q, c_cm * 1e3, "--", color=RED, label=r"$a_H\,(1-Q/\mu_d P)^{1/3}$", zorder=2)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower left")
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlim(left=-0.04 * axes.get_xlim()[1])
    axes.set_ylim(bottom=-0.04 * axes.get_ylim()[1])
    axes.set(xlabel=r"shear force $Q$ (N)", ylabel=r"stick radius $c$ (mm)", title=r"(b) $c(Q)$")


def _draw_ring_displacements(
    axes: Any, drive: Sequence[Snapshot], radius_m: float, summary: Summary | None
) -> None:
    """u_x at r = 0, a/2, 3a/4 and a against time, and the construction of t_s (Fig. 7)."""
    time = series_of(drive, "time_s")
    for share, colour in zip(RADII, RADII_COLOURS, strict=True):
        if share == 0:
            ux = series_of(drive, "centre_ux_m")
        elif math.isfinite(radius_m):
            ux = np.array([_at_radius(s, share * radius_m) for s in drive])
        else:
            continue
        if not np.isfinite(ux).any():
            continue
        name = "r = 0" if share == 0 else "r = a" if share == 1 else f"r = {share:g} a"
        axes.plot(time, ux * 1e6, color=colour, label=f"${name}$")
    axes.axhline(0, color="black", lw=0.6, ls=":")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left")
    if (
        summary
        and math.isfinite(summary.onset_time_s)
        and math.isfinite(summary.sliding_velocity_m_s)
        and len(time)
    ):
        ends = np.array([summary.onset_time_s, time[-1]])
        axes.plot(
            ends,
            summary.sliding_velocity_m_s * (ends - ends[0]) * 1e6,
            "-.",
            color=GREY,
            lw=0.9,
            zorder=3,
        )
        low = axes.get_ylim()[1] * -0.16
        axes.annotate(
            "$t_s$",
            (ends[0], 0),
            (ends[0], low),
            ha="center",
            va="bottom",
            arrowprops={"arrowstyle": "->", "lw": 0.8},
        )
        axes.set_ylim(bottom=1.15 * low)
    axes.set(xlabel=r"time $t$ (s)", ylabel=r"$u_x(r)$ (µm)", title=r"(c) $u_x(r)$ in time")


def _at_radius(shot: Snapshot, radius_m: float) -> float:
    """Ring mean of u_x at a radius, linear between the rings; NaN outside them."""
    if shot.rings is None:
        return math.nan
    good = np.isfinite(shot.rings.ux_m)
    if not good.any():
        return math.nan
    r, ux = shot.rings.radius_m[good], shot.rings.ux_m[good]
    return float(np.interp(radius_m, r, ux, left=math.nan, right=math.nan))


def _draw_field(
    figure: Any,
    axes: Any,
    ux_um: NDArray[np.float64],
    x_mm: NDArray[np.float64],
    y_mm: NDArray[np.float64],
    number: int,
    shot: Snapshot,
) -> None:
    """One u_x field in micrometres with its cut along y = 0, read on the colour bar (Fig. 6a)."""
    good = ux_um[np.isfinite(ux_um)]
    low, high = (float(v) for v in np.percentile(good, (0.5, 99.5))) if good.size else (0.0, 1.0)
    low, high = min(0.0, low), max(high, low + 0.1)
    half_x, half_y = abs(x_mm[1] - x_mm[0]) / 2, abs(y_mm[1] - y_mm[0]) / 2
    extent = (x_mm[0] - half_x, x_mm[-1] + half_x, y_mm[-1] + half_y, y_mm[0] - half_y)
    axes.set_facecolor("#d9d9d9")
    shown = axes.imshow(
        ux_um, extent=extent, vmin=low, vmax=high, cmap="viridis", interpolation="nearest"
    )
    # as high as the panel: the cut is read on it
    bar = figure.colorbar(shown, cax=axes.inset_axes((1.03, 0, 0.05, 1)))
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(length=2)
    if number % 3 == 0:
        bar.set_label("$u_x$ (µm)", labelpad=1)
    middle = int(np.argmin(np.abs(y_mm)))
    rows = np.ma.masked_invalid(ux_um[max(0, middle - CUT_HALF_ROWS) : middle + CUT_HALF_ROWS + 1])
    cut = rows.mean(axis=0).filled(np.nan)
    heights = extent[2] + (cut - low) / (high - low) * (extent[3] - extent[2])
    axes.plot(
        x_mm,
        heights,
        color="white",
        lw=1.0,
        path_effects=[withStroke(linewidth=2.0, foreground="black")],
        label="cut",
        zorder=4,
    )
    axes.set(xlim=extent[:2], ylim=extent[2:])
    now = shot.conditions
    axes.set_title(f"{number}:  $t$ = {now.time_s:.1f} s,  $Q$ = {now.shear_force_n:.3f} N", pad=3)
    axes.set_xlabel("$x$ (mm)")
    axes.set_ylabel("$y$ (mm)", labelpad=1)


def _draw_circles(axes: Any, contact: ContactResult | None, shot: Snapshot) -> None:
    """The apparent contact (dashed) and the stick zone (solid)."""
    if contact is not None and math.isfinite(contact.apparent_radius_m):
        axes.add_patch(
            Circle(
                (0, 0),
                contact.apparent_radius_m * 1e3,
                fill=False,
                ec="#ff5a4d",
                ls="--",
                lw=1.1,
                zorder=3,
            )
        )
    if shot.stick is not None and shot.stick.stick_radius_m > 0:
        axes.add_patch(
            Circle(
                (0, 0), shot.stick.stick_radius_m * 1e3, fill=False, ec="white", lw=1.1, zorder=3
            )
        )
