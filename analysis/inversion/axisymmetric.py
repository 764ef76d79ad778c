"""Shear stress of a round contact from the ring means of u_x: fast enough for every frame."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, I64, Bool, as_grid, floats
from analysis.contact.rings import Rings
from analysis.inversion.geometry_checks import grid_pitch
from analysis.inversion.penalised_fit import SmoothFit, Smoothing, overlaps
from analysis.inversion.result import NOT_COVERED, NOT_SEEN, EndOfInversion, RadialInversion
from analysis.mechanics.cattaneo_mindlin import phi0
from analysis.mechanics.half_space import check_block, layer_correction
from analysis.mechanics.hertz import check
from analysis.robust import robust_sd

BASIS = 30  # terms, at least a ring's width apart
AT_A_TIME = 64  # rings
STEPS = 64  # per ring, at which the displacement under a term is computed
MIN_RINGS = 8  # some of them outside the mask
LEAST_COVERAGE = 0.25  # share of its circle that a ring must have measured
# the same, for the rings that cover the contact; the innermost have a few points each
COMPLETE = 0.6
INNERMOST = 3
# points' worth of the typical noise in each ring's: a ring of three points may agree by chance
POOLED = 20
# of the mask's radius and never under a ring's width, within which curvature at the edge is hardly
# penalised
EDGE_WIDTH = 0.02
LEAST_ERROR = 1e-12  # metres, of a ring: a field may be free of noise
OUTLYING = 4.0  # standard deviations beyond which a ring is left out
# share of the rings that may be left out; if there are more, it is the model that is wrong
MOST_WRONG = 0.05
TOO_LARGE = 4.0  # standard deviations of chi2
MIN_STRESS_SIGMAS = 4.0  # sds from which a stress stands out of the noise
# standard deviations, and share of the greatest stress, of the last two rings' stress if the mask
# cuts the contact
RIM_STRESS_SIGMAS, RIM_STRESS_SHARE = 6.0, 0.1


class AxisymmetricInversion:
    """Inverts ring means of u_x into sigma(r), Q and D. Set up once for a geometry, then `solve`
    each frame.

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,), or both (ny, nx)
        Coordinates of the measured grid from the contact's centre, metres.
    width : float
        Of the rings, metres: those of ``ring_means(r, ux, width, theta=theta)``.
    mask_radius : float
        Beyond it sigma is 0, metres.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio of the block.
    edge : float, optional
        Radius at which the stress ends steeply, Hertz's, metres: there the curvature of
        sigma is not penalised. A few per cent off is no worse than leaving it out.
    box : float
        Side of the correlation box, metres: u_x is a mean over it.
    is_quadratic : bool
        u_x is the value in the middle of the box of the quadratic that fits it best there, instead.
    noise_box : float, optional
        Distance over which points share noise, metres; default `box`. 0: independent points.
    thickness : float
        Of the block on a rigid plate, metres; default a half-space.

    Attributes
    ----------
    radius, points : ndarray, shape (n,)
        Radius of each ring, metres, and the number of points in a whole one.

    Raises
    ------
    ValueError
        No point inside the mask, too few rings outside, a grid that is not square and even, or a
        parameter out of its range.

    Notes
    -----
    sigma is a sum of terms sqrt(1 - r^2/a_k^2), whose displacement has a closed form; the sum's
    curvature is penalised. The even harmonic cos 2 theta of u_x drops out of complete rings, and of
    the fits of `ring_means` with ``theta``.

    References
    ----------
    Prevost et al. 2013, section 4 (the inversion) and Fig. 13 (angular means).
    """

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        width: float,
        mask_radius: float,
        E: float,
        nu: float,
        *,
        edge: float | None = None,
        box: float = 0.0,
        is_quadratic: bool = False,
        noise_box: float | None = None,
        thickness: float = math.inf,
    ) -> None:
        x, y = as_grid(x, y)
        pitch = grid_pitch(x, y, "axisymmetric inversion")
        check_block(thickness, box, pitch, "axisymmetric inversion")
        r = np.hypot(x, y)
        check("axisymmetric inversion", E=E, nu=nu)
        _check(r, width, mask_radius, edge)
        A = self.mask_radius = float(mask_radius)
        self.E, self.nu = float(E), float(nu)
        radii = self._radii = _basis_radii(A, edge, min(BASIS, int(A / width)))
        n = int(r.max() / width) + 1
        self.radius = floats((np.arange(n) + 0.5) * width)
        self.points = 2 * np.pi * self.radius * width / pitch**2
        scale = (1 + nu) / (np.pi * E) * (1 - nu / 2)
        green = scale * _mean_phi0(self.radius, radii, box, width, is_quadratic)
        self._green = scale * phi0(self.radius[:, None], radii)
        if math.isfinite(thickness):
            layer = 2 / 3 * np.pi * radii**2 * _layer(self.radius, radii, E, nu, thickness)
            green, self._green = green + layer, self._green + layer
        self.design = np.column_stack([np.ones(n), -green])
        self._sigma = np.column_stack([np.zeros(n), self._terms(self.radius)])
        self._force = np.concatenate([[0.0], 2 / 3 * np.pi * radii**2])
        self._totals = np.stack([np.eye(len(self._force))[0], self._force])  # D and Q
        self.penalty = np.zeros((self.design.shape[1],) * 2)
        self.penalty[1:, 1:] = self._curvature(edge, width)
        noise_box = box if noise_box is None else noise_box
        self.correlation, self.widening = _ring_correlation(r, n, width, pitch, noise_box)

    def stress(self, r: ArrayLike, coefficients: F64) -> F64:
        """Shear stress at any distance from the centre, pascals, shape of `r`, from a solution's
        coefficients.
        """
        r = floats(r)
        return np.asarray(self._terms(r.ravel()) @ coefficients).reshape(r.shape)

    def slip(self, fit: SmoothFit) -> F64:
        """u_x at the rings' radii, metres, with the averaging over boxes and rings undone."""
        return np.asarray(fit.coefficients[0] - self._green @ fit.coefficients[1:])

    def seen(self, fit: SmoothFit) -> F64:
        """u_x in the rings as the solution says that it is measured, metres."""
        return self.design @ fit.coefficients

    def traction(self, fit: SmoothFit) -> tuple[F64, F64]:
        """Shear stress in the rings and its standard uncertainty, pascals."""
        return self._sigma @ fit.coefficients, fit.sd(self._sigma)

    def force(self, fit: SmoothFit) -> tuple[float, float]:
        """Integral of the shear stress and its standard uncertainty, newtons."""
        return float(self._force @ fit.coefficients), float(fit.sd(self._totals)[1])

    @cached_property
    def correlated(self) -> F64:
        """Root of the correlation matrix of the noise of rings, shape (n, n)."""
        values, vectors = np.linalg.eigh(self.correlation)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def _terms(self, r: F64) -> F64:
        return np.sqrt(np.maximum(1 - (r[:, None] / self._radii) ** 2, 0.0))

    def _curvature(self, edge: float | None, width: float) -> F64:
        n, A = len(self._radii), self.mask_radius
        at = np.linspace(0, A, 4 * n + 1)
        terms = self._terms(at)
        bend = np.diff(np.vstack([terms[1:2], terms, np.zeros((1, n))]), 2, axis=0)
        if edge is not None:
            bend *= (np.abs(at - edge) / A + max(EDGE_WIDTH, width / A))[:, None]
        return bend.T @ bend

    def solve(self, rings: Rings) -> RadialInversion:
        """Shear stress, force and far displacement from the ring means of one field.

        Rings that are empty, or miss most of their circle, or a few that lie four standard
        deviations off the fit, are left out.

        Raises
        ------
        ValueError
            Too few rings are left to tell stress from displacement.
        """
        return InvertedRings(self, rings).solve(rings.mean)

    def result(
        self, fit: SmoothFit, residual: F64, is_covered: bool, left_out: int
    ) -> RadialInversion:
        """The result of a fit to the rings, and how far it can be trusted."""
        inside = self.radius < self.mask_radius
        b, chi2 = fit.coefficients, fit.chi2
        fits = chi2 < 1 + TOO_LARGE * math.sqrt(2 / fit.freedom)
        sigma, sigma_sd = self.traction(fit)
        D_sd, Q_sd = fit.sd(self._totals)
        rim, size = np.flatnonzero(inside)[-2:], np.abs(sigma)
        visible = np.maximum(RIM_STRESS_SIGMAS * sigma_sd[rim], RIM_STRESS_SHARE * size.max())
        cuts = bool((size[rim] > visible).any())
        stands_out = (size > MIN_STRESS_SIGMAS * sigma_sd)[inside].any()
        seen = bool(stands_out or abs(self._force @ b) > MIN_STRESS_SIGMAS * Q_sd)
        stopped = EndOfInversion.GCV if seen or not fits else EndOfInversion.SILENT
        notes = [] if is_covered else [NOT_COVERED]
        if stopped is EndOfInversion.SILENT:
            notes.append(NOT_SEEN)
        if not fits:
            notes.append(
                f"axisymmetric inversion: the residual is {math.sqrt(chi2):.2f} times the noise;"
                " widen the mask, or invert the field"
            )
        if cuts:
            notes.append(
                "axisymmetric inversion: the stress does not vanish at the mask's rim,"
                f" {self.mask_radius:.3g} m; widen the mask"
            )
        if left_out:
            notes.append(
                f"axisymmetric inversion: {left_out} rings lie off the rest and were left out"
            )
        return RadialInversion(
            radius=self.radius,
            coefficients=b[1:],
            covariance=self._sigma @ fit.covariance @ self._sigma.T,
            sigma=sigma,
            sigma_sd=sigma_sd,
            D=float(b[0]),
            D_sd=float(D_sd),
            Q=float(self._force @ b),
            Q_sd=float(Q_sd),
            residual=residual,
            chi2=chi2,
            iterations=0,
            stopped=stopped,
            is_covered=is_covered,
            is_converged=fits and seen and not cuts,
            notes=tuple(notes),
        )


