"""What each way to correlate images costs and reaches, for one texture and its noise."""

from __future__ import annotations

import math
import os
import time
import tracemalloc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any
from zlib import crc32

import numpy as np

from analysis.arrays import F64
from analysis.dic import Correlation, Grid, Status, compile_kernels, open_tracker
from analysis.settings import PRESETS
from app.system.errors import UserError
from app.tradeoff.exact_speckle import (
    AT_REST,
    Displacement,
    ExactMotion,
    Pattern,
    Picture,
    Wave,
    noise_bound,
)
from app.tradeoff.study import Figures, Found, Study, Variant
from app.tradeoff.texture import Texture, binned

COLUMNS = {
    "bias_px": "bias (px)",
    "sigma_px": "sigma (px)",
    "over_floor": "sigma / floor",
    "error_px": "error (px)",
    "period_px": "period (px)",
    "efficiency_px2": "period x sigma (px²)",
    "contact_px": "contact (px)",
    "cpu_ms": "CPU (ms)",
    "wall_ms": "wall (ms)",
    "points_per_s": "points /s",
    "memory_mib": "memory (MiB)",
    "lost_percent": "lost (%)",
}
METHODS: dict[str, dict[str, Any]] = {
    "shared": {"method": "shared"},
    "shared order 2": {"method": "shared", "order": 2},
    "icgn": {"method": "icgn"},
    "direct": {"method": "direct"},
}
BOXES = (10, 14, 20, 32, 48, 64, 100)
ALONE: dict[str, tuple[dict[str, Any], ...]] = {  # what else is changed, one at a time
    "shared": (
        {"tolerance": 0.3}, {"tolerance": 0.01}, {"tolerance": 1e-3},
        {"step": 5}, {"step": 20}, {"step": 40},
    ),
    "shared order 2": ({"tolerance": 0.3}, {"tolerance": 0.01}, {"step": 5}, {"step": 20}),
    "icgn": (
        {"tolerance": 0.1}, {"tolerance": 0.01}, {"tolerance": 1e-4}, {"step": 5}, {"step": 20},
    ),
    "direct": ({"step": 20},),
}  # fmt: skip
BINNED = {"shared": (20, 32, 48, 64)}
EFFORT = {"shared": 1.0, "shared order 2": 1.5, "icgn": 9.0}
PASSED = 0.9  # share of a wave's amplitude: its period is the spatial resolution
PERIODS_PX = 14.0 * 2.0 ** (np.arange(24) / 4)
EDGE_PX = 6.0  # a box closer to the border of the picture, before or after its motion, is not used
CALM_PX = 40.0  # further inside, the border does not change how a wave is passed
EQUAL = 1.03  # errors closer than this differ by chance
WRONG_PX = 1.0  # a point further from the truth counts as lost, not as noise
DRIVE_PX = 0.5  # motion from one picture to the next where cost is measured


@dataclass(frozen=True, slots=True)
class Scale:
    """How much is measured.

    Attributes
    ----------
    crop : tuple of int
        Rows and columns of the pictures for the errors.
    fractions : int
        Displacements, evenly over a pixel.
    frames : int
        Pictures whose cost is measured.
    """

    crop: tuple[int, int] = (480, 640)
    fractions: int = 10
    frames: int = 5


FULL, QUICK = Scale(), Scale((288, 432), 4, 3)
QUICK_BOXES = (10, 20, 32, 64)


