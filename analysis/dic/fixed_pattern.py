"""A pattern that stays in the picture while the block moves, of unequal pixels or fine dirt: how
strong it is, and by how much it pulls displacements towards zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft

from analysis.arrays import F32, F64, Array, Bool, floats
from analysis.contact.registration import shifted
from analysis.dic.correlation import open_tracker
from analysis.dic.status import Status
from analysis.grid import Grid
from analysis.robust import robust_sd
from analysis.settings import Correlation

REACH = 4  # lags up to which the pattern is like itself, px
FAR = REACH + 4, 16  # lags at which chance is measured
CLEAR_PX = 2.5  # least motion of the block that tells it from the pattern
LEAST_PIXELS = 20000
CERTAIN = 5.0  # standard uncertainties from which there is a pattern
CUT = 5.0  # standard deviations at which a difference is cut: dust in few boxes is not a pattern
WAYS_PX = (0.15, 0.3, 0.5, 0.75, 1.0, 1.35, 1.75, 2.25, 3.0, 4.0, 5.5)
CALIBRATED = 0.15  # relative uncertainty of a pull by the likeness of the pattern drawn for it
SEED = 20130


@dataclass(frozen=True, slots=True)
class FixedPattern:
    """What two pictures of a block that has moved have in common at the same place.

    Attributes
    ----------
    share, share_sd : float
        Standard deviation of the pattern over the mean grey level, and its standard uncertainty.
    covariance : ndarray, shape (2 REACH + 1, 2 REACH + 1)
        Of the pattern with itself over the square of the mean grey level, from lag -REACH to REACH
        along y and x.
    """

    share: float
    share_sd: float
    covariance: F64

    @property
    def is_certain(self) -> bool:
        """Whether there is a pattern."""
        # its square, which is what is measured, is known half as well
        return self.share > 2 * CERTAIN * self.share_sd


def fixed_pattern(
    background: Array, difference: F32, usable: Bool, shift: tuple[float, float]
) -> FixedPattern | None:
    """The pattern that stays, None where the block has moved too little to tell it.

    Parameters
    ----------
    background : ndarray, shape (rows, columns)
        Grey levels of the free block.
    difference : ndarray, shape (rows, columns)
        A picture less the background moved by `shift`, in which the texture of the block is gone:
        what stays in the picture is there once as it is, and once moved with the other sign.
    usable : ndarray of bool, shape (rows, columns)
        Pixels outside the contact.
    shift : (float, float)
        That the block has moved, px along x and y.

    Notes
    -----
    The mean product of the difference and the background, at a lag, is the covariance of the
    pattern with itself; noise is not in it, as it is another one in either picture but at the lag
    of the shift.
    """
    n = int(np.count_nonzero(usable))
    if float(np.hypot(*shift)) < CLEAR_PX or n < LEAST_PIXELS:
        return None
    level = float(np.asarray(background)[usable].mean())
    own = np.where(usable, _flattened(difference), np.float32(0))
    cut = CUT * robust_sd(own[usable])
    own = np.clip(own, -cut, cut)
    other = _flattened(background)
    reach = FAR[1]
    padded = [fft.next_fast_len(side + reach, real=True) for side in own.shape]
    product = np.conj(fft.rfft2(own, padded)) * fft.rfft2(other, padded)
    mean = fft.irfft2(product, padded)
    lag = np.arange(-reach, reach + 1)
    found = floats(mean[np.ix_(lag, lag)]) / n
    y, x = np.meshgrid(lag, lag, indexing="ij")
    # at minus the shift the noise of the background meets itself, and the pattern its copy
    chance = found[(np.hypot(x, y) >= FAR[0]) & (np.hypot(x + shift[0], y + shift[1]) >= FAR[0])]
    sd = float(np.sqrt(np.mean(chance**2)))
    near = slice(reach - REACH, reach + REACH + 1)
    covariance = found[near, near] / level**2
    strength, strength_sd = float(found[reach, reach]) / level**2, sd / level**2
    share = float(np.sqrt(max(strength, 0.0)))
    share_sd = strength_sd / (2 * share) if share > 0 else np.inf
    copy = np.hypot(x, y)[near, near] >= np.hypot(*shift) / 2
    covariance[(covariance < 3 * strength_sd) | copy] = 0.0
    return FixedPattern(share, share_sd, covariance)


@dataclass(frozen=True, slots=True)
class Pull:
    """By how much displacements of those lengths are too short: `found_px`, increasing, and
    `missing_px`; `relative_sd` is the standard uncertainty of the latter over itself.
    """

    found_px: F64
    missing_px: F64
    relative_sd: float

    @property
    def largest_px(self) -> float:
        """Of what is missing."""
        return float(np.abs(self.missing_px).max())

    def missing(self, length_px: Array | float) -> F64:
        """What is missing of displacements of those lengths, px."""
        return np.asarray(np.interp(np.abs(length_px), self.found_px, self.missing_px))

    def corrected(self, ux_px: Array, uy_px: Array) -> tuple[F64, F64]:
        """Displacements without the pull."""
        length = np.hypot(ux_px, uy_px)
        factor = 1 + self.missing(length) / np.maximum(length, 1e-6)
        return ux_px * factor, uy_px * factor


def pull_of(
    pattern: FixedPattern, settings: Correlation, reference: Array, difference: F32 | None = None
) -> Pull:
    """How a pattern pulls the displacements that are measured with these settings: the reference,
    moved by known ways, is correlated under a pattern drawn like it.

    With the `difference` of `fixed_pattern` the reference is taken without half of its own noise
    and pattern, which would move with it.
    """
    grey = np.asarray(reference, dtype=np.float32)
    if difference is not None:
        small = np.abs(difference) < CUT * robust_sd(difference[difference != 0])
        grey = grey - np.where(small, difference / 2, np.float32(0))
    gain, top = 1 + _drawn(pattern, grey.shape), float(grey.max())

    def seen(picture: F32) -> Array:
        # not brighter than the brightest pixel, which may be the end of the scale
        return np.asarray(np.clip(np.rint(picture * gain), 0, top).astype(reference.dtype))

    tracker = open_tracker(settings, seen(grey))
    found, grid = [0.0], Grid.cover(grey.shape, settings.box, settings.step)
    tracker.start_from(np.zeros(grid.shape), np.zeros(grid.shape))
    try:
        for way in WAYS_PX:
            field = tracker.track(seen(shifted(grey, way, 0.0)))
            good = field.status == Status.OK
            found.append(float(np.median(field.ux_px[good])) if good.any() else way)
    finally:
        tracker.close()
    way_px = np.array([0.0, *WAYS_PX])
    found_px = np.maximum.accumulate(np.array(found))
    missing = way_px - found_px
    missing[-1] = 0.0  # of a way that is long the pattern hides a random part, and none in the mean
    relative = float(np.hypot(2 * pattern.share_sd / pattern.share, CALIBRATED))
    keep = np.concatenate([[True], np.diff(found_px) > 0])
    return Pull(found_px[keep], missing[keep], relative)


def _drawn(pattern: FixedPattern, shape: tuple[int, ...]) -> F32:
    """A random pattern like it, the same for the same shape."""
    whole, lag = np.zeros(shape), np.arange(-REACH, REACH + 1)
    whole[np.ix_(lag, lag)] = pattern.covariance
    power = np.clip(fft.rfft2(whole).real, 0, None)
    white = np.random.default_rng(SEED).standard_normal(shape)
    return np.asarray(fft.irfft2(fft.rfft2(white) * np.sqrt(power), shape), dtype=np.float32)


def _flattened(image: Array) -> F32:
    """The image without the slow changes of its light: its local mean removed."""
    grey = np.asarray(image, dtype=np.float32)
    return np.asarray(grey - cv2.blur(grey, (31, 31)))