class InvertedRings:
    """Inverts any means of rings with the same points and the same noise.

    Attributes
    ----------
    sd : ndarray, shape (n,)
        Standard uncertainty of the ring means, metres, NaN where there are none.
    is_covered : bool
        Whether all rings inside the mask but the innermost have most of their circle.
    """

    def __init__(self, inversion: AxisymmetricInversion, rings: Rings) -> None:
        self._inversion, self._rings = inversion, rings
        n = self.count = min(len(inversion.radius), len(rings.mean))
        self.sd, coverage = (np.full(len(inversion.radius), v) for v in (np.nan, 0.0))
        self.sd[:n] = np.maximum(_pooled(rings)[:n], LEAST_ERROR) * inversion.widening[:n]
        coverage[:n] = rings.count[:n] / inversion.points[:n]
        inside = inversion.radius < inversion.mask_radius
        self.is_covered = bool((coverage[inside][INNERMOST:] > COMPLETE).all())
        self._usable = np.isfinite(self.sd) & (coverage >= LEAST_COVERAGE)
        self._fits: dict[bytes, tuple[F64, F64, Smoothing]] = {}  # by the rings used

    def drawn_noise(self, rng: np.random.Generator) -> F64:
        """Noise of ring means as stated, neighbours sharing that of overlapping boxes; metres."""
        noise = self._inversion.correlated @ rng.standard_normal(len(self.sd))
        return np.asarray((noise * np.nan_to_num(self.sd))[: self.count])

    def fits(self, rings: Rings) -> bool:
        """Whether other rings have the same points and the same noise."""
        known = self._rings
        return np.array_equal(known.count, rings.count) and np.array_equal(
            known.standard_error, rings.standard_error, equal_nan=True
        )

    def solve(self, mean: F64) -> RadialInversion:
        """As `AxisymmetricInversion.solve`, of other means of the rings, metres."""
        fit, residual, left_out = self.fit(mean)
        return self._inversion.result(fit, residual, self.is_covered, left_out)

    def fit(self, mean: F64) -> tuple[SmoothFit, F64, int]:
        """The fit to means of the rings (m), the residual of each, and how many were left out."""
        u = np.full(len(self.sd), np.nan)
        u[: self.count] = mean[: self.count]
        used = np.isfinite(u) & self._usable
        measured = int(used.sum())
        for _ in range(2):
            weight, X, smoothing = self._weighted(used)
            y = np.where(used, u, 0.0) * weight
            fit = smoothing.fit(X.T @ y, float(y @ y))
            residual = u - self._inversion.design @ fit.coefficients
            size = np.where(used, np.abs(residual) * weight, 0.0)
            if size.max() < OUTLYING:  # no ring is out of line: spare the median
                break
            wrong = size > OUTLYING * max(1.0, robust_sd(size[used]))
            if wrong.sum() > MOST_WRONG * measured:
                break
            used &= ~wrong
        return fit, residual, measured - int(used.sum())

    def _weighted(self, used: Bool) -> tuple[F64, F64, Smoothing]:
        """Weights of some of the rings, the weighted basis and its smoothing."""
        if (known := self._fits.get(used.tobytes())) is not None:
            return known
        inversion, count = self._inversion, int(used.sum())
        inside = int((used & (inversion.radius < inversion.mask_radius)).sum())
        outside = count - inside
        if inside < 3 or outside < 3 or count < MIN_RINGS:
            raise ValueError(
                f"axisymmetric inversion: {inside} rings inside the mask and {outside} outside"
                " were measured; 3 or more are needed on either side"
            )
        weight = np.where(used, 1 / self.sd, 0.0)
        X = inversion.design * weight[:, None]
        shared = X.T @ (inversion.correlation @ X)
        smoothing = Smoothing(X.T @ X, shared, inversion.penalty, count)
        found = self._fits[used.tobytes()] = (weight, X, smoothing)
        return found


