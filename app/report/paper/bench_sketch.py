"""Fig. 1: a sketch of the bench at hand, with the dimensions of its settings.

References
----------
Prevost et al. 2013, section 2.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.patches import Rectangle

from app.records.quantities import with_uncertainty
from app.report.figures import BLUE, GREY, RED
from app.report.paper.published import LIGHTEST
from app.report.paper.runs import Runs, nearest
from app.report.paper.style import SINGLE, WIDE, Drawn, new_panels
from app.settings.sections import Config

GLASS, BLOCK = "#dbe9f4", "#f3e3c3"
FORCE = {"arrowstyle": "-|>", "lw": 1.2, "shrinkA": 0, "shrinkB": 0}


class Dimension(NamedTuple):
    """A number of the bench: what it is, its symbol as a formula, its value and its uncertainty
    (NaN: none is stated) in its unit.
    """

    name: str
    symbol: str
    value: float
    sd: float
    unit: str

    def __str__(self) -> str:
        digits = with_uncertainty(self.value, self.sd) if self.sd > 0 else (f"{self.value:.4g}",)
        return " ".join((f"${self.symbol}$ =", *digits, self.unit))


def dimensions(config: Config) -> dict[str, Dimension]:
    """The numbers of a bench by the keys of its settings, a block without a thickness left out."""
    sample, forces, camera, stated = (
        config.sample, config.forces, config.camera, config.uncertainty,
    )  # fmt: skip
    (k_N, K_T), (k_sd, K_sd) = forces.stiffness, forces.stiffness_uncertainty
    (high, wide), nan = camera.shape, float("nan")
    found = {
        "stiffness_normal": Dimension("normal cantilever", "k_N", k_N, k_sd, "N/m"),
        "stiffness_shear": Dimension("tangential cantilever", "K_T", K_T, K_sd, "N/m"),
        "lens_radius": _scaled("radius of the lens", "R", sample.lens_radius, stated.lens_radius,
                               1e3, "mm"),
        "thickness": _scaled("thickness of the block", "H", sample.thickness, stated.thickness,
                             1e3, "mm"),
        "young_modulus": _scaled("Young's modulus", "E", sample.young_modulus, stated.young_modulus,
                                 1e-6, "MPa"),
        "roughness": _scaled("roughness", "h", sample.roughness, stated.roughness, 1e6, "µm"),
        "velocity": Dimension("velocity", "v", config.run.velocity * 1e6, nan, "µm/s"),
        "pixel": _scaled("pixel", "p", camera.pixel, stated.pixel, 1e6, "µm"),
        "field_width": Dimension("field of view", "w", wide * camera.pixel * 1e3, nan, "mm"),
        "field_height": Dimension("its height", "b", high * camera.pixel * 1e3, nan, "mm"),
        "frame_rate": Dimension("images", "f", config.frame_rate_hz, nan, "/s"),
    }  # fmt: skip
    return {key: one for key, one in found.items() if one.value > 0}


def _scaled(
    name: str, symbol: str, value: float, relative: float, scale: float, unit: str
) -> Dimension:
    return Dimension(name, symbol, value * scale, value * relative * scale, unit)


def bench_sketch(runs: Runs) -> Drawn:
    """Fig. 1: the lens on its cantilevers, the block on its stage, and the camera."""
    sizes = dimensions(nearest(runs, LIGHTEST).config)
    figure, (axes,) = new_panels(1, 2, aspect=0.62)
    axes.set(xlim=(0, 100), ylim=(0, 60), aspect="equal")
    axes.set_axis_off()
    size = 6.0 if figure.get_figwidth() < (SINGLE + WIDE) / 2 / 25.4 else 8.0
    _draw_contact(axes, sizes, size)
    _draw_cantilevers(axes, sizes, size)
    _draw_camera(axes, sizes, size)
    table: dict[str, Any] = {
        "quantity": [one.name for one in sizes.values()],
        "input": list(sizes),
        "value_in_unit": np.array([one.value for one in sizes.values()]),
        "sd_in_unit": np.array([one.sd for one in sizes.values()]),
        "in_unit": [one.unit for one in sizes.values()],
    }
    return Drawn(
        figure,
        {"": table},
        "Sketch of the bench, not to scale, with the numbers of the settings of the lowest load and"
        " their standard uncertainties. The glass lens presses on the rough block with P, measured"
        " by the normal cantilever; the stage moves the block at v, and the tangential cantilever"
        " measures Q. The camera sees the interface through the lens.",
    )


def _draw_contact(axes: Any, sizes: dict[str, Dimension], size: float) -> None:
    """The block on its stage, and the lens above it."""
    axes.add_patch(Rectangle((8, 8), 54, 4, fc="#b9b9b9", ec="black", lw=0.6))
    axes.add_patch(Rectangle((12, 12), 46, 10, fc=BLOCK, ec="black", lw=0.6))
    x = np.linspace(22, 48, 60)
    rough = 22 + 0.35 * np.sin(np.linspace(12, 58, 300) * 5.1)
    axes.plot(np.linspace(12, 58, 300), rough, color="#8a6d3b", lw=0.7)
    below = 22.2 + (x - 35) ** 2 / 45
    axes.fill_between(x, below, 31, color=GLASS, ec="black", lw=0.6)
    axes.annotate("", (76, 10), (63, 10), arrowprops={**FORCE, "color": BLUE})
    _write(axes, (77, 10), [sizes.get("velocity")], size, va="center", color=BLUE)
    _write(axes, (13, 17), [sizes.get("young_modulus"), sizes.get("thickness")], size, va="center")
    _write(axes, (60, 20.5), [sizes.get("roughness")], size, va="center")
    axes.text(35, 10, "stage", ha="center", va="center", fontsize=size)
    _write(axes, (21, 28), [sizes.get("lens_radius")], size, va="center", ha="right")


def _draw_cantilevers(axes: Any, sizes: dict[str, Dimension], size: float) -> None:
    """The arm that holds the lens: a leaf for P along it, and one for Q across it."""
    axes.plot([48, 66], [29.5, 29.5], color="black", lw=1.6)
    for y in (28.3, 30.7):
        axes.plot([66, 88], [y, y], color=GREY, lw=1.2)  # leaves that bend with P
    for x in (88, 91):
        axes.plot([x, x], [26, 50], color=GREY, lw=1.2)  # leaves that bend with Q
    axes.add_patch(Rectangle((84, 50), 14, 2.5, fc="#b9b9b9", ec="black", lw=0.6, hatch="////"))
    axes.annotate("", (40, 31.5), (40, 40), arrowprops={**FORCE, "color": RED})
    axes.text(41, 37, "$P$", color=RED, fontsize=size + 1)
    axes.annotate("", (49, 25.2), (60, 25.2), arrowprops={**FORCE, "color": RED})
    axes.text(61, 25.2, "$Q$", color=RED, fontsize=size + 1, va="center")
    _write(axes, (86.5, 32), [sizes["stiffness_normal"]], size, va="bottom", ha="right")
    _write(axes, (84, 46), [sizes["stiffness_shear"]], size, va="top", ha="right")


def _draw_camera(axes: Any, sizes: dict[str, Dimension], size: float) -> None:
    """The camera above, and the light that comes through the block."""
    axes.add_patch(Rectangle((30, 51), 10, 7, fc="#555555", ec="black", lw=0.6))
    axes.add_patch(Rectangle((32, 48), 6, 3, fc="#888888", ec="black", lw=0.6))
    for side in (-1, 1):
        axes.plot([35 + 2 * side, 35 + 6 * side], [48, 22.5], ":", color=GREY, lw=0.8)
    axes.text(35, 54.5, "camera", color="white", ha="center", va="center", fontsize=size - 1)
    axes.annotate("", (35, 7.5), (35, 2), arrowprops={**FORCE, "color": "#d9a400"})
    axes.text(37, 3.5, "light", fontsize=size, va="center")
    seen = [sizes["pixel"], sizes["field_width"], sizes["field_height"], sizes["frame_rate"]]
    _write(axes, (28, 58), seen, size, va="top", ha="right")


def _write(
    axes: Any,
    place: tuple[float, float],
    sizes: Sequence[Dimension | None],
    size: float,
    **how: Any,
) -> None:
    text = "\n".join(str(one) for one in sizes if one)
    axes.text(*place, text, fontsize=size, linespacing=1.25, **{"ha": "left", **how})
