"""What the pictures of certificates have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def above_residual(figure: Figure, x: str, y: str, residual: str) -> tuple[Axes, Axes]:
    """Axes for data with their fit and, below, for what is left of it, with these labels."""
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    above.set_ylabel(y)
    below.axhline(0, lw=0.5, color="0.5")
    below.set(xlabel=x, ylabel=residual)
    return above, below


def draw_map(axes: Axes, values: Any, label: str = "", *, unit: str = "px", **how: Any) -> None:
    """A map in grey with its scale; without a label there is none."""
    shown = axes.imshow(values, **{"cmap": "gray", **how})
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    if label:
        axes.figure.colorbar(shown, ax=axes, label=label, orientation="horizontal")