def _check(r: F64, width: float, mask_radius: float, edge: float | None) -> None:
    why = ""
    if not (width > 0 and mask_radius > 3 * width):
        why = (
            f"a mask of {mask_radius:g} m and rings of {width:g} m were given; use 3 rings or more"
        )
    elif not r.min() < mask_radius:
        why = (
            f"the field begins {r.min():.3g} m from the centre, and the mask ends at"
            f" {mask_radius:g} m; check the centre"
        )
    elif not r.max() > mask_radius + 3 * width:
        why = (
            f"the field reaches {r.max():g} m from the centre and the mask {mask_radius:g} m;"
            " points outside the mask are needed for D"
        )
    elif edge is not None and not 0 < edge < mask_radius:
        why = f"an edge at {edge:g} m was given; use one inside the mask of {mask_radius:g} m"
    if why:
        raise ValueError(f"axisymmetric inversion: {why}")


def _basis_radii(A: float, edge: float | None, n: int) -> F64:
    """Radii of n terms, evenly spaced up to the mask's; one of them is the edge."""
    if edge is None:
        return np.linspace(0, A, n + 1)[1:]
    inner = min(max(round(n * edge / A), 1), n - 1)
    within, beyond = np.linspace(0, edge, inner + 1), np.linspace(edge, A, n - inner + 1)
    return np.concatenate([within[1:], beyond[1:]])


