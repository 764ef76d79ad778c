"""Even Legendre polynomials of xi = sqrt(1 - r^2/a^2), in which the half-space is diagonal for
round contacts.

For tractions P_2n(xi)/xi on a disc the displacement under the disc is proportional to P_2n(xi)
(Popov). The same sums have Abel's form ``G*sigma ~ integral of F(t)/sqrt(r^2 - t^2)`` over t <
min(r, a), with F a sum of Legendre polynomials of t/a; a factor ``1 - 2 t^2/r^2`` gives the part
that goes with the double angle. The displacement is exact at all r, inside and outside.

References
----------
Popov 1962 (the eigenfunctions); Copson 1947 (Abel's form).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from analysis.arrays import F64, floats
from analysis.kernels import compiled


class EvenLegendre(NamedTuple):
    """Even Legendre polynomials at Gauss nodes on 0 to 1."""

    xi: F64  # (modes,) nodes, rising
    weight: F64  # (modes,) of Gauss
    values: F64  # (modes, modes) P_0, P_2 ... at each node
    at_zero: F64  # (modes,) their values at 0


@lru_cache(maxsize=8)
def even_legendre(modes: int) -> EvenLegendre:
    """The polynomials of degree 0, 2, ... 2 (modes - 1) at as many nodes."""
    x, w = legendre.leggauss(2 * modes)
    xi = floats(x[modes:])
    weight = floats(w[modes:])
    return EvenLegendre(xi, weight, evaluated(xi, modes), evaluated(np.zeros(1), modes)[0])


def evaluated(t: F64, modes: int) -> F64:
    """The polynomials of degree 0, 2, ... 2 (modes - 1) at t, in a new last axis."""
    return np.asarray(legendre.legvander(t, 2 * modes - 2)[..., ::2])


def chebyshev_series(terms: int) -> tuple[F64, F64]:
    """Nodes of Chebyshev on -1 to 1, (terms,), and the matrix from values there to coefficients."""
    angle = np.pi * (np.arange(terms) + 0.5) / terms
    series = 2 / terms * np.cos(np.outer(np.arange(terms), angle))
    series[0] /= 2
    return np.cos(angle), series


@compiled
def chebyshev_sum(x, coefficients):  # type: ignore[no-untyped-def]
    """A series of Chebyshev at x, shape (n,): `numpy.polynomial.chebyshev.chebval` in one pass
    (Clenshaw 1955), for a simulated picture needs four of a hundred terms at thousands of points.
    """
    newer, older = np.zeros_like(x), np.zeros_like(x)
    for k in range(coefficients.size - 1, 0, -1):
        for i in range(x.size):
            made = coefficients[k] + 2.0 * x[i] * newer[i] - older[i]
            older[i], newer[i] = newer[i], made
    return coefficients[0] + x * newer - older


class Basis(NamedTuple):
    """What depends on the number of modes alone, for a contact of radius 1; its series are of
    Chebyshev.
    """

    xi: F64
    weight: F64  # of a traction in the force, over 2 pi a^2
    green: F64  # traction -> integral of sigma/|x - x'|, at the nodes
    share: F64  # values at the nodes -> series in 2 xi^2 - 1
    # xi sigma -> series of both parts of the displacement, azimuthal mean and double angle, in 1 -
    # 2 r^2
    inside: tuple[F64, F64]
    outside: tuple[F64, F64]  # the same over asin(1/r), in the square of asin(1/r)


@lru_cache(maxsize=8)
def basis(modes: int) -> Basis:
    """The matrices for a number of modes."""
    xi, w, even, at_zero = even_legendre(modes)
    project = (4 * np.arange(modes) + 1)[:, None] * (w[:, None] * even).T
    z, series = chebyshev_series(modes + 16)
    t, v = legendre.leggauss(2 * modes + 16)

    def parts(end: F64, r: F64, divisor: F64 | float) -> tuple[F64, F64]:
        theta = end[:, None] / 2 * (1 + t)
        # F(t), for each mode
        abel = np.pi**2 * at_zero * evaluated(r[:, None] * np.sin(theta), modes)
        weights = end[:, None] / np.pi * v
        mean, double = (
            series @ (np.einsum("kt,ktn->kn", q, abel) / divisor) @ project
            for q in (weights, weights * np.cos(2 * theta))
        )
        return mean, double

    opening = np.pi / 2 * np.sqrt((1 + z) / 2)
    return Basis(
        xi=xi,
        weight=w * xi,
        green=even @ ((np.pi * at_zero)[:, None] ** 2 * project) * xi,
        share=series @ evaluated(np.sqrt((1 + z) / 2), modes) @ project,
        inside=parts(np.full(z.size, np.pi / 2), np.sqrt((1 - z) / 2), 1.0),
        outside=parts(opening, 1 / np.sin(opening), opening[:, None]),
    )
