"""How the time of a frame grows with its pixels, its points and their boxes: method shared, one
core, processor time, a translation by fractions of a pixel with noise of 2 grey levels.

    python -m benchmarks growth [--plot docs/growth.png]

pixels   300 x 400 to 2048 x 2448, box 20, step 10
points   1200 x 1600 with steps of 40 to 3 px, box 20
box      1200 x 1600 with boxes of 10 to 100 px, step 10
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from analysis.dic import Correlation, Grid, compile_kernels
from benchmarks.dic import following
from benchmarks.report import Report
from benchmarks.scores import follow
from benchmarks.speckle import ExactMotion, Frame, Pattern, camera

SUBJECT = "Growth of the time of a frame"
SIZES = ((300, 400), (600, 800), (1200, 1600), (2048, 2448))
STEPS = (40, 20, 10, 5, 3)
BOXES = (10, 14, 20, 32, 48, 64, 100)
FRAMES = 7


def frames_of(size: tuple[int, int]) -> list[Frame]:
    """A reference and pictures that have moved a little more each."""
    pattern, rng = Pattern(size), np.random.default_rng(3)
    motions = [ExactMotion.uniform(0.04 * n) for n in range(FRAMES + 1)]
    return [Frame(camera(pattern.grey(motion), 2, rng), motion) for motion in motions]


def milliseconds(frames: list[Frame], correlation: Correlation) -> float:
    """Median time of a picture that needs one pass."""
    _, spent = follow(following(correlation), frames)
    return 1e3 * float(np.median(spent[2:]))


def measure(report: Report, *, plot: Path | None = None) -> None:
    """The three curves, and their picture."""
    cv2.setNumThreads(1)
    compile_kernels()
    plain = Correlation(threads=1)
    curves: dict[str, list[tuple[float, float]]] = {"pixels": [], "points": [], "box (px)": []}
    full: list[Frame] = []
    report.table("Time of a frame")
    for size in SIZES:
        frames = frames_of(size)
        full = frames if size == (1200, 1600) else full
        took = milliseconds(frames, plain)
        curves["pixels"].append((size[0] * size[1], took))
        per_pixel = 1e6 * took / (size[0] * size[1])
        report.row(f"{size[1]} x {size[0]}", time=(took, "ms"), per_pixel=(per_pixel, "ns"))
    for step in STEPS:
        took, points = (
            milliseconds(full, Correlation(step=step, threads=1)),
            np.prod(Grid.cover((1200, 1600), 20, step).shape),
        )
        curves["points"].append((float(points), took))
        report.row(f"step {step}, {points} points", time=(took, "ms"))
    for box in BOXES:
        took = milliseconds(full, Correlation(box=box, threads=1))
        curves["box (px)"].append((box, took))
        report.row(f"box {box}", time=(took, "ms"))
    if plot:
        draw(curves, plot)


def draw(curves: dict[str, list[tuple[float, float]]], file: Path) -> None:
    """Draw the three curves side by side."""
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 3, figsize=(9, 2.9), layout="constrained", sharey=True)
    for axes, (name, curve) in zip(panels, curves.items(), strict=True):
        x, took = np.array(curve).T
        axes.loglog(x, took, "o-", color="#1f5fa8")
        axes.set_xlabel(name)
        axes.grid(visible=True, which="both", color="0.9")
        if name == "box (px)":
            axes.set_xticks(BOXES, map(str, BOXES), minor=False)
            axes.minorticks_off()
    panels[0].set_ylabel("processor time of a frame (ms)")
    panels[0].set_yticks((0.5, 1, 2, 5, 10, 20, 50), ("0.5", "1", "2", "5", "10", "20", "50"))
    panels[0].set_title("box 20, step 10", fontsize=9)
    panels[1].set_title("1600 x 1200, box 20", fontsize=9)
    panels[2].set_title("1600 x 1200, step 10", fontsize=9)
    figure.savefig(file, dpi=110)