def _mean_phi0(r: F64, radii: F64, box: float, width: float, is_quadratic: bool) -> F64:
    """Phi0 of each term, averaged over the box, over the azimuth and over the ring's width; shape
    (rings, terms). With `is_quadratic` the value of its least-squares quadratic in the middle of
    the box takes the place of the mean over it.
    """
    t, w = _gauss(4)
    tx, wx = _gauss(6 if is_quadratic else 4)
    turn = np.pi / 4 * (np.arange(4) + 0.5) / 4
    angle, dr, dx, dy = (v.reshape(-1, 1) for v in np.meshgrid(turn, t, tx, tx, indexing="ij"))
    weight = np.multiply.outer(np.multiply.outer(np.full(4, 1 / 4), w), np.outer(wx, wx)).ravel()
    if is_quadratic:
        # 3.5 (1 - 15/14 (X^2 + Y^2)) on a box from -1 to 1: its mean is 1, and it has no second
        # moments
        weight *= (3.5 - 15.0 * (dx**2 + dy**2)).ravel()
    mean = np.empty((r.size, radii.size))
    for some in (slice(k, k + AT_A_TIME) for k in range(0, r.size, AT_A_TIME)):
        along, across = (
            (r[some] + dr * width) * way + offset * box
            for way, offset in ((np.cos(angle), dx), (np.sin(angle), dy))
        )
        at, shares = _interpolation(np.hypot(along, across) / (width / STEPS), weight)
        mean[some] = shares @ phi0(width / STEPS * at[:, None], radii)
    return mean


