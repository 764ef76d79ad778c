"""A map of the pixels: the dark level (grey levels) and relative gain of each, which the camera and
the glass add to every picture. It comes from dark pictures, a flat field, or pictures of a block
that is moved.

References
----------
EMVA Standard 1288, release 4.0 Linear (2021), section 8 (dark signal and photo response
nonuniformity); Kuhn, Lin, Loranz, Publ. Astron. Soc. Pacific 103 (1991) 1097 (gain from displaced
pictures of an unknown scene).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from analysis.arrays import F32, F64, I64, Array, Bool, floats, grey_pictures
from analysis.contact.marks import COARSE_PX, LIGHT_PX, SEEN
from analysis.contact.registration import shifted
from analysis.robust import robust_sd

FEWEST = 8  # pictures
FEWEST_MOVED = 12
LEAST_SPAN_PX = 15.0  # of the ways of the block
EDGE_PX = 6  # where a moved picture is made of what is outside of it
ROUNDS = 5
SWEEPS, TOLD_FROM, CUT_FROM = 8, 1, 5  # repeats; from which marks are told, noise is cut
ROUNDS_LEFT = SWEEPS - CUT_FROM + 1  # from even gains to those found, away from marks
CUT = 4.0  # standard deviations of the noise
OUTLIER = 6.0  # standard deviations of the dark levels from which a pixel is hot
SURE = 5.0
LEAK, AROUND = 4.0, 5  # grey levels of light in the dark, and px of a pixel's neighbours
LARGEST_LIGHT = 0.05  # change of the light from one picture to another
LARGEST_LEFT = 0.3  # of the contrast of the texture, that may be left of the pictures
LEAST_SHARE = 0.25  # of the pictures, in which a pixel must have seen the block's frame
NEARLY_ALL = 0.9  # of the pictures
# of the power of the noise of a map: its relative standard uncertainty (benchmarks calibrations
# --only whole --whole 40)
NOISE_KNOWN = 0.1
SATURATED = 0.001  # share of the pixels of a flat field
LIKELY = 0.05  # gains, by which those are held that no motion tells, but in the last round
SEEN_BY = 2.0  # pictures, by which the texture at a place is told
NEAR_PX = 7  # of a mark, where the texture of the block is not told
HARD = 0.05  # share of the power of a wave by which it looks the same in all pictures
MOST_MARKED = 0.3  # of the picture
THIN = 8  # px, from one of those that tell the slow light to the next
GAINS = 0.2, 5.0  # relative ones beyond which a pixel tells nothing
UNEVEN = 0.002  # curvature of a flat field over its mean, px^-2


@dataclass(frozen=True, eq=False)
class PixelMap:
    """Dark level and relative gain of each pixel: a picture is ``dark + gain * light``.

    Attributes
    ----------
    dark : ndarray, shape (rows, columns)
        Grey level without light.
    gain : ndarray, shape (rows, columns)
        Relative to the mean of the pixels; NaN: the pixel shows nothing.
    is_bad : ndarray of bool, shape (rows, columns)
        Pixels that are hot, dead, or at a mark (dust) that takes or adds 5 % of the light.
    sd : float
        Standard uncertainty of one pixel of ``gain``.
    is_told : ndarray of bool, shape (rows, columns), or None
        Pixels that nearly all pictures tell: those at the border know less; None: all.
    share : float
        Of the power of unequal pixels, that ``gain`` has beyond ``sd``: a motion hides waves.
    """

    dark: F32
    gain: F32
    is_bad: Bool
    sd: float = math.nan
    is_told: Bool | None = None
    share: float = 1.0

    def unequal(self) -> tuple[float, float]:
        """Standard deviation of the gains of usable pixels, beside the noise of the map, and its
        standard uncertainty.
        """
        from scipy.stats import truncnorm  # here, for it takes long to load

        usable = ~self.is_bad if self.is_told is None else self.is_told & ~self.is_bad
        gain = self.gain[usable].astype(np.float64)
        cut_off = power = float(gain.var())
        for _ in range(ROUNDS):  # of what pixels that stand out, as bad ones, take from it
            at = max(SEEN, SURE * self.sd) / math.sqrt(max(power, 1e-12))
            at = max(at, 1e-3)  # less would round to no power
            power = cut_off / float(truncnorm.var(-at, at))
        spread = math.sqrt(max(power - self.sd**2, 0.0) / self.share)
        least = max(spread, self.sd) * self.share
        by_chance = power / math.sqrt(2 * max(gain.size, 1)) / least
        by_noise = NOISE_KNOWN / 2 * self.sd**2 / least
        return spread, math.hypot(by_chance, by_noise)

    def corrected(self, image: Array) -> Array:
        """A picture, shape (rows, columns), flat-fielded, as equal pixels would show it; of the
        same type.

        A pixel that shows nothing is given the value of the nearest that does.

        Raises
        ------
        ValueError
            The picture has another shape.
        """
        if image.shape != self.gain.shape:
            raise ValueError(
                f"pixel map: a picture of shape {image.shape} was given to a map of shape"
                f" {self.gain.shape}; measure the map with the same size and place on the sensor"
            )
        factor, summand, blind, beside = self._linear
        is_counted = image.dtype in (np.uint8, np.uint16)
        held = image if is_counted else image.astype(np.float32)
        grey = cv2.multiply(held, factor, dtype=cv2.CV_32F)
        depth = {1: cv2.CV_8U, 2: cv2.CV_16U}[image.itemsize] if is_counted else cv2.CV_32F
        even = cv2.add(grey, summand, dtype=depth)  # rounded, and cut off at the ends of the type
        if is_counted:
            brightest = np.iinfo(image.dtype).max
            np.copyto(even, brightest, where=image == brightest)  # saturated, which must be seen
        even.reshape(-1)[blind] = even.reshape(-1)[beside]
        return np.asarray(even.astype(image.dtype, copy=False))

    @cached_property
    def _linear(self) -> tuple[F32, F32, I64, I64]:
        """Factor and summand of each pixel, places of those that show nothing, and places of their
        nearest that do.
        """
        is_blind = np.isnan(self.gain)
        factor = np.where(is_blind, 1, 1 / self.gain).astype(np.float32)
        summand = np.where(is_blind, 0, self.dark.mean() - self.dark * factor).astype(np.float32)
        nearest = distance_transform_edt(is_blind, return_distances=False, return_indices=True)
        beside = np.ravel_multi_index(tuple(nearest), is_blind.shape)[is_blind]
        return factor, summand, np.flatnonzero(is_blind), beside


def dark_levels(pictures: Sequence[Array]) -> tuple[F32, Bool, float]:
    """Grey level of each pixel without light, and which pixels are hot, shape (rows, columns); the
    standard uncertainty of the level of one pixel, grey levels.

    Parameters
    ----------
    pictures : sequence of ndarray, shape (rows, columns)
        Grey levels without light, at the exposure of the measurements.

    Raises
    ------
    ValueError
        Too few pictures, or light in them.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.pixel_map as pixel_map
    >>> rng = np.random.default_rng(0)
    >>> level, is_hot, sd = pixel_map.dark_levels([rng.normal(8, 1, (50, 60)) for _ in range(16)])
    >>> round(float(level.mean()), 1), int(is_hot.sum()), round(sd, 2)
    (8.0, 0, 0.25)
    """
    pictures = grey_pictures("dark pictures", pictures)
    mean, noise = _mean_and_noise(pictures, "dark pictures")
    off = mean - np.median(mean)
    fine = robust_sd(mean - cv2.blur(mean, (AROUND, AROUND)))
    sd = noise / math.sqrt(len(pictures))
    usual = max(fine, sd, 1e-6)
    slow = cv2.blur(np.clip(off, -LEAK, LEAK), (LIGHT_PX, LIGHT_PX))
    if np.ptp(slow) > max(LEAK / 2, usual):
        raise ValueError(
            f"dark pictures: they are brighter by {np.ptp(slow):.2g} grey levels in one place than"
            " in another; cover the lens"
        )
    return mean, np.abs(off) > OUTLIER * usual, sd


def map_of_flat(
    pictures: Sequence[Array],
    dark: F32 | float = 0.0,
    is_hot: Bool | None = None,
    top: float = math.inf,
    dark_sd: float = 0.0,
) -> PixelMap:
    """The map by pictures of an even light; its slow changes over the picture are left out.

    Parameters
    ----------
    pictures : sequence of ndarray, shape (rows, columns)
        Grey levels, half of the scale or more and not saturated.
    dark : ndarray, shape (rows, columns), or float
        Grey level without light.
    is_hot : ndarray of bool, shape (rows, columns), optional
        Pixels that `dark_levels` found hot.
    top : float
        The highest grey level.
    dark_sd : float
        Standard uncertainty of `dark` in one pixel, grey levels.

    Raises
    ------
    ValueError
        Too few pictures, saturated or unsteady ones, or a light that is not even.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.pixel_map as pixel_map
    >>> rng = np.random.default_rng(0)
    >>> gain = 1 + 0.02 * rng.standard_normal((100, 120))
    >>> found = pixel_map.map_of_flat([120 * gain + rng.normal(0, 1, gain.shape)] * 10)
    >>> bool(np.std(found.gain / gain) < 0.01)
    True
    """
    pictures = grey_pictures("flat field", pictures)
    if (share := max((float((one >= top).mean()) for one in pictures), default=0)) > SATURATED:
        raise ValueError(
            f"flat field: {100 * share:.2g} % of the pixels are saturated, {100 * SATURATED:g} %"
            " are allowed; use a shorter exposure"
        )
    mean, noise = _mean_and_noise(pictures, "flat field")
    light = np.asarray(mean - dark, dtype=np.float32)
    if np.median(np.abs(cv2.Laplacian(cv2.GaussianBlur(light, (0, 0), 2), cv2.CV_32F))) > (
        UNEVEN * float(light.mean())
    ):
        raise ValueError("flat field: a texture is seen in it; show an even light, out of focus")
    # by boxes alone, the slope of the light at the border would be unequal pixels
    gain = light / np.maximum(light.mean() * _even_light([light], 0.0), 1e-6)
    sd = math.hypot(noise / math.sqrt(len(pictures)), dark_sd) / np.maximum(light, 1e-6)
    return _map(dark, is_hot, gain, sd)


def map_of_motion(
    pictures: Sequence[Array],
    shift_px: ArrayLike,
    dark: F32 | float = 0.0,
    is_hot: Bool | None = None,
    dark_sd: float = 0.0,
) -> PixelMap:
    """The map by pictures of a free block that was moved: what stays while the block moves.

    Parameters
    ----------
    pictures : sequence of ndarray, shape (rows, columns)
        Grey levels; the noise of the map falls with the root of their number.
    shift_px : array_like, shape (n, 2)
        Places of the block, (x, y), of no equal distances.
    dark : ndarray, shape (rows, columns), or float
        Grey level without light.
    is_hot : ndarray of bool, shape (rows, columns), optional
        Pixels that `dark_levels` found hot.
    dark_sd : float
        Standard uncertainty of `dark` in one pixel, grey levels.

    Raises
    ------
    ValueError
        Too few pictures, too short ways, unsteady light, or a scene that is not one that moves.

    Notes
    -----
    A picture is the gain of the pixels times the texture of the block, moved: both are found by
    turns, each as the least squares of all pictures given the other. Parts of the gain that are
    even along the motion, over longer distances than the block moves, cannot be separated from the
    texture and stay in it; slow changes of the light are left out.

    Examples
    --------
    >>> import numpy as np, scipy, analysis.calibration.pixel_map as pixel_map
    >>> rng = np.random.default_rng(0)
    >>> gain = 1 + 0.05 * rng.standard_normal((80, 200))
    >>> wide = 60 + 400 * scipy.ndimage.gaussian_filter(rng.uniform(-1, 1, (80, 300)), 1.5)
    >>> ways = [0, 1, 3, 7, 9, 12, 15, 21, 26, 33, 41, 50]
    >>> pictures = [gain * wide[:, 60 - way : 260 - way] for way in ways]
    >>> found = pixel_map.map_of_motion(pictures, [(way, 0) for way in ways])
    >>> middle = np.s_[10:-10, 40:-40]
    >>> round(float(np.std(found.gain[middle] - gain[middle])), 2)
    0.01
    """
    pictures, shift = grey_pictures("pixel map", pictures), floats(shift_px)
    if shift.shape != (len(pictures), 2) or not np.isfinite(shift).all():
        raise ValueError(
            f"pixel map: places of shape {shift.shape} for {len(pictures)} pictures; give a finite"
            " pair (x, y) for each"
        )
    shift = shift - (shift.max(axis=0) + shift.min(axis=0)) / 2
    span = float(np.hypot(*np.ptp(shift, axis=0)))
    if len(pictures) < FEWEST_MOVED or span < LEAST_SPAN_PX:
        raise ValueError(
            f"pixel map: {len(pictures)} pictures of a block that moved by {span:.3g} px were"
            f" given; {FEWEST_MOVED} and {LEAST_SPAN_PX:g} px are needed; add travels"
        )
    light = np.array([float(np.mean(one)) for one in pictures]) - float(np.mean(dark))
    light /= float(np.median(light))
    if np.ptp(light) > LARGEST_LIGHT:
        raise ValueError(
            f"pixel map: the light changed by {100 * np.ptp(light):.2g} % from one picture to"
            f" another, {100 * LARGEST_LIGHT:g} % is allowed; let the lamp warm up"
        )
    shape = pictures[0].shape
    seen = [_inside(shape, -one) for one in shift]  # of the pictures, that show the frame
    shown = [_inside(shape, one) for one in shift]  # of the frame, that the pictures show
    even = _even_light(pictures, dark)
    gain: Array = np.ones(shape, np.float32)
    beside = gain
    noise = math.inf
    for sweep in range(SWEEPS):
        total, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        if sweep >= TOLD_FROM:
            beside = np.minimum(beside, _beside_marks(gain))
        if TOLD_FROM <= sweep < CUT_FROM:  # what is beside marks was told with them in the texture
            gain = np.where(beside < 1, gain, np.float32(1))
        trusted = gain * beside
        for image, way, part, one in zip(pictures, shift, shown, light, strict=True):
            grey = (image.astype(np.float32) - dark) / (even * np.float32(one))
            total[part] += shifted(trusted * grey, *-way)[part]
            weight[part] += shifted(trusted * gain, *-way)[part]
        scene = total / np.maximum(weight, SEEN_BY)
        is_seen = cv2.erode((weight > SEEN_BY).astype(np.float32), np.ones((NEAR_PX, NEAR_PX)))
        scene[weight < SEEN_BY] = np.median(scene)
        total[:], weight[:] = 0, 0
        count, left = np.zeros(shape, np.float32), []
        for image, way, part, one in zip(pictures, shift, seen, light, strict=True):
            grey = ((image.astype(np.float32) - dark) / (even * np.float32(one)))[part]
            moved = shifted(scene, *way)[part] * (shifted(is_seen, *way)[part] > 0.99)
            expected = gain[part] * moved
            off = grey - expected
            left.append(robust_sd(off[::5, ::5][moved[::5, ::5] != 0]))
            if sweep >= CUT_FROM:
                off = np.clip(off, -CUT * noise, CUT * noise)
            total[part] += (expected + off) * moved
            weight[part] += moved * moved
            count[part] += moved != 0
        noise = float(np.median(left))
        known = count >= LEAST_SHARE * len(pictures)
        prior = (noise / LIKELY) ** 2 if 0 < sweep < SWEEPS - 1 else 0.0
        gain = np.where(known, (total + prior) / np.maximum(weight + prior, 1e-6), gain)
    contrast = robust_sd(scene - np.median(scene))
    if noise > LARGEST_LEFT * contrast:
        raise ValueError(
            f"pixel map: the pictures are no texture of contrast {contrast:.3g} that moves, what is"
            f" left of them is {noise:.2g} grey levels; the block must be free, and its ways right"
        )
    noise /= math.sqrt(1 - 2 / len(pictures))  # one of which tells the gain, and one the texture
    power = noise**2 + dark_sd**2 * count  # an error of the dark level is that of all pictures
    found = _map(dark, is_hot, gain, np.sqrt(power / np.maximum(weight, 1e-6)))
    told = count >= NEARLY_ALL * len(pictures)
    untold, share = _untold(found, told, shift)
    return replace(found, sd=math.hypot(found.sd, untold), is_told=told, share=share)


def _untold(found: PixelMap, is_told: Bool, shift: F64) -> tuple[float, float]:
    """Rms error of a gain by waves that are long along the ways, in which gain and texture are hard
    to tell apart; and the share of the power of unequal pixels that the gain has beyond it.

    Unequal pixels have the same power G in all waves. In one of which all pictures share the power
    s, each round leaves a part s of what is missing: a part a of the gain is found. Of the power
    that is found, a^2 G is right, and (1 - a)^2 G is missing: the error is what is found less
    (2 a - 1) G.
    """
    is_used = is_told & ~found.is_bad
    off = np.where(is_used, found.gain - 1, 0.0)
    power = np.abs(np.fft.fft2(off)) ** 2 / off.size / max(int(is_used.sum()), 1)
    ky, kx = (2j * np.pi * np.fft.fftfreq(size) for size in off.shape)
    common: Array = np.zeros(off.shape, np.complex64)
    for x, y in shift:
        common += np.multiply.outer(np.exp(y * ky), np.exp(x * kx)).astype(np.complex64)
    shared = np.abs(common / len(shift)) ** 2
    is_hard = shared > HARD
    usual = float(np.median(power[~is_hard])) / math.log(2)  # the mean of what scatters so
    left = 1 - 2 * np.where(is_hard, shared, 0.0) ** ROUNDS_LEFT
    more = power[is_hard] - usual * left[is_hard]
    return math.sqrt(max(float(more.sum()), 0.0)), float(left.mean())


def _inside(shape: tuple[int, ...], way: F64) -> tuple[slice, slice]:
    """Pixels of a frame that are in it still after they have moved by a way (x, y)."""
    ends = []
    for size, step in zip(shape, way[::-1], strict=True):
        first, last = EDGE_PX, size - EDGE_PX
        ends.append(slice(max(first, math.ceil(first - step)), min(last, math.floor(last - step))))
    return ends[0], ends[1]


def _mean_and_noise(pictures: Sequence[Array], what: str) -> tuple[F32, float]:
    """Mean of the pictures and their noise in one pixel, grey levels."""
    if len(pictures) < FEWEST:
        raise ValueError(f"{what}: {len(pictures)} were given, {FEWEST} or more are needed")
    mean = np.zeros(pictures[0].shape, np.float64)
    for one in pictures:
        mean += one
    levels = [float(np.mean(one)) for one in pictures]
    change = [float(np.std(np.subtract(*two, dtype=np.float32))) for two in pairwise(pictures)]
    if np.ptp(levels) > max(LARGEST_LIGHT * np.median(levels), 1.0):
        raise ValueError(
            f"{what}: their mean grey levels go from {min(levels):.4g} to {max(levels):.4g}; keep"
            " the light steady"
        )
    return (mean / len(pictures)).astype(np.float32), float(np.median(change)) / math.sqrt(2)


def _map(dark: F32 | float, is_hot: Bool | None, gain: Array, sd: Array) -> PixelMap:
    """The map without the slow changes of the light."""
    even = _flattened(gain)
    is_bad = np.abs(even - 1) > np.maximum(SEEN, SURE * sd)
    mark = cv2.morphologyEx(is_bad.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    is_bad |= cv2.dilate(mark, np.ones((NEAR_PX, NEAR_PX), np.uint8)) > 0
    if is_hot is not None:
        is_bad |= is_hot
    whole = np.asarray(np.broadcast_to(np.float32(dark), gain.shape))
    low, high = GAINS
    gain = np.where((even > low) & (even < high), even, np.float32(np.nan))
    return PixelMap(whole, gain, is_bad, float(np.median(sd)))


def _flattened(gain: Array) -> F32:
    """A gain without its slow changes."""
    usual, slow = np.ones(gain.shape, np.float32), np.ones(gain.shape, np.float32)
    side = (LIGHT_PX, LIGHT_PX)
    for _ in range(3):  # the next time without what stands out
        slow = cv2.blur(gain * usual, side) / np.maximum(cv2.blur(usual, side), 0.01)
        usual = (np.abs(gain / slow - 1) < SEEN).astype(np.float32)
    return np.asarray(gain / slow, dtype=np.float32)


def _even_light(pictures: Sequence[Array], dark: F32 | float) -> F32:
    """The slow changes of the light over the pictures, relative: a polynomial of their mean."""
    mean = np.zeros(pictures[0].shape, np.float32)
    for one in pictures:
        mean += one
    grey = cv2.blur(mean / len(pictures) - dark, (THIN, THIN))[::THIN, ::THIN].astype(np.float64)
    y, x = _across(grey.shape)
    found = np.polynomial.polynomial.polyvander2d(x.ravel(), y.ravel(), (2, 2))
    value = np.linalg.lstsq(found, grey.ravel())[0]
    y, x = _across(mean.shape)
    slow = np.polynomial.polynomial.polyval2d(x, y, value.reshape(3, 3))
    return np.asarray(slow / slow.mean(), dtype=np.float32)


def _across(shape: tuple[int, ...]) -> tuple[F64, F64]:
    """Places (y, x) of the pixels, from -1 to 1 over the picture."""
    y, x = (np.linspace(-1.0, 1.0, size) for size in shape)
    return np.broadcast_to(y[:, None], shape), np.broadcast_to(x, shape)


def _beside_marks(gain: F32) -> F32:
    """1 where no mark is near, 0 on marks, and smooth in between."""
    wide = cv2.GaussianBlur(_flattened(gain), (0, 0), COARSE_PX)
    is_mark = (np.abs(wide - 1) > SEEN).astype(np.uint8)
    near = cv2.dilate(is_mark, np.ones((NEAR_PX, NEAR_PX), np.uint8))
    if near.mean() > MOST_MARKED:
        return np.ones_like(gain)
    return np.asarray(cv2.GaussianBlur((1 - near).astype(np.float32), (0, 0), NEAR_PX / 4))
