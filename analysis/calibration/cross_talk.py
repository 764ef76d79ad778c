"""Newtons per volt and cross-talk of the two force sensors: from known weights, one axis at a time,
and the share of P in the reading of Q from records of contacts that were pressed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, ndtr, stdtrit

from analysis.arrays import F64, floats
from analysis.calibration.sensor_response import SensorResponse, response, sensor_response
from analysis.calibration.serial_fit import variances_of_sums
from analysis.mechanics.hertz import check
from analysis.robust import robust_sd

AXES = ("normal", "shear")
MOST_COUPLED = 0.2  # share of the other force: above it the axes are mixed up
BLOCK_S = 0.02  # means of so long are fitted while the contact is pressed
RISING, FEWEST_RISING = (0.1, 0.9), 25  # shares of the load, and means between them
LEAST_LOAD = 30.0  # standard deviations of these means
CERTAIN = 4.0
MOST_BENT = 0.002  # share of the load, by which Q may bend as it grows
UNLIKELY = 0.01  # chance of a scatter from one pressing to the next
MOST_SD = 0.005


@dataclass(frozen=True, slots=True)
class LoadCalibration:
    """The result of weights on either axis; index 0 is the normal, 1 the shear direction.

    Attributes
    ----------
    newtons_per_volt, newtons_per_volt_sd : (2,)
        Force per volt of each sensor, NaN where its axis was not loaded; negative where the voltage
        falls.
    coupling, coupling_sd : (2, 2)
        Reading in newtons = coupling @ (P, Q), with a diagonal of 1.
    responses : 2 x 2 of SensorResponse or None
        Of sensor i to weights on axis j, None where that was not loaded.
    """

    newtons_per_volt: F64
    newtons_per_volt_sd: F64
    coupling: F64
    coupling_sd: F64
    responses: tuple[tuple[SensorResponse | None, ...], ...]


def calibrate_loads(
    load: ArrayLike,
    axis: ArrayLike,
    volts: ArrayLike,
    time: ArrayLike | None = None,
    *,
    load_sd: float = 0.0,
    end_of_range: tuple[float, float] = (math.inf, math.inf),
    sign: tuple[int, int] = (0, 0),
) -> LoadCalibration:
    """Newtons per volt and cross-talk from weights on one axis at a time.

    Parameters
    ----------
    load : array_like, shape (n,)
        Newtons, in the order in which they were applied; see `sensor_response`.
    axis : array_like of int, shape (n,)
        0 where the weight loads the normal cantilever, 1 where the tangential one.
    volts : array_like, shape (n, 2)
        Readings of the normal and the shear sensor.
    time : array_like, shape (n,), optional
        Seconds; none: equal steps.
    load_sd : float
        Relative standard uncertainty that all weights share.
    end_of_range, sign : (2,)
        Of either sensor, see `sensor_response`.

    Raises
    ------
    ValueError
        As `sensor_response`, or what a sensor reads of the other axis is too much to be cross-talk.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> load = np.tile([0, 0.5, 1.0, 0.5, 0, 0.5, 1.0, 0.5, 0], 2)
    >>> axis = np.repeat([0, 1], 9)
    >>> forces = np.column_stack([load * (axis == 0), load * (axis == 1)])
    >>> volts = forces @ np.transpose([[1, 0.004], [0.008, 1]]) / [0.2067, 0.2107]
    >>> analysis.calibrate_loads(load, axis, volts).coupling.round(4).tolist()
    [[1.0, 0.004], [0.008, 1.0]]
    """
    x, which, read = floats(load), np.asarray(axis), floats(volts)
    if read.shape != (*x.shape, 2) or which.shape != x.shape or not np.isin(which, (0, 1)).all():
        raise ValueError(
            f"weights: load, axis and volts have the shapes {x.shape}, {which.shape} and"
            f" {read.shape}; give an axis, 0 or 1, and two volts for each load"
        )
    t = np.arange(float(x.size)) if time is None else floats(time)
    slopes, sds = np.full((2, 2), math.nan), np.full((2, 2), math.nan)
    found: list[list[SensorResponse | None]] = [[None, None], [None, None]]
    for j in (0, 1):
        on = which == j
        if not on.any():
            continue
        own = _named(j, x[on], read[on, j], t[on], end_of_range[j], sign[j])
        other = response(x[on], read[on, 1 - j], t[on])
        found[j][j], found[1 - j][j] = own, other
        slopes[j, j], sds[j, j] = own.slope, own.relative_sd * abs(own.slope)
        slopes[1 - j, j], sds[1 - j, j] = other.slope, other.slope_sd
    if np.isnan(slopes).all():
        raise ValueError("weights: no load was given; hang weights on one axis, then on the other")
    diagonal = np.diag(slopes)
    relative = np.abs(np.diag(sds) / diagonal)
    coupling = slopes / diagonal[:, None]
    coupling_sd = np.hypot(sds / np.abs(diagonal[:, None]), coupling * relative[:, None])
    np.fill_diagonal(coupling_sd, 0.0)
    for i, j in ((0, 1), (1, 0)):
        if abs(coupling[i, j]) > MOST_COUPLED:
            raise ValueError(
                f"weights: the {AXES[i]} sensor reads {100 * coupling[i, j]:.3g} % of a weight on"
                f" the {AXES[j]} axis, {100 * MOST_COUPLED:g} % is the most;"
                " see which axis was loaded"
            )
    return LoadCalibration(
        newtons_per_volt=1 / diagonal,
        newtons_per_volt_sd=np.hypot(relative, load_sd) / np.abs(diagonal),
        coupling=coupling,
        coupling_sd=coupling_sd,
        responses=tuple(map(tuple, found)),
    )


def _named(j: int, x: F64, y: F64, t: F64, end: float, sign: int) -> SensorResponse:
    try:
        return sensor_response(x, y, t, end_of_range=end, sign=sign)
    except ValueError as error:
        raise ValueError(f"{AXES[j]} sensor: {error}") from None


@dataclass(frozen=True, slots=True)
class PressedShare:
    """The share of P that the shear sensor reads while a contact is pressed.

    Attributes
    ----------
    value, sd : float
        Share, and its standard uncertainty by the noise; a steady drift of the zero is taken off.
    bend, bend_sd : float
        What Q departs by from a straight line in P, as a share of the load.
    load : float
        Greatest P, newtons.
    """

    value: float
    sd: float
    bend: float
    bend_sd: float
    load: float


def pressed_share(readings: ArrayLike, rate_hz: float) -> PressedShare:
    """The part of P that the shear sensor reads, from the free block until the load is steady,
    with no motion of the stage.

    A true shear in proportion to P, as of a block that comes down along a tilted way, looks the
    same as cross-talk, so it counts as cross-talk; one that slips, or is not in proportion, is
    refused. This record does not give the share of Q in the reading of P.

    Parameters
    ----------
    readings : array_like, shape (n, 2)
        Of the normal and the shear sensor in newtons, without any cross-talk taken off.
    rate_hz : float

    Raises
    ------
    ValueError
        The load does not rise, or not slowly enough, or the shear is not in proportion to it; the
        rate is none.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> P = 0.5 * np.clip(np.linspace(-1, 2, 3000), 0, 1)
    >>> noise = np.random.default_rng(1).normal(0, 1e-3, (3000, 2))
    >>> found = analysis.pressed_share(np.column_stack([P, 0.01 * P]) + noise, 1000)
    >>> round(found.value, 3)
    0.01
    """
    check("pressing", rate_hz=rate_hz)
    read = floats(readings)
    width = max(1, round(BLOCK_S * rate_hz))
    if read.ndim != 2 or read.shape[1] != 2 or len(read) < 4 * width:
        raise ValueError(
            f"pressing: readings of shape {read.shape} found; give the two sensors' readings of"
            f" {4 * BLOCK_S:g} s or more"
        )
    means = read[: len(read) // width * width].reshape(-1, width, 2).mean(axis=1)
    means = means[np.isfinite(means).all(axis=1)]
    P, Q = means.T if len(means) else np.zeros((2, 1))
    low = float(P.min())
    span = float(P.max()) - low
    share_of_load = (P - low) / (span or 1.0)
    noise = robust_sd(np.diff(read[: 20 * width, 0], 2)) / math.sqrt(6 * width)
    rising = (share_of_load > RISING[0]) & (share_of_load < RISING[1])
    if not span > LEAST_LOAD * noise:
        raise ValueError(
            f"pressing: P changes by {1e3 * span:.3g} mN, {LEAST_LOAD:g} times its noise of"
            f" {1e3 * noise:.2g} mN are needed; take a record in which the contact is pressed"
        )
    if rising.sum() < FEWEST_RISING:
        raise ValueError(
            f"pressing: the load rises within {BLOCK_S * rising.sum():.2g} s,"
            f" {FEWEST_RISING * BLOCK_S:g} s or more are needed; press more slowly"
        )
    u = 2 * share_of_load - 1
    drifting = np.linspace(-1, 1, len(u))
    columns = np.column_stack([np.ones_like(u), u, 1 - u**2, drifting])
    at = np.linalg.lstsq(columns, Q)[0]
    off = Q - columns @ at
    sd = np.sqrt(variances_of_sums(columns, off, np.linalg.pinv(columns)))
    (_, half, bend, _), (_, half_sd, bend_sd, _) = (at / span).tolist(), (sd / span).tolist()
    if abs(bend) > max(CERTAIN * bend_sd, MOST_BENT):
        raise ValueError(
            f"pressing: Q departs by {100 * bend:.2g} +- {100 * bend_sd:.1g} % of P from a straight"
            " line in P, as no cross-talk does: the block was sheared while it was pressed; press"
            " it straight down, or use weights"
        )
    return PressedShare(2 * half, 2 * half_sd, bend, bend_sd, load=span)


def common_share(shares: list[PressedShare]) -> tuple[float, float]:
    """Cross-talk from several pressings, and its standard uncertainty: by the noise, or by their
    scatter where that is more than noise explains.

    Raises
    ------
    ValueError
        They do not agree, as cross-talk would.
    """
    if len(shares) < 3:
        raise ValueError(
            f"pressing: {len(shares)} records found; 3 or more are needed to see whether the shear"
            " sensor reads the same share of P each time"
        )
    values, sds = np.array([s.value for s in shares]), np.array([s.sd for s in shares])
    weights = sds**-2.0
    mean = float(weights @ values / weights.sum())
    power, free = float(weights @ (values - mean) ** 2), len(values) - 1
    sd = float(weights.sum()) ** -0.5
    if chdtrc(free, power) < UNLIKELY:
        # what differs from one to the next is a true shear: each of them has its own
        mean, scatter = float(values.mean()), float(values.std(ddof=1))
        # few of them tell badly how far they scatter
        sd = float(stdtrit(free, ndtr(1.0))) * scatter / math.sqrt(len(values))
        if sd > MOST_SD:
            raise ValueError(
                f"pressing: the shear sensor reads {100 * values.min():.2f} to"
                f" {100 * values.max():.2f} % of P, not the same each time: the block is sheared as"
                " it is pressed; use weights"
            )
    return mean, sd
