"""A linear fit to a record whose errors are correlated from one reading to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, Bool, floats, in_step
from analysis.robust import MOST_CORRELATED, robust_sd, serial_correlation, serial_sum

MOST_OUTLIERS = 0.05  # share of the readings
FAR = 6.0  # standard deviations, from which a reading is an outlier
SLOWEST = slice(2, 10)  # Fourier frequencies of the record; the fit takes the first of them away
SURELY_SLOW = 2.2  # mean of so many exponentials of mean 1, which chance reaches in 0.4 %
IN_STEP = 0.8  # of the scatter of roundings that are independent
LEAST_READINGS = 40  # for those frequencies
SLOW_COSINES = 128  # that tell 1/f noise from other errors
LEAST_SLOW = 0.1  # share of a column in these, from which it takes of them
KEPT = 0.3, 0.6, 0.8, 0.9, 0.95, 0.98  # of an error in the next reading
LASTING = 0.95  # of these, errors that may last like 1/f noise and a walk (which keep all)
SURELY_LASTING = 0.8  # probability of errors that last, from which all of these count
SLOW_POWERS = np.geomspace(0.03, 1e4, 12)  # of slow errors, over that of white ones
# probabilities before anything is read: of 1/f noise, of a walk, of each correlation, of no slow
# errors
PRIOR = np.array([0.04, 0.04, *[0.46 / len(KEPT)] * len(KEPT), 0.46])


@dataclass(frozen=True, slots=True)
class SerialFit:
    """Coefficients of the columns, with their standard uncertainties, both of shape (k,); the
    residual of the readings that were used, and which of all were.
    """

    values: F64
    sds: F64
    residual: F64
    is_used: Bool

    def of(self, i: int, unit: float) -> tuple[float, float]:
        """A coefficient, whose column counts in units of `unit`, and its standard uncertainty."""
        return float(self.values[i]) / unit, float(self.sds[i]) / unit

    @property
    def rms(self) -> float:
        """Of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))


def finite_readings(name: str, *columns: ArrayLike) -> list[F64]:
    """The rows of some columns, shape (n,) each, that are whole.

    Raises
    ------
    ValueError
        Their shapes differ, or they are too few; the message begins with `name`.
    """
    named = {f"column {number}": one for number, one in enumerate(columns, 1)}
    table = np.stack([np.ravel(one) for one in in_step(name, **named)])
    table = table[:, np.isfinite(table).all(axis=0)]
    if table.shape[1] < LEAST_READINGS:
        raise ValueError(
            f"{name}: {table.shape[1]} readings were taken; {LEAST_READINGS} or more are needed"
        )
    return list(table)


def serial_fit(name: str, design: F64, y: F64, resolution: float = 0.0) -> SerialFit:
    """Least squares of `y`, shape (n,), in the columns of `design`, shape (n, k), in the order in
    which they were read; single outliers are left out.

    The uncertainty is that of `variances_of_sums`. Readings of a `resolution` that hardly scatter,
    as of a motion in step with them, may be off by it together.

    Raises
    ------
    ValueError
        Too few readings, or too many outliers; the message begins with `name`.
    """
    known = np.isfinite(y) & np.isfinite(design).all(axis=1)
    if known.sum() < LEAST_READINGS:
        raise ValueError(
            f"{name}: {known.sum()} readings were taken; {LEAST_READINGS} or more are needed"
        )
    values = _least_absolute(design[known], y[known])
    is_used, residual = known, np.full(len(y), np.inf)
    # what is exact has the errors of its rounding
    rounding = max(1e-12 * float(np.abs(y[known]).max()), resolution / FAR)
    for _ in range(4):
        residual[known] = y[known] - design[known] @ values
        is_used = np.abs(residual) < FAR * max(robust_sd(residual[known]), rounding)
        values = np.linalg.lstsq(design[is_used], y[is_used])[0]
    lost = 1 - is_used.sum() / known.sum()
    if lost > MOST_OUTLIERS:
        raise ValueError(
            f"{name}: {lost:.0%} of the readings lie further from the fit than {FAR:g} times their"
            f" scatter; up to {MOST_OUTLIERS:.0%} are left out, so look at the record for what"
            " disturbed it"
        )
    inverse = floats(np.linalg.pinv(design[is_used]))
    values = inverse @ y[is_used]
    left = y[is_used] - design[is_used] @ values
    sds = np.sqrt(variances_of_sums(design[is_used], left, inverse))
    # roundings of a slow motion change seldom from one reading to the next
    scatter = min(float(left.std()), float(np.diff(left).std()) / math.sqrt(2))
    if scatter < IN_STEP * resolution / math.sqrt(12):
        together = resolution / math.sqrt(12) * np.abs(inverse).sum(axis=1)
        sds = np.maximum(sds, together)
    return SerialFit(values, sds, left, is_used)


