"""A sheared contact with the law sigma = mu p (1 - exp(-s/(mu L))), solved by Abel's integrals on
Chebyshev points: the tests' own truth.

``int sigma / distance = 4 int_0^min(r,a) S(t) / sqrt(r^2 - t^2) dt`` with ``S(t) = int_t^a s
sigma(s) / sqrt(s^2 - t^2) ds`` (Copson 1947). The unknown is the slip on Chebyshev points of r^2:
both integrals of a polynomial times sqrt(a^2 - r^2) are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import brentq

from analysis.contact.rings import Rings, ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion

E, NU, R, MU, L = 3.43e6, 0.5, 0.1288, 0.93, 0.80e-6
H = 0.595e-6  # metres, standard deviation of the heights of the paper's sample
PITCH, BOX, SHAPE, NOISE = 70.4e-6, 140.8e-6, (118, 158), 232e-9


def points(
    shape: tuple[int, int] = SHAPE,
    pitch: float = PITCH,
    centre: tuple[float, float] = (0.0, 0.0),
) -> list[np.ndarray]:
    """Coordinates x, y of the grid's points from the contact's centre; `centre` is the contact's
    place from the middle of the grid.
    """
    (ny, nx), (x0, y0) = shape, centre
    return np.meshgrid(
        (np.arange(nx) - (nx - 1) / 2) * pitch - x0, (np.arange(ny) - (ny - 1) / 2) * pitch - y0
    )


X, Y = points()
RADIUS, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
REACH = 58 * PITCH  # of whole rings
N = 48  # Chebyshev points
M = N + 8  # of the midpoint rule, exact for the polynomials here
DENSE = np.linspace(0, 11e-3, 2201)  # metres, as far as the corners of a field and their boxes


def hertz_radius(P: float) -> float:
    return float(np.cbrt(3 * P * R * (1 - NU**2) / (4 * E)))


def _to_abel(t: np.ndarray) -> np.ndarray:
    """From coefficients of f to S(t) of sqrt(1 - r^2) f, for t below 1, contact of unit radius."""
    angle = (np.arange(M) + 0.5) * np.pi / (2 * M)  # midpoint rule: exact for polynomials
    y, weight = np.sin(angle), np.cos(angle) ** 2 * np.pi / (2 * M)
    z = t[:, None] ** 2 + (1 - t[:, None] ** 2) * y**2
    return np.einsum("i,j,ijk->ik", 1 - t**2, weight, chebyshev.chebvander(2 * z - 1, N - 1))


@cache
def _displacement_matrix(inside: bool) -> tuple[np.ndarray, np.ndarray]:
    """From coefficients of f to the integral of sqrt(1 - s^2) f / distance, and the radii where:
    contact of unit radius.
    """
    if inside:
        r = np.sqrt((1 - np.cos((np.arange(N) + 0.5) * np.pi / N)) / 2)
        angle = np.broadcast_to((np.arange(M) + 0.5) * np.pi / (2 * M), (N, M))
        weight = np.full_like(angle, np.pi / (2 * M))
    else:
        r = 1 + np.linspace(0, 1, 150) ** 2 * 7
        node, w = np.polynomial.legendre.leggauss(N)
        top = np.arcsin(1 / r)[:, None]
        angle, weight = top * (node + 1) / 2, top * w / 2
    t = np.minimum(r[:, None] * np.sin(angle), 1.0)
    S = _to_abel(t.ravel()).reshape(*t.shape, N)
    return r, 4 * np.einsum("ij,ijk->ik", weight, S)


def _places_in_boxes(x: np.ndarray, y: np.ndarray, box: float) -> list[tuple]:
    """The share of each place within the boxes, its radius and the cosine of twice its azimuth."""
    node, weight = np.polynomial.legendre.leggauss(3 if box else 1)
    places = []
    for dx, wx in zip(node, weight / 2, strict=True):
        for dy, wy in zip(node, weight / 2, strict=True):
            at_x, at_y = x + dx * box / 2, y + dy * box / 2
            places.append((wx * wy, np.hypot(at_x, at_y), np.cos(2 * np.arctan2(at_y, at_x))))
    return places


@cache
def _places_of_grid(box: float) -> list[tuple]:
    return _places_in_boxes(X, Y, box)


@dataclass(frozen=True)
class State:
    """The contact with the block driven by D: slip, traction, displacement and force."""

    P: float
    D: float
    Q: float
    a: float
    sigma: Callable[[np.ndarray], np.ndarray]  # Pa, of r; for r up to a
    g0: np.ndarray  # metres, on DENSE
    g2: np.ndarray

    @property
    def peak(self) -> float:
        """Radius at which sigma is largest: the paper's c."""
        r = np.linspace(0, self.a, 20001)
        return float(r[np.argmax(self.sigma(r))])

    @property
    def full(self) -> float:
        """Greatest traction in full sliding, mu p(0), pascals."""
        return 1.5 * MU * self.P / (np.pi * self.a**2)

    def rings(self, field_noise: np.ndarray | float = 0.0) -> Rings:
        return rings_of(self.field() + field_noise)

    def field(self, box: float = BOX) -> np.ndarray:
        """u_x on the grid, averaged over boxes; of its shape."""
        return self._averaged(_places_of_grid(box))

    def displacement(self, x: np.ndarray, y: np.ndarray, box: float = BOX) -> np.ndarray:
        """The same at other points (x, y)."""
        return self._averaged(_places_in_boxes(x, y, box))

    def _averaged(self, places: list[tuple]) -> np.ndarray:
        both, total = CubicSpline(DENSE, np.column_stack([self.g0, self.g2])), 0.0
        for weight, r, cos in places:
            even, double = np.moveaxis(both(r), -1, 0)
            total = total + weight * (even + double * cos)
        return self.D - total


