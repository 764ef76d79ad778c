"""The picture of a study: cost against each error with its front, and for the correlation sigma
against the box, as in Fig. 4d of the paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.patheffects import withStroke

from app.report.figures import GREY, STYLE
from app.report.paper.published import BOX_PX, SIGMA_PX
from app.report.paper.style import draw_letters, new_figure, plain_logs
from app.tradeoff.study import Found, Study, Variant, front

COLOURS = ("#1f5fa8", "#2e8b57", "#d98200", "#c0392b", "#7d3c98", "#444444")
MARKERS = {"step": "s", "tolerance": "v", "binning": "x"}
PLACES = (0.0, -1.0, 1.0, -2.0, 2.0, -3.0, 3.0, -4.0, 4.0)  # lines below or above a point
Label = tuple[str, float, float, str]
"""A text, perhaps empty, the point that it belongs to, and a colour."""
DECADES = 10**2.6  # span of an axis up to which 2 and 5 are written
LEAST = 1e-9  # least figure on a logarithmic axis


def draw(study: Study, found: Found, path: Path) -> None:
    """Draw a study into a file, whose ending says how: .png, .pdf or .svg."""
    is_correlation = "sigma_px" in study.columns
    panels = [*study.errors, *(["box", "efficiency"] if is_correlation else [])]
    with mpl.rc_context(STYLE):
        rows = math.ceil(len(panels) / 2)
        figure = new_figure(7.2, 0.5 + 2.9 * rows)
        axes: Any = figure.subplots(rows, 2, squeeze=False)
        texts = {}
        for panel, what in zip(axes.ravel(), panels, strict=False):
            if what == "box":
                _over_box(panel, study, found)
            else:
                pair = ("period_px", "sigma_px") if what == "efficiency" else (study.cost, what)
                texts[panel] = _scatter(panel, study, found, *pair)
        for panel in axes.ravel()[len(panels) :]:
            panel.axis("off")
        draw_letters(axes.ravel()[: len(panels)])
        _legend(figure, study)
        about = study.identity()
        size = f"; pictures of {about['picture']}" if "picture" in about else ""
        figure.suptitle(f"{study.subject} on {about['processor']}{size}", fontsize=8, color=GREY)
        label(figure, texts)
        figure.savefig(path, dpi=170)


def label(figure: Any, texts: dict[Any, list[Label]], size: float = 6.0) -> None:
    """Write texts beside points of axes, each at the first of several places where it covers no
    point and no other text.
    """
    figure.canvas.draw()  # lays out
    point = figure.dpi / 72
    for axes, labels in texts.items():
        at = axes.transData.transform([(x, y) for _, x, y, _ in labels]) / point
        taken = [(x - 3.5, y - 3.5, x + 3.5, y + 3.5) for x, y in at]
        left, bottom, right, top = axes.get_window_extent().extents / point
        for n in sorted((n for n, one in enumerate(labels) if one[0]), key=lambda n: -at[n][1]):
            text, x, y, colour = labels[n]
            wide, high = 0.58 * size * len(text), 1.2 * size
            places = [(side, k) for k in PLACES for side in (-1, 1)]
            boxes = {}
            for side, k in places:
                start = at[n][0] + 5.5 * side - (wide if side < 0 else 0)
                middle = at[n][1] + k * high
                boxes[side, k] = start, middle - high / 2, start + wide, middle + high / 2
            free = [
                key
                for key, (x0, y0, x1, y1) in boxes.items()
                if left < x0 and x1 < right and bottom < y0 and y1 < top
                and not any(x0 < c and a < x1 and y0 < d and b < y1 for a, b, c, d in taken)
            ]  # fmt: skip
            side, k = free[0] if free else places[0]
            taken.append(boxes[side, k])
            note = axes.annotate(
                text, (x, y), (5.5 * side, k * high), textcoords="offset points", va="center",
                ha="left" if side > 0 else "right", fontsize=size, color=colour,
                path_effects=[withStroke(linewidth=2.0, foreground="white")],
                arrowprops={"arrowstyle": "-", "lw": 0.4, "color": colour} if k else None,
            )  # fmt: skip
            note.set_in_layout(False)


def colours(study: Study) -> dict[str, str]:
    """Colour of each group."""
    groups = dict.fromkeys(v.group for v in study.variants if "preset" not in v.name)
    return {group: COLOURS[n % len(COLOURS)] for n, group in enumerate(groups)}


def _marker(variant: Variant) -> str:
    if "preset" in variant.name:
        return "*"
    return next((m for name, m in MARKERS.items() if name in variant.settings), "o")


def _scatter(axes: Any, study: Study, found: Found, across: str, up: str) -> list[Label]:
    """All variants by two of their figures; those that no other beats in both, on a line. Returns
    what is to be written beside the points.
    """
    colour = colours(study)
    shown = [v for v in study.variants if all(found[v.name][k] > LEAST for k in (across, up))]
    for variant in shown:
        x, y = (found[variant.name][k] for k in (across, up))
        size = 8 if (marker := _marker(variant)) == "*" else 4
        axes.plot(x, y, marker, ms=size, mfc="none", color=colour[variant.group], mew=0.9)
    named = {v.name: found[v.name] for v in shown}
    best = sorted(front(named, (across, up)), key=lambda name: named[name][across])
    line = [[named[name][k] for name in best] for k in (across, up)]
    axes.plot(*line, color=GREY, lw=0.7, zorder=0)
    axes.margins(0.08)
    axes.set(xscale="log", yscale="log", xlabel=study.columns[across], ylabel=study.columns[up])
    plain_ticks(axes.xaxis, axes.yaxis)
    texts = {
        v.name: v.name.removeprefix("preset ") if "preset" in v.name else f"{v.settings['box']}"
        for v in shown
        if "preset" in v.name or ("box" in v.settings and v.name in best)
    }
    points = {name: (f[across], f[up]) for name, f in named.items()}
    # one text for points that look the same
    once = {(text, *np.log(points[n]).round(1)): n for n, text in texts.items()}
    texts = {name: text for name, text in texts.items() if name in once.values()}
    return [(texts.get(name, ""), *p, GREY) for name, p in points.items()] + along(*line)


def along(x: Sequence[float], y: Sequence[float]) -> list[Label]:
    """Points without a text on a line between these points, so that no text is written over it."""
    t = np.linspace(0, len(x) - 1, 25 * len(x))
    lines = (np.exp(np.interp(t, np.arange(len(x)), np.log(v))) for v in (x, y))
    return [("", a, b, "") for a, b in zip(*map(np.ndarray.tolist, lines), strict=True)]


def _over_box(axes: Any, study: Study, found: Found) -> None:
    """Sigma against the box, of the variants in which nothing else is changed."""
    bounds: dict[float, float] = {}
    for group, colour in colours(study).items():
        plain = [v for v in study.variants if v.group == group and _marker(v) == "o"]
        plain = [v for v in plain if found[v.name]["sigma_px"] > 0]
        curve = sorted((v.settings["box"], found[v.name]["sigma_px"]) for v in plain)
        if curve:
            axes.plot(*zip(*curve, strict=True), "o-", ms=3, color=colour, lw=0.8)
        for v in plain:
            figures = found[v.name]
            bounds[v.settings["box"]] = figures["sigma_px"] / figures["over_floor"]
    axes.plot(*zip(*sorted(bounds.items()), strict=True), "--", color=GREY, lw=0.8)
    axes.plot(BOX_PX, SIGMA_PX, "*", color="black", ms=8)
    axes.annotate(
        "Prevost et al. 2013", (BOX_PX, SIGMA_PX), (6, 3), "data",
        "offset points", fontsize=6.5,
    )  # fmt: skip
    about = "dashed: least possible (Cramér-Rao)"
    axes.text(0.03, 0.04, about, transform=axes.transAxes, fontsize=6.5, color=GREY)
    axes.set(xscale="log", yscale="log", xlabel="box (px)", ylabel=study.columns["sigma_px"])
    boxes = sorted(bounds)
    plain_ticks(axes.yaxis)
    axes.set_xticks(boxes, [f"{box:g}" for box in boxes])
    axes.set_xticks([], minor=True)


def plain_ticks(*sides: Any) -> None:
    """1, 2, 5 and their multiples by ten, or over many decades 1 alone, as plain numbers."""
    for side in sides:
        side.axes.autoscale_view()
        least, most = side.get_view_interval()
        few = most < DECADES * least
        plain_logs(side, subs=(1.0, 2.0, 5.0) if few else (1.0,))


def _legend(figure: Any, study: Study) -> None:
    from matplotlib.lines import Line2D

    kinds = [Line2D([], [], color=c, marker="o", ls="", ms=4, label=g) for g, c in
             colours(study).items()]  # fmt: skip
    for name, marker in MARKERS.items():
        if study.subject == "image correlation" and any(name in v.settings for v in study.variants):
            kinds.append(Line2D([], [], marker=marker, mfc="none", color=GREY, ls="", ms=4,
                                label=f"another {name}"))  # fmt: skip
    if any("preset" in v.name for v in study.variants):
        kinds.append(
            Line2D([], [], marker="*", mfc="none", color=GREY, ls="", ms=8, label="preset")
        )
    boxes = any("box" in v.settings for v in study.variants)
    front = f"front{', with the box in px' * boxes}"
    kinds.append(Line2D([], [], color=GREY, lw=0.7, label=front))
    figure.legend(handles=kinds, loc="outside lower center", ncols=min(6, len(kinds)))
