"""Young's modulus and work of adhesion from the radius of a smooth contact against the load: the
test of Johnson, Kendall and Roberts (paper, section 2.2).

In y = a^(3/2) the theory is a parabola, ``P = A y^2 - B y`` with ``A = 4 E*/(3 R)`` and
``B = sqrt(8 pi w E*)``: Hertz's contact less what adhesion pulls. E is that of both branches; w is
larger where the contact opens, which is the hysteresis of adhesion.

References
----------
Johnson, Kendall, Roberts 1971; Chaudhury, Whitesides 1991 (the linear form P/y against y);
Prevost et al. 2013, section 2.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import special
from scipy.optimize import least_squares

from analysis.arrays import F64, Bool, in_step
from analysis.mechanics import hertz, jkr
from analysis.robust import robust_sd, serial_inflation

MIN_LOADS = 6  # of the loading, and of an unloading that is used
LEAST_RANGE = 1.25  # of the largest radius over the least: else Hertz's share is not told from w's
LARGEST_E_SD = 0.1  # relative, by the scatter of the radii alone
OUTLYING = 5.0  # robust standard deviations
LARGEST_OUTLYING_SHARE = 0.2
LEAST_TABOR = 5.0
WRONG = 4.0  # standard uncertainties from which a sign is wrong, or two values differ
NOISIER = 2.0  # than stated, from which this is told
UNLIKELY = 1e-4  # probability of the misfit of both branches where that of one is chance
ROUNDS = 12
NEWTON_STEPS = 4
ROUNDING = 1e-6  # of a standard deviation: what is left of exact points shows no correlation


@dataclass(frozen=True, slots=True)
class AdhesionTest:
    """The result of a JKR test; SI units.

    Attributes
    ----------
    E, E_sd : float
        Young's modulus in pascals, and its standard uncertainty by everything that was stated.
    E_scatter_sd : float
        Its part by the scatter of radii and loads.
    w, w_sd : float
        Work of adhesion in J/m^2 of the loading.
    E_w_covariance : float
        Of E and w, Pa J/m^2.
    w_unloading, w_unloading_sd : float
        That of the unloading; NaN where it was not measured.
    hysteresis, hysteresis_sd : float
        w of the unloading less that of the loading; NaN as above.
    w_pull_off : float
        By the force at which the contact tore; NaN where that is not given.
    tabor : float
        Tabor's parameter: the theory holds above about 5.
    residual_m : ndarray, shape (n,)
        Measured radius less that of the fit; NaN for a point that was left out.
    misfit : float
        Residuals over what was stated of them, rms; 1 where both agree.
    outliers : int
        Number of points left out.
    notes : tuple of str
        What a reader should know.
    """

    E: float
    E_sd: float
    E_scatter_sd: float
    w: float
    w_sd: float
    E_w_covariance: float
    w_unloading: float
    w_unloading_sd: float
    hysteresis: float
    hysteresis_sd: float
    w_pull_off: float
    tabor: float
    residual_m: F64
    misfit: float
    outliers: int
    notes: tuple[str, ...]


def adhesion_test(
    a: ArrayLike,
    P: ArrayLike,
    R: float,
    nu: float,
    *,
    a_sd: ArrayLike,
    P_sd: ArrayLike,
    unloading: ArrayLike | None = None,
    zero_sd: float = 1e-3,
    edge_sd: float = 0.0,
    relative_sd: tuple[float, float, float] = (0.0, 0.0, 0.0),
    nu_sd: float = 0.0,
    pull_off: float = math.nan,
) -> AdhesionTest:
    """Young's modulus and work of adhesion of a smooth contact.

    Parameters
    ----------
    a, P : array_like, shape (n,)
        Contact radius (m) and normal force (N), negative where it pulls, in the order in which they
        were measured; points with a NaN are left out.
    R, nu : float
        Radius of the sphere (m) and Poisson's ratio of the block.
    a_sd, P_sd : float or array_like, shape (n,)
        Standard uncertainties of each radius (m) and force (N) by noise.
    unloading : array_like of bool, shape (n,), optional
        Which points were measured while the load fell; default: those after the greatest load.
    zero_sd : float
        Of the zero of the force, newtons, which all points share.
    edge_sd : float
        Of the place of the contact's edge in the picture, metres, which all radii share.
    relative_sd : (float, float, float)
        Relative standard uncertainties of the sphere's radius, of the scale of the picture, and of
        the scale of the force.
    nu_sd : float
        Of Poisson's ratio. The test determines E/(1 - nu^2).
    pull_off : float, optional
        Force at which the contact tore, newtons, below 0.

    Raises
    ------
    ValueError
        Too few loads or too narrow a range, radii that do not grow with the load, that are smaller
        than Hertz's or that follow no JKR contact, an unloading that follows none with the E of the
        loading or adheres less, or a zero of the force that is not the one stated.

    Notes
    -----
    A least-squares fit in a and P: each point has its own place on the curve. Zero and edge are
    parameters held by what is known of them. Outlying points are left out. A drift of the force by
    much more than its zero is known shows in the unloading only: alone, a loading hides it.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> P = np.linspace(0.0, 0.5, 12)
    >>> a = analysis.jkr.contact_radius(P, 0.05, 3.43e6, 0.5, 0.1288)
    >>> found = analysis.adhesion_test(a, P, 0.1288, 0.5, a_sd=1e-6, P_sd=1e-4)
    >>> round(found.E * 1e-6, 3), round(found.w, 4), found.misfit < 1e-3
    (3.43, 0.05, True)
    """
    hertz.check("adhesion", R=R, nu=nu)
    columns = in_step("adhesion", a=a, P=P, a_sd=a_sd, P_sd=P_sd)
    radius, force, radius_sd, force_sd = map(np.ravel, columns)
    known = np.isfinite(radius) & np.isfinite(force)
    sds = np.append(radius_sd[known], force_sd[known])
    if not np.all((sds > 0) & (sds < np.inf)):
        raise ValueError(
            "adhesion: a standard uncertainty that is no finite number above 0 was found; give"
            " those of each radius and force"
        )
    if unloading is None:
        last = int(np.nanargmax(np.where(known, force, -np.inf))) if known.any() else 0
        falls = np.arange(len(force)) > last
    else:
        falls = np.broadcast_to(np.asarray(unloading, dtype=np.bool_), force.shape)
    points = _Points(radius, force, radius_sd, force_sd, falls, R, zero_sd, edge_sd)
    _check_loading(points, known & ~falls)
    notes: list[str] = []
    used = known
    if 0 < np.count_nonzero(known & falls) < MIN_LOADS:
        used = known & ~falls
        notes.append(
            f"adhesion: {np.count_nonzero(known & falls)} points of the unloading are left out,"
            f" {MIN_LOADS} are needed"
        )
    elif np.any(known & falls):
        _check_order(points, known & falls, "unloading")
    fit = _fitted(points, used)
    if np.any(used & falls):
        alone = _fitted(points, used & ~falls)
        apart = abs(fit.A - alone.A) / max(math.hypot(alone.sd(0), fit.sd(0)), 1e-300)
        if _worse(fit, alone) < UNLIKELY or apart > WRONG:
            raise ValueError(
                "adhesion: the unloading does not follow the JKR contact of the loading (E of the"
                f" loading alone {_modulus(alone, R, nu) * 1e-6:.3g} MPa, of both"
                f" {_modulus(fit, R, nu) * 1e-6:.3g} MPa): the force drifts, or the contact is"
                " pinned or creeps; unload more slowly, or give the loading alone if the force is"
                " known not to drift"
            )
    return _result(points, fit, nu, relative_sd, nu_sd, pull_off, known, notes)


@dataclass(frozen=True, slots=True)
class _Points:
    a: F64
    P: F64
    a_sd: F64
    P_sd: F64
    falls: Bool
    R: float
    zero_sd: float
    edge_sd: float


@dataclass(frozen=True, slots=True)
class _Fit:
    """Parameters A, B of the loading, B of the unloading, and their covariance."""

    values: F64
    covariance: F64
    shared: F64  # zero and edge, in what was stated of them
    conflicts: F64  # of what the points say of them with what was stated, in sds
    residual: F64  # in a, shape of the points, NaN: not used
    misfit: float
    freedom: int
    outliers: int
    is_unloaded: bool

    @property
    def A(self) -> float:
        return float(self.values[0])

    def sd(self, i: int) -> float:
        return math.sqrt(self.covariance[i, i])


def _worse(both: _Fit, alone: _Fit) -> float:
    """Probability that the unloading adds so much to the misfit of the loading by chance."""
    more = both.freedom - alone.freedom
    added = both.misfit**2 * both.freedom - alone.misfit**2 * alone.freedom
    if alone.misfit <= 1:  # as stated
        return float(special.chdtrc(more, max(added, 0.0)))
    return float(special.fdtrc(more, alone.freedom, max(added / more, 0.0) / alone.misfit**2))


def _modulus(fit: _Fit, R: float, nu: float) -> float:
    return 0.75 * R * fit.A * (1 - nu**2)


def _check_loading(points: _Points, chosen: Bool) -> None:
    count = int(np.count_nonzero(chosen))
    if count < MIN_LOADS:
        raise ValueError(
            f"adhesion: {count} loads of the loading have a radius; {MIN_LOADS} or more are needed"
        )
    least, most = points.a[chosen].min(), points.a[chosen].max()
    if not 0 < least <= most < points.R / 2:
        raise ValueError(
            f"adhesion: radii from {least:.3g} to {most:.3g} m were found for a sphere of R ="
            f" {points.R:.3g} m; give those of the contact in m"
        )
    ratio = float(most / least)
    if ratio < LEAST_RANGE:
        raise ValueError(
            f"adhesion: the radii of the loading span a factor of {ratio:.3g}; load from the least"
            f" to the greatest force so that it is {LEAST_RANGE:g} or more"
        )
    _check_order(points, chosen, "loading")


def _check_order(points: _Points, chosen: Bool, branch: str) -> None:
    """Refuse radii that do not grow with the load, but for single outliers."""
    order = np.argsort(points.P[chosen], kind="stable")
    a, sd, P = (v[chosen][order] for v in (points.a, points.a_sd, points.P))
    slope = np.gradient(a, P) if np.all(np.diff(P) > 0) else np.ptp(a) / max(np.ptp(P), 1e-300)
    off = np.hypot(sd, np.abs(slope) * points.P_sd[chosen][order])
    falling = np.diff(a) < -WRONG * np.hypot(off[1:], off[:-1])
    rising = np.corrcoef(a, P)[0, 1]
    if not rising > 0.7 or np.count_nonzero(falling) > max(1, LARGEST_OUTLYING_SHARE * len(a)):
        raise ValueError(
            f"adhesion: the radii of the {branch} do not grow with the load (correlation"
            f" {rising:.2f}); check the sign of the force, the branch of each point and the"
            " uncertainties of the radii"
        )


def _fitted(points: _Points, chosen: Bool) -> _Fit:
    keep = chosen.copy()
    noise = 1.0
    for _ in range(ROUNDS):
        # noise that was stated much too small would decide on zero and edge, too
        noisy = replace(points, a_sd=noise * points.a_sd, P_sd=noise * points.P_sd)
        fit = _least_squares(noisy, keep)
        misfit = noise * fit.misfit
        off = noise * _distance(noisy, np.append(fit.values, fit.shared))
        scale = max(1.0, robust_sd(off[keep]))
        before, keep = (noise, keep), chosen & (np.abs(off) < OUTLYING * scale)
        noise = misfit if misfit > NOISIER else 1.0
        if np.array_equal(before[1], keep) and abs(noise / before[0] - 1) < 0.05:
            break
    outliers = int(np.count_nonzero(chosen & ~keep))
    if outliers > LARGEST_OUTLYING_SHARE * np.count_nonzero(chosen):
        raise ValueError(
            f"adhesion: {outliers} of {np.count_nonzero(chosen)} points lie far from any JKR"
            " contact; check the pictures and the uncertainties of the radii"
        )
    residual = np.where(keep, fit.residual, np.nan)
    return replace(fit, residual=residual, outliers=outliers, misfit=misfit)


def _least_squares(points: _Points, keep: Bool) -> _Fit:
    y = points.a[keep] ** 1.5
    falls = points.falls[keep]
    is_unloaded = bool(falls.any())
    columns = [y * y, -y * ~falls, -y * falls][: 2 + is_unloaded]
    rough = points.P_sd[keep] + points.a_sd[keep] / points.a[keep] * np.ptp(points.P[keep])
    start = np.linalg.lstsq(np.transpose(columns) / rough[:, None], points.P[keep] / rough)[0]
    largest = max(np.abs(start[1:]).max(), 1)
    size = np.concatenate([np.abs(start[:1]), np.full(len(start) - 1, largest), [1.0, 1.0]])
    start = np.append(start, [0.0, 0.0])

    def off(values: F64) -> F64:
        full = _filled(values * size, is_unloaded)
        return np.append(_distance(points, full)[keep], values[-2:])

    found = least_squares(off, start / size)
    if not found.success:
        raise ValueError(
            f"adhesion: no solution after {found.nfev} trials; check the radii and loads"
        )
    freedom = max(int(keep.sum()) - len(start) + 2, 1)
    distances = found.fun[:-2]
    misfit = math.sqrt(float(distances @ distances) / freedom)
    widened = max(1.0, misfit**2)
    if freedom >= MIN_LOADS and misfit > ROUNDING:
        widened *= _slow(distances, freedom)
    # what is known beforehand of zero and edge is not made worse by the scatter of the points
    jac = found.jac.copy()
    jac[:-2] /= math.sqrt(widened)
    covariance = np.linalg.inv(jac.T @ jac) * np.outer(size, size)
    values = _filled(found.x * size, is_unloaded)
    # the estimate differs from 0, what was stated, by 1 less its own variance
    resolved = 1 - np.diag(np.linalg.inv(found.jac.T @ found.jac))[-2:]
    conflicts = values[-2:] / np.sqrt(np.maximum(resolved, 1e-6))
    keep_rows = [0, 1, 2] if is_unloaded else [0, 1, 1]
    covariance = covariance[np.ix_(keep_rows, keep_rows)]
    _, residual = _placed(points, values)
    shared = values[-2:]
    return _Fit(
        values[:3], covariance, shared, conflicts, residual, misfit, freedom, 0, is_unloaded
    )


def _slow(distances: F64, freedom: int) -> float:
    """Factor of the variance by errors that neighbours share, beyond what chance makes of white
    ones.
    """
    r = 1 - 1 / max(1.0, serial_inflation(distances) / 2 + 0.5)  # their correlation
    return serial_inflation(distances) if r > 2 / math.sqrt(freedom) else 1.0


def _filled(values: F64, is_unloaded: bool) -> F64:
    """A, B of loading, B of unloading, zero and edge in their sds."""
    return values if is_unloaded else np.insert(values, 2, values[1])


def _placed(points: _Points, values: F64) -> tuple[F64, F64]:
    """Each point's best place on the curve less its measured radius, with the opposite sign: (force
    off, radius off).
    """
    A, loading, opening, zero, edge = values.tolist()
    B = np.where(points.falls, opening, loading)
    measured = points.a - edge * points.edge_sd
    force = points.P - zero * points.zero_sd
    at = measured.copy()
    for _ in range(NEWTON_STEPS):  # the nearest point, in units of both uncertainties
        at = np.maximum(at, 1e-9)
        y = at**1.5
        model, slope = A * y * y - B * y, 3 * A * at * at - 1.5 * B * np.sqrt(at)
        curve = force - model + slope * at  # the tangent
        weight = (slope / points.P_sd) ** 2 + 1 / points.a_sd**2
        at = (slope * curve / points.P_sd**2 + measured / points.a_sd**2) / weight
    at = np.maximum(at, 1e-9)
    y = at**1.5
    return force - (A * y * y - B * y), measured - at


def _distance(points: _Points, values: F64) -> F64:
    """Signed distance of each point from the curve, in units of its uncertainties."""
    force, radius = _placed(points, values)
    sign = np.where(radius == 0, -np.sign(force), np.sign(radius))
    return sign * np.hypot(force / points.P_sd, radius / points.a_sd)


def _result(
    points: _Points,
    fit: _Fit,
    nu: float,
    relative_sd: tuple[float, float, float],
    nu_sd: float,
    pull_off: float,
    known: Bool,
    notes: list[str],
) -> AdhesionTest:
    R = points.R
    A, loading, opening = fit.values.tolist()
    if not A > 0 or fit.sd(0) > LARGEST_E_SD * A:
        raise ValueError(
            f"adhesion: E comes out as {_modulus(fit, R, nu):.3g} Pa with an uncertainty of"
            f" {fit.sd(0) / max(abs(A), 1e-300):.0%}; measure more loads over a wider range"
        )
    for what, conflict, sd, unit in zip(
        ("zero of the force", "edge of the contact"),
        fit.conflicts.tolist(),
        (points.zero_sd, points.edge_sd),
        "Nm",
        strict=True,
    ):
        if abs(conflict) > WRONG:
            raise ValueError(
                f"adhesion: the points contradict the {what}, stated to {sd:.2g} {unit}, by"
                f" {abs(conflict):.1f} standard uncertainties; zero the force while nothing"
                " touches, focus on the edge, and measure again"
            )
    for B, i in ((loading, 1), (opening, 2)):
        if fit.sd(i) * -WRONG > B:
            raise ValueError(
                "adhesion: the radii are smaller than those of Hertz's contact of any modulus"
                f" (sqrt(8 pi w E*) = {B:.3g} at an uncertainty of {fit.sd(i):.2g}); check the zero"
                " of the force, the scale of the picture and the edge of the contact"
            )
    # E* = 3 R A/4 and w = B^2/(8 pi E*); the columns are A, B of both branches, and the relative
    # errors of R, of the scale of the picture (E ~ 1/scale^3, w does not change) and of the force
    E = _modulus(fit, R, nu)
    unit = 6 * np.pi * R * A
    w, w_open = (math.copysign(B * B / unit, B) for B in (loading, opening))
    by_nu = 2 * nu / (1 - nu**2)
    slopes = np.array(
        [
            [E / A, 0.0, 0.0, E, -3 * E, E, -by_nu * E],
            [-w / A, 2 * abs(loading) / unit, 0.0, -w, 0.0, w, 0.0],
            [-w_open / A, 0.0, 2 * abs(opening) / unit, -w_open, 0.0, w_open, 0.0],
        ]
    )
    inputs = np.zeros((7, 7))
    inputs[:3, :3] = fit.covariance
    inputs[range(3, 7), range(3, 7)] = np.square([*relative_sd, nu_sd])
    covariance = slopes @ inputs @ slopes.T
    # of a square near 0: its variance does not vanish there
    bent = 2 * (np.square([fit.sd(1), fit.sd(2)]) / unit) ** 2
    covariance[[1, 2], [1, 2]] += bent
    sds = np.sqrt(np.diag(covariance))
    gap = np.array([0.0, -1.0, 1.0])
    hysteresis, hysteresis_sd = w_open - w, math.sqrt(gap @ covariance @ gap)
    if fit.is_unloaded and hysteresis < -WRONG * hysteresis_sd:
        raise ValueError(
            f"adhesion: the unloading adheres less than the loading ({w_open:.3g} and {w:.3g}"
            " J/m^2), which no contact does; the force drifts, or the branches are exchanged"
        )
    tabor = jkr.tabor_parameter(max(w, 0.0), E, nu, R)
    if loading < 2 * fit.sd(1):
        notes.append(
            f"adhesion: no adhesion is resolved (w = {w:.2g} +- {sds[1]:.2g} J/m^2); E is that of"
            " a Hertz contact"
        )
    elif tabor < LEAST_TABOR:
        notes.append(
            f"adhesion: Tabor's parameter is {tabor:.2g}, JKR holds above {LEAST_TABOR:g}; w is"
            " that of another regime"
        )
    if fit.misfit > NOISIER:
        notes.append(
            f"adhesion: the points scatter {fit.misfit:.1f} times as much as stated; the"
            " uncertainties are widened by that"
        )
    torn = -pull_off / (1.5 * np.pi * R)
    if not (math.isnan(pull_off) or torn > 0):
        raise ValueError(f"adhesion: a pull-off force of {pull_off:g} N found; give one below 0")
    E_sd, w_sd, open_sd = sds.tolist()
    if not fit.is_unloaded:
        w_open = open_sd = hysteresis = hysteresis_sd = math.nan
    return AdhesionTest(
        E=E,
        E_sd=E_sd,
        E_scatter_sd=E / A * fit.sd(0),
        w=w,
        w_sd=w_sd,
        E_w_covariance=float(covariance[0, 1]),
        w_unloading=w_open,
        w_unloading_sd=open_sd,
        hysteresis=hysteresis,
        hysteresis_sd=hysteresis_sd,
        w_pull_off=torn,
        tabor=tabor,
        residual_m=fit.residual,
        misfit=fit.misfit,
        outliers=fit.outliers,
        notes=tuple(notes),
    )