def variants(
    size: tuple[int, int],
    methods: Sequence[str] = tuple(METHODS),
    boxes: Sequence[int] = (),
    quick: bool = False,
) -> tuple[Variant, ...]:
    """Every method with every box, and at box 20 its other settings, each by itself; the presets,
    unless methods or boxes are chosen. `size` is that of the pictures, (rows, columns).

    Raises
    ------
    UserError
        A box does not fit them.
    """
    largest = min(size) - 2 * round(CALM_PX)
    sides = boxes or [box for box in (QUICK_BOXES if quick else BOXES) if box <= largest]
    if max(sides) > largest:
        raise UserError(
            f"--box {max(sides)}: the picture has {size[1]} x {size[0]} px, {largest} px is its"
            " limit; give smaller boxes, or a larger picture"
        )
    middle = min(sides, key=lambda side: abs(side - Correlation().box))
    made = []
    if not boxes and set(methods) == set(METHODS):
        for name, given in PRESETS.items():
            fitting = [m for m, own in METHODS.items() if own.items() <= given.items()]
            group = max(fitting, key=lambda m: len(METHODS[m]))
            made.append(Variant(f"preset {name}", group, dict(given), _effort(group, given)))
    for method in methods:
        few = quick and not method.startswith("shared")
        changes: list[dict[str, Any]] = [{"box": b} for b in sides if boxes or not few or b <= 32]
        alone = ALONE[method][:: 3 if quick else 1] if not few else ()
        changes += [{"box": middle, **change} for change in alone]
        changes += [{"box": b, "binning": 2} for b in BINNED.get(method, ())[: 1 if few else 4]]
        for change in changes:
            given = METHODS[method] | change
            others = [f"{k} {v}" for k, v in change.items() if k != "box"]
            name = ", ".join([method, f"box {given['box']}", *others])
            made.append(Variant(name, method, given, _effort(method, given)))
    return tuple(variant for variant in made if variant.settings["box"] <= largest)


def _effort(method: str, given: Mapping[str, Any]) -> float:
    effort = EFFORT.get(method, 3.0) * (given["box"] / 20) + 1.0
    return float(effort * (10 / given.get("step", 10)) / given.get("binning", 1) ** 2)


@dataclass(frozen=True)
class SpecklePictures:
    """Pictures of one texture after exact displacements, each with its own noise."""

    texture: Texture
    size: tuple[int, int]
    seed: int = 1
    _made: dict[Displacement, Picture] = field(default_factory=dict)

    def moved(self, motion: Displacement) -> Picture:
        """The picture after a motion, always the same one."""
        if motion not in self._made:
            rng = np.random.default_rng([self.seed, crc32(repr(motion).encode())])
            self._made[motion] = self.texture.picture(self._pattern.grey(motion), rng)
        return self._made[motion]

    def floor(self, box: int, step: int) -> float:
        """Root mean square of the Cramer-Rao bound of u_x, pixels."""
        bound = noise_bound(Grid.cover(self.size, box, step), self._information)
        return float(np.sqrt(np.mean(bound**2)))

    @cached_property
    def _pattern(self) -> Pattern:
        return self.texture.pattern(self.size, self.seed)

    @cached_property
    def _information(self) -> list[F64]:
        return self._pattern.information(self.texture.variance(self._pattern.grey(AT_REST)))


