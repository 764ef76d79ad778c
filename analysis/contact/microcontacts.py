"""Places of the micro-contacts that the background difference lights up (paper, Fig. 2b)."""

from __future__ import annotations

import math

import cv2
import numpy as np

from analysis.arrays import F32, F64, Bool
from analysis.robust import robust_sd

# standard deviation of the matched filter; a micro-contact is about as wide as the resolution of
# the optics
SPOT_PX = 1.2
LIGHT_PX = 61  # side of the box whose mean is taken for slow light
# standard deviations of the filtered noise: less than one false spot in 1600x1200
SIGNIFICANT = 6.0


def micro_contacts(difference: F32, rounding: float = 0.0) -> tuple[F64, F64]:
    """Positions x, y (px) of the local maxima of a background difference that stand out of its
    noise; both of shape (n,).

    The noise is that of the picture's rim, where the block is free, so that a large contact does
    not raise its own threshold; it is no less than the `rounding` of the difference, which is all
    that two equal pictures leave.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> difference = np.random.default_rng(0).normal(size=(80, 90)).astype(np.float32)
    >>> difference[40, 50] = 90.0
    >>> x, y = analysis.micro_contacts(difference)
    >>> x.round().tolist(), y.round().tolist()
    ([50.0], [40.0])
    """
    difference = np.asarray(difference, np.float32)
    if difference.ndim != 2 or not difference.size:
        raise ValueError(
            f"micro-contacts: a difference of shape {difference.shape} found; give one picture,"
            " (rows, columns)"
        )
    light = cv2.blur(difference, (LIGHT_PX, LIGHT_PX))
    filtered = cv2.GaussianBlur(difference, (0, 0), SPOT_PX) - light
    threshold = SIGNIFICANT * max(_rim_noise(filtered), rounding)
    highest = cv2.dilate(filtered, np.ones((5, 5), np.uint8))
    y, x = np.nonzero((filtered >= highest) & (filtered > threshold))
    inside = (x > 0) & (x < filtered.shape[1] - 1) & (y > 0) & (y < filtered.shape[0] - 1)
    return x[inside].astype(np.float64), y[inside].astype(np.float64)


def far_from_dark_spots(difference: F32, x: F64, y: F64, distance: float) -> Bool:
    """Which of the micro-contacts, shape (n,), have no dark spot within a distance (px): a contact
    has none, so that what is bright beside one is the echo of a mark in the background.
    """
    cut = 2 * robust_sd(difference[::5, ::5])
    light = cv2.blur(np.clip(difference, -cut, cut), (LIGHT_PX, LIGHT_PX))
    filtered = cv2.GaussianBlur(difference, (0, 0), SPOT_PX) - light
    dark = filtered < -SIGNIFICANT * _rim_noise(filtered)
    side = 2 * math.ceil(distance) + 1
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    near = cv2.dilate(dark.view(np.uint8), around) > 0
    return np.asarray(~near[y.astype(int), x.astype(int)])


def _rim_noise(filtered: F32) -> float:
    """Standard deviation of the noise, from the median absolute value along the four sides: a
    contact that touches one hardly raises it.
    """
    band = max(8, min(filtered.shape) // 10)
    sides = (filtered[:band], filtered[-band:], filtered[:, :band], filtered[:, -band:])
    return robust_sd(np.concatenate([side[::2, ::2].ravel() for side in sides]))
