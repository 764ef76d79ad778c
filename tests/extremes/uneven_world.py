"""Contacts that are not what the methods assume: not round, with uneven friction, before a camera
that shakes; their truth and their pictures.

The mechanics are a solver of its own on a grid of cells, with both components of the traction; of
the program only the surface's response to a traction is used (`half_space`, checked by closed
forms). The pictures are Gaussian blobs that are moved exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from blobs import _add
from scipy.ndimage import map_coordinates

from analysis.mechanics.half_space import SurfaceGreen

E, NU, R, MU, L = 3.43e6, 0.5, 0.1288, 0.93, 0.8e-6
SLACK = 1 / 9579 + 0.68e-6  # of cantilever and lens holder, m/N
LENS = 0.68e-6
CELL = 50e-6  # m
SUB = 4
Shape = Callable[[np.ndarray, np.ndarray], np.ndarray]


def ellipse(along: float, across: float, turned_deg: float = 0.0) -> Shape:
    """Hertz's pressure over an ellipse with those half axes (m), its peak 1."""
    t = np.radians(turned_deg)

    def pressure(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, v = x * np.cos(t) + y * np.sin(t), y * np.cos(t) - x * np.sin(t)
        return np.sqrt(np.clip(1 - (u / along) ** 2 - (v / across) ** 2, 0, None))

    return pressure


def one(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.ones_like(x)


ROUND = ellipse(1.1225e-3, 1.1225e-3)


@dataclass(frozen=True)
class Uneven:
    """A world; each part by default as the methods assume it.

    `friction` is mu over that of the settings at (x, y), `shake` (dx px, dy px, rad) of the time.
    """

    P: float = 0.067
    pressure: Shape = ROUND
    friction: Shape = one
    shake: Callable[[float], tuple[float, float, float]] = lambda t: (0.0, 0.0, 0.0)
    v: float = 3e-6
    rate: float = 8.0
    frames: int = 96
    size: int = 480
    pixel: float = 10e-6
    noise: float = 1.0
    seed: int = 1
    spots: float = 0.02  # candidates of micro-contacts per square pixel
    roughness: float = 0.1

    # ---------------------------------------------------------------- mechanics

    @cached_property
    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """The pressure p, and mu p/MU, on the cells of the contact."""
        n = 56
        fine = (np.arange(n * SUB) - (n * SUB - 1) / 2) * CELL / SUB
        x, y = np.meshgrid(fine, fine)
        p = self.pressure(x, y)

        def mean(f: np.ndarray) -> np.ndarray:
            return f.reshape(n, SUB, n, SUB).mean(axis=(1, 3))

        p *= self.P / (mean(p).sum() * CELL**2)
        return mean(p), mean(p * self.friction(x, y))

    @cached_property
    def states(self) -> list[tuple[float, float, np.ndarray]]:
        """D, Q and the traction (2, n, n), one after the other."""
        p = self.cells[1]
        green = SurfaceGreen(p.shape, CELL, E, NU, coupled=True)
        s, most = np.zeros((2, *p.shape)), MU * float(p.sum()) * CELL**2
        D, found = 0.0, [(0.0, 0.0, np.zeros_like(s))]
        way = self.v * self.frames / self.rate
        while D + SLACK * (Q := found[-1][1]) < way:
            D += 2e-6 if 0.999 * most < Q else 0.4e-6
            block = np.stack([np.full(p.shape, D), np.zeros(p.shape)])
            s, sigma = settled(green, p, block, s)
            found.append((D, float(sigma[0].sum()) * CELL**2, sigma))
        return found

    @cached_property
    def surface(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Where the surface's displacements are known (m, along each axis), and G*sigma of each
        state there, shape (2, m, m).
        """
        n = 2 * int(0.62 * self.size * self.pixel / CELL)
        wide = SurfaceGreen((n, n), CELL, E, NU, coupled=True)
        at = (np.arange(n) - (n - 1) / 2) * CELL
        fields = []
        for _, _, sigma in self.states:
            edge = (n - sigma.shape[1]) // 2
            fields.append(wide.apply(np.pad(sigma, ((0, 0), (edge, edge), (edge, edge)))))
        return at, fields

    # ---------------------------------------------------------------- what is seen

    def at(self, t: float) -> tuple[float, float, np.ndarray]:
        """D, Q and G*sigma on the surface, t s after the start of the drive."""
        stage = np.array([D + SLACK * Q for D, Q, _ in self.states])
        n = int(np.clip(np.searchsorted(stage, self.v * t), 1, len(stage) - 1))
        w = float(np.clip((self.v * t - stage[n - 1]) / (stage[n] - stage[n - 1]), 0, 1))
        (D0, Q0, _), (D1, Q1, _) = self.states[n - 1], self.states[n]
        g = self.surface[1]
        return D0 + w * (D1 - D0), Q0 + w * (Q1 - Q0), g[n - 1] + w * (g[n] - g[n - 1])

    @cached_property
    def _blobs(self) -> list[list[np.ndarray]]:
        rng, halo = np.random.default_rng(self.seed), 40
        both = []
        for density, low, high, peak in (
            (0.08, 0.75, 1.25, (14.0, 32.0)),
            (self.spots, 1.1, 1.4, (45.0, 65.0)),
        ):
            n = int(density * (self.size + 2 * halo) ** 2)
            x, y = rng.uniform(-halo, self.size + halo, (2, n))
            both.append([x, y, rng.uniform(low, high, n), rng.uniform(*peak, n),
                         rng.uniform(0, 1, n)])  # fmt: skip
        return both

    def sliding(self, side: float) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (m) of a square about the contact, and u_x there while all of it slides, less
        that of the block far away.
        """
        n = 2 * round(side / CELL / 2)
        edge = (n - len(self.cells[0])) // 2
        wide = SurfaceGreen((n, n), CELL, E, NU)
        return (np.arange(n) - (n - 1) / 2) * CELL, -wide.apply(np.pad(MU * self.cells[1], edge))

    @property
    def middle(self) -> tuple[float, float]:
        return self.size / 2 + 2.3, self.size / 2 - 1.6

    def image(self, n: int, t: float | None) -> np.ndarray:
        """Frame n, t s after the start of the drive; None: of the free block."""
        D, Q, g = self.at(t or 0.0)
        axis = self.surface[0]
        rng = np.random.default_rng((self.seed, n))
        scene = np.zeros((self.size, self.size))
        dx, dy, turn = self.shake(n / self.rate)
        cx, cy = self.middle[0] + LENS * Q / self.pixel, self.middle[1]
        for kind, (x, y, width, peak, threshold) in enumerate(self._blobs):
            if kind and t is None:
                break
            px, py = x + D / self.pixel, y.copy()
            for _ in range(3):  # the displacement is that of the place where the blob is now
                mx, my = (px - cx) * self.pixel, (py - cy) * self.pixel
                place = [(my - axis[0]) / CELL, (mx - axis[0]) / CELL]
                gx, gy = (map_coordinates(one, place, order=1, mode="nearest") for one in g)
                px = x + (D - gx + LENS * Q) / self.pixel
                py = y - gy / self.pixel
            lit = np.ones_like(px)
            if kind:
                mx, my = (px - cx) * self.pixel, (py - cy) * self.pixel
                lit = np.clip((self.pressure(mx, my) - threshold) / 0.05, 0, 1)
            h = self.size / 2
            sx, sy = px - turn * (py - h) + dx, py + turn * (px - h) + dy
            seen = lit > 0
            total = (peak * lit * 2 * np.pi * width**2)[seen]
            _add(scene, sx[seen], sy[seen], width[seen], total)
        grey = 40 + scene + self.noise * rng.normal(size=scene.shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def settled(
    green: SurfaceGreen, p: np.ndarray, block: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement s of the surface and traction, ``s = block - G sigma(s)``, with the law of
    Bureau along the displacement: Newton's method from `s`, steps by conjugate gradients.
    """
    soft = MU * L

    def law(s: np.ndarray):
        size = np.maximum(np.hypot(*s), 1e-13)
        along, across = (
            MU * p * np.exp(-size / soft) / soft,
            -MU * p * np.expm1(-size / soft) / size,
        )
        n = s / size

        def root(v: np.ndarray) -> np.ndarray:
            part = n * (n * v).sum(axis=0)
            return np.sqrt(along) * part + np.sqrt(across) * (v - part)

        return across * s, root

    sigma, root = law(s)
    rest = block - s - green.apply(sigma)
    scale = float(np.abs(block).max())
    for _ in range(80):
        size = float(np.sqrt((rest**2).mean()))
        if size < 1e-6 * scale:
            return s, sigma
        y, r = np.zeros_like(s), root(rest)
        d, power = r, float(np.vdot(r, r))
        goal = 1e-3 * np.sqrt(power)
        while power > goal**2:
            product = d + root(green.apply(root(d)))
            step = power / float(np.vdot(d, product))
            y, r = y + step * d, r - step * product
            power, last = float(np.vdot(r, r)), power
            d = r + power / last * d
        ds, share = rest - green.apply(root(y)), 1.0
        while True:
            sigma, root = law(s + share * ds)
            after = block - s - share * ds - green.apply(sigma)
            if np.sqrt((after**2).mean()) < size or share < 1e-3:
                break
            share /= 2
        s, rest = s + share * ds, after
    raise AssertionError("the truth has not converged")