class Tracking:
    """A correlation of pictures as a variant says, binned or not, in pixels of the pictures."""

    def __init__(self, settings: dict[str, Any], threads: int, full_scale: int) -> None:
        given = {k: v for k, v in settings.items() if k != "binning"}
        self._by = int(settings.get("binning", 1))
        whole = Correlation(**given, threads=threads, full_scale=full_scale)
        self.correlation = whole
        if self._by > 1:
            self.correlation = replace(
                whole, box=max(4, whole.box // self._by), step=max(1, whole.step // self._by)
            )

    def open(self, reference: Picture) -> None:
        """Begin with a reference, at rest."""
        self._tracker = open_tracker(self.correlation, self._seen(reference))
        self._tracker.start_from(*np.zeros((2, *self._tracker.grid.shape)))

    def track(self, image: Picture) -> tuple[np.ndarray, np.ndarray]:
        """u_x of every point, NaN where it is lost, and its status."""
        found = self._tracker.track(self._seen(image))
        return self._by * found.ux_px.astype(np.float64), found.status

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """X and y of every point."""
        grid, by = self._tracker.grid, self._by
        x, y = np.meshgrid(grid.x_px, grid.y_px)
        return by * x + (by - 1) / 2, by * y + (by - 1) / 2

    def close(self) -> None:
        """End the threads."""
        self._tracker.close()

    def _seen(self, picture: Picture) -> Picture:
        return picture if self._by == 1 else binned(picture)


class VariantTimer:
    """Measures variants on pictures of one texture."""

    def __init__(self, texture: Texture, size: tuple[int, int], scale: Scale, threads: int) -> None:
        self._texture, self._scale, self._threads = texture, scale, threads
        self._small = SpecklePictures(texture, scale.crop)
        self._large = SpecklePictures(texture, size, seed=2)

    def measure(self, variant: Variant) -> Figures:
        """The figures of a variant, in the order of `COLUMNS`."""
        settings = variant.settings
        tracking = Tracking(settings, self._threads, self._texture.end)
        compile_kernels(tracking.correlation, self._texture.dtype)
        box, step = settings["box"], settings.get("step", Correlation().step)
        bias, sigma, lost = self.errors(tracking, box)
        period = self.period(tracking, box)
        cost = self._cost(tracking)
        floor = self.floor(box, step)
        return {
            "bias_px": bias,
            "sigma_px": sigma,
            "over_floor": sigma / floor if floor else math.nan,
            "error_px": math.hypot(bias, sigma),
            "period_px": period,
            "efficiency_px2": period * sigma,
            **cost,
            "lost_percent": 100 * lost,
        }

    def floor(self, box: int, step: int) -> float:
        """See `SpecklePictures.floor`."""
        return self._small.floor(box, step)

    def errors(self, tracking: Tracking, box: int) -> tuple[float, float, float]:
        """Largest mean error of u_x over the fractions of a pixel, scatter within the pictures, and
        share of lost points.
        """
        tracking.open(self._small.moved(AT_REST))
        x, y = tracking.points()
        (rows, columns), least = self._scale.crop, box / 2 + EDGE_PX
        biases, scatters, lost = [], [], []
        for n in range(1, self._scale.fractions + 1):  # with jumps: each starts from the last one
            ux = (3 * n % self._scale.fractions or self._scale.fractions) / self._scale.fractions
            found, _ = tracking.track(self._small.moved(ExactMotion.uniform(ux)))
            scored = (x >= least) & (x + ux <= columns - 1 - least)
            scored &= (y >= least) & (y <= rows - 1 - least)
            error = (found - ux)[scored]
            right = np.abs(error) <= WRONG_PX
            lost.append(1 - float(right.mean()) if right.size else math.nan)
            if right.any():
                biases.append(float(error[right].mean()))
                scatters.append(float(error[right].var()))
        tracking.close()
        if not biases:
            return math.nan, math.nan, 1.0
        return max(map(abs, biases)), math.sqrt(np.mean(scatters)), float(np.mean(lost))

    def passed(self, tracking: Tracking, box: int, period: float) -> float:
        """Share of the amplitude of a wave of u_x along x that is measured."""
        rows, columns = self._scale.crop
        wave = Wave(period)
        tracking.open(self._small.moved(AT_REST))
        x, y = tracking.points()
        found, status = tracking.track(self._small.moved(wave))
        tracking.close()
        inside = np.abs(x - (columns - 1) / 2) < (columns - box) / 2 - CALM_PX
        inside &= np.abs(y - (rows - 1) / 2) < (rows - box) / 2 - CALM_PX
        used = inside & (status == Status.OK)
        if used.sum() < 12:
            return math.nan
        true = wave(x[used], y[used])[0]
        return float(np.polyfit(true, found[used], 1)[0])

    def period(self, tracking: Tracking, box: int) -> float:
        """Period of the wave of which 90 % of the amplitude is measured, pixels; NaN beyond the
        width of the pictures.
        """
        last = int(np.searchsorted(PERIODS_PX, 0.8 * self._scale.crop[1])) - 1
        share = cache(lambda n: self.passed(tracking, box, float(PERIODS_PX[n])))
        n = min(last, int(np.argmin(np.abs(PERIODS_PX - 4 * box))))
        while n < last and not share(n) >= PASSED:
            n += 1
        if not share(n) >= PASSED:
            return math.nan
        while n > 0 and share(n - 1) >= PASSED:
            n -= 1
        if n == 0:
            return float(PERIODS_PX[0])
        below, above = share(n - 1), share(n)
        t = (PASSED - below) / (above - below) if above > below else 1.0
        return float(PERIODS_PX[n - 1] * (PERIODS_PX[n] / PERIODS_PX[n - 1]) ** t)

    def _cost(self, tracking: Tracking) -> Figures:
        """Medians over pictures of full size of a contact that slips from its edge, half a pixel
        further each time; and the rms error of u_x where it slips.
        """
        size, frames = self._large.size, self._scale.frames
        radius = 0.25 * min(size)
        drives = DRIVE_PX * np.arange(1, frames + 2)
        motions = [
            ExactMotion.contact(drive, size, radius, radius / 80) for drive in drives.tolist()
        ]
        pictures = [self._large.moved(motion) for motion in (AT_REST, *motions)]
        tracemalloc.start()
        tracking.open(pictures[0])
        tracking.track(pictures[1])
        memory = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        wall, cpu, errors = [], [], []
        x, y = tracking.points()
        for picture, motion in zip(pictures[2:], motions[1:], strict=True):
            began, used = time.perf_counter(), time.process_time()
            found, _ = tracking.track(picture)
            wall.append(time.perf_counter() - began)
            cpu.append(time.process_time() - used)
            errors.append((found - motion(x, y)[0])[motion.ring(x, y)])
        tracking.close()
        every = np.concatenate(errors)
        right = every[np.abs(every) <= WRONG_PX]
        return {
            "contact_px": math.sqrt(np.mean(right**2)) if right.size else math.nan,
            "cpu_ms": 1e3 * float(np.median(cpu)),
            "wall_ms": 1e3 * float(np.median(wall)),
            "points_per_s": x.size / float(np.median(wall)),
            "memory_mib": memory / 2**20,
        }


def study(
    texture: Texture,
    size: tuple[int, int],
    threads: int,
    wanted: Sequence[Variant],
    quick: bool = False,
) -> Study:
    """The study of a texture, for pictures of `size` (rows, columns)."""
    scale = QUICK if quick else FULL
    about = {
        "picture": f"{size[1]} x {size[0]} {texture.dtype}",
        "texture": texture.sentence(),
        "read_variance": round(texture.read_variance, 6),
        "shot_variance": round(texture.shot_variance, 8),
        "grains": None if texture.grains is None else texture.grains.sigma_px.round(4).tolist(),
        "threads": threads,
        "scale": f"{scale.crop[1]} x {scale.crop[0]} px, {scale.fractions} displacements",
    }
    bench = VariantTimer(texture, size, scale, threads)
    errors = "error_px", "period_px"
    subject = "image correlation"
    return Study(subject, about, COLUMNS, "cpu_ms", errors, tuple(wanted), bench.measure)


def advice(found: Found, rate_hz: float, free: float, period_px: float | None) -> list[str]:
    """Which variant to use for so many pictures a second, in sentences.

    Parameters
    ----------
    free : float
        Share of this computer that must be left to others.
    period_px : float or None
        Longest period of a wave that must be passed; None: that of the standard settings.
    """
    standard = f"shared, box {Correlation().box}"
    longest = period_px or found.get(standard, {}).get("period_px", math.nan)
    longest = longest if math.isfinite(longest) else math.inf
    share, cores = (1 - free) * 1e3 / rate_hz, os.cpu_count() or 1
    fits = {
        name: f
        for name, f in found.items()
        if f["cpu_ms"] <= cores * share and f["wall_ms"] <= share
    }
    where = f"for {rate_hz:g} frames/s on this machine with {free:.0%} of it free"
    if not fits:
        fastest = min(found, key=lambda name: found[name]["wall_ms"])
        return [
            f"{where}: none; the fastest is {fastest} with {found[fastest]['wall_ms']:.3g} ms a"
            " frame"
        ]
    fine = {name: f for name, f in fits.items() if f["period_px"] <= longest * 1.005}
    lines = []
    resolution = f"waves of {longest:.0f} px and more passed to {PASSED:.0%}"
    for what, chosen, key in (
        (resolution if longest < math.inf else "at any resolution", fine, ("error_px",)),
        ("the least period x error", fits, ("period_px", "error_px")),
    ):
        values = {name: math.prod(f[k] for k in key) for name, f in chosen.items()}
        usable = [name for name, value in values.items() if math.isfinite(value)]
        if usable:
            least = min(values[name] for name in usable)
            near = [name for name in usable if values[name] <= EQUAL * least]
            # of those that differ by chance, the one with the most points
            best = max(near, key=lambda name: found[name]["points_per_s"] * found[name]["wall_ms"])
            f = chosen[best]
            lines.append(
                f"{where}, {what}: {best}, {f['sigma_px']:.2g} px, a period of {f['period_px']:.0f}"
                f" px, {f['wall_ms']:.3g} ms a frame"
            )
    return lines
