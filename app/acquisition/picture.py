"""A camera's image as it is shown before a run: thinned, with what says whether light and focus are
right.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from analysis.arrays import Array
from analysis.saturation import end_of_scale
from app.records.bench_view import PictureView

WIDTH = 640  # largest width of a thinned picture, px
BINS = 64
RED = (255, 0, 0)


def focus(image: Array) -> float:
    """How sharp an image is: variance of its Laplacian over the square of its mean grey level, in
    thousandths. It does not depend on the exposure, and falls as the image goes out of focus; it
    compares pictures of the same scene only. NaN for a black image.

    References
    ----------
    Pech-Pacheco, Cristóbal, Chamorro-Martínez, Fernández-Valdivia, "Diatom autofocusing in
    brightfield microscopy: a comparative study", Proc. ICPR 2000, vol. 3, pp. 314-317: the variance
    of the Laplacian (operator LAP4 of Pertuz, Puig, Garcia, Pattern Recognition 46, 2013, p. 1415).
    """
    mean = float(cv2.mean(image)[0])
    if not mean:
        return math.nan
    _, sd = cv2.meanStdDev(cv2.Laplacian(image, cv2.CV_32F))
    return 1e3 * float(sd[0, 0] / mean) ** 2


def picture_of(number: int, image: Array, full_scale: int, lost: int = 0) -> PictureView:
    """An image of grey levels up to `full_scale`, as it is shown."""
    rows, columns = image.shape
    counts = np.bincount(image.ravel(), minlength=full_scale + 1)
    end = int(end_of_scale(image, full_scale))
    at_end = int(counts[end:].sum())
    edges = np.linspace(0, full_scale + 1, BINS + 1).round().astype(int)[:-1]
    histogram = np.add.reduceat(counts[: full_scale + 1].astype(float), edges)
    histogram[-1] += counts[full_scale + 1 :].sum()
    scale = min(1.0, WIDTH / columns)
    size = max(1, round(columns * scale)), max(1, round(rows * scale))
    grey = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    levels = np.clip(grey * (255.0 / full_scale), 0, 255).astype(np.uint8)
    rgb = np.repeat(levels[:, :, None], 3, axis=2)
    if at_end:
        mask = (image >= end).astype(np.float32)
        rgb[cv2.resize(mask, size, interpolation=cv2.INTER_AREA) > 0] = RED
    return PictureView(
        number=number,
        rgb=rgb,
        histogram=histogram / image.size,
        saturated=at_end / image.size,
        dark=float(counts[0]) / image.size,
        mean=float(cv2.mean(image)[0]) / full_scale,
        focus=focus(image),
        lost=lost,
    )
