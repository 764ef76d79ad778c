"""The disc that the micro-contacts fill: centre, radius and uncertainty from their positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from analysis.arrays import F64

LARGEST_EXPONENT = 2.0
ROUNDS = 8
DRAWS = 512
FEWEST_DRAWS = 80.0  # effective number of draws that a round keeps by flattening the likelihood
RADIAL_NODES = 24
# how well the place of a micro-contact is known: no radius or centre is known better
LOCALISATION_PX = 0.5
CHUNK = 50_000  # densities worked on at a time: they stay in the cache


@dataclass(frozen=True, slots=True)
class Disc:
    """Where micro-contacts end: density ``(1 - (r/radius)^2)^exponent``; pixels.

    `gain` is the logarithm of how much better the disc explains the positions than an even scatter
    over the picture does.
    """

    centre_px: tuple[float, float]
    centre_sd_px: tuple[float, float]
    radius_px: float
    radius_sd_px: float
    exponent: float
    gain: float


def micro_contact_disc(x: F64, y: F64, shape: tuple[int, int]) -> Disc:
    """Centre and radius of the disc of micro-contacts, with standard uncertainties.

    Their density is taken as ``(1 - (r/a)^2)^m`` with m between 0 and 2 unknown (0: even, 1/2:
    Hertz), plus stray points anywhere in the picture. The result is the mean over everything that
    the positions allow (flat prior over centre, a and m): the distance of the outermost point is
    biased low, the most likely radius as well, this mean is not.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Positions, 4 or more.
    shape : (rows, columns)
        Of the picture, which may cut the disc.

    Notes
    -----
    Importance sampling on a fixed low-discrepancy set: the same positions give the same bits. Each
    round draws around the result of the one before; the likelihood is flattened until enough draws
    count, except in the last round.
    """
    area = float(shape[0] * shape[1])
    middle = np.array([np.median(x), np.median(y)])
    # half of the points lie within 0.6 a for m = 1/2, 0.7 a for m = 0, 0.45 a for m = 3/2
    radius = 1.65 * float(np.median(np.hypot(x - middle[0], y - middle[1])))
    stray = _stray_share(np.hypot(x - middle[0], y - middle[1]), 1.3 * radius, area)

    centre = np.array([*middle, radius, 0.7])
    spread = np.diag([0.04 * radius, 0.04 * radius, 0.1 * radius, 0.6]) ** 2
    for turn in range(ROUNDS):
        normal = ndtri(_even_points(turn))
        draws = centre + normal @ np.linalg.cholesky(spread).T
        level = _log_likelihood(draws, x, y, shape, stray)
        fewest = FEWEST_DRAWS if turn < ROUNDS - 1 else 0.0
        weight = _weights(level, 0.5 * (normal**2).sum(axis=1), fewest)
        centre = weight @ draws
        covariance = np.cov(draws.T, aweights=weight, ddof=0)
        spread = 1.5 * covariance + np.diag([0.05, 0.05, 0.05, 1e-4])
    sd_x, sd_y, sd_radius, _ = np.sqrt(np.diag(covariance) + LOCALISATION_PX**2).tolist()
    at_x, at_y, a, exponent = centre.tolist()
    gain = float(level.max() + len(x) * np.log(area))
    return Disc((at_x, at_y), (sd_x, sd_y), a, sd_radius, exponent, gain)


def _stray_share(r: F64, limit: float, area: float) -> float:
    """Share of the points that belong to no contact, from those beyond `limit`; at least half a
    point.
    """
    outside = max(area - np.pi * limit**2, 0.1 * area)
    return float(min(max(0.5, np.count_nonzero(r > limit) * area / outside) / len(r), 0.9))


def _even_points(turn: int) -> F64:
    """Points that fill the unit cube of four dimensions evenly, shape (DRAWS, 4): additive
    recurrence of the generalised golden ratio.
    """
    golden = 1.1673039782614187  # root of x^5 = x + 1
    index = np.arange(1, DRAWS + 1)[:, None] + turn * DRAWS
    return np.asarray((0.5 + index * golden ** -np.arange(1.0, 5.0)) % 1.0)


def _log_likelihood(draws: F64, x: F64, y: F64, shape: tuple[int, int], stray: float) -> F64:
    """Log-probability of the positions for each (x0, y0, a, m), shape (k, 4) to (k,)."""
    level = np.full(len(draws), -np.inf)
    high = np.array([shape[1], shape[0], 0.5 * np.hypot(*shape), LARGEST_EXPONENT])
    allowed = np.flatnonzero(((draws > 0) & (draws < high)).all(axis=1))
    for rows in np.array_split(allowed, max(1, len(allowed) * len(x) // CHUNK)):
        x0, y0, a, m = (column[:, None] for column in draws[rows].T)
        scale = (1 - stray) * (m + 1) / (np.pi * a**2) / _visible_share(x0, y0, a, m, shape)
        inside = 1 - ((x - x0) ** 2 + (y - y0) ** 2) / a**2
        # exp(m log) is several times faster than a power; the floor keeps the logarithm finite
        # where the result is not used
        density = np.exp(m * np.log(np.maximum(inside, 1e-12)) + np.log(scale))
        density[inside <= 0] = 0
        level[rows] = np.log(density + stray / (shape[0] * shape[1])).sum(axis=1)
    return level


def _visible_share(x0: F64, y0: F64, a: F64, m: F64, shape: tuple[int, int]) -> F64:
    """Share of the micro-contacts that lies in the picture, shape (k, 1)."""
    sides = np.hstack([x0 + 0.5, shape[1] - 0.5 - x0, y0 + 0.5, shape[0] - 0.5 - y0])
    if (sides >= a).all():
        return np.ones_like(a)
    part = (np.arange(RADIAL_NODES) + 0.5) / RADIAL_NODES
    r = a * np.sqrt(1 - (1 - part) ** (1 / (m + 1)))
    arcs = np.arccos(np.clip(sides[:, :, None] / r[:, None, :], -1, 1))
    left, right, top, bottom = np.moveaxis(arcs, 1, 0)
    hidden = 2 * (left + right + top + bottom)
    # beyond a corner two sides hide the same arc
    for corner in (left + top, left + bottom, right + top, right + bottom):
        hidden -= np.maximum(corner - np.pi / 2, 0)
    return np.asarray(np.maximum(1 - hidden / (2 * np.pi), 0.05).mean(axis=1, keepdims=True))


def _weights(level: F64, correction: F64, fewest: float) -> F64:
    """Normalised weights of the draws; the likelihood is flattened until at least `fewest` of them
    count.
    """
    power = 1.0
    while True:
        logarithm = power * (level + correction)
        weight = np.exp(logarithm - logarithm.max())
        weight /= weight.sum()
        if 1 / (weight @ weight) >= fewest or power < 1e-4:
            return np.asarray(weight)
        power *= 0.7
