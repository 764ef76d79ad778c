"""The measurements of another lab, with the truth behind them: images of a sphere that is pressed
on a rough block and sheared, forces and times of the images, and the tables in which such labs
write them.

The mechanics are those of `friction.elasto_plastic_world`, the pictures Gaussian blobs that are
moved exactly; nothing that imports or analyses is used for them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blobs import _add
from friction.elasto_plastic_world import DENSE, R, World

from app.files import importing

NU, STIFFNESS, COMPLIANCE = 0.5, 9579.0, 0.68e-6  # of the block; of Q's cantilever, N/m; m/N
LENGTH = 0.02e-6  # of slip, m: so short that the law is Coulomb's
FULL = 4095  # 12 bit


@dataclass(frozen=True)
class Lab:
    """What was measured; all times are those of the clock of the images, s."""

    images: list[np.ndarray]
    at: np.ndarray  # beginning of each exposure
    times: np.ndarray  # of the forces
    forces: np.ndarray  # P and Q, N
    pixel: float  # m
    free: list[int] = field(default_factory=list)  # images before the contact
    drive_s: float = 0.0
    E: float = 0.0
    mu: float = 0.0
    v: float = 0.0
    t_s: float = 0.0  # from the start of the drive
    radius: float = 0.0

    @property
    def rest(self) -> int:
        """The last image that ended before the drive."""
        return int(np.flatnonzero(self.at + EXPOSURE < self.drive_s)[-1])


EXPOSURE = 0.01


@dataclass(frozen=True)
class Plan:
    """How an experiment goes; lengths in px are of the picture, all others in SI units."""

    shape: tuple[int, int] = (360, 360)
    pixel: float = 11e-6
    P: float = 0.03
    E: float = 2.1e6
    mu: float = 0.85
    v: float = 3e-6
    rate: float = 8.0  # images per second
    force_rate: float = 500.0
    jitter: float = 0.1  # of the steps of the forces' clock
    pressed: tuple[float, float] = (1.22, 2.13)  # when P rises
    drive: float = 3.47
    end: float = 11.5
    noise: float = 2e-4  # of the forces, N
    zero: tuple[float, float] = (0.0, 0.0)  # of the forces, N
    seed: int = 3
    density: float = 0.1  # grains per square pixel
    sideways: tuple[float, float] = (0.0, 0.0)  # px by which pressing moves the block


def measured(plan: Plan) -> Lab:
    """The experiment of a plan, as it was measured."""
    world = World(plan.P, mu=plan.mu, L=LENGTH, E=plan.E, nu=NU)
    slack = 1 / STIFFNESS + COMPLIANCE
    sliding = plan.mu * plan.P
    distances = world.full * np.concatenate([np.linspace(0.02, 1.0, 60), [1.1, 1.2]])
    states = world.run(distances)
    D = np.concatenate([[0.0], distances])
    Q = np.concatenate([[0.0], [state.Q for state in states]])
    zero = np.zeros((1, len(DENSE)))
    g0 = np.concatenate([zero, [state.g0 for state in states]])
    g2 = np.concatenate([zero, [state.g2 for state in states]])
    rng = np.random.default_rng(plan.seed)

    def moved(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D and Q at times: D + Q (1/k + C) = v (t - t_0)."""
        travel = plan.v * np.maximum(np.asarray(t) - plan.drive, 0.0)
        held = D[:-1] + Q[:-1] * slack  # up to where it slides
        in_contact = np.interp(travel, held, D[:-1])
        far = travel - Q[-1] * slack
        slides = travel > held[-1]
        return np.where(slides, far, in_contact), np.where(
            slides, Q[-1], np.interp(travel, held, Q[:-1])
        )

    def pressed(t: np.ndarray) -> np.ndarray:
        begin, end = plan.pressed
        share = np.clip((np.asarray(t) - begin) / (end - begin), 0, 1)
        return plan.P * share * share * (3 - 2 * share)

    steps = 1 + plan.jitter * rng.uniform(-1, 1, int(plan.end * plan.force_rate))
    times = np.cumsum(steps) / plan.force_rate - 1 / plan.force_rate
    times -= times[0]
    forces = np.column_stack([pressed(times), moved(times)[1]]) + plan.zero
    forces += plan.noise * rng.normal(size=forces.shape)

    at = np.arange(0, plan.end - EXPOSURE, 1 / plan.rate)
    scene = _Scene(plan, rng)
    images = []
    for t in at + EXPOSURE / 2:
        d, q = (float(value) for value in moved(t))
        a = np.cbrt(3 * float(pressed(t)) * R * (1 - NU**2) / (4 * plan.E))
        n = min(int(np.searchsorted(D, d)), len(D) - 1)
        share = 0.0 if n == 0 else min(1.0, (d - D[n - 1]) / (D[n] - D[n - 1]))
        even, double = (
            g[max(0, n - 1)] + share * (g[n] - g[max(0, n - 1)]) if d < D[-1] else g[-1]
            for g in (g0, g2)
        )
        aside = np.multiply(plan.sideways, float(pressed(t)) / plan.P)
        images.append(
            scene.image(d + COMPLIANCE * q, COMPLIANCE * q, even, double, float(a), rng, aside)
        )
    return Lab(
        images,
        at,
        times,
        forces,
        plan.pixel,
        [int(n) for n in np.flatnonzero(at + EXPOSURE < plan.pressed[0])],
        plan.drive,
        plan.E,
        plan.mu,
        plan.v,
        (world.full + sliding * slack) / plan.v,
        world.a,
    )