class World:
    """Sphere on plane under a normal force P; L = 0 is not possible here."""

    def __init__(
        self, P: float, mu: float = MU, L: float = L, E: float = E, nu: float = NU
    ) -> None:
        self.P, self.mu, self.L, self.a = (
            P,
            mu,
            L,
            float(np.cbrt(3 * P * R * (1 - nu**2) / (4 * E))),
        )
        self.peak_pressure = 3 * P / (2 * np.pi * self.a**2)
        self.scale = (1 + nu) / (np.pi * E) * mu * self.peak_pressure * self.a
        self.nu = nu
        self.r, matrix = _displacement_matrix(True)
        self.to_coefficients = np.linalg.inv(chebyshev.chebvander(2 * self.r**2 - 1, N - 1))
        self.matrix = self.scale * (1 - nu / 2) * matrix @ self.to_coefficients
        self.full = float(self.matrix.sum(axis=1).max())

    def slip(self, D: float, start: np.ndarray) -> np.ndarray:
        s, soft = start, self.mu * self.L
        for _ in range(60):
            decay = np.exp(-s / soft)
            miss = s + self.matrix @ (1 - decay) - D
            step = np.linalg.solve(np.eye(N) + self.matrix * (decay / soft), -miss)
            s = s + step * min(1.0, 2 * soft / max(np.abs(step).max(), 1e-300))
            if np.abs(step).max() < 1e-13 * self.full:
                return s
        raise AssertionError("the truth has not converged")

    def run(self, distances: np.ndarray) -> list[State]:
        """States at growing displacements of the block."""
        states, s, last = [], np.zeros(N), 0.0
        for D in distances:
            for stop in np.linspace(last, D, int(np.ceil((D - last) / (4 * self.mu * self.L))) + 1)[
                1:
            ]:
                s = self.slip(float(stop), s)
            last = D
            states.append(self._state(float(D), s))
        return states

    def _state(self, D: float, s: np.ndarray) -> State:
        f = self.to_coefficients @ (1 - np.exp(-s / (self.mu * self.L)))
        outer, matrix = _displacement_matrix(False)
        z = np.linspace(0, 1, 600)
        inner = self.matrix @ chebyshev.chebval(2 * self.r**2 - 1, f)
        at = np.minimum(DENSE / self.a, 1)
        inside = chebyshev.chebval(2 * at**2 - 1, self.to_coefficients @ inner)
        beyond = make_interp_spline(np.sqrt(outer - 1), self.scale * (1 - self.nu / 2) * matrix @ f)
        g0 = np.where(self.a > DENSE, inside, beyond(np.sqrt(np.maximum(DENSE / self.a - 1, 0))))
        root = np.sin(z * np.pi / 2)  # r/a, crowded at the edge
        sigma = (
            self.mu
            * self.peak_pressure
            * np.cos(z * np.pi / 2)
            * chebyshev.chebval(2 * root**2 - 1, f)
        )
        node, weight = np.polynomial.legendre.leggauss(N)
        angle = (node + 1) * np.pi / 4
        rim = np.cos(angle) ** 2 * np.sin(angle) * chebyshev.chebval(2 * np.sin(angle) ** 2 - 1, f)
        Q = 2 * np.pi * self.a**2 * self.mu * self.peak_pressure * float(weight @ rim) * np.pi / 4
        angle_of = CubicSpline(z, sigma)
        return State(
            self.P,
            D,
            Q,
            self.a,
            lambda r: angle_of(np.arcsin(np.minimum(np.asarray(r) / self.a, 1)) * 2 / np.pi),
            g0,
            double_part(g0, self.nu),
        )


