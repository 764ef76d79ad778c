"""How densely micro-contacts lie about the contact's centre: families of densities with a scale and
a shape, for `analysis.contact.disc`.

A family tells the logarithm of the density at points (up to what all families share), the share of
it that a picture shows, and the apparent radius that goes with scale and shape.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from analysis.arrays import F64, I64
from analysis.kernels import compiled
from analysis.mechanics.greenwood_tripp import rough_contact

NODES = 24  # radii that stand for the whole density
FAINTEST = 1e-6  # share of the central density at which the rough one is cut
# h R/a_H^2: with less no number of micro-contacts tells the edge from a sharp one, and with more
# there are only a few of them
ROUGHNESSES = np.geomspace(5e-3, 10.0, 14)
TOGETHER = 16  # densities per px^2 whose product has its logarithm taken: of 1e-18, it is 1e-288
ALONG = 160  # places of a rough density, from the centre to where it is cut


class Power:
    """``(1 - (r/a)^2)^m``: 0 is an even density, 1/2 that of Hertz's pressure. It ends at a.

    Attributes
    ----------
    start : (float, float, float)
        Scale over the median distance of the points, shape, and the spread of the shape, where a
        search begins.
    least, most : float
        Of the shape, which has an even prior between them.
    """

    start = (1.65, 0.7, 0.6)  # half of the points lie within 0.6 a for m = 1/2
    least, most = 0.0, 1.0

    def apparent(self, scale: F64, shape: F64) -> F64:
        """Apparent radius, in the unit of the scale."""
        return scale

    def nodes(self, shape: F64) -> F64:
        """Radii over the scale between which equal shares of the density lie, (k, 1) to (k,
        NODES).
        """
        part = (np.arange(NODES) + 0.5) / NODES
        return np.sqrt(1 - (1 - part) ** (1 / (shape + 1)))

    def levels(self, draws: F64, x: F64, y: F64, share: F64, stray: float) -> F64:
        """Sum over the points (x, y) of the logarithm of ``share density + stray`` for each draw of
        (x0, y0, scale, shape), shape (k, 4) to (k,).
        """
        return np.asarray(_power_levels(draws, x, y, share, stray))


class Rough:
    """Greenwood and Tripp's, whose roughness ``h R/a_H^2`` is the exponential of the shape; the
    scale is Hertz's radius a_H, the apparent one ``a_H + sqrt(R h)``.
    """

    start = (1.45, math.log(0.02), 0.9)
    least, most = math.log(ROUGHNESSES[0]), math.log(ROUGHNESSES[-1])

    def apparent(self, scale: F64, shape: F64) -> F64:
        """See `Power`."""
        return np.asarray(scale * (1 + np.exp(shape / 2)))

    @cached_property
    def _table(self) -> tuple[F64, F64, F64]:
        """Logarithm of the densities over a_H^2, normalised, at even steps to their ends, shape
        (shapes, ALONG); the ends over a_H; the radii of `nodes`.
        """
        part = (np.arange(NODES) + 0.5) / NODES
        rows, ends, nodes = [], [], []
        for alpha in ROUGHNESSES.tolist():
            contact = rough_contact(4 / 3, 1.0, 0.0, 1.0, alpha)  # a_H = R = 1
            end = contact.radius_at(FAINTEST)
            at = np.linspace(0, end, 4 * ALONG)
            p = contact.pressure(at)
            inside = np.append(0.0, np.cumsum((p * at)[1:] + (p * at)[:-1])) / 2 * at[1]
            density = np.interp(np.linspace(0, end, ALONG), at, p) / (2 * np.pi * inside[-1])
            rows.append(np.log(density))
            ends.append(end)
            nodes.append(np.interp(part * inside[-1], inside, at))
        return np.array(rows), np.array(ends), np.array(nodes)

    def nodes(self, shape: F64) -> F64:
        """See `Power`."""
        _, _, nodes = self._table
        k, t = _place(shape.ravel())
        return nodes[k] * (1 - t)[:, None] + nodes[k + 1] * t[:, None]

    def levels(self, draws: F64, x: F64, y: F64, share: F64, stray: float) -> F64:
        """See `Power`."""
        table, ends, _ = self._table
        k, t = _place(draws[:, 3])
        return np.asarray(_rough_levels(draws, x, y, share, stray, table, ends, k, t))


Density = Power | Rough


def _place(shape: F64) -> tuple[I64, F64]:
    """Row of the table below a shape, and how far between it and the next."""
    known = np.log(ROUGHNESSES)
    at = np.clip((shape - known[0]) / (known[1] - known[0]), 0, len(known) - 1 - 1e-9)
    return at.astype(np.int64), at % 1


@compiled
def _log_of_product(values: F64) -> float:
    level, product = 0.0, 1.0
    for i in range(values.size):
        product *= values[i]
        if i % TOGETHER == 0:
            level += math.log(product)
            product = 1.0
    return level + math.log(product)


@compiled
def _power_levels(draws: F64, x: F64, y: F64, share: F64, stray: float) -> F64:
    out, each = np.zeros(len(draws)), np.empty(x.size)
    for n in range(len(draws)):
        x0, y0, a, m = draws[n]
        scale = share[n] * (m + 1) / (np.pi * a * a)
        for i in range(x.size):
            inside = 1 - ((x[i] - x0) ** 2 + (y[i] - y0) ** 2) / (a * a)
            density = stray
            if inside > 0:
                density += scale * math.exp(m * math.log(max(inside, 1e-12)))
            each[i] = density
        out[n] = _log_of_product(each)
    return out


@compiled
def _rough_levels(
    draws: F64,
    x: F64,
    y: F64,
    share: F64,
    stray: float,
    table: F64,
    ends: F64,
    k: I64,
    t: F64,
) -> F64:
    out, each = np.zeros(len(draws)), np.empty(x.size)
    last = table.shape[1] - 1
    for n in range(len(draws)):
        x0, y0, a = draws[n, 0], draws[n, 1], draws[n, 2]
        scale, row, f = share[n] / (a * a), k[n], t[n]
        per = last / (a * (ends[row] * (1 - f) + ends[row + 1] * f))
        for i in range(x.size):
            at = math.sqrt((x[i] - x0) ** 2 + (y[i] - y0) ** 2) * per
            density = stray
            if at < last:
                j = int(at)
                g = at - j
                below = table[row, j] * (1 - g) + table[row, j + 1] * g
                above = table[row + 1, j] * (1 - g) + table[row + 1, j + 1] * g
                density += scale * math.exp(below * (1 - f) + above * f)
            each[i] = density
        out[n] = _log_of_product(each)
    return out
