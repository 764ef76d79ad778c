"""A sheared contact under any axisymmetric pressure, Greenwood and Tripp's among them, with the law
sigma = mu p (1 - exp(-s/(mu L))): the tests' own truth, on annuli of even traction.

An even traction on a disc of radius b moves the surface by its integral over distance, 4 b E(r/b)
inside and 4 r (E(b/r) - (1 - b^2/r^2) K(b/r)) outside (Johnson, section 3.5); an annulus is the
difference of two discs. Nothing of the program's mechanics is used.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import ellipe, ellipk

from . import elasto_plastic_world as smooth

E, NU, R, MU, L = smooth.E, smooth.NU, smooth.R, smooth.MU, smooth.L
H = 0.6e-6  # metres, standard deviation of the heights
ANNULI = 400
FINEST = 1e-12  # metres of slip, at which Newton's method ends


def over_distance(r: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Integral of 1/distance over discs of radius b, at the distance r from their centre; shape (r,
    b), metres.
    """
    r, b = np.broadcast_arrays(np.asarray(r)[:, None], np.asarray(b)[None, :])
    inside = r <= b
    near = np.where(inside, r / np.where(b > 0, b, 1.0), 0.0) ** 2
    far = np.where(inside, 0.0, b / np.where(r > 0, r, 1.0)) ** 2
    outer = 4 * r * (ellipe(far) - (1 - far) * ellipk(np.minimum(far, 1 - 1e-16)))
    return np.where(inside, 4 * b * ellipe(np.minimum(near, 1.0)), outer)


def hertz_pressure(P: float, E: float = E, nu: float = NU) -> tuple[Callable, float]:
    """Pressure as a function of r, and the radius where it ends."""
    a = smooth.World(P, E=E, nu=nu).a
    peak = 3 * P / (2 * np.pi * a * a)
    return lambda r: peak * np.sqrt(np.maximum(1 - (np.asarray(r) / a) ** 2, 0.0)), a


@cache
def greenwood_tripp(
    P: float, h: float = H, E: float = E, nu: float = NU, R: float = R
) -> tuple[Callable, float]:
    """Pressure of a sphere on asperities of exponential heights: p = C exp(-gap/h), with gap =
    r^2/2R + bending; function of r, and a radius beyond which it is below 1e-12 of its peak.
    """
    a = float(np.cbrt(3 * P * R * (1 - nu**2) / (4 * E)))
    reach = float(np.sqrt(1.5 * a * a + 80 * R * h))
    edges = np.linspace(0, reach, ANNULI + 1)
    r, area = (edges[1:] + edges[:-1]) / 2, np.pi * np.diff(edges**2)
    discs = over_distance(r, edges)
    bend = (1 - nu**2) / (np.pi * E) * np.diff(discs, axis=1)
    log_p = np.log(3 * P / (2 * np.pi * a * a)) - (r / a) ** 4
    level = log_p[0]
    for _ in range(400):
        p = np.exp(log_p)
        # unknowns: log p at the annuli and the level of the rigid approach
        off = np.append(log_p - level + (r**2 / (2 * R) + bend @ p) / h, area @ p / P - 1)
        matrix = np.zeros((ANNULI + 1, ANNULI + 1))
        matrix[:-1, :-1] = np.eye(ANNULI) + bend * p / h
        matrix[:-1, -1] = -1
        matrix[-1, :-1] = area * p / P
        step = np.linalg.solve(matrix, off)
        step *= min(1.0, 2.0 / np.abs(step[:-1][p > 1e-8 * p.max()]).max())
        log_p, level = log_p - step[:-1], level - step[-1]
        if np.abs(step).max() < 1e-10:
            break
    else:
        raise AssertionError("the rough pressure has not converged")
    curve = CubicSpline(np.append(-r[2::-1], r), np.append(log_p[2::-1], log_p))

    def pressure(at: np.ndarray) -> np.ndarray:
        at = np.abs(at)
        return np.where(at < reach, np.exp(curve(np.minimum(at, reach))), 0.0)

    return pressure, reach


