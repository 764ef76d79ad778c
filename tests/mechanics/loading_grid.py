"""A rough contact of any pressure loaded tangentially, on a grid of cells: one or both components
of the traction. SI units throughout.

The equations are those of `loading`, ``s = D - G*sigma(s)``, with G a `half_space.SurfaceGreen`.
With both components the traction points along the displacement s of the surface, so that friction
turns where the block moves sideways too (nu > 0).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64
from analysis.mechanics.half_space import SurfaceGreen
from analysis.mechanics.interface import Interface, Memory
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

CLOSE = 3e-7
"""Residual, as a fraction of what drives the contact, at which a step is done: 100 times below the
error of 128 x 128 cells.
"""
MOST_STEPS = 200
MOST_PRODUCTS = 200
FORCING = 0.01  # part of the residual that conjugate gradients leave
SUB = 8  # points along each side of a cell over which the pressure is averaged


@dataclass(frozen=True)
class GridState:
    """The contact at one moment of its history.

    Attributes
    ----------
    D, Q : float
        Displacement of the block far away (m), and shear force along x (N).
    s, sigma : ndarray, shape (ny, nx), or (2, ny, nx) with both components
        Displacement of the surface (m) as a camera at rest with the sphere sees it, and shear
        traction (Pa).
    pressure : ndarray, shape (ny, nx)
        Pascals.
    memory : Memory
        Of the interface, cell by cell; empty with both components.
    """

    D: float
    Q: float
    s: F64
    sigma: F64
    pressure: F64
    memory: Memory


@dataclass(frozen=True)
class _Response:
    """The interface after a move: traction, the square root of its derivative as an operator, and
    what the memory needs.
    """

    sigma: F64
    root: Callable[[F64], F64]
    move: F64
    front: F64


def hertz_cells(contact: SphereContact, cells: int, pitch: float) -> F64:
    """Mean pressure (Pa) on each cell of a square grid, shape (cells, cells)."""
    at = (np.arange(cells * SUB) - (cells * SUB - 1) / 2) * pitch / SUB
    fine = contact.pressure(np.hypot(at[:, None], at))
    p = fine.reshape(cells, SUB, cells, SUB).mean(axis=(1, 3))
    return p * (contact.P / (p.sum() * pitch * pitch))


class GridLoading:
    """States of a contact whose block is displaced, on a grid; first loadings of a round one only.

    Parameters
    ----------
    pressure : ndarray, shape (ny, nx)
        Pascals, 0 outside the contact.
    green : SurfaceGreen
        Of that shape; coupled: both components of the traction.
    interface : Interface
        With L above 0.

    Notes
    -----
    Newton's method with a line search; each step by conjugate gradients, symmetric because the
    interface's stiffness k enters as ``1 + sqrt(k) G sqrt(k)``.
    """

    def __init__(self, pressure: F64, green: SurfaceGreen, interface: Interface) -> None:
        self.pressure, self.green, self.interface = pressure, green, interface
        self._area = green.pitch[0] * green.pitch[1]

    @classmethod
    def of_sphere(
        cls, contact: SphereContact, cells: int = 128, *, coupled: bool = False
    ) -> GridLoading:
        """A sphere on a plane, on a square grid that just holds the contact."""
        pitch = 2 * contact.reach / (cells - 2)
        p = hertz_cells(contact, cells, pitch)
        E, nu, thickness = contact.E, contact.nu, contact.thickness
        green = SurfaceGreen(p.shape, pitch, E, nu, thickness=thickness, coupled=coupled)
        loading = cls(p, green, Interface(contact.mu, contact.L))
        loading.round = AxisymmetricLoading(contact)
        return loading

    def _guess(self, stage: float, compliance: float) -> F64:
        """Where the search for a first loading starts: at the axisymmetric solution."""
        ny, nx = self.green.shape
        x = (np.arange(nx) - (nx - 1) / 2) * self.green.pitch[0]
        y = (np.arange(ny)[:, None] - (ny - 1) / 2) * self.green.pitch[1]
        state = self.round.driven(stage, compliance)
        r, double = np.hypot(x, y), 2 * np.arctan2(y, x)
        at = np.linspace(0, r.max(), 2048)
        g0, g2 = (np.interp(r, at, g) for g in state.displacement(at))
        along = state.D - g0 - g2 * np.cos(double)
        return np.stack([along, -g2 * np.sin(double)]) if self.green.coupled else along

    @property
    def rest(self) -> GridState:
        """The state before any shear."""
        zero = np.zeros((2, *self.green.shape) if self.green.coupled else self.green.shape)
        return GridState(0.0, 0.0, zero, zero, self.pressure, Memory.fresh(self.pressure.size))

    def driven(self, stage: float, compliance: float = 0.0) -> GridState:
        """State after a first loading by a stage (m) in series with a compliance (m/N)."""
        return self._solved(self.rest, self._guess(stage, compliance), stage, compliance)

    def advance(
        self,
        state: GridState,
        stage: float,
        *,
        compliance: float = 0.0,
        pressure: F64 | None = None,
    ) -> GridState:
        """State that follows another one of one component, once the pressure (default: its own) and
        then the stage have come to their new values.
        """
        p = state.pressure if pressure is None else pressure
        loading = self if p is self.pressure else GridLoading(p, self.green, self.interface)
        return loading._solved(state, state.s, stage, compliance)

    def _solved(self, state: GridState, s: F64, stage: float, compliance: float) -> GridState:
        p, memory = self.pressure.ravel(), state.memory
        if state.pressure is not self.pressure:
            memory = self.interface.under(memory, state.pressure.ravel(), p)
        drive = np.zeros_like(s)
        _along(drive)[...] = stage

        def yielded(sigma: F64) -> F64:
            """By how much a traction holds the surface back behind the stage."""
            u = self.green.apply(sigma)
            _along(u)[...] += compliance * self._force(sigma)
            return u

        def respond(s: F64) -> _Response:
            move = (s - state.s).reshape(-1, p.size)
            if self.green.coupled:
                return self._along_slip(move)
            return self._one_component(memory, move[0])

        # at rest, the direction in which a point will move decides its stiffness
        s = s + math.copysign(1e-12 * self.interface.L, stage - state.D - compliance * state.Q)
        law = respond(s)
        rest = drive - s - yielded(law.sigma)
        scale = max(abs(stage), float(np.abs(state.s).max()))
        for _ in range(MOST_STEPS):
            size = float(np.linalg.norm(rest))
            if size <= CLOSE * scale * math.sqrt(rest.size):
                break
            ds = _newton_step(rest, law.root, yielded)
            share = 1.0
            while True:
                trial = respond(s + share * ds)
                after = drive - s - share * ds - yielded(trial.sigma)
                gained = trial.sigma - law.sigma
                down, up = float(np.vdot(rest, gained)), -float(np.vdot(after, gained))
                # the energy is convex in the traction, with slope -rest: it may rise again only a
                # little at the end of the step
                if up <= 0.5 * down or share < 1e-6:
                    break
                share *= min(0.5, max(0.1, down / (down + up)))
            s, law, rest = s + share * ds, trial, after
        else:
            raise ValueError(
                f"loading: no equilibrium was found in {MOST_STEPS} steps towards {stage:g} m; go"
                " there in smaller steps"
            )
        Q = self._force(law.sigma)
        if not self.green.coupled:
            memory = self.interface.remember(memory, p, law.move, law.front)
        return GridState(stage - compliance * Q, Q, s, law.sigma, self.pressure, memory)

    def _force(self, sigma: F64) -> float:
        return self._area * float(_along(sigma).sum())

    def _one_component(self, memory: Memory, move: F64) -> _Response:
        shape = self.green.shape
        sigma, stiffness, front = self.interface.respond(memory, self.pressure.ravel(), move)
        root = np.sqrt(stiffness).reshape(shape)
        return _Response(sigma.reshape(shape), lambda v: root * v, move, front)

    def _along_slip(self, move: F64) -> _Response:
        shape, length = self.green.shape, np.hypot(move[0], move[1])
        fresh = Memory.fresh(length.size)
        sigma, stiffness, front = self.interface.respond(fresh, self.pressure.ravel(), length)
        n = np.divide(move, length, out=np.zeros_like(move), where=length > 0)
        across = np.divide(sigma, length, out=stiffness.copy(), where=length > 0)
        root_along, root_across = (np.sqrt(k).reshape(shape) for k in (stiffness, across))
        direction = n.reshape(2, *shape)

        def root(v: F64) -> F64:
            part = direction * (direction * v).sum(axis=0)
            return np.asarray(root_along * part + root_across * (v - part))

        return _Response((sigma * n).reshape(2, *shape), root, length, front)


def _along(field: F64) -> F64:
    """The component along x, as a view."""
    return field[0] if field.ndim == 3 else field


def _newton_step(rest: F64, root: Callable[[F64], F64], yielded: Callable[[F64], F64]) -> F64:
    """Newton's ds of ``(1 + G k) ds = rest``, as ``rest - G sqrt(k) y`` with ``(1 + sqrt(k) G
    sqrt(k)) y = sqrt(k) rest``.
    """
    y = np.zeros_like(rest)
    r = root(rest)
    goal = FORCING * float(np.linalg.norm(r))
    d, power = r, float(np.vdot(r, r))
    for _ in range(MOST_PRODUCTS):
        if math.sqrt(power) <= goal:
            break
        product = d + root(yielded(root(d)))
        step = power / float(np.vdot(d, product))
        y, r = y + step * d, r - step * product
        power, last = float(np.vdot(r, r)), power
        d = r + power / last * d
    return np.asarray(rest - yielded(root(y)))
