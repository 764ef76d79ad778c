"""Local law of friction sigma = mu p (1 - exp(-s/(mu L))) from a loading run: mu, L and E by
fitting the loading solution to u_x(r) and Q.

The measured u_x at the contact, lens removed, is the law's s. The stress that goes with it is the
loading solution's for the same mu, L and E: none is inverted, and nothing is smoothed.
`master_curve` draws the law as the paper does.

References
----------
Prevost et al. 2013, section 6; Bureau et al. 2003.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from analysis.arrays import F64
from analysis.friction.stick import correlation_factor, seen_in_rings
from analysis.mechanics import hertz
from analysis.mechanics.interface import elastic_length
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from analysis.robust import robust_sd

FEWEST = 12  # frames
REACH = 1.5  # of a: the displacement is compared up to there
STATES = 32  # of the table that is interpolated in D: 64 change mu by 3e-6, L by 2e-5
STIFFEST = 1e-4  # of a: an L below which the fit may run away towards 0
ROUNDS = 15
HUBER = 2.5  # standard deviations from which a residual counts less
STEPS = np.array([0.01, 0.03, 0.01])  # of the logarithms of mu, L and E, for derivatives
SMALL, AT_REST = 0.05, 1e-3  # steps after which derivatives hardly change, and the last one
FURTHEST = np.array([1.5, 3.0, 1.0])  # from the first guess of these logarithms
# a prior of 10 in each logarithm: what is not measured at all comes out as uncertain as that
WEAK = 0.01
# of the noise of Q, and of Q: the fit meets the forces within one of these, or gives no result
FORCE_OFF = (5.0, 0.05)
LOST = (0.1, 0.5, 0.1)  # relative uncertainties of mu, L and E from which there is no result


@dataclass(frozen=True, slots=True)
class LocalLaw:
    """Interface and modulus for which the loading solution meets the measured displacements and
    forces. NaN where they can not be determined; `notes` then gives the reason.

    Attributes
    ----------
    mu, mu_sd : float
        Friction coefficient.
    L, L_sd, h, h_sd : float
        Elastic length and the roughness that it stands for, ``L = (2 - nu)/(2 (1 - nu)) h``,
        metres.
    E, E_sd : float
        Young's modulus, pascals.
    D : ndarray, shape (nt,)
        Displacement of the block far away in each frame, metres; NaN in frames without a
        measurement.
    reduced_chi2 : float
        Per degree of freedom, outliers clipped.
    notes : tuple of str
        What the numbers rest on, or why there are none.
    """

    mu: float = np.nan
    mu_sd: float = np.nan
    L: float = np.nan
    L_sd: float = np.nan
    h: float = np.nan
    h_sd: float = np.nan
    E: float = np.nan
    E_sd: float = np.nan
    D: F64 | None = None
    reduced_chi2: float = np.nan
    notes: tuple[str, ...] = ()


def displacement_in_rings(
    state: LoadingState, r: ArrayLike, box: float = 0.0, width: float = 0.0
) -> F64:
    """Mean of u_x over rings in a state of the loading solution, metres, as measured with boxes and
    rings of a given size; shape of `r`.
    """
    return np.asarray(state.D - seen_in_rings(lambda at: state.displacement(at)[0], r, box, width))


def fit_local_law(
    radii: ArrayLike,
    ux: ArrayLike,
    ux_sd: ArrayLike,
    P: ArrayLike,
    Q: ArrayLike,
    *,
    E: float,
    nu: float,
    R: float,
    Q_sd: float = 1e-3,
    thickness: float = math.inf,
    box: float = 0.0,
    width: float = 0.0,
) -> LocalLaw:
    """mu, L and E for which the loading solution meets u_x(r) and Q in all frames, the block's
    displacement in each frame unknown.

    Parameters
    ----------
    radii : array_like, shape (nr,)
        Metres.
    ux, ux_sd : array_like, shape (nt, nr)
        Ring means of u_x since the start of a first loading, lens removed, and their standard
        errors, metres. NaN where not measured.
    P, Q : array_like, shape (nt,)
        Normal and shear force, newtons; P should be constant: its median is used.
    E : float
        First guess of Young's modulus, pascals, within 30 % or so.
    nu, R : float
        Poisson's ratio, and the sphere's radius (m).
    Q_sd : float
        Noise of the shear force, newtons.
    thickness : float
        Of the block on its rigid plate, metres.
    box, width : float
        Side of the correlation boxes and width of the rings, metres.

    Notes
    -----
    Q fixes mu, the shape of u_x the modulus, and the displacement at the centre L. Rings within 1.5
    a are compared, with the noise of the typical frame. Half of its variance is the reference
    image's, shared by all frames, and neighbouring rings share that of overlapping boxes: the
    uncertainty, widened to the scatter of the residuals, is that of errors shared so.
    """
    r, force = np.asarray(radii, dtype=np.float64), np.asarray(Q, dtype=np.float64)
    load = float(np.nanmedian(np.asarray(P, dtype=np.float64)))
    if not load > 0:
        return _no_law(
            f"a normal force of {load:.3g} N was measured; without contact there is no friction"
        )
    a = hertz.contact_radius(load, E, nu, R)
    near = r < REACH * a
    r, u = r[near], np.asarray(ux, dtype=np.float64)[:, near]
    u_sd = np.asarray(ux_sd, dtype=np.float64)[:, near]
    measured = np.isfinite(u) & (u_sd > 0)
    seen = measured.mean(axis=0) > 0.5
    frames = np.isfinite(force) & (2 * measured[:, seen].sum(axis=1) > max(seen.sum(), 1))
    if frames.sum() < FEWEST or seen.sum() < FEWEST:
        return _no_law(
            f"{frames.sum()} frames and {seen.sum()} rings were measured; {FEWEST} or more are"
            " needed"
        )
    top = float(np.max(force[frames]))
    if not top > 10 * Q_sd:
        return _no_law(
            f"the shear force reached {top:.3g} N at most, with a noise of {Q_sd:.2g} N; drive"
            " further"
        )
    both = np.ix_(frames, seen)
    r, u, u_sd, measured = r[seen], u[both], u_sd[both], measured[both]
    noise = np.sqrt(np.nanmedian(np.where(measured, u_sd, np.nan) ** 2, axis=0))
    data = np.column_stack([np.where(measured, u, 0.0), force[frames]])
    root = np.column_stack([measured / noise, np.full(len(u), 1 / Q_sd)])
    fit = _Fit(data, root, load, nu, R, thickness, r, box, width)
    found = fit.run(np.log([top / load, elastic_length(1e-6, nu), E]))
    mu, L, modulus = np.exp(found.theta).tolist()
    mu_sd, L_sd, E_sd = (np.exp(found.theta) * found.sd).tolist()
    if not math.isfinite(found.off) and STIFFEST * a > L:
        return _no_law(
            f"L is below {STIFFEST * a * 1e6:.2g} um, too short to be determined: the interface"
            " looks like Cattaneo and Mindlin's"
        )
    if not found.off * Q_sd < max(FORCE_OFF[0] * Q_sd, FORCE_OFF[1] * top):
        why = f"Q is {found.off * Q_sd:.2g} N off"
        return _no_law(
            "displacements and forces do not go together"
            f" ({why if math.isfinite(found.off) else 'the fit has not settled'}); check E, P and"
            " the zero of Q"
        )
    if not (found.sd < LOST).all():
        return _no_law(
            f"mu, L, E come out within {', '.join(f'{v:.0%}' for v in found.sd)} only; drive until"
            " it slides"
        )
    D = np.full(len(frames), np.nan)
    D[frames] = found.D
    rough = elastic_length(1.0, nu)
    note = (
        f"local law: {int(frames.sum())} frames, {len(r)} rings within {REACH:g} a; Q met within"
        f" {found.off * Q_sd * 1e3:.2g} mN"
    )
    return LocalLaw(
        mu=mu,
        mu_sd=mu_sd,
        L=L,
        L_sd=L_sd,
        h=L / rough,
        h_sd=L_sd / rough,
        E=modulus,
        E_sd=E_sd,
        D=D,
        reduced_chi2=found.chi2,
        notes=(note,),
    )


def _no_law(reason: str) -> LocalLaw:
    return LocalLaw(notes=(f"local law: {reason}",))


class _Loading:
    """u_x in rings, and Q in the last column, as smooth functions of the block's D."""

    def __init__(self, contact: SphereContact, r: F64, box: float, width: float) -> None:
        # there exp(-10) of the interface is still to slip
        furthest = contact.full_shift + 10 * contact.mu * contact.L
        states = AxisymmetricLoading(contact).table(STATES, furthest)
        rows = [np.append(displacement_in_rings(s, r, box, width), s.Q) for s in states]
        self.furthest = states[-1].D
        self._of_D = CubicSpline([s.D for s in states], np.array(rows))
        self._slope = self._of_D.derivative()
        self._sliding = np.append(np.ones(len(r)), 0.0)

    def at(self, D: F64) -> F64:
        """Shape (nt, nr + 1)."""
        beyond = np.maximum(D - self.furthest, 0.0)[:, None]
        return np.asarray(self._of_D(np.minimum(D, self.furthest)) + beyond * self._sliding)

    def slope(self, D: F64) -> F64:
        """Derivative by D, shape (nt, nr + 1)."""
        slope = self._slope(np.minimum(D, self.furthest))
        return np.where((self.furthest > D)[:, None], slope, self._sliding)


