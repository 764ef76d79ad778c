"""Where the pattern of a reference repeats itself: by the autocorrelation of parts of the picture,
then by the correlation of every box with the reference one period away.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import ifft, irfft, rfft2
from scipy.ndimage import maximum_filter

from analysis.arrays import F32, Array
from analysis.dic.repeating import Repetition
from analysis.dic.searching import DirectSearch
from analysis.dic.spectrum import TextureCorrelation
from analysis.dic.tracker import ReferenceImage

# correlation of a box with the reference a period further, as a share of that with itself in
# another picture: then either may be the higher one
ALIKE = 0.75
TILE = 128  # px; side of the parts of a picture that are looked at, four times the longest period
LEAST_REPEAT = 0.4  # correlation of a tile, without noise, from which it repeats itself
# scatter of the correlation of as many grains as a tile holds, beyond which no peak is by chance,
# and the most that this asks for
BY_CHANCE, MOST_BY_CHANCE = 6.0, 0.8
COMPARABLE = 0.8  # share of the highest peak of a tile from which another counts
MOST_LAGS = 4  # that are tried in every box
FEW = 0.01  # share of the points; if fewer repeat themselves, it is by chance


def repetition(
    reference: ReferenceImage, texture: TextureCorrelation, min_contrast: float
) -> Repetition | None:
    """Which points of a reference of that texture repeat themselves; None: hardly any.

    Every box is looked for where the texture of some part of the picture repeats itself, on both
    sides of it.
    """
    noise = 1 + texture.noise_share
    side = min(TILE, *reference.image.shape)
    chance = min(BY_CHANCE * math.sqrt(texture.grain_px2) / side, MOST_BY_CHANCE)
    if not (lags := _repeats(reference.image, max(LEAST_REPEAT / noise, chance))):
        return None
    method = DirectSearch(
        reference,
        search=2,
        min_correlation=ALIKE / noise,
        min_contrast=min_contrast,
        states_uncertainty=False,
    )
    points, period = np.zeros(reference.grid.shape, np.bool_), math.inf
    for lag in (np.array(lag, np.float64) * sign for lag in lags for sign in (1, -1)):
        start = np.broadcast_to(lag[:, None, None], (2, *points.shape))
        method.start_from(start)
        found = method.measure(reference.image)
        alike = found.is_ok & (np.abs(found.u - start).max(axis=0) < np.abs(lag).max() / 2)
        alike &= cv2.medianBlur(alike.astype(np.uint8), 5) > 0  # chance meets single points
        if alike.sum() >= FEW * alike.size:
            points |= alike
            period = min(period, float(np.median(np.hypot(*found.u[:, alike]))))
    return Repetition(points, period) if points.any() else None


def _repeats(image: Array, least: float) -> list[tuple[int, int]]:
    """The lags (x, y), px, at which tiles of the image repeat themselves: of each tile the shortest
    at which its correlation has a peak that stands out by `least` from the way there.
    """
    side = min(TILE, *image.shape) // 2 * 2
    reach = side // 4
    rows, columns = (
        np.unique(np.linspace(0, size - side, -(-size // side)).astype(int)) for size in image.shape
    )
    tiles = sliding_window_view(image, (side, side))[np.ix_(rows, columns)].astype(np.float32)
    window = np.sqrt(np.multiply.outer(*2 * [np.hanning(side + 2)[1:-1]])).astype(np.float32)
    tiles -= tiles.mean(axis=(2, 3), keepdims=True)
    tiles *= window
    across = np.arange(-reach, reach + 1)

    def correlation(pictures: F32) -> F32:
        spectrum = rfft2(pictures)
        power = spectrum.real**2 + spectrum.imag**2
        near = irfft(ifft(power, axis=-2)[..., : reach + 1, :])[..., across]
        return np.asarray(near / np.maximum(near[..., :1, reach, None], 1e-9))

    near = correlation(tiles.reshape(-1, side, side)) / correlation(window)
    is_peak = (near > least) & (near == maximum_filter(near, (1, 3, 3)))
    is_peak[:, :2, reach - 1 : reach + 2] = is_peak[:, -1] = False
    is_peak[:, :, 0] = is_peak[:, :, -1] = False
    n, y, x = np.nonzero(is_peak)
    way = np.linspace(0, 1, 33)[:, None]
    lowest = near[n, np.rint(way * y).astype(int), np.rint(way * (x - reach)).astype(int) + reach]
    height = near[n, y, x]
    stands_out = height - lowest.min(axis=0) > least
    found: set[tuple[int, int]] = set()
    for tile in np.unique(n[stands_out]):
        here = np.flatnonzero(stands_out & (n == tile))
        here = here[height[here] > COMPARABLE * height[here].max()]
        shortest = here[np.argmin(np.hypot(x[here] - reach, y[here]))]
        found.add((int(x[shortest]) - reach, int(y[shortest])))
    return sorted(found, key=lambda lag: math.hypot(*lag))[:MOST_LAGS]
