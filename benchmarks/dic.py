"""Speed and accuracy of every method of the image correlation, on pictures of 1600 x 1200 pixels
whose displacement is known exactly: 18,644 points (box 20, step 10), one core unless stated
otherwise, processor time.

    python -m benchmarks dic [PART...]
                             [--frames 5] [--plot sigma.png]

table        points per second, a translation and a graded ring, without and with noise
light        the translation after a change of gain or level of the whole picture
jumps        a cold start and a jump of 40 px: seconds, share of the points that are right
cost         time of a frame for other boxes and steps, relative to box 20 and step 10
threads      time of a frame on two threads against one
paper        the paper's calibration (Fig. 4d): sigma for boxes of 10 to 100 px, u_x up to 14 px
waves        amplitude that is left of a sinusoidal u_x, by wavelength, beside a plain average's
compilation  seconds of the first use with an empty cache, and of a later one
start        seconds from the beginning of a program to the first sample of its run

benchmarks/dic_peers.py fills the same table for other libraries, on the same pictures.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np

from analysis.dic import Correlation, Grid, Tracker, compile_kernels, open_tracker
from app.tradeoff.exact_speckle import ExactMotion, Wave
from benchmarks import scores
from benchmarks.report import ROOT, Report
from benchmarks.scores import Picture, follow, frames_of, score_translation
from benchmarks.speckle import SIZE, Frame, camera, noise_floor, pattern

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
FRAME_MS = 42.0  # from one frame of the camera to the next, at its highest rate
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


def light(report: Report, limit: int | None) -> None:
    """Gain and offset between the reference and the frames."""
    report.table("Change of gain or level, shared, translation, noise 2")
    reference, *moved = frames_of("translation", 2, limit)
    exact, rng = pattern(), np.random.default_rng(5)
    cases = {
        f"gain {gain:g}, offset {offset}": [
            replace(f, image=cv2.convertScaleAbs(f.image, alpha=gain, beta=offset)) for f in moved
        ]
        for gain, offset in ((1, 0), (0.75, 0), (1, 20), (1, -20), (0.5, 0), (0.5, 60))
    }
    cases["0.75 of the light, noise still 2 (floor 1.18 times as high)"] = [
        replace(f, image=camera(0.75 * exact.grey(f.truth), 2, rng)) for f in moved[:5]
    ]
    for name, frames in cases.items():
        measured, _ = follow(following(METHODS["shared"]), [reference, *frames])
        bias, sigma, rmse, _ = score_translation(frames, measured)
        report.row(name, worst_bias=(bias, "px"), sigma=(sigma, "px"), rms_error=(rmse, "px"))


def jumps(report: Report, _: int | None) -> None:
    """Cold starts and jumps."""
    report.table("Cold starts and jumps")
    rng, exact = np.random.default_rng(3), pattern()
    for method in ("shared", "icgn, order 1", "direct"):
        reference = camera(exact.grey(ExactMotion.uniform(0)), 2, rng)
        tracker = at_rest(METHODS[method], reference)
        for ux in (40.3, -49.6):
            image, name = camera(exact.grey(ExactMotion.uniform(ux)), 2, rng), f"{method}, {ux} px"
            tracker.track(image)  # prepares what the search needs
            kinds = (("cold start", tracker.reset), ("jump", partial(tracker.track, reference)))
            for column, prepare in kinds:
                prepare()
                start = time.process_time()
                field = tracker.track(image)
                report.add(name, time.process_time() - start, "s", column=column)
            x = tracker.grid.x_px
            stays = (x + ux > 20) & (x + ux < SIZE[1] - 20)
            right = np.mean(np.abs(field.ux_px[:, stays] - ux) < 0.2)
            report.add(name, 100 * right, "%", column="right points", digits=5)


def milliseconds(correlation: Correlation, frames: list[Frame], wall: bool = False) -> float:
    """Median time of a frame."""
    tracker = at_rest(correlation, frames[0].image)
    clock, spent = time.perf_counter if wall else time.process_time, []
    for frame in frames[1:]:
        start = clock()
        tracker.track(frame.image)
        spent.append(clock() - start)
    tracker.close()
    return 1e3 * float(np.median(spent[1:]))


def cost(report: Report, limit: int | None) -> None:
    """Other boxes and steps."""
    report.table("Time of a frame for other boxes and steps, shared, contact, noise 2")
    frames = frames_of("contact", 2, limit)
    base = milliseconds(METHODS["shared"], frames)
    report.add("box 20, step 10", base, "ms", FRAME_MS, column="time")
    steps = {10: (10, 21, 40, 60, 100), 5: (20, 60), 20: (20,)}
    for box, step in [(box, step) for step, boxes in steps.items() for box in boxes]:
        shape, name = Grid.cover(SIZE, box, step).shape, f"box {box}, step {step}"
        pixels = shape[0] * shape[1] * box**2 / (118 * 158 * 400)
        took = milliseconds(Correlation(box=box, step=step, threads=1), frames)
        report.row(name, time=(took, "ms"), relative_time=took / base, relative_pixels=pixels)


def threads(report: Report, limit: int | None) -> None:
    """One thread and two, wall clock."""
    report.table("Two threads, wall clock, shared, noise 2")
    for name in ("translation", "contact"):
        frames = frames_of(name, 2, limit)
        one, two = (
            min(milliseconds(Correlation(threads=n), frames, wall=True) for _ in range(3))
            for n in (1, 2)
        )
        both = {"one_thread": (one, "ms"), "two_threads": (two, "ms")}
        report.row(name, **both, times_as_fast=one / two)


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


def compilation(report: Report, _: int | None) -> None:
    """First and later use, in processes of their own."""
    report.table("Use of the default method in a new process, imports included")
    code = (
        "import time; t = time.perf_counter(); from analysis.dic import compile_kernels;"
        " compile_kernels(); print(time.perf_counter() - t)"
    )
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT)}
        for use in ("first use, compiling", "later use"):
            command = [sys.executable, "-c", code]
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
            report.add(use, float(done.stdout), "s")


def start(report: Report, _: int | None) -> None:
    """From the beginning of a program to the first sample of its run, simulated bench."""
    report.table("Start of a run in a new process, imports included")
    code = (
        "import time; t = time.perf_counter(); import sys; from pathlib import Path;"
        " from app.settings import config; from app.processes.client import LaunchedRun;"
        " run = LaunchedRun(config.load(None, []), Path(sys.argv[1]), pace=1.0, overwrite=True);"
        " run.start()\n"
        "while not run.look().health.phase: time.sleep(0.01)\n"
        "print(time.perf_counter() - t); run.request_stop('it has begun'); run.wait()"
    )
    with tempfile.TemporaryDirectory() as folder:
        kept, session = str(Path(folder) / "kept"), str(Path(folder) / "run.h5")
        env = os.environ | {"NUMBA_CACHE_DIR": kept, "PYTHONPATH": str(ROOT)}
        for use in ("first use, compiling", "later use", "later use, again"):
            command = [sys.executable, "-c", code, session]
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
            report.add(use, float(done.stdout.split()[0]), "s")


PARTS = {
    f.__name__: f for f in (table, light, jumps, cost, threads, paper, waves, compilation, start)
}


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