class _Scene:
    """The face of the block under a camera: grains that are always seen, spots where it touches."""

    def __init__(self, plan: Plan, rng: np.random.Generator) -> None:
        self.plan, (rows, columns) = plan, plan.shape
        halo = 60
        size = (rows + 2 * halo, columns + 2 * halo)

        def blobs(density: float, low: float, high: float, peak: tuple[float, float]) -> list:
            n = int(density * size[0] * size[1])
            return [
                rng.uniform(-halo, columns + halo, n),
                rng.uniform(-halo, rows + halo, n),
                rng.uniform(low, high, n),
                rng.uniform(*peak, n),
            ]

        self.grains = blobs(plan.density, 0.75, 1.25, (400, 1000))
        self.spots = blobs(0.006, 1.2, 1.6, (1100, 1500))
        self.threshold = rng.uniform(0, 1, len(self.spots[0]))
        y, x = np.mgrid[: plan.shape[0], : plan.shape[1]]
        self.light = 1 - 0.1 * ((x / columns - 0.45) ** 2 + (y / rows - 0.55) ** 2)
        self._place: tuple[float, ...] = ()

    def image(self, block, lens, even, double, a, rng, aside) -> np.ndarray:
        """Moved by `block` far from the lens, which has moved by `lens`; metres. 12 bit in 16. All
        of the block has moved by `aside` px more.
        """
        place = block, lens, a, *aside
        if place != self._place:  # at rest it is seen many times
            self._place = place
            self._lit = 350 + self.light * self._drawn(block, lens, even, double, a, aside)
        grey = self._lit + np.sqrt(12.0**2 + 0.3 * self._lit) * rng.normal(size=self._lit.shape)
        return np.clip(np.rint(grey), 0, FULL).astype(np.uint16)

    def _drawn(self, block, lens, even, double, a, aside) -> np.ndarray:
        pixel, (rows, columns) = self.plan.pixel, self.plan.shape
        cx, cy = columns / 2 + 3.3 + lens / pixel, rows / 2 - 2.6
        scene = np.zeros(self.plan.shape)
        for n, (x, y, width, height) in enumerate((self.grains, self.spots)):
            at_x, at_y = x + aside[0], y + aside[1]
            px, py = at_x + block / pixel, at_y
            for _ in range(3):  # the displacement is that of the place where the blob is now
                dx, dy = (px - cx) * pixel, (py - cy) * pixel
                r, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
                e, d = np.interp(r, DENSE, even), np.interp(r, DENSE, double)
                px = at_x + (block - e - d * np.cos(2 * angle)) / pixel
                py = at_y - d * np.sin(2 * angle) / pixel
            lit = np.ones_like(px)
            if n and a > 0:
                pressure = np.sqrt(np.clip(1 - (np.hypot(px - cx, py - cy) * pixel / a) ** 2, 0, 1))
                lit = np.clip((pressure - self.threshold) / 0.05, 0, 1)
            elif n:
                break
            peak = height * lit
            seen = (peak > 0) & (px > -9) & (px < columns + 9) & (py > -9) & (py < rows + 9)
            # `_add` takes what a blob holds in all; its peak is that over 2 pi width^2
            total = peak * 2 * np.pi * width**2 / 4
            _add(scene, px[seen], py[seen], width[seen], total[seen])
        return scene


