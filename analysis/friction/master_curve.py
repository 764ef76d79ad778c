"""Master curve of friction: sigma/p against u_x at all radii and frames, and the law through it
(paper, section 6 and Fig. 15).

sigma comes from an inversion, which smooths it, and the curve inherits that: L comes out 1 to 3 %
too long. `local_law.fit_local_law` needs no stress and is the one to quote; this is what to draw.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.friction.local_law import FEWEST, LOST, huber
from analysis.mechanics import hertz
from analysis.robust import robust_sd

# of a: beyond, p vanishes, and with it what sigma/p is worth; boxes mix inside and outside
INNER = 0.9
BINS = 40
ROUNDS = 240
LAGS = 3  # rings whose errors may be shared
OUTLYING = 4.0  # standard deviations


@dataclass(frozen=True, slots=True)
class MasterCurve:
    """sigma/p against u_x, all radii and frames together (paper, Fig. 15), and the law through it.
    NaN where it can not be determined; `notes` then gives the reason.

    Attributes
    ----------
    radius : ndarray, shape (m,)
        Radii used, metres: those below 0.9 a.
    slip, ratio : ndarray, shape (nt, m)
        u_x (m) and sigma/p; NaN where either was not measured.
    bin_slip, bin_ratio, bin_sd : ndarray
        Medians over bins of equal numbers of points, and robust standard deviation of a point.
    mu, mu_sd, L, L_sd : float
        Of the curve, L in metres; not corrected for the smoothing of sigma.
    stiffness : ndarray, shape (m,)
        k = p/L, the initial slope of sigma against u_x at each radius, Pa/m.
    outliers : float
        Share of the points that lie more than four standard deviations off the law.
    notes : tuple of str
    """

    radius: F64
    slip: F64
    ratio: F64
    bin_slip: F64
    bin_ratio: F64
    bin_sd: F64
    mu: float = np.nan
    mu_sd: float = np.nan
    L: float = np.nan
    L_sd: float = np.nan
    stiffness: F64 | None = None
    outliers: float = np.nan
    notes: tuple[str, ...] = ()


def master_curve(
    radii: ArrayLike,
    ux: ArrayLike,
    ux_sd: ArrayLike,
    sigma: ArrayLike,
    sigma_sd: ArrayLike,
    P: ArrayLike,
    a: float,
) -> MasterCurve:
    """sigma/p against u_x at all radii and frames of the drive, and the law through it.

    Parameters
    ----------
    radii : array_like, shape (nr,)
        Metres.
    ux, ux_sd, sigma, sigma_sd : array_like, shape (nt, nr)
        Ring means of u_x, lens removed, and inverted stress, with their standard uncertainties (m,
        Pa). NaN where not measured.
    P : array_like, shape (nt,) or scalar
        Normal force, newtons.
    a : float
        Hertz's radius, metres.

    Notes
    -----
    Least squares with the errors of both variables, outliers down-weighted. Errors are taken to be
    shared by all frames of a ring (smoothing, reference image) and by neighbouring rings.
    """
    r = np.asarray(radii, dtype=np.float64)
    inner = r < INNER * a
    given = (np.atleast_2d(np.asarray(v, dtype=np.float64)) for v in (ux, ux_sd, sigma, sigma_sd))
    u, u_sd, s, s_sd = (field[:, inner] for field in given)
    force = np.broadcast_to(np.asarray(P, dtype=np.float64), len(u))[:, None]
    p = hertz.pressure(r[inner], 1.0, a) * force
    ratio, ratio_sd = s / p, s_sd / p
    good = np.isfinite(u) & np.isfinite(ratio) & (u_sd > 0) & (ratio_sd > 0)
    slip, ratio = np.where(good, u, np.nan), np.where(good, ratio, np.nan)
    bins = [b for b in np.array_split(np.flatnonzero(good)[np.argsort(slip[good])], BINS) if b.size]
    bin_slip, bin_ratio = (np.array([np.median(v.ravel()[b]) for b in bins]) for v in (slip, ratio))
    from_median = [ratio.ravel()[b] - m for b, m in zip(bins, bin_ratio, strict=True)]
    bin_sd = np.array([robust_sd(values) for values in from_median])
    curve = MasterCurve(r[inner], slip, ratio, bin_slip, bin_ratio, bin_sd)
    frames = good.any(axis=1).sum()
    if frames < FEWEST or not inner.any():
        why = f"{frames} frames have a stress inside the contact; {FEWEST} or more are needed"
        return replace(curve, notes=(f"master curve: {why}",))
    x, y = np.where(good, u, 0.0), np.where(good, ratio, 0.0)
    top = bin_ratio[-3:].mean()
    theta = np.log([top, np.interp(0.63 * top, bin_ratio, bin_slip) / top])
    for _ in range(ROUNDS):
        mu, L = np.exp(theta)
        t = np.maximum(x, 0.0) / (mu * L)
        decay = np.exp(-t)
        root = np.where(good, 1 / np.sqrt(ratio_sd**2 + (decay / L * u_sd) ** 2), 0.0)
        e = (y - np.where(x < 0, x / L, mu * (1 - decay))) * root
        scale = max(1.0, robust_sd(e[good]))
        weight = huber(e / scale)
        J = np.stack([mu * (1 - decay - t * decay) * root, -mu * t * decay * root])
        H = np.einsum("aij,bij,ij->ab", J, J, weight)
        step = np.linalg.solve(H, np.einsum("aij,ij,ij->a", J, weight, e))
        theta = theta + np.clip(step, -0.3, 0.3)
        if np.abs(step).max() < 1e-6:
            break
    scores = _neighbouring(np.einsum("aij,ij,ij->ja", J, weight, e))
    sd = np.sqrt(np.diag(np.linalg.solve(H, np.linalg.solve(H, scores).T)))
    if not (sd < LOST[:2]).all():
        why = f"mu and L come out within {sd[0]:.0%} and {sd[1]:.0%} only; drive further"
        return replace(curve, notes=(f"master curve: {why}",))
    (mu, L), (mu_sd, L_sd) = np.exp(theta).tolist(), (np.exp(theta) * sd).tolist()
    outliers = float(np.mean(np.abs(e[good]) > OUTLYING * scale))
    note = f"{int(good.sum())} points at {int(inner.sum())} radii below {INNER:g} a"
    return replace(
        curve,
        mu=mu,
        mu_sd=mu_sd,
        L=L,
        L_sd=L_sd,
        stiffness=p.mean(axis=0) / L,
        outliers=outliers,
        notes=(f"master curve: {note}",),
    )


def _neighbouring(scores: F64) -> F64:
    """Covariance of the sum of the scores of rings, shape (nr, k), each of which shares errors with
    its neighbours (Newey and West).
    """
    total = scores.T @ scores
    for lag in range(1, LAGS):
        part = scores[lag:].T @ scores[:-lag]
        total += (1 - lag / LAGS) * (part + part.T)
    return np.asarray(total)