def exponential(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The interface's law: traction over mu p at a slip in mu L, and its derivative."""
    return -np.expm1(-t), np.exp(-t)


def hyperbolic_tangent(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Another law of the same initial slope, which is steeper and saturates earlier."""
    return np.tanh(t), 1 / np.cosh(t) ** 2


class World:
    """A contact under a pressure p(r) that ends at `reach`."""

    share = staticmethod(exponential)

    def __init__(
        self,
        P: float,
        pressure: Callable,
        reach: float,
        mu: float = MU,
        L: float = L,
        E: float = E,
        nu: float = NU,
    ) -> None:
        self.P, self.mu, self.L, self.E, self.nu = P, mu, L, E, nu
        self.pressure, self.reach = pressure, reach
        edges = np.linspace(0, reach, ANNULI + 1)
        self.r, self.area = (edges[1:] + edges[:-1]) / 2, np.pi * np.diff(edges**2)
        self.p = pressure(self.r)
        self.p = self.p * P / (self.area @ self.p)
        self.edges, self.scale = edges, (1 + nu) / (np.pi * E) * (1 - nu / 2)
        self.matrix = self.scale * np.diff(over_distance(self.r, edges), axis=1)

    @property
    def full(self) -> float:
        """Displacement of the centre, against the block, in full sliding; metres."""
        return float((self.matrix @ (self.mu * self.p)).max())

    @cached_property
    def _dense(self) -> np.ndarray:
        return self.scale * np.diff(over_distance(smooth.DENSE, self.edges), axis=1)

    def run(self, distances: np.ndarray) -> list[smooth.State]:
        """States at growing displacements of the block, metres."""
        states, s, last, soft = [], np.zeros(ANNULI), 0.0, self.mu * self.L
        for D in distances:
            stops = int(np.ceil((D - last) / (6 * soft))) + 1
            for stop in np.linspace(last, D, stops)[1:]:
                s = self._slip(float(stop), s)
            last = float(D)
            states.append(self._state(last, s))
        return states

    def relaxing(self, times: np.ndarray, speed: float, g: float, tau: float) -> list[smooth.State]:
        """States at those times of a steady drive of a block of which the share g of the modulus
        relaxes in tau, by implicit steps of tau/40 or less: a step of Euler of what it has yielded
        to.
        """
        states, s, last = [], np.zeros(ANNULI), 0.0
        yielded = np.zeros(ANNULI)
        for time in times:
            count = int(np.ceil((time - last) / min(tau / 40, self.mu * self.L / speed)))
            x = (time - last) / count * (1 - g) / tau
            for t in np.linspace(last, time, count + 1)[1:]:
                left, at_once = g * yielded / (1 + x), 1 - g + g * x / (1 + x)
                s = self._slip(float(speed * t), s, left, at_once)
                sigma = self.mu * self.p * self.share(s / (self.mu * self.L))[0]
                yielded = (yielded + x * sigma) / (1 + x)
            last = float(time)
            states.append(self._state(speed * last, s, left, at_once))
        return states

    def _slip(
        self, D: float, s: np.ndarray, left: np.ndarray | float = 0.0, at_once: float = 1.0
    ) -> np.ndarray:
        soft = self.mu * self.L
        for _ in range(80):
            share, slope = self.share(s / soft)
            miss = s + self.matrix @ (left + at_once * self.mu * self.p * share) - D
            step = np.linalg.solve(
                np.eye(ANNULI) + self.matrix * (at_once * self.mu * self.p * slope / soft), -miss
            )
            s = s + step * min(1.0, 2 * soft / max(np.abs(step).max(), 1e-300))
            if np.abs(step).max() < FINEST:
                return s
        raise AssertionError("the truth has not converged")

    def _state(
        self, D: float, s: np.ndarray, left: np.ndarray | float = 0.0, at_once: float = 1.0
    ) -> smooth.State:
        sigma = self.mu * self.p * self.share(s / (self.mu * self.L))[0]
        g0 = self._dense @ (left + at_once * sigma)
        mirrored = np.append(-self.r[2::-1], self.r), np.append(sigma[2::-1], sigma)
        curve, reach = CubicSpline(*mirrored), self.reach
        return smooth.State(
            self.P,
            D,
            float(self.area @ sigma),
            reach,
            lambda r: np.where(np.asarray(r) < reach, curve(np.minimum(r, reach)), 0.0),
            g0,
            smooth.double_part(g0, self.nu),
        )


def rough(P: float, h: float = H, **constants: float) -> World:
    """A world under Greenwood and Tripp's pressure."""
    return World(P, *greenwood_tripp(P, h), **constants)


@cache
def drive(
    P: float, frames: int, h: float = H, *, end: float = 1.3, law: Callable = exponential
) -> smooth.Run:
    """As `elasto_plastic_world.driven`; h = 0 is Hertz's pressure."""
    world = rough(P, h) if h else World(P, *hertz_pressure(P))
    world.share = law
    return smooth.driven(world, frames, end)
