"""Two pictures that are turned or stretched against each other by more than a correlation follows:
features that both show tell how, and the picture is correlated after it was turned back.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from analysis.arrays import F32, F64, U8, Array
from analysis.dic.field import Field, Tracker
from analysis.dic.status import MASKED, OK, OUT_OF_IMAGE

FEATURES = 6000  # most features of a picture: the strongest
RATIO = 0.8  # best over second best distance of a match, at most (Lowe 2004)
WITHIN_PX = 3.0  # largest distance of a match from the common deformation
MIN_MATCHES = 12  # matches that agree by chance are fewer
SEED = 1
DEGREE = 5  # degree of the B-spline that turns the picture back


class Alignment(NamedTuple):
    """Where places of the reference have gone, on the whole: from x to ``matrix @ x + shift``, in
    pixels (x, y); and how many matches agree with it.
    """

    matrix: F64
    shift: F64
    matches: int


def alignment(reference: Array, image: Array) -> Alignment | None:
    """The common deformation of two pictures by features that both show (SIFT, Lowe 2004); None if
    too few agree.
    """
    finder = cv2.SIFT.create(nfeatures=FEATURES, contrastThreshold=0.01)
    found = [finder.detectAndCompute(_8_bit(picture), None) for picture in (reference, image)]
    (here, one), (there, other) = found
    if one is None or other is None or len(other) < 2:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(one, other, k=2)
    good = [first for first, second in pairs if first.distance < RATIO * second.distance]
    if len(good) < MIN_MATCHES:
        return None
    x = np.array([here[m.queryIdx].pt for m in good])
    y = np.array([there[m.trainIdx].pt for m in good])
    cv2.setRNGSeed(SEED)
    affine, agree = cv2.estimateAffine2D(x, y, ransacReprojThreshold=WITHIN_PX)
    if affine is None or int(agree.sum()) < MIN_MATCHES:
        return None
    return Alignment(affine[:, :2], affine[:, 2], int(agree.sum()))


def track_aligned(
    make: Callable[[F32], Tracker], reference: Array, image: Array, found: Alignment
) -> Field:
    """The displacement between the reference and an image that is turned back first.

    Parameters
    ----------
    make : callable
        Makes a tracker of a reference, shape (rows, columns), float32.

    Notes
    -----
    The image is read between its pixels by a quintic B-spline, once more than in any other
    correlation; tests/dic/test_aligned.py holds the whole error for speckle of 3 to 5 px within
    0.03 px rms.
    """
    matrix, shift = found.matrix, found.shift
    flipped = matrix[::-1, ::-1]  # rows before columns
    turned = ndimage.affine_transform(
        image.astype(np.float64), flipped, shift[::-1], order=DEGREE, mode="nearest"
    )
    tracker = make(reference.astype(np.float32))
    try:
        field, grid = tracker.track(turned.astype(np.float32)), tracker.grid
    finally:
        tracker.close()
    x, y = np.meshgrid(grid.x_px, grid.y_px)
    at = np.stack([x + field.ux_px, y + field.uy_px])
    there = np.tensordot(matrix, at, 1) + shift[:, None, None]
    u = there - np.stack([x, y])
    sd = np.sqrt(np.tensordot(matrix**2, np.stack([field.ux_std_px, field.uy_std_px]) ** 2, 1))
    status = field.status.copy()
    rows, columns = image.shape
    half = np.abs(matrix).sum(axis=1) * grid.box_px / 2  # of a turned box
    size = np.array([columns - 1, rows - 1])
    # where a point without a displacement would be
    place = np.tensordot(matrix, np.stack([x, y]), 1) + shift[:, None, None]
    place = np.where(status == OK, there, place)
    fits = (place >= half[:, None, None]) & (place <= (size - half)[:, None, None])
    status[~fits.all(axis=0) & (status != MASKED)] = OUT_OF_IMAGE
    return Field.of(grid, u, field.zncc, sd, status, field.iterations)


def _8_bit(picture: Array) -> U8:
    """The picture with its grey levels spread over 8 bits."""
    low, high = np.percentile(picture, (0.5, 99.5))
    spread = (picture - low) * (255 / max(float(high - low), 1e-9))
    return np.asarray(spread.clip(0, 255), np.uint8)