def double_part(g0: np.ndarray, nu: float) -> np.ndarray:
    """The part in the double angle that goes with a mean over the azimuth, on DENSE."""
    swept = CubicSpline(DENSE, g0 * DENSE).antiderivative()(DENSE)
    mean = np.divide(2 * swept, DENSE**2, out=g0.copy(), where=DENSE > 0)
    return nu / 2 / (1 - nu / 2) * (mean - g0)


@cache
def loaded(P: float, share: float) -> State:
    """The contact under normal force P (N) with shear force share * mu P."""
    world = World(P)

    def state(D: float) -> State:
        return world.run(np.array([D]))[0]

    if share >= 1:
        return state(2e-4)
    return state(brentq(lambda D: state(D).Q - share * MU * P, 1e-9, 1.2 * world.full, xtol=1e-14))


def noise(
    seed: int,
    box: float = 0.0,
    shape: tuple[int, int] = SHAPE,
    pitch: float = PITCH,
    level: float = NOISE,
) -> np.ndarray:
    """White noise, or that of means over overlapping boxes: each point is the scaled mean of the
    white cells in its box.
    """
    side = max(round(box / pitch), 1)
    white = np.random.default_rng(seed).normal(size=[n + side - 1 for n in shape])
    cells = np.lib.stride_tricks.sliding_window_view(white, (side, side))
    return level * cells.sum(axis=(2, 3)) / side


def inversion(a: float, modulus: float = E, rim: float = 2.0) -> AxisymmetricInversion:
    """As a run has it that takes the contact for one of that radius, with a rim of so many
    sqrt(R h), and the block to be so soft.
    """
    mask = a + rim * np.sqrt(R * 0.6e-6) + 2 * PITCH
    return AxisymmetricInversion(X, Y, PITCH, mask, modulus, NU, edge=a, box=BOX)


def rings_of(field: np.ndarray) -> Rings:
    return ring_means(RADIUS, field, PITCH, REACH, theta=AZIMUTH)


@cache
def ring_noise(count: int, *, shared: bool) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard errors of rings of `count` fields of unit noise; shape (count, rings)."""
    box = BOX if shared else 0.0
    rings = [rings_of(noise(seed, box, level=1.0)) for seed in range(count)]
    return np.array([ring.mean for ring in rings]), np.array(
        [ring.standard_error for ring in rings]
    )


@dataclass(frozen=True)
class Run:
    """What a bench would see, without noise: frames (t), rings (r)."""

    world: World
    states: list[State]
    radius: np.ndarray
    count: np.ndarray
    ux: np.ndarray  # (t, r)
    Q: np.ndarray

    @property
    def peak(self) -> np.ndarray:
        return np.array([state.peak for state in self.states])

    def measured(
        self, sd: float, seed: int, shared: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """u_x, its standard error and Q: image noise of every frame and of the reference, which all
        share, and 1 mN.
        """
        mean, error = ring_noise(128, shared=shared)
        rng = np.random.default_rng(seed)
        pick = rng.permutation(len(mean))[: len(self.Q) + 1]
        ux = self.ux + sd * (mean[pick[1:]] - mean[pick[0]]) / np.sqrt(2)
        return ux, sd * error[pick[1:]], self.Q + rng.normal(0, 1e-3, len(self.Q))


def driven(
    world: World, frames: int, end: float = 1.3, compliance: float = 1 / 9579 + 0.68e-6
) -> Run:
    """Frames evenly spaced in time, from rest to `end` times the distance at which the contact
    slides.
    """
    D = np.linspace(0, (end + 0.1) * world.full, 80)[1:]
    stage = np.append(0.0, D + compliance * np.array([state.Q for state in world.run(D)]))
    slides = world.full + compliance * MU * world.P
    states = world.run(
        np.interp(end * slides * np.arange(1, frames + 1) / frames, stage, np.append(0.0, D))
    )
    rings = [state.rings() for state in states]
    return Run(
        world,
        states,
        rings[0].radius,
        rings[0].count,
        np.array([ring.mean for ring in rings]),
        np.array([state.Q for state in states]),
    )


@cache
def drive(P: float, frames: int) -> Run:
    """As `driven`, under Hertz's pressure."""
    return driven(World(P), frames)
