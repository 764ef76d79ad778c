"""Displacement fields of a sheared sphere-on-plane contact whose stress is known exactly: no grid
operator, no basis of the inversion.

The interface law sigma = mu p (1 - exp(-s/(mu L))) with Hertz's p is solved in even Legendre
polynomials of xi = sqrt(1 - r^2/a^2), in which the potential of the disc is diagonal (Popov);
outside the disc the potential is a sum over rings of elliptic integrals.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import ellipk, eval_legendre

E, NU, R, H, MU, L = 3.43e6, 0.5, 128.8e-3, 0.595e-6, 0.93, 0.80e-6
PITCH, BOX, SHAPE, NOISE = 70.4e-6, 140.8e-6, (118, 158), 232e-9
MODES = 64
K = (1 + NU) / (np.pi * E)  # 1 / (2 pi G)


def points(shape=SHAPE, pitch=PITCH, centre=(0.0, 0.0)):
    """Coordinates x, y of the grid's points from the contact's centre; `centre` is the contact's
    place from the middle of the grid.
    """
    ny, nx = shape
    return np.meshgrid(
        (np.arange(nx) - (nx - 1) / 2) * pitch - centre[0],
        (np.arange(ny) - (ny - 1) / 2) * pitch - centre[1],
    )


def hertz_radius(P):
    """Radius of the contact, metres."""
    return float(np.cbrt(3 * P * R * (1 - NU**2) / (4 * E)))


def noise(seed, box=0.0, shape=SHAPE, pitch=PITCH, level=NOISE):
    """White noise, or that of means over overlapping boxes: each point is the scaled mean of the
    white cells in its box.
    """
    rng, side = np.random.default_rng(seed), max(round(box / pitch), 1)
    white = rng.normal(size=(shape[0] + side - 1, shape[1] + side - 1))
    return (
        level
        * np.lib.stride_tricks.sliding_window_view(white, (side, side)).sum(axis=(2, 3))
        / side
    )


@dataclass(frozen=True, eq=False)
class Contact:
    """One state of loading: stress and displacement as functions of r, sums exact to about 1e-8."""

    a: float
    Q: float
    D: float
    peak: float  # mu p0
    coefficients: np.ndarray  # of xi sigma in P_2n(xi)

    def stress(self, r):
        """Shear stress at r, pascals."""
        xi = np.sqrt(np.maximum(1 - (np.asarray(r) / self.a) ** 2, 0.0))
        product = sum(c * eval_legendre(2 * n, xi) for n, c in enumerate(self.coefficients))
        return np.divide(product, xi, out=np.zeros_like(xi), where=xi > 0)

    def displacement(self, x, y, box=BOX):
        """Measured u_x (lens left out) at points (x, y), averaged over a box."""
        r_max = np.hypot(x, y).max() + 2 * box
        V, double = _potentials(self, float(np.ceil(1e3 * r_max) / 1e3))
        at = (np.arange(10) - 4.5) / 10 * box if box else np.zeros(1)
        total = np.zeros_like(x)
        for dy in at:
            for dx in at:
                X, Y = x + dx, y + dy
                r = np.hypot(X, Y)
                cos2 = np.divide(X * X - Y * Y, r * r, out=np.zeros_like(r), where=r > 0)
                total += (1 - NU / 2) * V(r) + NU * double(r) * cos2
        return self.D - K * total / at.size**2


@lru_cache(maxsize=8)
def _potentials(contact, r_max):
    """The potential of the stress out to r_max and what it has beside, as functions of r."""
    r = np.concatenate([np.linspace(0, contact.a, 1500), np.linspace(contact.a, r_max, 3000)[1:]])
    xi, w = np.polynomial.legendre.leggauss(400)
    xi, w = (1 + xi) / 2, w / 2
    s = contact.a * np.sqrt(1 - xi**2)
    out = r[r > contact.a][:, None]
    strength = contact.a**2 * xi * w * contact.stress(s)
    potential = np.concatenate(
        [
            sum(
                np.pi**2
                * contact.a
                * c
                * eval_legendre(2 * n, 0) ** 2
                * eval_legendre(2 * n, np.sqrt(1 - (r[r <= contact.a] / contact.a) ** 2))
                for n, c in enumerate(contact.coefficients)
            ),
            (4 / (out + s) * ellipk(4 * out * s / (out + s) ** 2)) @ strength,
        ]
    )
    V = CubicSpline(r, potential)
    inner = CubicSpline(r, potential * r).antiderivative()(r) / np.maximum(r, 1e-12) ** 2
    inner[0] = potential[0] / 2
    return V, CubicSpline(r, inner - potential / 2)


def loaded(P, share, length=L):
    """The contact under normal force P (N) with shear force share * mu P."""
    a = hertz_radius(P)
    peak = MU * 3 * P / (2 * np.pi * a**2)
    t, w = np.polynomial.legendre.leggauss(2 * MODES)
    xi, w = t[t > 0], w[t > 0]
    table = np.array([eval_legendre(2 * n, xi) for n in range(MODES)])
    analysis = (4 * np.arange(MODES) + 1)[:, None] * table * (w * xi)
    green = (
        K
        * (1 - NU / 2)
        * np.pi**2
        * a
        * (table.T * eval_legendre(2 * np.arange(MODES), 0) ** 2)
        @ analysis
    )
    force = 2 * np.pi * a**2 * w * xi
    full = peak * xi

    def stress(D):
        s = np.full(xi.size, min(D, 1e-3 * L))
        for _ in range(200):
            e = np.exp(-np.maximum(s, -5 * length) / (MU * length))
            step = np.linalg.solve(
                np.eye(xi.size) + green * (full * e / (MU * length)),
                D - green @ (full * (1 - e)) - s,
            )
            s = s + np.clip(step, -length, None) * min(
                1.0, 2 * length / max(np.abs(step).max(), 1e-30)
            )
            if np.abs(step).max() < 1e-13 * length + 1e-15 * D:
                break
        return full * (1 - np.exp(-s / (MU * length)))

    limit = MU * P
    D = (
        2e-4
        if share >= 1
        else brentq(lambda D: force @ stress(D) - share * limit, 1e-9, 4e-4, xtol=1e-14)
    )
    sigma = full if share >= 1 else stress(D)
    return Contact(a, float(force @ sigma), D, peak, analysis @ sigma)
