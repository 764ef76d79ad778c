"""The rough interface as Gaussian blobs, and their exact images.

A blob keeps its place on the block (material coordinates, pixels). Its image is never interpolated:
the blob is moved to its exact place, deformed by the local gradient of the motion, and integrated
over each pixel in closed form.

The pattern is periodic and slightly larger than the image, so that the block may travel any
distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from analysis.arrays import F32, F64
from analysis.kernels import compiled

HALO_PX = 64
"""The period of the pattern exceeds the image by this much on every side, so that each blob appears
at most once.
"""

SPECKLE_PER_PX2 = 0.15
SPECKLE_DIAMETER_PX = (3.0, 5.0)
"""e^-2 diameters of the grains: four standard deviations."""
SPECKLE_MEAN, SPECKLE_RMS = 90.0, 25.0
"""Grey levels of the free block under even light."""

SPOTS_PER_PX2 = 0.004
SPOT_SIGMA_PX = (1.2, 1.6)
SPOT_GREY = (90.0, 130.0)
SPOT_RAMP = 0.05
"""A micro-contact reaches its full brightness when the relative pressure exceeds its threshold by
this much.
"""
ROUGH_RAMP = 0.3
"""The same on a rough face, as a share of the pressure."""

_REACH = 5.5  # standard deviations; the brightest grain is below 2e-5 grey levels there
_WIDTH = 24  # half pixels, of a grain; the brightest one is below 0.01 grey levels beyond
_POLE = math.sqrt(3) - 2  # of the filter that gives cubic B-spline coefficients (Unser 1999)
_PHI_END, _PHI_STEPS = 7.0, 4096  # integral of a Gaussian: up to that many standard deviations


@dataclass(frozen=True, slots=True)
class Blobs:
    """Gaussian blobs of the block: centres (x, y) and standard deviations in pixels, peaks in grey
    levels.
    """

    x: F64
    y: F64
    sigma: F64
    peak: F64


@dataclass(frozen=True, slots=True)
class MicroContacts:
    """Bright junctions that the block can form; each is lit while the relative Hertz pressure
    exceeds its threshold in (0, 1).
    """

    blobs: Blobs
    threshold: F64


def period(shape: tuple[int, int]) -> tuple[int, int]:
    """Period (rows, columns) of the pattern for images of `shape`."""
    return shape[0] + 2 * HALO_PX, shape[1] + 2 * HALO_PX


Range = tuple[float, float]


def _blobs(
    shape: tuple[int, int], per_px2: float, sigma: Range, peak: Range, rng: np.random.Generator
) -> Blobs:
    rows, columns = period(shape)
    n = round(per_px2 * rows * columns)
    return Blobs(
        x=rng.uniform(0, columns, n),
        y=rng.uniform(0, rows, n),
        sigma=rng.uniform(*sigma, n),
        peak=rng.uniform(*peak, n),
    )


def speckle(shape: tuple[int, int], seed: int) -> tuple[Blobs, float]:
    """Grains of the rough surface and the even grey level under them, the same for the same seed.

    Both follow from Campbell's theorem, so that the image has the mean `SPECKLE_MEAN` and the rms
    `SPECKLE_RMS` (before the pixels blur it slightly).
    """
    low, high = SPECKLE_DIAMETER_PX
    grains = _blobs(
        shape, SPECKLE_PER_PX2, (low / 4, high / 4), (0.4, 1.0), np.random.default_rng([seed, 101])
    )
    mass = 2 * math.pi * grains.sigma**2 * grains.peak
    mean = SPECKLE_PER_PX2 * mass.mean()
    rms = math.sqrt(SPECKLE_PER_PX2 * np.mean(mass * grains.peak) / 2)
    scale = SPECKLE_RMS / rms
    return Blobs(grains.x, grains.y, grains.sigma, scale * grains.peak), SPECKLE_MEAN - scale * mean


def micro_contacts(shape: tuple[int, int], seed: int) -> MicroContacts:
    """All junctions that the block can form, the same for the same seed; see `brightness` for which
    of them are lit.
    """
    rng = np.random.default_rng([seed, 102])
    spots = _blobs(shape, SPOTS_PER_PX2, SPOT_SIGMA_PX, SPOT_GREY, rng)
    return MicroContacts(spots, rng.uniform(0.0, 1.0, spots.x.size))


def brightness(distance: F64, radius: float, threshold: F64) -> F64:
    """Relative brightness of each micro-contact, 0 to 1, at a distance from the contact's centre
    (in the unit of `radius`).

    A junction is lit where sqrt(1 - (r/a)^2) > threshold: with thresholds uniform in (0, 1) the
    density of lit junctions follows the Hertz pressure and ends exactly at r = a. It brightens
    smoothly over `SPOT_RAMP`, so that no junction jumps into the image.

    References
    ----------
    Prevost et al. 2013, Fig. 2 and section 2.3.1 (micro-contacts, apparent radius).
    """
    if radius <= 0.0:
        return np.zeros_like(distance)
    pressure = np.sqrt(np.clip(1.0 - (distance / radius) ** 2, 0.0, None))
    return _smooth_step((pressure - threshold) / SPOT_RAMP)


def rough_brightness(pressure: F64, threshold: F64) -> F64:
    """The same on a rough face, under a pressure relative to its peak: heights with an exponential
    distribution look the same at every gap, so that the number of junctions of any brightness is
    proportional to the pressure.

    References
    ----------
    Greenwood, Tripp 1967; Bureau et al. 2003.
    """
    share = 1.0 - threshold / np.maximum(pressure, 1e-12)
    return _smooth_step(share / ROUGH_RAMP)


def _smooth_step(t: F64) -> F64:
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


@compiled
def _profiles(first, count, centre, sigma, is_upright, out):  # type: ignore[no-untyped-def]
    """Integrals over `count` pixels of a unit Gaussian's profile (row 0) and, unless it is upright,
    of its first three derivatives, up to common signs.
    """
    p0, f0, g0, h0 = 0.0, 0.0, 0.0, 0.0
    for i in range(count + 1):
        z = (first + i - 0.5 - centre) / sigma
        p1 = 0.5 * math.erf(z * math.sqrt(0.5))
        if is_upright:
            if i > 0:
                out[0, i - 1] = p1 - p0
            p0 = p1
            continue
        f1 = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
        g1 = z * f1
        h1 = (z * z - 1.0) * f1
        if i > 0:
            out[0, i - 1] = p1 - p0
            out[1, i - 1] = f1 - f0
            out[2, i - 1] = g1 - g0
            out[3, i - 1] = h1 - h0
        p0, f0, g0, h0 = p1, f1, g1, h1


@compiled
def _touched(centre, reach, count):  # type: ignore[no-untyped-def]
    """The first and the last of `count` pixels that a blob touches."""
    first, last = math.ceil(centre - reach - 0.5), math.floor(centre + reach + 0.5)
    return max(0, first), min(count - 1, last)


@compiled
def add_blobs(image, x, y, xx, xy, yy, peak):  # type: ignore[no-untyped-def]
    """Add Gaussian blobs to an image, each integrated over every pixel that it touches.

    Along the axes the integral is a product of error functions. The oblique part of the covariance
    enters as a series (Mehler's formula: d/d(xy) of a Gaussian is its d2/dxdy) up to the third
    power of the correlation rho = xy / sqrt(xx yy). For a blob of 100 grey levels the remainder is
    below 1e-4 grey levels if |rho| <= 0.05, which a gradient of 3 % does not exceed.

    Parameters
    ----------
    image : ndarray, shape (rows, columns), float32 or float64
        Added to in place; blobs outside are clipped.
    x, y : ndarray, shape (n,)
        Centres, pixels.
    xx, xy, yy : ndarray, shape (n,)
        Covariance of each blob, pixels squared.
    peak : ndarray, shape (n,)
        Grey level at the centre of each blob, before integration over pixels.
    """
    rows, columns = image.shape
    across = np.empty((4, 256))
    down = np.empty((4, 256))
    for k in range(x.size):
        sx, sy = math.sqrt(xx[k]), math.sqrt(yy[k])
        i0, i1 = _touched(x[k], _REACH * sx, columns)
        j0, j1 = _touched(y[k], _REACH * sy, rows)
        if i0 > i1 or j0 > j1 or peak[k] == 0.0:
            continue
        is_upright = xy[k] == 0.0  # as most are, of which the series is one term
        _profiles(i0, i1 - i0 + 1, x[k], sx, is_upright, across)
        _profiles(j0, j1 - j0 + 1, y[k], sy, is_upright, down)
        rho = xy[k] / (sx * sy)
        mass = peak[k] * 2 * math.pi * sx * sy * math.sqrt(1.0 - rho * rho)
        for j in range(j0, j1 + 1):
            b0 = mass * down[0, j - j0]
            if is_upright:
                for i in range(i1 - i0 + 1):
                    image[j, i0 + i] += b0 * across[0, i]
                continue
            b1 = mass * down[1, j - j0] * rho
            b2 = mass * down[2, j - j0] * rho * rho / 2
            b3 = mass * down[3, j - j0] * rho * rho * rho / 6
            for i in range(i1 - i0 + 1):
                image[j, i0 + i] += (
                    b0 * across[0, i] + b1 * across[1, i] + b2 * across[2, i] + b3 * across[3, i]
                )


@compiled(fastmath=True)
def _line(centre, sigma, phi, out):  # type: ignore[no-untyped-def]
    """Cubic B-spline coefficients along one axis, over 6, of a Gaussian that is integrated over the
    pixel about each half pixel; returns the place of the first one in the canvas.
    """
    f = np.float32
    first, middle = int(2 * centre) + 1, f(_PHI_STEPS // 2)
    per_half = f(_PHI_STEPS / (4 * _PHI_END) / sigma)
    end = middle - per_half * f(2 * centre - first + out.size // 2 - 1)  # of the first pixel
    made, before, last = f(0), f(0), f(0)
    for i in range(out.size):
        at = min(max(end + f(i) * per_half, f(0)), f(_PHI_STEPS - 1))
        m = np.int32(at)
        passed = phi[m] + (at - f(m)) * (phi[m + 1] - phi[m])
        made = passed - before + f(_POLE) * made
        out[i] = made
        before, last = last, passed
    made = f(0)
    for i in range(out.size - 1, -1, -1):
        made = f(_POLE) * (made - out[i])
        out[i] = made
    return first


@compiled(fastmath=True)
def _add_coefficients(canvas, x, y, sigma, peak, phi, width):  # type: ignore[no-untyped-def]
    """Add the coefficients of round blobs, which are products of those along both axes; the loops
    vectorise because `width` is not a constant.
    """
    across, down = np.empty(width, np.float32), np.empty(width, np.float32)
    for k in range(x.size):
        left, top = _line(x[k], sigma[k], phi, across), _line(y[k], sigma[k], phi, down)
        mass = np.float32(36 * 2 * math.pi * peak[k] * sigma[k] * sigma[k])
        for j in range(width):
            row, level = canvas[top + j, left : left + width], mass * down[j]
            for i in range(width):
                row[i] += level * across[i]


def spline_coefficients(blobs: Blobs, shape: tuple[int, int]) -> F32:
    """Cubic B-spline coefficients of one whole period of the undeformed pattern, integrated over
    pixels, at every half pixel; shape twice `period(shape)`. Those at (0, 0) are of material point
    (0, 0).
    """
    rows, columns = (2 * n for n in period(shape))
    edge = _WIDTH // 2
    canvas = np.zeros((rows + 2 * edge, columns + 2 * edge), np.float32)
    phi = ndtr(np.linspace(-_PHI_END, _PHI_END, _PHI_STEPS + 1)).astype(np.float32)
    by_row = np.argsort(blobs.y.astype(np.uint16), kind="stable")  # to touch the same memory
    drawn = (a[by_row] for a in (blobs.x, blobs.y, blobs.sigma, blobs.peak))
    _add_coefficients(canvas, *drawn, phi, _WIDTH)
    for along in (canvas, canvas.T):
        along[edge : 2 * edge] += along[-edge:]
        along[-2 * edge : -edge] += along[:edge]
    return canvas[edge:-edge, edge:-edge]
