"""The disc that the micro-contacts fill: centre, radius and uncertainty from their positions; an
ellipse where they do not fill a disc.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from analysis.arrays import F64
from analysis.contact.densities import Density, Power, Rough
from analysis.dic.threads import together

ROUNDS = 8
DRAWS = 512
FEWEST_DRAWS = 80.0  # effective number of draws that a round keeps by flattening the likelihood
# how well the place of a micro-contact is known: no radius or centre is known better
LOCALISATION_PX = 0.5
# an elongation is looked at from so many standard uncertainties on, and is there if an ellipse
# explains the positions so much better than a disc does, in log-likelihood
ELONGATED, BETTER = 2.0, 6.5
MOST_ELONGATED = 0.8  # of half axes 3 to 1: what is longer is no contact
WITHIN = 1.15  # radii of the disc within which it is looked for

FAMILIES: tuple[Density, ...] = (Power(), Rough())


@dataclass(frozen=True, slots=True)
class Disc:
    """The disc that micro-contacts fill; pixels.

    `rough_share` is how likely they thin out like Greenwood and Tripp's pressure, 0 to 1, against a
    density that ends. `gain` is the logarithm of how much better the disc explains the positions
    than an even scatter over the picture does. `axes_px` are the half axes, the long one first, of
    the ellipse that the micro-contacts fill, `angle` is that of the long one from +x towards +y,
    -pi/2 to pi/2 rad; the radius is then that of a disc of the same area. NaN where they fill a
    disc as far as they show, or the picture cuts it.
    """

    centre_px: tuple[float, float]
    centre_sd_px: tuple[float, float]
    radius_px: float
    radius_sd_px: float
    rough_share: float
    gain: float
    axes_px: tuple[float, float] = (math.nan, math.nan)
    angle: float = math.nan


def micro_contact_disc(x: F64, y: F64, shape: tuple[int, int]) -> Disc:
    """Centre and apparent radius of the disc or ellipse of micro-contacts, with standard
    uncertainties.

    Their density ends like ``(1 - (r/a)^2)^m`` with m between 0 and 1 unknown (0: even, 1/2:
    Hertz), or thins out like Greenwood and Tripp's pressure of unknown roughness, whose apparent
    radius is ``a_H + sqrt(R h)``; plus stray points anywhere in the picture. The result is the mean
    over everything that the positions allow (flat prior over centre and scale, both kinds equally
    likely): the distance of the outermost point is biased low, the most likely radius as well, this
    mean is not.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Positions, 4 or more.
    shape : (rows, columns)
        Of the picture, which may cut the disc.

    Notes
    -----
    An elongation is that of the second moments of the positions. Where it stands out of their
    scatter, they are stretched to a disc of the same area, and the result is that of this disc.

    Importance sampling on a fixed low-discrepancy set: the same positions give the same bits. Each
    round draws around the result of the one before; the likelihood is flattened until enough draws
    count, except in the last round.
    """
    disc = _disc(x, y, shape)
    q, sd = _elongation(x, y, disc, shape)
    if not ELONGATED * sd < abs(q) < MOST_ELONGATED:
        return disc
    turn, root = cmath.exp(0.5j * cmath.phase(q)), ((1 + abs(q)) / (1 - abs(q))) ** 0.25
    centre = complex(*disc.centre_px)

    def stretched(z: Any, by: float) -> Any:
        """Along the long axis by that factor, and by its inverse across."""
        z = (z - centre) / turn
        return centre + turn * (by * z.real + 1j * z.imag / by)

    z = stretched(x + 1j * y, 1 / root)
    even = _disc(z.real, z.imag, shape)
    if even.gain < disc.gain + BETTER:
        return disc
    a = even.radius_px
    # an elongation that is left makes a disc too large
    sd_a = math.hypot(even.radius_sd_px, 0.5 * sd * a)
    axes = a * root, a / root
    middle = stretched(complex(*even.centre_px), root)
    return replace(
        even,
        centre_px=(middle.real, middle.imag),
        radius_sd_px=sd_a,
        axes_px=axes,
        angle=cmath.phase(turn),
    )


def _elongation(x: F64, y: F64, disc: Disc, shape: tuple[int, int]) -> tuple[complex, float]:
    """``(A^2 - B^2)/(A^2 + B^2) exp(2 i angle)`` of the ellipse with half axes A and B that has the
    second moments of the positions, and the standard uncertainty of each part; 0 and NaN where the
    picture cuts the disc.
    """
    (x0, y0), reach = disc.centre_px, WITHIN * disc.radius_px
    if not reach < min(x0, shape[1] - 1 - x0, y0, shape[0] - 1 - y0):
        return 0.0, math.nan
    z = (x - x0) + 1j * (y - y0)
    z = z[np.abs(z) < reach]
    z = z - z.mean()
    square = np.abs(z) ** 2
    size = float(square.mean())
    if not size > 0:  # all in one place
        return 0.0, math.nan
    sd = math.sqrt(0.5 * float((square * square).mean()) / len(z)) / size
    return complex((z * z).mean()) / size, sd


def _disc(x: F64, y: F64, shape: tuple[int, int]) -> Disc:
    """As `micro_contact_disc`, of a disc."""
    area = float(shape[0] * shape[1])
    middle = np.median(x), np.median(y)
    half = float(np.median(np.hypot(x - middle[0], y - middle[1])))
    # points in one place, or all along the rim of the picture, are where no draw would be possible
    half = float(np.clip(half, LOCALISATION_PX, 0.29 * math.hypot(*shape)))
    stray = _stray_share(np.hypot(x - middle[0], y - middle[1]), 1.3 * 1.65 * half, area)
    fits = [partial(_fitted, kind, x, y, shape, half, stray) for kind in FAMILIES]
    known = together(fits, len(fits))
    evidence = np.array([one.evidence for one in known])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    mean = share @ [one.mean for one in known]
    spread = share @ [one.variance + (one.mean - mean) ** 2 for one in known]
    sd_x, sd_y, sd_radius = np.sqrt(spread + LOCALISATION_PX**2).tolist()
    at_x, at_y, a = mean.tolist()
    gain = max(one.highest for one in known) + len(x) * np.log(area)
    return Disc((at_x, at_y), (sd_x, sd_y), a, sd_radius, float(share[1]), float(gain))


class _FittedDisc(NamedTuple):
    """What one family says: mean and variance of (x0, y0, apparent radius), logarithm of its
    evidence, the highest log-likelihood.
    """

    mean: F64
    variance: F64
    evidence: float
    highest: float


def _fitted(
    kind: Density, x: F64, y: F64, shape: tuple[int, int], half: float, stray: float
) -> _FittedDisc:
    """The mean over everything that the positions allow in one family of densities."""
    of_half, form, form_sd = kind.start
    radius = of_half * half
    centre = np.array([np.median(x), np.median(y), radius, form])
    spread = np.diag([0.04 * radius, 0.04 * radius, 0.1 * radius, form_sd]) ** 2
    for turn in range(ROUNDS):
        normal, root = ndtri(_even_points(turn)), np.linalg.cholesky(spread)
        draws = centre + normal @ root.T
        level = _log_likelihood(kind, draws, x, y, shape, stray)
        fewest = FEWEST_DRAWS if turn < ROUNDS - 1 else 0.0
        correction = 0.5 * (normal**2).sum(axis=1)
        weight = _weights(level, correction, fewest)
        centre = weight @ draws
        covariance = np.cov(draws.T, aweights=weight, ddof=0)
        spread = 1.5 * covariance + np.diag([0.05, 0.05, 0.05, 1e-4])
    a = kind.apparent(draws[:, 2], draws[:, 3])
    mean = np.append(centre[:2], weight @ a)
    variance = np.append(np.diag(covariance)[:2], weight @ (a - mean[2]) ** 2)
    total = level + correction
    highest = float(total.max())
    evidence = highest + math.log(float(np.exp(total - highest).mean()))
    evidence += float(np.log(np.diag(root)).sum()) - math.log(kind.most - kind.least)
    return _FittedDisc(mean, variance, evidence, float(level.max()))


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
    return (0.5 + index * golden ** -np.arange(1.0, 5.0)) % 1.0


def _log_likelihood(
    kind: Density, draws: F64, x: F64, y: F64, shape: tuple[int, int], stray: float
) -> F64:
    """Log-probability of the positions for each (x0, y0, scale, shape), shape (k, 4) to (k,)."""
    level = np.full(len(draws), -np.inf)
    low = np.array([0.0, 0.0, 0.0, kind.least])
    high = np.array([shape[1], shape[0], 0.5 * np.hypot(*shape), kind.most])
    allowed = np.flatnonzero(((draws > low) & (draws < high)).all(axis=1))
    chosen = draws[allowed]
    share = (1 - stray) / _visible_share(kind, chosen, shape)
    level[allowed] = kind.levels(chosen, x, y, share, stray / (shape[0] * shape[1]))
    return level


def _visible_share(kind: Density, draws: F64, shape: tuple[int, int]) -> F64:
    """Share of the micro-contacts that lies in the picture, shape (k,)."""
    x0, y0, scale, form = draws.T[:, :, None]
    sides = np.hstack([x0 + 0.5, shape[1] - 0.5 - x0, y0 + 0.5, shape[0] - 0.5 - y0])
    r = scale * kind.nodes(form)
    if (sides.min(axis=1) >= r[:, -1]).all():
        return np.ones(len(draws))
    arcs = np.arccos(np.clip(sides[:, :, None] / r[:, None, :], -1, 1))
    left, right, top, bottom = np.moveaxis(arcs, 1, 0)
    hidden = 2 * (left + right + top + bottom)
    # beyond a corner two sides hide the same arc
    for corner in (left + top, left + bottom, right + top, right + bottom):
        hidden -= np.maximum(corner - np.pi / 2, 0)
    return np.asarray(np.maximum(1 - hidden / (2 * np.pi), 0.05).mean(axis=1))


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
