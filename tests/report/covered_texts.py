"""Whether a text of a figure lies on another one, or leaves the figure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from matplotlib.figure import Figure


def covered_or_outside(
    figure: Figure, every: Iterable[Any], spare: float
) -> tuple[int, list[tuple[str, str]], list[str]]:
    """How many titles and labels of these axes and their insets are shown, which of them cover one
    another, and which leave the figure, by more than so many pixels.
    """
    figure.canvas.draw()
    texts: list[Any] = []
    for axes in [one for panel in every for one in (panel, *panel.child_axes)]:
        ticks = [
            label
            for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim()))
            for at, label in zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=False)
            if min(limits) <= at <= max(limits)
        ]
        own = (axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label)
        texts += [t for t in (*own, *ticks) if t.get_text() and t.get_visible()]
    # texts turned askew have boxes that overlap though they do not
    upright = [t for t in texts if t.get_rotation() in (0, 90)]
    boxes = [(t.get_text(), t.get_window_extent().padded(-spare / 2)) for t in upright]
    covered = [
        (a, b)
        for i, (a, box) in enumerate(boxes)
        for b, other in boxes[i + 1 :]
        if box.overlaps(other)
    ]
    wide, high = figure.canvas.get_width_height()
    outside = [
        text for text, box in boxes if min(box.x0, box.y0, wide - box.x1, high - box.y1) < -spare
    ]
    return len(boxes), covered, outside
