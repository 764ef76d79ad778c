"""The contact of two smooth faces: a disc that is evenly brighter or darker than what surrounds it,
as in a JKR test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from analysis.arrays import F64, Array, Bool
from analysis.robust import robust_sd, serial_inflation, white_noise

SMOOTHING_PX = 2.0  # before the first look only
LEAST_RADIUS_PX = 12.0
LEAST_RIM = 0.5  # share of the edge that must be seen
LEAST_CONTRAST = 4.0  # of the edge, in sds of the noise of a pixel over those of its rays
WINDOW_PX = 12.0  # half width of the stretch of a ray in which the edge is looked for
OUTLYING = 4.0  # robust sds of an edge from the circle
ROUNDS = 4
LARGEST_OVAL = 0.05  # amplitude of the second harmonic over the radius
MOST_OUTLYING = 0.3
RAYS_PER_PX = 1.0  # of the edge: neighbours share little of their noise


@dataclass(frozen=True, slots=True)
class SmoothContact:
    """The disc of a smooth contact; pixels and grey levels.

    Attributes
    ----------
    centre_px : (x, y)
    radius_px, radius_sd_px : float
        Mean radius over the azimuth, and its standard uncertainty by what scatters along the edge.
    oval : float
        Amplitude of the second harmonic of the radius over its mean: half of the difference between
        the largest and the smallest radius.
    contrast : float
        Level inside less that outside, at the edge; of the ratio with the background where there is
        one.
    rim : float
        Share of the edge that was measured.
    """

    centre_px: tuple[float, float]
    radius_px: float
    radius_sd_px: float
    oval: float
    contrast: float
    rim: float


def smooth_contact(image: Array, background: Array | None = None) -> SmoothContact:
    """Centre and radius of the contact between two smooth faces.

    Parameters
    ----------
    image, background : ndarray, shape (rows, columns)
        Grey levels with and without contact. With a background what is seen is their ratio, so that
        uneven light and dust that stays do not matter.

    Raises
    ------
    ValueError
        No disc is seen, or one that is too small, cut off by the picture, or not round.

    Notes
    -----
    Along each of many rays the edge is where a step between the levels on either side would hold as
    much light as is there: so it is that of the sharp disc whatever symmetric blur the lens adds. A
    circle with its second harmonic goes through the edges, outlying ones (dust, scratches) left
    out.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> y, x = np.mgrid[:200, :240]
    >>> disc = 100 + 40 * np.clip(60.25 - np.hypot(x - 118.5, y - 101.0) + 0.5, 0, 1)
    >>> found = analysis.smooth_contact(disc)
    >>> abs(found.radius_px - 60.25) < 0.02, found.contrast > 0
    (True, True)
    """
    seen: Array = np.asarray(image, dtype=np.float32)
    if seen.ndim != 2 or min(seen.shape) < 4 * LEAST_RADIUS_PX:
        raise ValueError(
            f"smooth contact: a picture of shape {seen.shape} found; give one of"
            f" {4 * LEAST_RADIUS_PX:g} px or more in rows and columns"
        )
    if background is not None:
        free = np.asarray(background, dtype=np.float32)
        if free.shape != seen.shape:
            raise ValueError(
                f"smooth contact: the background has the shape {free.shape}, the picture"
                f" {seen.shape}; give pictures of the same camera"
            )
        seen = seen / np.maximum(free, np.float32(1))
    if not np.isfinite(seen).all():
        raise ValueError("smooth contact: grey levels that are no numbers found; give a picture")
    centre, radius = _first_look(seen)
    noise = white_noise(seen)
    for turn in range(ROUNDS):
        # the first circle is off by more than the window may be narrow
        half = WINDOW_PX * (2 if turn == 0 else 1)
        half = min(half, 0.6 * radius)
        angle, edge, contrast = _edges(seen, centre, radius, half)
        typical = float(np.median(contrast)) if len(contrast) else 0.0
        sure = contrast * np.sign(typical) > 0.3 * abs(typical)
        if len(edge) < LEAST_RIM * _rays(radius) or np.mean(sure) < 1 - MOST_OUTLYING:
            raise ValueError(
                f"smooth contact: {np.count_nonzero(sure) / _rays(radius):.0%} of an edge is seen,"
                f" {LEAST_RIM:.0%} are needed; use a lower force or magnification, and clean the"
                " faces"
            )
        harmonics, sd, keep = _circle(angle[sure], edge[sure])
        centre = centre[0] + float(harmonics[1]), centre[1] + float(harmonics[2])
        radius = float(harmonics[0])
    if abs(typical) * math.sqrt(_rays(radius)) < LEAST_CONTRAST * max(noise, 1e-9) or math.isnan(
        sd
    ):
        raise ValueError(
            f"smooth contact: the disc is {abs(typical):.2g} from its surroundings, with a noise of"
            f" {noise:.2g} per pixel; light the contact better"
        )
    oval = float(np.hypot(*harmonics[3:])) / radius
    if oval > LARGEST_OVAL or np.mean(keep) < 1 - MOST_OUTLYING:
        raise ValueError(
            f"smooth contact: the edge is no circle (oval by {oval:.1%}, {1 - np.mean(keep):.0%} of"
            " it lies elsewhere); check that the faces are smooth and nothing is between them"
        )
    rim = float(np.count_nonzero(keep)) / _rays(radius)
    return SmoothContact(centre, radius, sd, oval, typical, min(rim, 1.0))


def _rays(radius: float) -> int:
    return max(64, round(2 * np.pi * radius * RAYS_PER_PX))


def _first_look(seen: Array) -> tuple[tuple[float, float], float]:
    """Centre and radius of the largest blob on one side of the threshold that splits the levels
    best, the side that the frame of the picture does not belong to.
    """
    smooth = cv2.GaussianBlur(seen, (0, 0), SMOOTHING_PX)
    low, high = np.percentile(smooth, [0.1, 99.9])
    if not high > low:
        raise ValueError("smooth contact: the picture is evenly bright; light the contact")
    levels = np.clip((smooth - low) / (high - low) * 255, 0, 255).astype(np.uint8)
    _, bright = cv2.threshold(levels, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    frame = np.concatenate([bright[0], bright[-1], bright[:, 0], bright[:, -1]])
    inside = bright if frame.mean() < 0.5 else 1 - bright
    count, _, stats, middles = cv2.connectedComponentsWithStats(inside)
    if count < 2:
        raise ValueError("smooth contact: no disc is seen; check the light and the picture")
    best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    area, width, height = (
        float(stats[best, i]) for i in (cv2.CC_STAT_AREA, cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT)
    )
    radius = math.sqrt(area / np.pi)
    if radius < LEAST_RADIUS_PX:
        raise ValueError(
            f"smooth contact: the largest disc that is seen has a radius of {radius:.1f} px,"
            f" {LEAST_RADIUS_PX:g} are needed; press more, or check the light"
        )
    if area < 0.5 * np.pi / 4 * width * height:
        raise ValueError(
            "smooth contact: what is seen fills"
            f" {area / (np.pi / 4 * width * height):.0%} of a disc of its size; give a background"
            " picture, and check that the faces are smooth"
        )
    return (float(middles[best][0]), float(middles[best][1])), radius


def _edges(
    seen: Array, centre: tuple[float, float], radius: float, half: float
) -> tuple[F64, F64, F64]:
    """Azimuth, distance from the centre and contrast of the edge on each ray that lies in the
    picture.
    """
    angle = np.linspace(0, 2 * np.pi, _rays(radius), endpoint=False)
    step = 0.5
    along = np.arange(-half, half + step / 2, step)
    r = radius + along
    x = centre[0] + np.cos(angle)[:, None] * r
    y = centre[1] + np.sin(angle)[:, None] * r
    rows, columns = seen.shape
    whole = (x.min(1) >= 0) & (x.max(1) <= columns - 1) & (y.min(1) >= 0) & (y.max(1) <= rows - 1)
    level = map_coordinates(seen, [y[whole], x[whole]], order=1, mode="nearest")
    third = len(along) // 4
    inner, outer = (np.median(part, axis=1) for part in (level[:, :third], level[:, -third:]))
    # levels over a stretch of the edge: a ray alone knows them badly
    wide = max(1, len(inner) // 24)
    inner, outer = _along(inner, wide), _along(outer, wide)
    contrast = inner - outer
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (level - outer[:, None]) / contrast[:, None]
    filled = (share.sum(axis=1) - share[:, 0] / 2 - share[:, -1] / 2) * step
    edge = np.where(contrast == 0, np.nan, radius - half + filled)
    good = np.isfinite(edge)
    return angle[whole][good], edge[good], contrast[good]


def _along(levels: Array, wide: int) -> F64:
    """Running mean along the closed edge."""
    padded = np.pad(levels.astype(np.float64), wide, mode="wrap")
    total = np.cumsum(np.append(0.0, padded))
    return np.asarray((total[2 * wide + 1 :] - total[: -2 * wide - 1]) / (2 * wide + 1))


def _circle(angle: F64, edge: F64) -> tuple[F64, float, Bool]:
    """Mean, first and second harmonics of the edge over the azimuth, the standard uncertainty of
    the mean, and the rays that count.
    """
    basis = np.stack(
        [np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)],
        axis=1,
    )
    values = np.array([np.median(edge), 0, 0, 0, 0])
    keep = np.ones(len(edge), dtype=np.bool_)
    for _ in range(ROUNDS):
        off = edge - basis @ values
        off -= np.median(off)
        keep = np.abs(off) <= max(OUTLYING * robust_sd(off), 1e-6)
        values = np.linalg.lstsq(basis[keep], edge[keep])[0]
    residual = edge[keep] - basis[keep] @ values
    freedom = len(residual) - len(values)
    if freedom < 1:
        return values, math.nan, keep
    variance = float(residual @ residual) / freedom * serial_inflation(residual)
    covariance = np.linalg.inv(basis[keep].T @ basis[keep]) * variance
    return values, math.sqrt(float(covariance[0, 0])), keep
