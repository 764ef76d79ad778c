"""Speed and accuracy of every method of the image correlation, on pictures of 1600 x 1200 pixels
whose displacement is known exactly: 18,644 points (box 20, step 10), one core, processor time.

    python -m benchmarks dic [PART...] [--frames 5] [--plot sigma.png]

table  points per second, a translation and a graded ring, without and with noise
paper  the paper's calibration (Fig. 4d): sigma for boxes of 10 to 100 px, u_x up to 14 px
waves  amplitude that is left of a sinusoidal u_x, by wavelength, beside a plain average's

`benchmarks growth` measures other boxes and steps; `benchmarks dic_peers` fills the table for other
libraries, on the same pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np

from analysis.dic import Correlation, Grid, Tracker, compile_kernels, open_tracker
from app.tradeoff.exact_speckle import ExactMotion, Wave
from benchmarks import scores
from benchmarks.report import Report
from benchmarks.scores import Picture, follow, frames_of, score_translation
from benchmarks.speckle import SIZE, noise_floor, pattern

SUBJECT = "Image correlation"
METHODS = {
    "shared": Correlation(threads=1),
    "shared, order 2": Correlation(order=2, threads=1),
    "shared, tolerance 0.01": Correlation(tolerance=0.01, threads=1),
    "icgn, order 1": Correlation(method="icgn", threads=1),
    "direct": Correlation(method="direct", threads=1),
}
# promised for the default method, pixels: a sigma of 1.2 times the smallest possible one, 0.0055, a
# bias that vanishes beside it, and in the ring, where strain changes within a box, 1.2 times sigma
BOUNDS = {
    ("shared", "bias, noise 2"): 0.001,
    ("shared", "sigma, noise 2"): 0.0066,
    ("shared", "ring, noise 2"): 0.008,
}
COMPARED = ("direct", "shared", "icgn, order 1")
PAPER_BOXES = (10, 14, 20, 32, 48, 64, 100)
PAPER_SIGMA_PX = 0.033  # of box 20


def at_rest(correlation: Correlation, reference: Picture) -> Tracker:
    """A tracker that starts from zero displacement."""
    tracker = open_tracker(correlation, reference)
    tracker.start_from(*np.zeros((2, *tracker.grid.shape)))
    return tracker


def following(correlation: Correlation) -> scores.Start:
    """The correlation in the form of `benchmarks.scores`."""

    def start(reference: Picture) -> scores.Step:
        tracker = at_rest(correlation, reference)
        x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)

        def step(image: Picture) -> scores.Measured:
            field = tracker.track(image)
            measured = (x, y, field.ux_px, field.uy_px, field.ux_std_px)
            return tuple(values.ravel() for values in measured)

        return step

    return start


def floor(box: int, noise: float) -> float:
    """Root mean square of the Cramer-Rao bound of u_x over a grid, pixels."""
    return float(np.sqrt(np.mean(noise_floor(Grid.cover(SIZE, box, 10), noise) ** 2)))


def table(report: Report, limit: int | None) -> None:
    """Every method on both sets, and the floor."""
    scores.table(report, {name: following(c) for name, c in METHODS.items()}, limit, BOUNDS)
    report.table("Smallest possible error of u_x (Cramer-Rao) at box 20")
    report.add("no noise, rounding alone", floor(20, 0), "px", digits=2)
    report.add("noise of 2 grey levels", floor(20, 2), "px", digits=2)


def paper(report: Report, limit: int | None) -> list[list[float]]:
    """The paper's Fig. 4d and the floor below it; rows of box and sigmas."""
    report.table("Sigma of u_x by box, u_x from 0.14 to 14 px, noise 2 (the paper's Fig. 4d)")
    frames, curves = frames_of("long", 2, limit), []
    for box in PAPER_BOXES:
        row = [float(box)]
        for method in COMPARED:
            measured, _ = follow(following(replace(METHODS[method], box=box)), frames)
            row.append(score_translation(frames[1:], measured, box).sigma)
        row.append(floor(box, 2))
        curves.append(row)
        for column, sigma in zip((*COMPARED, "floor"), row[1:], strict=True):
            report.add(f"box {box}", sigma, "px", column=column)
    return curves


def draw(curves: list[list[float]], file: Path) -> None:
    """Draw the curves of `paper` into a file."""
    from matplotlib import pyplot

    box_px, *sigmas = np.array(curves).T
    figure, axes = pyplot.subplots(figsize=(6, 4.2), layout="constrained")
    styles = zip(sigmas, (*COMPARED, "floor"), ("o-", "s-", "^-", "k--"), strict=True)
    for sigma, label, style in styles:
        axes.loglog(box_px, sigma, style, label=label)
    axes.loglog(20, PAPER_SIGMA_PX, "r*", markersize=12, label="Prevost et al. (2013), box 20")
    axes.set(xlabel="box λ (px)", ylabel="standard deviation of $u_x$ (px)")
    axes.set_xticks(PAPER_BOXES, map(str, PAPER_BOXES), minor=False)
    axes.minorticks_off()
    axes.legend(frameon=False)
    figure.savefig(file, dpi=150)


def waves(report: Report, _: int | None) -> None:
    """How much each method passes of short waves, and the side of the box whose plain average would
    pass as much.
    """
    report.table("Amplitude passed of a sinusoidal u_x (and the box of a plain average, px)")
    made = pattern((480, 480))

    def picture(motion) -> Picture:
        return np.rint(made.grey(motion)).clip(0, 255).astype(np.uint8)

    for wavelength in (40, 60, 80, 120, 200):
        for axis in (0, 1):
            motion, name = Wave(wavelength, axis), f"{wavelength} px along {'xy'[axis]}"
            report.add(name, np.sinc(20 / wavelength), column="average over box 20")
            for method, correlation in METHODS.items():
                tracker = at_rest(correlation, picture(ExactMotion.uniform(0)))
                found = tracker.track(picture(motion)).ux_px[4:-4, 4:-4]
                true = motion(*np.meshgrid(tracker.grid.x_px, tracker.grid.y_px))[0][4:-4, 4:-4]
                tracker.close()
                passed = float((found * true).sum() / (true**2).sum())
                box = wavelength * np.sqrt(6 * max(0.0, 1 - passed)) / np.pi
                report.add(name, f"{passed:.3f} ({box:.1f})", column=method)


PARTS = {f.__name__: f for f in (table, paper, waves)}


def measure(
    report: Report,
    parts: Annotated[Sequence[str], PARTS] = tuple(PARTS),
    *,
    frames: int | None = None,
    plot: Path | None = None,
) -> None:
    """Measure the parts that are named, or all."""
    cv2.setNumThreads(1)
    for correlation in METHODS.values():
        compile_kernels(correlation)
    for part in parts:
        found = PARTS[part](report, frames)
        if part == "paper" and plot is not None:
            draw(found, plot)