class _Fitted(NamedTuple):
    """The outcome of a fit."""

    theta: F64  # logarithms of mu, L and E
    sd: F64  # their standard uncertainties
    D: F64  # (nt,) metres
    chi2: float  # per degree of freedom
    off: float  # how far off Q is, in its noise; infinite where the fit has not settled


@dataclass(frozen=True)
class _Fit:
    """Least squares in (ln mu, ln L, ln E), every frame at its own best D."""

    data: F64  # (nt, nr + 1)
    root: F64  # of the weights
    P: float
    nu: float
    R: float
    thickness: float
    r: F64
    box: float
    width: float

    def _loading(self, theta: F64) -> _Loading:
        mu, L, E = np.exp(theta).tolist()
        contact = SphereContact(self.P, E, self.nu, self.R, mu, L, self.thickness)
        return _Loading(contact, self.r, self.box, self.width)

    def run(self, start: F64) -> _Fitted:
        """The best fit near a first guess of the logarithms."""
        theta, loading = start, self._loading(start)
        D, scale, step = self._nearest(loading), 50.0, np.ones(3)
        for _ in range(ROUNDS):
            D = self._followed(loading, D, scale)
            e, t = self._miss(loading, D), loading.slope(D) * self.root
            scale = max(1.0, robust_sd(e[self.root > 0]))
            weight = huber(e / scale)
            if np.abs(step).max() > SMALL:
                slopes = self._slopes(theta, loading.at(D), D)
            along_D = (weight * t * slopes).sum(axis=2) / (weight * t * t).sum(axis=1)
            J = slopes - t * along_D[:, :, None]  # D follows
            H = np.einsum("aij,bij,ij->ab", J, J, weight) + WEAK * np.eye(3)
            if np.abs(step).max() < AT_REST:
                break
            step = np.clip(np.linalg.solve(H, np.einsum("aij,ij,ij->a", J, weight, e)), -0.5, 0.5)
            theta = np.clip(theta + step, start - FURTHEST, start + FURTHEST)
            loading = self._loading(theta)
        freedom = np.count_nonzero(self.root) - len(D) - 3
        off = robust_sd(e[:, -1]) if np.abs(step).max() < AT_REST else np.inf
        e = weight * e
        chi2 = float((e * e).sum() / freedom)
        wide = max(1.0, chi2) * correlation_factor(e[:, :-1])
        rings, force = (weight * J)[:, :, :-1], (weight * J)[:, :, -1]
        own, common = np.einsum("aij,bij->ab", rings, rings), rings.sum(axis=1)
        meat = wide / 2 * (own + common @ common.T) + force @ force.T + WEAK * np.eye(3)
        covariance = np.linalg.solve(H, np.linalg.solve(H, meat).T)
        return _Fitted(theta, np.sqrt(np.diag(covariance)), D, chi2, off)

    def _slopes(self, theta: F64, base: F64, D: F64) -> F64:
        """Derivatives by the logarithms at constant D, in the noise, shape (3, nt, nr + 1)."""
        moved = ((self._loading(theta + d).at(D) - base) / d.sum() for d in np.diag(STEPS))
        return np.array([slope * self.root for slope in moved])

    def _miss(self, loading: _Loading, D: F64) -> F64:
        return (self.data - loading.at(D)) * self.root

    def _nearest(self, loading: _Loading) -> F64:
        """The best D of each frame among a thousand."""
        grid = np.linspace(0, loading.furthest, 1000)
        table, square = loading.at(grid), self.root**2
        chi2 = square @ (table * table).T - 2 * (square * self.data) @ table.T
        return np.asarray(grid[np.argmin(chi2, axis=1)])

    def _followed(self, loading: _Loading, D: F64, scale: float) -> F64:
        """The best D of each frame near the given ones."""
        for _ in range(5):
            e, t = self._miss(loading, D), loading.slope(D) * self.root
            weight = huber(e / scale)
            D = np.maximum(D + (weight * t * e).sum(axis=1) / (weight * t * t).sum(axis=1), 0.0)
        return D


def huber(e: F64) -> F64:
    """Weights of residuals in standard deviations: 1 up to `HUBER`, then falling as their inverse
    (Huber 1964).
    """
    return np.asarray(1 / np.maximum(1.0, np.abs(e) / HUBER))
