"""The charts of a certificate, as a calibration states them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class FitCurve(NamedTuple):
    """Points of a chart, shape (n,) each, how matplotlib writes them, their name in the legend, and
    their standard uncertainties.
    """

    x: Any
    y: Any
    how: str = "-"
    name: str = ""
    sd: Any = None


@dataclass(frozen=True)
class FitChart:
    """Curves under the labels of both axes, the title and whether both axes are logarithmic."""

    x: str
    y: str
    curves: Sequence[FitCurve]
    title: str = ""
    is_log: bool = False

    def draw(self, axes: Axes) -> None:
        """Draw it."""
        for one in self.curves:
            axes.errorbar(one.x, one.y, one.sd, fmt=one.how, ms=4, lw=0.8, label=one.name or None)
        axes.set(xlabel=self.x, ylabel=self.y, title=self.title)
        if self.is_log:
            axes.set(xscale="log", yscale="log")
        if axes.get_legend_handles_labels()[1]:
            axes.legend()


@dataclass(frozen=True)
class GreyMap:
    """A map in grey, shape (rows, columns), what its scale means, where it has one, and its title;
    the size of a pixel, the greatest value that is shown (0: any), and the colours.
    """

    values: Any
    label: str = ""
    title: str = ""
    pixel: float = 1.0
    unit: str = "px"
    most: float = 0.0
    colours: str = "gray"

    def draw(self, axes: Axes) -> None:
        """Draw it."""
        rows, columns = (size * self.pixel for size in self.values.shape)
        shown = axes.imshow(self.values, cmap=self.colours, extent=(0, columns, rows, 0))
        if self.most:
            shown.set_clim(-self.most, self.most)
        axes.set(xlabel=f"x ({self.unit})", ylabel=f"y ({self.unit})", title=self.title)
        if self.label:
            axes.figure.colorbar(shown, ax=axes, label=self.label, orientation="horizontal")


def draw_charts(figure: Figure, charts: Sequence[FitChart | GreyMap], columns: int = 0) -> None:
    """Draw charts row by row in so many columns; 0: in one, or in one row where there is a map."""
    has_map = any(isinstance(one, GreyMap) for one in charts)
    columns = columns or (len(charts) if has_map else 1)
    panels = figure.subplots(-(-len(charts) // columns), columns, squeeze=False)
    for axes, chart in zip(panels.flat, charts, strict=True):
        chart.draw(axes)