def _least_absolute(design: F64, y: F64) -> F64:
    """Coefficients of the least sum of absolute residuals, nearly, which outliers hardly move."""
    weight = np.ones(len(y))
    for _ in range(10):
        values = np.linalg.lstsq(design * weight[:, None], y * weight)[0]
        left = np.abs(y - design @ values)
        weight = 1 / np.sqrt(np.maximum(left, max(1e-3 * float(np.median(left)), 1e-30)))
    return np.asarray(values)


def variances_of_sums(design: F64, left: F64, weights: F64) -> F64:
    """Variances of weighted sums of the errors of a record, shape (m,), of which a fit of `design`,
    shape (n, k), has left the residual, shape (n,); weights of shape (m, n).

    That of errors whose correlation falls by a factor from one to the next or, where the lowest
    frequencies of the residual have more power than such errors, that of this power; and no less
    than by 1/f noise or a random walk, times the probability that there is one; nor than by errors
    of a correlation of 0.95 or more, where it is likely that something lasts.
    """
    short = [_variance_of_sum(one, left, design.shape[1]) for one in weights]
    return np.maximum(short, _by_lasting_errors(design, left, weights))


def _by_lasting_errors(design: F64, left: F64, weights: F64) -> F64:
    """The part of these variances by errors that last beside white errors: each spectrum
    counts by its restricted likelihood in the slowest cosines of the record, of which such errors
    make independent amplitudes. What is faster has the power that the residual has there.

    References
    ----------
    Patterson and Thompson, Biometrika 58 (1971) 545; Ahmed, Natarajan and Rao, IEEE Trans. Comput.
    C-23 (1974) 90 (cosines in place of the eigenvectors of serial errors).
    """
    # here, for they take long to load
    from scipy.fft import dct
    from scipy.ndimage import uniform_filter1d

    n = len(left)
    m = min(n, SLOW_COSINES)
    errors, *sums = dct(np.vstack([left, weights]), norm="ortho")
    columns, shares, _ = np.linalg.svd(
        dct(np.linalg.qr(design)[0], axis=0, norm="ortho")[:m], full_matrices=False
    )
    columns = columns[:, shares > LEAST_SLOW]
    bend = 2 - 2 * np.cos(np.pi * np.arange(m) / n)
    bend[0] = bend[1]  # nothing tells a mean from what is slower than the record
    shapes = 1 / np.array(
        [np.sqrt(bend), bend, *((1 - kept) ** 2 + kept * bend for kept in KEPT), np.ones(m)]
    )
    shapes /= shapes.mean(axis=1, keepdims=True)
    spectra = (1 + np.multiply.outer(SLOW_POWERS, shapes)).reshape(-1, m)
    information = np.einsum("sm,mi,mj->sij", 1 / spectra, columns, columns, optimize=True)
    right = (errors[:m] / spectra) @ columns
    taken = np.einsum("si,si->s", right, np.linalg.solve(information, right[:, :, None])[:, :, 0])
    power = np.maximum((errors[:m] ** 2 / spectra).sum(axis=1) - taken, np.finfo(float).tiny)
    free = m - columns.shape[1]
    likelihood = free * np.log(power) + np.log(spectra).sum(axis=1)
    likelihood += np.linalg.slogdet(information)[1]
    chance = np.exp((likelihood.min() - likelihood) / 2) * np.tile(PRIOR, len(SLOW_POWERS))
    chance /= chance.sum()
    kept = np.tile([1.0, 1.0, *KEPT, 0.0], len(SLOW_POWERS))
    lasts = LASTING if chance[kept >= LASTING].sum() > SURELY_LASTING else 1.0
    chance[kept < lasts] = 0.0
    spectrum = uniform_filter1d(errors**2, m) * chance.sum()
    spectrum[:m] = (chance * power / free) @ spectra
    return np.asarray(np.square(sums) @ spectrum)


def _variance_of_sum(weights: F64, left: F64, k: int) -> float:
    """Variance of a weighted sum of errors of which the residual is known, after a fit of k
    parameters.
    """
    n = len(left)
    power = float(left @ left)
    near, far = serial_correlation(left, k), float(left[2:] @ left[:-2]) / power if power else 0.0
    far = (far + k / n) / (1 - (k + 2) / n)
    # white errors beside serial ones: the correlation falls more slowly than its first step
    share, factor = 1.0, near
    if far > max(near * near, 2 / math.sqrt(n)):
        factor = min(far / near, MOST_CORRELATED) if near else 0.0
        share = min(near / factor, 1.0) if factor else 1.0
    freedom = n / (1 + 2 * share * factor / (1 - factor))
    variance = power / n * freedom / max(freedom - k, 1.0)
    white, serial = float(weights @ weights), serial_sum(weights, factor)
    found = variance * ((1 - share) * white + share * serial)
    slow = float(np.mean(np.abs(np.fft.rfft(left)[SLOWEST]) ** 2)) / n
    return max(found, slow * white) if slow > SURELY_SLOW * found / white else found
