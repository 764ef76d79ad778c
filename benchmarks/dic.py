"""Speed and accuracy of every method of the correlation, on pictures whose displacement is exact.

    python benchmarks/dic.py [table light jumps cost threads paper waves compile] [--frames 5]
    [--plot sigma.png]

table    points/s on one core, translation (worst bias / sigma / rmse) and graded ring (rmse)
without and with noise of 2 grey levels light    the same translation after a change of gain or
level of the whole picture, noise included jumps    a cold start and a jump of 40 px: seconds, share
of the points that are right cost     time of a frame for other boxes and steps, relative to box 20
and step 10 threads  time of a frame on two threads against one paper    the paper's calibration
(Fig. 4d): u_x from 0.14 to 14 px, sigma for boxes of 10 to 100 px, and the floor waves    amplitude
that is left of a sinusoidal u_x, by wavelength, beside that of a plain average over the box compile
seconds of the first use with an empty cache, and of a later one

benchmarks/dic_peers.py prints the same table for other libraries, on the same pictures.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from analysis.dic import Correlation, Grid, Tracker, compile_kernels, open_tracker  # noqa: E402
from benchmarks.dic_peers import Step, follow, score_ring, score_translation  # noqa: E402
from benchmarks.speckle import SIZE, Frame, Motion, camera, images, noise_floor, pattern  # noqa: E402

METHODS = {
    "shared (default)": Correlation(threads=1),
    "shared, tolerance 0.01": Correlation(tolerance=0.01, threads=1),
    "IC-GN order 0": Correlation(method="icgn", order=0, threads=1),
    "IC-GN order 1": Correlation(method="icgn", order=1, threads=1),
    "IC-GN order 2": Correlation(method="icgn", order=2, threads=1),
    "direct (the paper)": Correlation(method="direct", threads=1),
}
PAPER_BOXES = (10, 14, 20, 32, 48, 64, 100)


def at_rest(correlation: Correlation, reference: np.ndarray) -> Tracker:
    """A tracker that starts from zero displacement."""
    tracker = open_tracker(correlation, reference)
    tracker.start_from(*np.zeros((2, *tracker.grid.shape)))
    return tracker


def peer(correlation: Correlation, uncertainties: list[np.ndarray] | None = None):
    """The correlation in the form of `benchmarks.dic_peers`."""

    def start(reference: np.ndarray) -> Step:
        tracker = at_rest(correlation, reference)
        x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)

        def step(image: np.ndarray):
            field = tracker.track(image)
            if uncertainties is not None:
                uncertainties.append(field.ux_std_px.ravel())
            return x.ravel(), y.ravel(), field.ux_px.ravel(), field.uy_px.ravel()

        return step

    return start


def frames_of(name: str, noise: float, limit: int | None) -> list[Frame]:
    """The reference and the first frames of a set."""
    return list(images(name, noise))[: limit and limit + 1]


def table(limit: int | None) -> None:
    """Every method on both sets."""
    errors = "bias / sigma / rmse       ring"
    print(
        f"method                     kpoints/s   noise 0: {errors}   noise 2: {errors}   lost % "
        " error/std"
    )
    for name, correlation in METHODS.items():
        cells, spent, lost, normalised = [], [], 0.0, []
        for noise in (0, 2):
            for kind, score in (("translation", score_translation), ("contact", score_ring)):
                stated: list[np.ndarray] = []
                frames = frames_of(kind, noise, limit)
                measured, seconds = follow(peer(correlation, stated), frames)
                bias, sigma, rmse, wrong = score(frames[1:], measured)
                cells.append(
                    f"{bias:.4f} / {sigma:.4f} / {rmse:.4f}"
                    if kind == "translation"
                    else f"{rmse:.4f}"
                )
                if noise:
                    spent += seconds
                    for frame, (x, y, ux, _), std in zip(
                        frames[1:], measured, stated[-len(measured) :], strict=True
                    ):
                        normalised.append((ux - frame.truth(x, y)[0]) / std)
                lost = max(lost, wrong)
        unit = np.concatenate(normalised)
        rate = measured[0][0].size / np.median(spent) / 1e3
        print(
            f"{name:24s} {rate:10.0f}    {'   '.join(cells)}   {100 * lost:6.3f}  "
            f" {np.std(unit[np.abs(unit) < 8]):.3f}",
            flush=True,
        )
    floors = [
        np.sqrt(np.mean(noise_floor(Grid.cover(SIZE, 20, 10), noise) ** 2)) for noise in (0, 2)
    ]
    print(
        f"floor at box 20: {floors[0]:.5f} px without noise (rounding), {floors[1]:.5f} px with"
        " noise 2"
    )


def light(limit: int | None) -> None:
    """Gain and offset between the reference and the frames."""
    frames = frames_of("translation", 2, limit)
    print("gain  offset   bias / sigma / rmse")
    for gain, offset in ((1, 0), (0.75, 0), (1, 20), (1, -20), (0.5, 0), (0.5, 60)):
        changed = [
            frames[0],
            *(
                replace(f, image=cv2.convertScaleAbs(f.image, alpha=gain, beta=offset))
                for f in frames[1:]
            ),
        ]
        measured, _ = follow(peer(METHODS["shared (default)"]), changed)
        bias, sigma, rmse, _ = score_translation(changed[1:], measured)
        print(f"{gain:4.2f}  {offset:6d}   {bias:.4f} / {sigma:.4f} / {rmse:.4f}")
    exact, rng = pattern(), np.random.default_rng(5)
    dim = [
        frames[0],
        *(replace(f, image=camera(0.75 * exact.grey(f.truth), 2, rng)) for f in frames[1:6]),
    ]
    bias, sigma, rmse, _ = score_translation(
        dim[1:], follow(peer(METHODS["shared (default)"]), dim)[0]
    )
    print(
        f"0.75 of the light, noise still 2 grey levels (floor 1.18 times as high): {bias:.4f} /"
        f" {sigma:.4f} / {rmse:.4f}"
    )


def jumps(_: int | None) -> None:
    """Cold starts and jumps."""
    rng, exact = np.random.default_rng(3), pattern()
    print("method                   jump px   cold s (cpu)   jump s (cpu)   right points")
    for name in ("shared (default)", "IC-GN order 1", "direct (the paper)"):
        reference = camera(exact.grey(Motion.uniform(0)), 2, rng)
        tracker = at_rest(METHODS[name], reference)
        for ux in (40.3, -49.6):
            image = camera(exact.grey(Motion.uniform(ux)), 2, rng)
            tracker.track(image)  # makes ready what the search needs
            seconds = []
            for cold in (True, False):
                if cold:
                    tracker.reset()
                else:
                    tracker.track(reference)
                start = time.process_time()
                field = tracker.track(image)
                seconds.append(time.process_time() - start)
            x = tracker.grid.x_px
            stays = (x + ux > 20) & (x + ux < SIZE[1] - 20)
            right = np.mean(np.abs(field.ux_px[:, stays] - ux) < 0.2)
            print(
                f"{name:24s} {ux:7.1f}   {seconds[0]:12.3f}   {seconds[1]:12.3f}   {right:.5f}",
                flush=True,
            )


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


def cost(limit: int | None) -> None:
    """Other boxes and steps."""
    frames = frames_of("contact", 2, limit)
    base = milliseconds(METHODS["shared (default)"], frames)
    print(
        f"shared, contact set: {base:.1f} ms of one core a frame at box 20, step 10; relative to"
        " that, and to the number of box pixels"
    )
    for box, step in (
        (10, 10),
        (21, 10),
        (40, 10),
        (60, 10),
        (100, 10),
        (20, 5),
        (60, 5),
        (20, 20),
    ):
        correlation = Correlation(box=box, step=step, threads=1)
        shape = Grid.cover(SIZE, box, step).shape
        pixels = shape[0] * shape[1] * box**2 / (118 * 158 * 400)
        print(
            f"  box {box:3d} step {step:2d}: {milliseconds(correlation, frames) / base:6.2f}  "
            f" {pixels:6.2f}",
            flush=True,
        )


def threads(limit: int | None) -> None:
    """One thread and two, wall clock."""
    for name in ("translation", "contact"):
        frames = frames_of(name, 2, limit)
        one, two = (
            min(milliseconds(Correlation(threads=n), frames, wall=True) for _ in range(3))
            for n in (1, 2)
        )
        print(
            f"{name}: {one:.1f} ms on one thread, {two:.1f} ms on two: {one / two:.2f} times as"
            " fast"
        )


def paper(limit: int | None, plot: Path | None = None) -> None:
    """The paper's Fig. 4d and what lies below it."""
    frames = frames_of("long", 2, limit)
    print(
        "box     direct sigma   shared sigma   IC-GN 1 sigma   floor  (px; u_x from 0.14 to 14 px,"
        " noise 2)"
    )
    curves = []
    for box in PAPER_BOXES:
        row = [float(box)]
        for correlation in (
            METHODS["direct (the paper)"],
            METHODS["shared (default)"],
            METHODS["IC-GN order 1"],
        ):
            measured, _ = follow(peer(replace(correlation, box=box)), frames)
            row.append(score_translation(frames[1:], measured, box).sigma)
        row.append(float(np.sqrt(np.mean(noise_floor(Grid.cover(SIZE, box, 10), 2) ** 2))))
        curves.append(row)
        print("{:3.0f}   {:12.4f}   {:12.4f}   {:13.4f}   {:.4f}".format(*row), flush=True)
    if plot is not None:
        from matplotlib import pyplot

        box_px, *sigmas = np.array(curves).T
        figure, axes = pyplot.subplots(figsize=(6, 4.2), layout="constrained")
        for sigma, label, style in zip(
            sigmas,
            ("direct (the paper's)", "shared", "IC-GN order 1", "floor"),
            ("o-", "s-", "^-", "k--"),
            strict=True,
        ):
            axes.loglog(box_px, sigma, style, label=label)
        axes.loglog(20, 0.033, "r*", markersize=12, label="Prevost et al. (2013), box 20")
        axes.set(xlabel="box λ (px)", ylabel="standard deviation of $u_x$ (px)")
        axes.set_xticks(PAPER_BOXES, map(str, PAPER_BOXES), minor=False)
        axes.minorticks_off()
        axes.legend(frameon=False)
        figure.savefig(plot, dpi=150)
        print(plot)


