"""Noise and gain of a camera from pairs of pictures: the variance of grey levels against their
mean (photon-transfer curve), and the exposure that uses the camera best.

References
----------
EMVA Standard 1288, release 4.0 Linear (2021), sections 2 and 6; Janesick 2007, Photon Transfer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, Array, Bool, floats, grey_pictures, in_step
from analysis.robust import robust_sd

AROUND = 5  # px, side of the square around a pixel whose mean says how bright it is there
FEWEST_PIXELS = 500  # of a bin
MOST_BINS = 40  # of a pair
CLIPPED = 1e-4  # share of pixels at an end of the scale, from which a variance is not believed
LARGEST_MOTION_PX = 0.1
LARGEST_FLICKER = 0.05
FEWEST_BINS = 5
LEAST_RANGE = 2.0  # the brightest over the darkest level above the dark
ROUNDING = 1 / 12  # variance of what rounding to whole grey levels adds
BENT, SURE = 0.15, 5.0  # relative curvature, and its standard uncertainties, of no shot noise
FULL = 0.5  # of the variance expected, below which the pixels are full
DIM = 6.0  # times the noise that the brightest pixels are above the dark, at least
HUBER, SWEEPS = 3.0, 12
LINEAR = 0.02, 0.95  # of the scale, between which the response is to be linear


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """How much grey levels vary from one picture to the next, by how bright they are.

    Attributes
    ----------
    level, variance : ndarray, shape (n,)
        Mean grey level and variance, grey levels and their squares, of the pixels of a bin.
    count : ndarray, shape (n,)
        Its pixels.
    """

    level: F64
    variance: F64
    count: F64


def noise_levels(first: Array, second: Array, top: float) -> NoiseLevels:
    """The temporal noise of a pair of pictures of the same scene, flat or not, at rest.

    Parameters
    ----------
    first, second : ndarray, shape (rows, columns)
        Grey levels under the same light.
    top : float
        The highest grey level.

    Raises
    ------
    ValueError
        The pictures differ in shape, in light, or by a motion.

    Notes
    -----
    A pixel is sorted by the mean of those around it, which knows nothing of its own noise, so that
    pixels are not called bright because of it. A small motion, and a change of the light, are taken
    off the differences.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.photon_transfer as photon_transfer
    >>> rng = np.random.default_rng(0)
    >>> pair = rng.normal(100.0, 2.0, (2, 200, 200))
    >>> found = photon_transfer.noise_levels(*pair, top=255)
    >>> round(float(np.average(found.variance, weights=found.count)), 1)
    4.0
    """
    a, b = (v.astype(np.float32) for v in grey_pictures("camera noise", (first, second)))
    mean, change = (a + b) / 2, b - a
    light = float(mean.mean())
    if abs(float(change.mean())) > LARGEST_FLICKER * max(light, 1.0):
        raise ValueError(
            f"camera noise: the light of a pair changed by {100 * float(change.mean()) / light:.2g}"
            f" %, {100 * LARGEST_FLICKER:g} % is allowed; take both pictures in the same light"
        )
    clipped = (np.minimum(a, b) <= 0) | (np.maximum(a, b) >= top)
    change -= _alike(mean, change, clipped)
    side = (AROUND, AROUND)
    around = (cv2.blur(mean, side) * AROUND**2 - mean) / (AROUND**2 - 1)
    half = AROUND // 2
    inner = (slice(half, -half), slice(half, -half))
    order = np.argsort(around[inner], axis=None)
    grey, off, cut_off = (one[inner].ravel() for one in (mean, change, clipped))
    n = int(np.clip(len(order) // FEWEST_PIXELS, 1, MOST_BINS))
    bins = [
        (
            grey[pixels].mean(dtype=np.float64),
            off[pixels].astype(np.float64).var(ddof=1) / 2,
            len(pixels),
        )
        for pixels in np.array_split(order, n)
        if cut_off[pixels].mean() <= CLIPPED
    ]
    return NoiseLevels(*np.array(bins, np.float64).reshape(-1, 3).T)


def _alike(mean: Array, change: Array, clipped: Bool) -> Array:
    """What a change of the light and a small motion make of the difference of a pair."""
    slopes = [cv2.Sobel(mean, cv2.CV_32F, *d, ksize=1, scale=0.5) for d in ((1, 0), (0, 1))]
    causes = np.stack([*slopes, mean - mean.mean(), np.ones_like(mean)])
    usable, off = causes[:, ~clipped].astype(np.float64), change[~clipped].astype(np.float64)
    if len(off) < FEWEST_PIXELS:
        return np.zeros_like(change)
    matrix = usable @ usable.T
    matrix += 1e-9 * np.trace(matrix) * np.eye(4)  # of an even picture no motion is seen
    value = np.linalg.solve(matrix, usable @ off)
    sd = np.sqrt(np.linalg.inv(matrix).diagonal() * off.var())
    if (way := float(np.hypot(*value[:2]))) > max(LARGEST_MOTION_PX, SURE * float(sd[:2].max())):
        raise ValueError(
            f"camera noise: the picture moved by {way:.2g} px between the two of a pair,"
            f" {LARGEST_MOTION_PX:g} px are allowed; hold the block still"
        )
    return np.tensordot(value.astype(np.float32), causes, 1)


@dataclass(frozen=True, slots=True)
class PhotonTransfer:
    """Noise and gain of a camera.

    Attributes
    ----------
    gain, gain_sd : float
        Grey levels per electron.
    read_noise, read_noise_sd : float
        Grey levels, without that of rounding.
    dark : float
        Grey level without light.
    full_well, full_well_sd : float
        Electrons of the brightest grey level.
    nonlinearity : float
        Largest relative deviation of the mean grey level from being proportional to the exposure;
        NaN where no exposures were given.
    level, variance, residual : ndarray, shape (n,)
        The bins that were used, in grey levels and their squares, and what is left of the variance
        over its standard uncertainty.
    """

    gain: float
    gain_sd: float
    read_noise: float
    read_noise_sd: float
    dark: float
    full_well: float
    full_well_sd: float
    nonlinearity: float
    level: F64
    variance: F64
    residual: F64

    def noise(self, level: ArrayLike) -> F64:
        """Standard deviation of grey levels, rounding included."""
        above = np.maximum(floats(level) - self.dark, 0)
        return np.asarray(np.sqrt(self.gain * above + self.read_noise**2 + ROUNDING))

    @property
    def largest_snr(self) -> float:
        """Signal over noise of the brightest grey level, dimensionless."""
        top = self.dark + self.full_well * self.gain
        return float((top - self.dark) / self.noise(top))


def photon_transfer(
    levels: NoiseLevels,
    top: float,
    *,
    dark: float = 0.0,
    mean_level: ArrayLike = (),
    exposure_s: ArrayLike = (),
) -> PhotonTransfer:
    """Gain, read noise and full well from the noise of pictures of several brightnesses.

    Parameters
    ----------
    levels : NoiseLevels
        Of all pairs together.
    top : float
        The highest grey level.
    dark : float
        Mean grey level without light.
    mean_level, exposure_s : array_like, shape (m,)
        Mean grey level of pictures of one scene without saturated pixels, and their exposure times,
        seconds, for the linearity.

    Raises
    ------
    ValueError
        Too few levels, or too close; noise that does not grow with the light, or not in proportion
        to it.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.photon_transfer as photon_transfer
    >>> level = np.linspace(10.0, 200, 20)
    >>> bins = photon_transfer.NoiseLevels(level, 0.0125 * level + 1 + 1 / 12, 0 * level + 1e4)
    >>> found = photon_transfer.photon_transfer(bins, 255)
    >>> round(found.gain, 4), round(found.read_noise, 3), round(found.full_well)
    (0.0125, 1.0, 20400)
    """
    order = np.argsort(levels.level)
    level, variance, count = (v[order] for v in (levels.level, levels.variance, levels.count))
    for _ in range(2):  # the second time without levels at which the pixels are full
        if len(level) < FEWEST_BINS:
            raise ValueError(
                f"camera noise: {len(level)} grey levels are not saturated, {FEWEST_BINS} are"
                " needed; take darker pictures, and a black level above 0"
            )
        above = level - dark
        if above[-1] < LEAST_RANGE * max(float(above[0]), 1e-9):
            raise ValueError(
                f"camera noise: the grey levels are {level[0]:.3g} to {level[-1]:.3g}, the"
                f" brightest must be {LEAST_RANGE:g} times the darkest above {dark:.3g}; take more"
                " exposures"
            )
        (gain, floor), covariance, left = _line(above, variance, count, degree=1)
        is_full = (variance < FULL * (gain * above + floor)) & (level > np.median(level))
        if not is_full.any():
            break
        top = float(level[is_full][0])
        keep = level < top
        level, variance, count = level[keep], variance[keep], count[keep]
    gain_sd = math.sqrt(covariance[0, 0])
    if gain <= SURE * gain_sd:
        raise ValueError(
            f"camera noise: it grows by {gain:.2g} +- {gain_sd:.2g} grey levels^2 per grey level,"
            " which is no shot noise; switch off what smooths the pictures (denoising, JPEG)"
        )
    bend, bend_covariance, _ = _line(above, variance, count, degree=2)
    curved, curved_sd = bend[0] * above[-1], math.sqrt(bend_covariance[0, 0]) * above[-1]
    if abs(curved) > max(BENT * gain, SURE * curved_sd):
        raise ValueError(
            f"camera noise: its variance is no straight line (its slope changes by"
            f" {100 * abs(curved) / gain:.0f} %); switch off gamma and automatic gain, and hold the"
            " block still"
        )
    read = floor - ROUNDING
    read_noise = math.sqrt(max(read, 0.0))
    of_read = math.sqrt(covariance[1, 1])
    full_well = (top - dark) / gain
    return PhotonTransfer(
        gain=float(gain),
        gain_sd=gain_sd,
        read_noise=read_noise,
        read_noise_sd=of_read / (2 * read_noise) if read > of_read else math.sqrt(of_read),
        dark=dark,
        full_well=full_well,
        full_well_sd=full_well * gain_sd / gain,
        nonlinearity=_nonlinearity(mean_level, exposure_s, dark, top),
        level=level,
        variance=variance,
        residual=left,
    )


def _line(above: F64, variance: F64, count: F64, degree: int) -> tuple[F64, F64, F64]:
    """Coefficients of a polynomial, highest first, their covariance, and what is left over its
    standard uncertainty; bins that stand out count less.
    """
    design = np.vander(above, degree + 1)
    expected, weight = np.maximum(variance, 1e-9), np.ones(len(above))
    for _ in range(SWEEPS):
        sd = expected * np.sqrt(2 / np.maximum(count - 1, 1))
        scaled = design * (np.sqrt(weight) / sd)[:, None]
        value = np.linalg.lstsq(scaled, variance * np.sqrt(weight) / sd)[0]
        left = (variance - design @ value) / sd
        spread = max(robust_sd(left), 1.0)
        weight = 1 / np.maximum(np.abs(left) / (HUBER * spread), 1.0)
        expected = np.maximum(design @ value, 1e-3 * float(variance.max()) + 1e-9)
    more = max(1.0, float((weight * left**2).sum()) / max(len(above) - degree - 1, 1))
    return np.asarray(value), np.asarray(more * np.linalg.inv(scaled.T @ scaled)), left


def _nonlinearity(mean_level: ArrayLike, exposure_s: ArrayLike, dark: float, top: float) -> float:
    """Largest relative deviation from a line, as EMVA 1288 has it, NaN for fewer than three."""
    pair = in_step("linearity", mean_level=mean_level, exposure_s=exposure_s)
    level, exposure = map(np.ravel, pair)
    share = (level - dark) / (top - dark)
    within = (share > LINEAR[0]) & (share < LINEAR[1]) & np.isfinite(exposure)
    if within.sum() < 3:
        return math.nan
    above, exposure = (level - dark)[within], exposure[within]
    design = np.stack([exposure, np.ones_like(exposure)], axis=1) / above[:, None]
    value = np.linalg.lstsq(design, np.ones(len(above)))[0]
    return float(np.abs(design @ value - 1).max())


@dataclass(frozen=True, slots=True)
class Exposure:
    """An exposure and what the picture would be.

    Attributes
    ----------
    exposure_s : float
        Seconds.
    mean_level, contrast, noise : float
        Grey levels: mean, standard deviation over the picture, and of the noise at the mean.
    saturated : float
        Share of the pixels that are saturated.
    """

    exposure_s: float
    mean_level: float
    contrast: float
    noise: float
    saturated: float


def best_exposure(
    image: Array,
    exposure_s: float,
    camera: PhotonTransfer,
    top: float,
    *,
    most_saturated: float = 1e-3,
    longest_s: float = math.inf,
) -> Exposure:
    """The longest exposure that saturates few pixels: contrast grows in proportion to the light,
    noise with its root at most, so that the longest is the best.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey levels of the scene, the brightest that is to be seen.
    exposure_s : float
        Its exposure, seconds.
    camera : PhotonTransfer
    top : float
        The highest grey level.
    most_saturated : float
        Share of pixels that may be.
    longest_s : float
        Longest exposure allowed, for the motion within it, seconds.

    Raises
    ------
    ValueError
        The picture is saturated, or dark.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.photon_transfer as photon_transfer
    >>> level = np.linspace(10.0, 200, 20)
    >>> bins = photon_transfer.NoiseLevels(level, 0.0125 * level + 1, 0 * level + 1e4)
    >>> camera = photon_transfer.photon_transfer(bins, 255)
    >>> image = np.linspace(20.0, 100, 10000).reshape(100, 100)
    >>> round(photon_transfer.best_exposure(image, 0.01, camera, 255).exposure_s, 4)
    0.0255
    """
    (image,) = grey_pictures("exposure", [image])
    saturated = float((image >= top).mean())
    if saturated > most_saturated:
        raise ValueError(
            f"exposure: {100 * saturated:.2g} % of the pixels are saturated,"
            f" {100 * most_saturated:.2g} % are allowed; take a picture of a shorter exposure"
        )
    above = floats(image) - camera.dark
    bright = float(np.quantile(above, 1 - most_saturated))
    if bright < DIM * float(camera.noise(camera.dark)):
        raise ValueError(
            f"exposure: the brightest grey level is {bright:.2g} above the dark, as large as the"
            " noise; take a picture of a longer exposure"
        )
    longer = min((top - camera.dark) / bright, longest_s / exposure_s)
    mean = camera.dark + float(above.mean()) * longer
    return Exposure(
        exposure_s=exposure_s * longer,
        mean_level=mean,
        contrast=float(above.std()) * longer,
        noise=float(camera.noise(mean)),
        saturated=float((above * longer >= top - camera.dark).mean()),
    )