def _interpolation(at: F64, weight: F64) -> tuple[I64, F64]:
    """Whole numbers around the places of each ring, shape (places, rings), and the share of the
    value at each of them in the weighted sum over the places, (rings, numbers), by cubic
    interpolation.
    """
    first = np.maximum(at.astype(np.int64) - 1, 0)
    a = at - first
    b, c, d = a - 1, a - 2, a - 3
    least, rings = int(first.min()), at.shape[1]
    count = int(first.max()) + 4 - least
    place = count * np.arange(rings) + first - least
    shares = np.zeros(rings * count)
    for k, cubic in enumerate((-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6)):
        each = (weight[:, None] * cubic).ravel()
        shares += np.bincount((place + k).ravel(), each, shares.size)
    return least + np.arange(count), shares.reshape(rings, count)


def _gauss(points: int) -> tuple[F64, F64]:
    """Places and weights of Gauss's quadrature over -1/2 to 1/2."""
    t, w = np.polynomial.legendre.leggauss(points)
    return t / 2, w / 2


def _layer(r: F64, radii: F64, E: float, nu: float, thickness: float) -> F64:
    """What a rigid plate adds to the displacement per newton of each term: nearly uniform, so that
    its first two moments suffice.
    """
    ring = radii * math.sqrt(2 / 5)
    cos = np.cos(2 * np.pi * (np.arange(8) + 0.5) / 8)
    far = r[:, None, None]
    distance = np.sqrt(far**2 + ring[:, None] ** 2 - 2 * far * ring[:, None] * cos)
    return np.asarray(layer_correction(distance, E, nu, thickness)[0].mean(axis=2))


def _ring_correlation(r: F64, n: int, width: float, pitch: float, box: float) -> tuple[F64, F64]:
    """Correlation of the noise of ring means, shape (n, n), and by how much it exceeds that of
    independent points, shape (n,).
    """
    ring = (r / width).astype(np.int64)
    count = np.maximum(np.bincount(ring.ravel(), minlength=n)[:n], 1).astype(np.float64)
    # over all pairs of boxes that overlap
    covariance = np.zeros(n * n)
    for down, across, share in overlaps(pitch, box):
        one, other = _shifted(ring, down, across)
        covariance += share * np.bincount((one * n + other).ravel(), minlength=n * n)
    covariance = covariance.reshape(n, n) / np.outer(count, count)
    independent = 1 / count
    spread = np.sqrt(np.maximum(np.diag(covariance), independent))
    return covariance / np.outer(spread, spread), spread / np.sqrt(independent)


def _shifted(values: I64, down: int, across: int) -> tuple[I64, I64]:
    """Values of a grid's points, and of those so many rows and columns further."""
    rows, columns = values.shape
    here = values[max(-down, 0) : rows - max(down, 0), max(-across, 0) : columns - max(across, 0)]
    there = values[max(down, 0) : rows + min(down, 0), max(across, 0) : columns + min(across, 0)]
    return here, there


def _pooled(rings: Rings) -> F64:
    """Standard error of each ring, shrunk towards that of the typical point."""
    count = np.maximum(rings.count, 1)
    variance = rings.standard_error**2 * count
    known = np.isfinite(variance) & (rings.count > 1)
    if not known.any():
        return np.full(len(count), np.nan)
    ordered = np.sort(variance[known])  # for few values far quicker than np.median
    typical = float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    own = np.where(known, count - 1, 0)
    total = np.where(known, variance, 0.0) * own + typical * POOLED
    return np.asarray(np.sqrt(total / (own + POOLED) / count))
