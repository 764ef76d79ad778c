"""How a sensor reads what is applied to it: known weights, or known displacements.

A straight line from nothing to the whole, beside it a bend, a hysteresis, and the drift of the zero
in time, all by linear least squares without the outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from analysis.arrays import F64, Bool, all_floats, floats
from analysis.robust import rounding_step

FEWEST, FEWEST_LEVELS, FEWEST_FREE = 8, 3, 3  # readings, different loads, degrees of freedom
CHANCE = 1e-3  # that a good set of readings loses one as an outlier
MOST_OUTLIERS = 0.2  # share of the readings
CERTAIN = 4.0  # standard uncertainties from which a bend or a hysteresis is there
MOST_BENT, MOST_HYSTERESIS, MOST_DRIFT = 0.01, 0.01, 0.05  # shares of the span
MOST_SD = 0.02  # of the slope
SAME_LEVEL = 0.02  # share of the span
END_OF_RANGE = 0.98
# variances of a random walk of the zero in half of the time, over that of a reading
WALKS = (0.0, *np.geomspace(0.03, 3e3, 11).tolist())
PRIOR = np.array([1.0, *[1 / (len(WALKS) - 1)] * (len(WALKS) - 1)])  # none, or some: as likely
ONE_SIDE = 0.8413447460685429  # probability below one standard deviation
ROUNDING = 1e-9  # of the readings' span
DECIMALS = 10.0 ** np.arange(2, 7)  # of readings that were written down, those that are believed


@dataclass(frozen=True, slots=True)
class SensorResponse:
    """A sensor's response; every ``_sd`` is a standard uncertainty.

    Attributes
    ----------
    slope, slope_sd : float
        Reading per unit applied, along the chord from the least to the greatest that was applied,
        and its uncertainty by the scatter of the readings.
    zero, zero_sd : float
        Reading where nothing is applied, at the first reading.
    drift, drift_sd : float
        Change of the zero from the first to the last reading; it is removed.
    bend, bend_sd : float
        Departure from the chord half way, in the unit of the readings.
    hysteresis, hysteresis_sd : float
        Half of what unloading reads beyond loading half way; NaN where only one was done.
    noise : float
        Standard deviation of the readings about the fit.
    span : float
        Reading at the greatest that was applied beyond that at the least.
    residual : (n,)
        Reading minus fit.
    is_used : (n,)
        False for outliers.
    """

    slope: float
    slope_sd: float
    zero: float
    zero_sd: float
    drift: float
    drift_sd: float
    bend: float
    bend_sd: float
    hysteresis: float
    hysteresis_sd: float
    noise: float
    span: float
    residual: F64
    is_used: Bool

    @property
    def relative_sd(self) -> float:
        """Relative uncertainty of the slope, with a bend and a hysteresis that are certain: any
        reading may be off the chord by them.
        """
        off = [
            value / self.span
            for value, sd in ((self.bend, self.bend_sd), (self.hysteresis, self.hysteresis_sd))
            if abs(value) > CERTAIN * sd
        ]
        return math.hypot(self.slope_sd / self.slope, *(one / math.sqrt(3) for one in off))


def sensor_response(
    applied: ArrayLike,
    reading: ArrayLike,
    time: ArrayLike | None = None,
    *,
    end_of_range: float = math.inf,
    sign: int = 0,
) -> SensorResponse:
    """The response of a sensor to known loads or displacements, one reading for each, in the order
    in which they were applied: up and down again, twice or more often.

    Parameters
    ----------
    applied : array_like, shape (n,)
        Newtons or metres.
    reading : array_like, shape (n,)
        Volts, each the mean of some seconds.
    time : array_like, shape (n,), optional
        Seconds, of the middle of each; none: equal steps.
    end_of_range : float
        Volts at which the reading is cut off.
    sign : int
        1 or -1: the slope that is expected; 0: any.

    Raises
    ------
    ValueError
        The readings give no calibration: too few, saturated, of the other sign, not resolved, bent,
        with a hysteresis, drifting, or with too many outliers.

    Examples
    --------
    >>> import analysis
    >>> loads = [0, 0.5, 1.0, 0.5, 0, 0.5, 1.0, 0.5, 0]
    >>> found = analysis.sensor_response(loads, [0.1 + 4.8 * F for F in loads])
    >>> round(found.slope, 6), round(found.zero, 6)
    (4.8, 0.1)
    """
    x, y, t = _checked(applied, reading, time)
    if np.abs(y).max() >= END_OF_RANGE * end_of_range:
        raise ValueError(
            f"sensor response: a reading of {y[np.abs(y).argmax()]:.4g} V is at the end of the"
            f" range of {end_of_range:g} V; apply less, or set the zero lower"
        )
    found = response(x, y, t)
    lost = int(np.count_nonzero(~found.is_used))
    if lost > MOST_OUTLIERS * len(x):
        raise ValueError(
            f"sensor response: {lost} of {len(x)} readings are far from the line of the others;"
            " repeat them, and let each come to rest"
        )
    if not abs(found.slope_sd) < MOST_SD * abs(found.slope):
        raise ValueError(
            f"sensor response: the slope is {found.slope:.4g} +- {found.slope_sd:.2g} V per unit,"
            f" {MOST_SD:.0%} is the most; apply more, read each for longer, or see what was loaded"
        )
    if sign and found.slope * sign < 0:
        raise ValueError(
            f"sensor response: the slope is {found.slope:.4g} V per unit, but a positive force is"
            f" to read {'more' if sign > 0 else 'less'}; apply it the other way, or correct"
            " forces.sign"
        )
    for name, value, sd, most, remedy in (
        (
            "drift of the zero",
            found.drift,
            found.drift_sd,
            MOST_DRIFT,
            "let the bench come to rest",
        ),
        ("bend", found.bend, found.bend_sd, MOST_BENT, "apply less, or check the sensor's gap"),
        ("hysteresis", found.hysteresis, found.hysteresis_sd, MOST_HYSTERESIS, "see what rubs"),
    ):
        share, share_sd = abs(value / found.span), sd / abs(found.span)
        if share > most and share > CERTAIN * share_sd:
            raise ValueError(
                f"sensor response: a {name} of {100 * share:.2g} +- {100 * share_sd:.1g} % of the"
                f" whole span, {100 * most:g} % is the most; {remedy}"
            )
    return found


def _checked(
    applied: ArrayLike, reading: ArrayLike, time: ArrayLike | None
) -> tuple[F64, F64, F64]:
    x, y = all_floats(applied, reading)
    t = np.arange(float(x.size)) if time is None else floats(time)
    if x.ndim != 1 or x.shape != y.shape or x.shape != t.shape:
        raise ValueError(
            f"sensor response: applied, reading and time have the shapes {x.shape}, {y.shape} and"
            f" {t.shape}; give one of each for every reading"
        )
    if not (np.isfinite(x) & np.isfinite(y) & np.isfinite(t)).all() or (np.diff(t) <= 0).any():
        raise ValueError(
            "sensor response: a value is not a finite number, or the times do not grow; leave out"
            " what was not read"
        )
    levels = _visits(x)
    if len(x) < FEWEST or len(levels) < FEWEST_LEVELS:
        raise ValueError(
            f"sensor response: {len(x)} readings at {len(levels)} different loads; {FEWEST} or more"
            f" at {FEWEST_LEVELS} or more are needed"
        )
    if max(levels) < 2:
        raise ValueError(
            "sensor response: no load was applied a second time, so that a drift of the zero cannot"
            " be separated from the load; go down again to the first one"
        )
    return x, y, t


def _visits(x: F64) -> list[int]:
    """How often each load was applied, not counting repetitions right after each other."""
    order = np.sort(x)
    near = SAME_LEVEL * (order[-1] - order[0])
    groups = np.split(order, np.flatnonzero(np.diff(order) > near) + 1)
    came = np.concatenate([[True], np.abs(np.diff(x)) > near])
    return [int(np.count_nonzero(came & (x >= g[0]) & (x <= g[-1]))) for g in groups]


def response(x: F64, y: F64, t: F64) -> SensorResponse:
    """As `sensor_response`, of readings whatever they are worth: those of a sensor that hardly
    feels what is applied, for one.
    """
    low, high = float(x.min()), float(x.max())
    u = (2 * x - low - high) / (high - low)
    tau = 2 * (t - t[0]) / (t[-1] - t[0]) - 1
    branch = _branch(x)
    inner = (1 - u**2) > SAME_LEVEL
    has_both = bool((branch[inner] > 0).any() and (branch[inner] < 0).any())
    shapes = [np.ones_like(x), u, 1 - u**2, tau]
    if has_both:
        shapes.append(-branch * (1 - u**2))
    if max(_visits(x)) > 2:
        shapes.append(tau**2 - 1)  # a drift that slows down; else it cannot be told from the load
    columns = np.column_stack(shapes)
    if np.linalg.cond(columns) > 1e6:
        raise ValueError(
            "sensor response: the loads follow the time, so that a drift cannot be separated from"
            " them; go up and down again"
        )
    used = _inliers(columns, y)
    at, covariance, noise, wander = fit_beside_walk(columns[used], y[used], tau[used])
    # readings that are equal were rounded by the same
    each, alike = np.linalg.pinv(columns[used]), np.unique(y[used], return_inverse=True)[1]
    shared = each @ np.eye(len(alike))[alike]
    rounded = rounding_step(y, DECIMALS) ** 2 / 12 * shared @ shared.T
    half, middle = (high - low) / 2, (high + low) / 2
    u0 = -middle / half  # of nothing

    def estimate(*weights: float) -> tuple[float, float]:
        w = np.pad(np.array(weights), (0, len(at) - len(weights)))
        return float(w @ at), math.sqrt(max(w @ covariance @ w, w @ rounded @ w))

    return SensorResponse(
        *estimate(0, 1 / half),
        *estimate(1, u0, 1 - u0**2, -1),
        *estimate(0, 0, 0, 2),
        *estimate(0, 0, 1),
        *(estimate(0, 0, 0, 0, 1) if has_both else (math.nan, math.nan)),
        noise=noise,
        span=2 * float(at[1]),
        residual=np.asarray(y - columns @ at - np.interp(tau, tau[used], wander)),
        is_used=used,
    )


def _branch(x: F64) -> F64:
    """1 where the load had grown to what it is, -1 where it had fallen; 0 at the first."""
    way = np.concatenate([[0.0], np.sign(np.diff(x))])
    for i in range(1, len(way)):  # the same load again: as it was come to
        way[i] = way[i] or way[i - 1]
    return way


def _inliers(columns: F64, y: F64) -> Bool:
    """Which readings are not far from the line of the others; they are left out one by one."""
    used = np.ones(len(y), dtype=bool)
    while (free := int(used.sum()) - columns.shape[1]) > FEWEST_FREE:
        c = columns[used]
        hat = np.einsum("ij,ij->i", c @ np.linalg.inv(c.T @ c), c)
        off = y[used] - c @ np.linalg.lstsq(c, y[used])[0]
        power = float(off @ off)
        if power <= (ROUNDING * np.ptp(y)) ** 2:
            break
        share = np.minimum(off**2 / np.maximum(1 - hat, 1e-9) / power, 1 - 1e-12)
        far = np.sqrt(share * (free - 1) / (1 - share))  # of Student's distribution
        if far.max() < stdtrit(free - 1, 1 - CHANCE / len(share) / 2):
            break
        used[np.flatnonzero(used)[far.argmax()]] = False
    return used


def fit_beside_walk(columns: F64, y: F64, tau: F64) -> tuple[F64, F64, float, F64]:
    """Linear least squares of readings y (n,) at times tau (n,), which run from -1 to 1, with
    errors that are white noise and a random walk: each share of the walk counts by its restricted
    likelihood.

    Gives the parameters of the columns (n, p), their covariance (p, p), the standard deviation of
    a reading, and how its zero wandered (n,).

    References
    ----------
    Patterson and Thompson, Biometrika 58 (1971) 545.
    """
    walk = np.minimum.outer(tau, tau) + 1  # in half the time that all takes
    fits = [_generalised(columns, y, np.eye(len(y)) + share * walk) for share in WALKS]
    ats, inverses, variances, likelihoods, weighed = zip(*fits, strict=True)
    weights = np.exp(np.subtract(likelihoods, max(likelihoods))) * PRIOR
    weights /= weights.sum()
    mean = sum(w * at for w, at in zip(weights, ats, strict=True))
    free = len(y) - columns.shape[1]
    # so that one standard uncertainty covers as much as that of many readings
    widened = float(stdtrit(free, ONE_SIDE)) ** 2
    covariance = sum(
        w * (widened * variance * inverse + np.outer(at - mean, at - mean))
        for w, at, inverse, variance in zip(weights, ats, inverses, variances, strict=True)
    )
    noise = math.sqrt(weights @ variances)
    wander = sum(
        w * share * walk @ off for w, share, off in zip(weights, WALKS, weighed, strict=True)
    )
    return np.asarray(mean), np.asarray(covariance), noise, np.asarray(wander)


def _generalised(columns: F64, y: F64, covariance: F64) -> tuple[F64, F64, float, float, F64]:
    """Parameters of least squares of errors of that covariance, apart from a factor; their
    covariance apart from it; that factor; the logarithm of the restricted likelihood; and the
    residuals, weighed by the inverse covariance.
    """
    n, p = columns.shape
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    c, z = white @ columns, white @ y
    inverse = np.linalg.inv(c.T @ c)
    at = inverse @ c.T @ z
    off = z - c @ at
    power = max(float(off @ off), (ROUNDING * float(np.ptp(y))) ** 2, np.finfo(float).tiny)
    logarithm = (
        float(np.log(np.diag(white)).sum())
        + np.linalg.slogdet(inverse)[1] / 2
        - (n - p) / 2 * math.log(power)
    )
    weighed = np.asarray(white.T @ off)
    return at, np.asarray(inverse), power / (n - p), float(logarithm), weighed