class Wave:
    """u_x = A sin(2 pi y / wavelength) of a pattern, or along x."""

    def __init__(self, wavelength: float, axis: int) -> None:
        self._k, self._axis, self._amplitude = (
            2 * np.pi / wavelength,
            axis,
            0.015 * wavelength / 2 / np.pi,
        )

    def __call__(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = self._amplitude * np.sin(self._k * np.asarray((x, y)[self._axis]))
        return u, np.zeros_like(u)

    def gradient(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = self._amplitude * self._k * np.cos(self._k * np.asarray((x, y)[self._axis]))
        return (slope, 0 * slope) if self._axis == 0 else (0 * slope, slope)


def waves(_: int | None) -> None:
    """What each method passes of short waves, and the side of the box whose plain average would
    pass as much.
    """
    size = (480, 480)
    made = pattern(size)
    grey = made.grey(Motion.uniform(0))
    chosen = ("shared (default)", "IC-GN order 0", "IC-GN order 1", "direct (the paper)")
    print(f"{'wavelength':>10s}  axis  average" + "".join(f"  {name:>24s}" for name in chosen))
    for wavelength in (40, 60, 80, 120, 200):
        for axis in (0, 1):
            motion, row = Wave(wavelength, axis), []
            for name in chosen:
                tracker = at_rest(METHODS[name], np.rint(grey).clip(0, 255).astype(np.uint8))
                found = tracker.track(
                    np.rint(made.grey(motion)).clip(0, 255).astype(np.uint8)
                ).ux_px[4:-4, 4:-4]
                true = motion(*np.meshgrid(tracker.grid.x_px, tracker.grid.y_px))[0][4:-4, 4:-4]
                tracker.close()
                passed = float((found * true).sum() / (true**2).sum())
                row.append(
                    f"{passed:.3f} (box {wavelength * np.sqrt(6 * max(0.0, 1 - passed)) / np.pi:4.1f} px)"
                )
            print(
                f"{wavelength:7d} px  {'xy'[axis]:>4s}  {np.sinc(20 / wavelength):7.3f}"
                + "".join(f"  {text:>24s}" for text in row)
            )


def compilation(_: int | None) -> None:
    """First and later use, in processes of their own."""
    code = (
        "import time; t = time.perf_counter(); from analysis.dic import compile_kernels;"
        " compile_kernels(); print(time.perf_counter() - t)"
    )
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT)}
        for use in ("first", "later"):
            done = subprocess.run(
                [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
            )
            print(f"{use} use of the default method: {float(done.stdout):.1f} s, imports included")


PARTS = {
    "table": table,
    "light": light,
    "jumps": jumps,
    "cost": cost,
    "threads": threads,
    "paper": paper,
    "waves": waves,
    "compile": compilation,
}


def main() -> None:
    """Print the parts that are asked for."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("parts", nargs="*", choices=[[], *PARTS], default=list(PARTS))
    ask.add_argument("--frames", type=int, metavar="N", help="only the first N frames of each set")
    ask.add_argument("--plot", type=Path, help="draw the paper's curve into this file")
    options = ask.parse_args()
    cv2.setNumThreads(1)
    for correlation in METHODS.values():
        compile_kernels(correlation)
    for part in options.parts:
        print(f"\n{part}")
        paper(options.frames, options.plot) if part == "paper" else PARTS[part](options.frames)


if __name__ == "__main__":
    main()