def look_once(patch: pytest.MonkeyPatch) -> None:
    """Let the import look for the motion in the same images, at the same times, once only: that is
    nearly all of its time.
    """
    motion_of, seen = importing.motion_of, {}

    def remembered(times_s: Sequence[float], image: Callable[[int], Any]) -> Any:
        ends = (image(n) for n in (0, len(times_s) - 1))
        key = (*times_s, *(None if end is None else end.tobytes() for end in ends))
        if key not in seen:
            seen[key] = motion_of(times_s, image)
        return seen[key]

    patch.setattr(importing, "motion_of", remembered)


# ------------------------------------------------------------------ what such labs write


def write_images(
    lab: Lab, folder: Path, name: Callable[[int], str] = "bild_{:04d}.tif".format, leave=()
) -> Path:
    """A file for each image, but those to be left out."""
    folder.mkdir()
    for n, image in enumerate(lab.images):
        if n not in leave:
            cv2.imwrite(str(folder / name(n)), image, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    return folder


def write_stack(lab: Lab, path: Path) -> Path:
    """All images in one file of many pages, as cameras write it."""
    cv2.imwritemulti(str(path), lab.images, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    return path


@dataclass(frozen=True)
class Style:
    """How a table is written."""

    names: tuple[str, ...] = ("Zeit [s]", "Normalkraft [N]", "Tangentialkraft [N]", "Notiz")
    separator: str = ";"
    decimal: str = ","
    encoding: str = "latin-1"
    time: float = 1.0  # what a second is written as
    force: float = 1.0
    ahead: float = 12.5  # the forces' clock was begun so much earlier, s
    order: Sequence[int] = (0, 1, 2, 3)
    thousands: str = ""
    digits: int = 6
    note: str = "µm-Prüfung"


def write_forces(lab: Lab, path: Path, style: Style = Style(), rows: slice = slice(None)) -> Path:
    """The forces as a table in a style."""

    def written(value: float) -> str:
        text = f"{value:,.{style.digits}f}".replace(",", "\0").replace(".", style.decimal)
        return text.replace("\0", style.thousands)

    lines = [style.separator.join(style.names[n] for n in style.order)]
    for t, (P, Q) in zip(lab.times[rows].tolist(), lab.forces[rows].tolist(), strict=True):
        cells = [written((t + style.ahead) * style.time)]
        cells += [written(P * style.force), written(Q * style.force), style.note]
        lines.append(style.separator.join(cells[n] for n in style.order))
    path.write_text("\n".join(lines) + "\n", encoding=style.encoding, newline="\n")
    return path


def write_settings(lab: Lab, path: Path) -> Path:
    """What the operator knows of sample and optics: E only within 5 %."""
    path.write_text(
        f"[camera]\npixel = {lab.pixel * 1e6:g}\n"
        f"[sample]\nyoung_modulus = {lab.E * 1.03e-6:g}\nroughness = 0.1\n"
        f"lens_compliance = {COMPLIANCE * 1e6:g}\n",
        encoding="utf-8",
    )
    return path


def with_forces(lab: Lab, every: int) -> Lab:
    """The same with fewer rows of forces."""
    return replace(lab, times=lab.times[::every], forces=lab.forces[::every])


FULL_SIZE = Plan(
    shape=(1024, 1024),
    pixel=7.04e-6,
    P=0.5,
    v=4e-6,
    rate=7.0,
    pressed=(1.5, 3.2),
    drive=6.13,
    end=300 / 7.0,
    noise=1e-3,
    density=0.07,
)

if __name__ == "__main__":  # the data set in full size: python foreign_lab.py FOLDER
    target = Path(sys.argv[1])
    target.mkdir()
    whole = measured(FULL_SIZE)
    write_images(whole, target / "images")
    write_forces(whole, target / "kraft.csv")
    write_settings(whole, target / "lab.toml")
    print(f"E {whole.E}, mu {whole.mu}, v {whole.v}, t_s {whole.t_s}, a {whole.radius}")
