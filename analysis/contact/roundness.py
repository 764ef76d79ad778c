"""Whether the displacement under a sheared sphere is that of a round contact: the harmonics of u_x
over the azimuth in rings, against those that its ring means imply.

With a traction along x that depends on r alone, u_x has a mean over the azimuth and a part in cos 2
theta that follows from that mean; nothing else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import F64
from analysis.contact.rings import Rings

MIN_RINGS = 4
QUIET = 0.25  # share of the rings that scatter less than what is taken for the noise
BEYOND = 1.2  # distance in radii from which a part in theta is taken for a turn of the picture


class Departure(NamedTuple):
    """By how much u_x departs from that of a round contact within a radius; metres.

    Attributes
    ----------
    first, second : float
        Root of the mean square over the disc of the parts in theta and in 2 theta that are too
        much.
    first_noise, second_noise : float
        Standard uncertainty of both, that of the first also by the centre of the rings.
    slip : float
        u_x at that radius less u_x at the centre.
    """

    first: float
    second: float
    first_noise: float
    second_noise: float
    slip: float

    @property
    def size(self) -> float:
        """Root of the mean square of both parts together."""
        return math.hypot(self.first, self.second)

    def is_seen(self, certain: float, least: float) -> bool:
        """Whether a part is so many times its standard uncertainty, and that share of the slip."""
        return any(
            part > max(certain * noise, least * abs(self.slip))
            for part, noise in ((self.first, self.first_noise), (self.second, self.second_noise))
        )


def implied_second(r: F64, mean: F64, nu: float) -> F64:
    """Amplitude of cos 2 theta that belongs to a mean of u_x over the azimuth, from the innermost
    ring on; all of shape (n,).

    ``nu/(2 - nu) (mean within r - mean at r)``: of a half-space, by its Green's tensor.
    """
    area = np.diff(np.square(np.append(0.0, 0.5 * (r[1:] + r[:-1]))), append=np.nan)
    area[-1] = r[-1] ** 2 - 0.25 * (r[-1] + r[-2]) ** 2
    inner = np.cumsum(area * mean) - area * mean
    inside = np.cumsum(area) - area
    own = r**2 - inside  # of the ring itself, up to its middle
    return np.asarray(nu / (2 - nu) * ((inner + own * mean) / r**2 - mean))


def departure_from_round(
    rings: Rings, radius: float, nu: float, shared: float = 1.0, centre_sd: float = 0.0
) -> Departure | None:
    """How u_x, along the drive, departs from that of a round contact of a radius (m); None where
    too few rings have harmonics.

    What grows in proportion to the distance, which is a turn or a stretch of the picture, is taken
    off. `shared` is the number of correlation boxes that overlap in a place, `centre_sd` the
    uncertainty of the rings' centre in each direction, metres.
    """
    known = np.isfinite(rings.mean) & (rings.radius > 0)
    implied = np.full(len(known), np.nan)
    if known.sum() >= MIN_RINGS:
        implied[known] = implied_second(rings.radius[known], rings.mean[known], nu)
    good = known & np.isfinite(rings.harmonics).all(axis=1) if len(rings.harmonics) else ~known
    r, u, count = rings.radius[good], rings.mean[good], rings.count[good]
    inside, outside = r < radius, r > BEYOND * radius
    if inside.sum() < MIN_RINGS:
        return None
    cos, sin, cos2, sin2 = rings.harmonics[good].T
    first, second = cos + 1j * sin, cos2 - implied[good] + 1j * sin2
    if outside.any():
        first = first - r * (first[outside] / r[outside]).mean()
    # uneven contacts add scatter to some rings, so that a point's own is that of the quietest
    point = float(np.quantile(np.square(rings.standard_error[good]) * count, QUIET))
    weight = r[inside] / r[inside].sum()
    noise = math.sqrt(2 * shared * point * float(weight @ (1 / count[inside])))
    off = centre_sd * math.sqrt(float(weight @ np.square(np.gradient(u, r)[inside])))

    def size(part: NDArray[np.complex128]) -> float:
        return math.sqrt(0.5 * float(weight @ np.square(np.abs(part[inside]))))

    slip = float(np.interp(radius, r, u) - rings.mean[known][0])
    return Departure(size(first), size(second), math.hypot(noise, off), noise, slip)
