"""Size of a pixel (m) and direction of the camera, from a block that touches nothing and that a
stage moves by known travels.

References
----------
Sutton, Orteu, Schreier 2009, section 3.2 (calibration by translations).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, stdtrit

from analysis.arrays import F64, Array, Bool, all_floats, floats, in_step
from analysis.calibration.distortion import distortion_of_translation
from analysis.robust import huber_fit

FEWEST_PICTURES = 5
# of the correlation's interpolation by the fraction of a pixel, which changes slowly across the
# travel; along it, it averages out (benchmarks calibrations --only whole)
BIAS_PX = 8e-4
LEAST_TRAVEL_PX = 8.0
SLACK = 0.05  # share of the travels within which a stage may take up its play after a turn
AT_REST = 0.002  # share of the travels that is the noise of a position
SURE = 3.0  # standard uncertainties from which there is more drift than was taken for possible
SWEEPS = 20
LARGEST_SCATTER = 0.01  # of the pictures about the line, share of the longest displacement
LARGEST_DRIFT = 0.1  # share of the longest displacement
LARGEST_SD = 0.01  # of the scale, relative
ACROSS = 30.0  # degrees by which a motion across the drive may be off


@dataclass(frozen=True, slots=True)
class ImageScale:
    """How large a pixel is on the interface, and how the camera is turned.

    Attributes
    ----------
    m_per_px, m_per_px_sd : float
        Size of a pixel, metres, and its standard uncertainty.
    angle, angle_sd : float
        Direction of the travel, of the rows of a board, or across ruled lines, in the picture, in
        radians from +x towards +y.
    k, k_sd : float
        Radial distortion at the corners of the picture (`analysis.undistorted`).
    rms_px : float
        What the fit leaves of the displacements (of the pictures that are used), or of the places
        of corners or tiles; of one component.
    """

    m_per_px: float
    m_per_px_sd: float
    angle: float
    angle_sd: float
    k: float
    k_sd: float
    rms_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TravelScale(ImageScale):
    """A scale, measured with travels of the stage.

    Attributes
    ----------
    drift_px_per_s : (float, float)
        Motion of the picture while the stage stands, along x and y; NaN where it is unknown.
    drift_sd : float
        Its standard uncertainty, px/s; where it is unknown, the assumed one.
    backlash_m, backlash_sd : float
        Play of the stage when it turns; NaN where all travels went one way.
    is_used : ndarray of bool, shape (n,)
        Pictures in which the stage has taken up its play.
    """

    drift_px_per_s: tuple[float, float]
    drift_sd: float
    backlash_m: float
    backlash_sd: float
    is_used: Bool


def scale_of_travels(
    travel_m: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    ux: ArrayLike,
    uy: ArrayLike,
    shape: tuple[int, int],
    *,
    time_s: ArrayLike | None = None,
    drift_sd: float = 5e-10,
    relative_sd: float = 0.0,
    box: float = 0.0,
    step_m: float = 0.0,
) -> TravelScale:
    """The scale from the fields of a free block that a stage moved: the slope of the displacement
    against the travel, so that an offset, the stage's play and a drift do not matter.

    Parameters
    ----------
    travel_m : array_like, shape (n,)
        Position of the stage in each picture, metres.
    x, y : array_like, shape (ny, nx)
        Places of the points, pixels.
    ux, uy : array_like, shape (n, ny, nx)
        Their displacements from one picture of the free block, pixels; NaN where not measured.
    shape : (rows, columns)
        Of the picture.
    time_s : array_like, shape (n,), optional
        Of each picture, seconds, to tell a drift: best of travels there and back.
    drift_sd : float
        Standard uncertainty of the drift, m/s, where the pictures cannot tell it as well.
    relative_sd : float
        Relative standard uncertainty of the travels.
    box : float
        Side of the square, pixels, over which each displacement is the mean.
    step_m : float
        Of the stage's encoder, metres: by half of it a position may be off, together in all
        pictures in which the stage rests there.

    Raises
    ------
    ValueError
        Too few pictures, too short travels, a block that touches, slips or drifts, a stage that did
        not go where it says, or a scale that is not resolved.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.scale as scale
    >>> x, y = np.meshgrid(np.arange(20.0, 400, 20), np.arange(20.0, 300, 20))
    >>> travel_um = np.arange(7) * 30.0
    >>> ux = np.ones((7, *x.shape)) * travel_um[:, None, None] / 7.04
    >>> found = scale.scale_of_travels(travel_um * 1e-6, x, y, ux, 0 * ux, (320, 420))
    >>> round(found.m_per_px * 1e6, 4), abs(found.angle) < 1e-9
    (7.04, True)
    """
    travel, ux, uy = all_floats(travel_m, ux, uy)
    time = None if time_s is None else floats(time_s)
    series = [travel] if time is None else [travel, time]
    is_whole = all(v.shape == ux.shape[:1] and np.isfinite(v).all() for v in series)
    if not is_whole or ux.shape != uy.shape:
        found = ", ".join(str(v.shape) for v in (*series, ux, uy))
        raise ValueError(
            f"scale: travels, times if any, and displacements of shapes {found}; give a finite"
            " travel and time for each picture"
        )
    span = float(np.ptp(travel))
    forth, used = _ways(travel, span)
    if used.sum() < FEWEST_PICTURES:
        raise ValueError(
            f"scale: {used.sum()} pictures were taken after the stage had moved, {FEWEST_PICTURES}"
            " are needed; add travels"
        )
    optics = distortion_of_translation(x, y, ux[used], uy[used], shape, box)
    shift = optics.shifts_px @ np.array([1, 1j])
    if (way := float(np.ptp(np.hypot(*(optics.shifts_px - optics.shifts_px[0]).T)))) < (
        LEAST_TRAVEL_PX
    ):
        raise ValueError(
            f"scale: the picture has moved by {way:.2g} px while the stage moved by"
            f" {span * 1e6:.3g} um, {LEAST_TRAVEL_PX:g} px are needed; use longer travels, and"
            " check that the stage moves the block"
        )
    design = np.column_stack([np.ones(used.sum()), travel[used]])
    if turns := len(np.unique(forth[used])) > 1:
        design = np.column_stack([design, forth[used]])
    value, sd, left = _fitted(design, shift)
    drift, drift_px_sd = complex(math.nan, math.nan), math.nan
    of_drift = of_play = 0.0
    if time is not None:
        time = time[used] - time[used].mean()
        rate = np.linalg.lstsq(design, time)[0]
        # by so much a drift that is not told would change the slope
        of_drift = drift_sd * float(abs(rate[1]))
        of_play = drift_sd * float(abs(rate[-1]))
        drift_px_sd = drift_sd * float(abs(value[1]))
        if np.ptp(time - design @ rate) > 1e-6 * np.ptp(time):
            drifting = np.column_stack([design, time])
            values, sds, rest = _fitted(drifting, shift)
            free_sd, held_sd = (float(s[1] / abs(value[1])) for s in (sds, sd))
            beyond = math.hypot(sds[-1], drift_px_sd)
            if free_sd < math.hypot(held_sd, of_drift) or abs(values[-1]) > SURE * beyond:
                drift, drift_px_sd = complex(values[-1]), float(sds[-1])
                of_drift = of_play = 0.0
                value, sd, left, design = values[:-1], sds[:-1], rest, drifting
            if abs(drift) * np.ptp(time) > LARGEST_DRIFT * way:
                raise ValueError(
                    f"scale: the picture drifts by {abs(drift) * np.ptp(time):.2g} px while it is"
                    f" moved by {way:.3g} px, a tenth of that is allowed; let the bench warm up"
                )
    if (scatter := float(np.sqrt(np.mean(np.abs(left) ** 2) / 2))) > LARGEST_SCATTER * way:
        raise ValueError(
            f"scale: the displacements scatter by {scatter:.2g} px about what follows the travel,"
            f" {LARGEST_SCATTER * way:.2g} px of {way:.3g} px are allowed; check that the block"
            " touches nothing and does not slip on its plate"
        )
    size, along = float(abs(value[1])), float(sd[1] / abs(value[1]))
    of_step, play_of_step = _of_rounding(design, travel[used], step_m)
    of_k = optics.share_per_k * optics.k_sd
    relative = math.hypot(along, of_step, of_k, of_drift, relative_sd)
    if relative > LARGEST_SD:
        raise ValueError(
            f"scale: it is known to {100 * relative:.2g} % only, {100 * LARGEST_SD:g} % is needed;"
            " use longer travels and more pictures"
        )
    back = value[-1] / value[1] if turns else complex(math.nan)
    return TravelScale(
        m_per_px=1 / size,
        m_per_px_sd=relative / size,
        angle=float(np.angle(value[1])),
        angle_sd=math.hypot(along, of_drift, BIAS_PX / way),
        k=optics.k,
        k_sd=optics.k_sd,
        rms_px=scatter,
        drift_px_per_s=(drift.real, drift.imag),
        drift_sd=drift_px_sd,
        backlash_m=-2 * back.real,
        backlash_sd=2 * math.hypot(sd[-1] / size, of_play, play_of_step) if turns else math.nan,
        is_used=used,
    )


def is_mirrored(drive: float, ux: ArrayLike, uy: ArrayLike) -> bool:
    """Whether a picture is mirrored: the block was moved to the left across its drive, for somebody
    who looks along the drive from where the camera looks from. Unless a mirror is in between, that
    is counterclockwise from the drive in the picture.

    Parameters
    ----------
    drive : float
        Direction of the drive in the picture, radians from +x towards +y, which is down.
    ux, uy : array_like
        Displacements of points of the block by that motion, pixels; NaN where not measured. The
        block may have turned a little.

    Raises
    ------
    ValueError
        The block has hardly moved, or not across its drive.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.scale as scale
    >>> up = np.full((5, 6), -20.0)
    >>> scale.is_mirrored(0.0, 0 * up, up), scale.is_mirrored(np.pi, 0 * up, up)
    (False, True)
    """
    both = [np.ravel(v) for v in in_step("mirror", ux=ux, uy=uy)]
    known = np.isfinite(both[0]) & np.isfinite(both[1])
    x, y = (float(np.median(v[known])) if known.any() else 0.0 for v in both)
    if (way := math.hypot(x, y)) < LEAST_TRAVEL_PX:
        raise ValueError(
            f"mirror: the block has moved by {way:.2g} px across its drive,"
            f" {LEAST_TRAVEL_PX:g} px are needed; push it further"
        )
    turn = math.degrees(math.remainder(math.atan2(y, x) - drive, 2 * math.pi))
    if abs(abs(turn) - 90) > ACROSS:
        raise ValueError(
            f"mirror: the block has moved {turn:.0f} degrees from its drive, 90 or -90 were asked"
            f" for, to within {ACROSS:g}; push it straight across"
        )
    return turn > 0


def _ways(travel: F64, span: float) -> tuple[F64, Bool]:
    """Whether the stage came forth (1) or back (-1) to each position, and whether it has taken up
    its play since it turned.
    """
    way, used = np.zeros(len(travel)), np.zeros(len(travel), np.bool_)
    now, furthest = 0.0, travel[0]
    for n, at in enumerate(travel):
        step = at - furthest
        is_turn = abs(step) > SLACK * span and step * now <= 0
        if is_turn:
            now = float(np.sign(step))
        if is_turn or step * now > 0:
            furthest = at
        way[n], used[n] = now, bool(now) and abs(at - furthest) <= AT_REST * span
    return way, used


def _of_rounding(columns: F64, travel: F64, step_m: float) -> tuple[float, float]:
    """Standard uncertainties of the slope, relative, and of the last of an offset, a slope and a
    play (m), by positions that are rounded to a step of an encoder: alike where they are equal.
    """
    share = np.linalg.pinv(columns)[1 : min(3, columns.shape[1])]
    _, place = np.unique(travel, return_inverse=True)
    off = [step_m / math.sqrt(12) * float(np.linalg.norm(np.bincount(place, s))) for s in share]
    return off[0], off[-1]


def _fitted(columns: F64, shift: Array) -> tuple[Array, F64, Array]:
    """Complex coefficients of the columns, their standard uncertainty (of one component) and what
    is left, by a fit in which pictures that stand out count less.
    """
    unit = np.abs(columns).max(axis=0)
    design = columns / unit
    n, p = columns.shape
    value, covariance, left = huber_fit(
        design, shift, SWEEPS, least=1e-6, wider=math.sqrt(n / max(n - p, 1))
    )
    freedom = 2 * (n - p)
    if freedom < 2:
        raise ValueError(
            f"scale: {n} pictures for {p} unknowns (offset, slope, drift, play) leave no scatter"
            " to judge by; add travels"
        )
    wider = float(stdtrit(freedom, ndtr(1.0)))  # few pictures tell the scatter badly
    return value / unit, wider * np.sqrt(covariance.diagonal()) / unit, left
