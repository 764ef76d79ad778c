"""What the inversions of a whole field share: the operator, the mask, the weights of the points and
the fitted displacement far away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from analysis.arrays import F64, Bool, floats, in_step
from analysis.inversion.result import NOT_COVERED, NOT_SEEN, EndOfInversion, Inversion
from analysis.mechanics.half_space import SurfaceGreen
from analysis.mechanics.hertz import contact_radius
from analysis.robust import robust_sd

OUTLYING = 4.0  # standard deviations from which a point counts less
LARGEST_CHI2 = 1.03**2  # of a residual that is down to the noise
MIN_OUTSIDE_POINTS = 8
SHAPES = (0.5, 1.5, 3.0)  # powers of 1 - r^2/A^2 for a disc: Hertz's, and two more peaked
# drop of chi2 (4 standard deviations) below which a stress does not stand out of the noise
MIN_CHI2_DROP = 16.0
BOX_OF_NOISE = 1 / 0.6  # of the box over which u is averaged: within it points share noise
LARGEST_HOLE = 0.02  # share of the mask's points that may be unmeasured


def mask_radius(P: float, E: float, nu: float, R: float, roughness: float, pitch: float) -> float:
    """Radius in metres beyond which the stress is taken as 0: Hertz's, and the rough layer's sqrt(R
    h), and two pitches.

    Too large a mask costs little, one too small by two pitches a tenth of the peak stress.

    Examples
    --------
    >>> import analysis
    >>> round(analysis.mask_radius(0.5, 3.4e6, 0.5, 0.13, roughness=6e-7, pitch=7e-5) * 1e3, 3)
    2.627
    """
    return contact_radius(P, E, nu, R) + math.sqrt(R * roughness) + 2 * pitch


@dataclass(frozen=True, slots=True)
class MeasuredField:
    """A displacement field ready for inversion; 0 with weight 0 where nothing was measured.

    Attributes
    ----------
    u : ndarray, shape (ny, nx)
        Metres.
    weight : ndarray, shape (ny, nx)
        1/sd^2, less for outliers, 1/m^2.
    count : float
        Number of points, outliers in part.
    """

    u: F64
    weight: F64
    count: float

    def mean(self, values: F64) -> float:
        """Weighted mean of a field."""
        return float(np.vdot(self.weight, values) / self.weight.sum())

    def chi2(self, residual: F64) -> float:
        """Mean square of a residual in units of its uncertainty."""
        return float(np.vdot(self.weight * residual, residual)) / self.count


class InversionProblem:
    """The inversion of u_x fields on one grid: the linear map from stress to displacement and the
    mask outside which the stress is 0.

    Parameters
    ----------
    mask : array_like of bool, shape (ny, nx)
        sigma is 0 outside.
    pitch : float
        Between the grid's points, metres.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio of the block.
    box : float
        Side of the correlation box, metres.
    thickness : float
        Of the block on a rigid plate, metres; default a half-space.

    Raises
    ------
    ValueError
        A mask without points, a grid of one point, or a parameter out of its range.
    """

    def __init__(
        self,
        mask: ArrayLike,
        pitch: float,
        E: float,
        nu: float,
        *,
        box: float = 0.0,
        thickness: float = math.inf,
    ) -> None:
        self.mask = np.array(mask, dtype=np.bool_)
        if self.mask.ndim != 2 or not self.mask.any():
            raise ValueError(
                f"inversion: a mask of shape {self.mask.shape} with {self.mask.sum()} points was"
                " given; give shape (ny, nx) and a point"
            )
        self._block: dict[str, Any] = {
            "pitch": pitch, "E": E, "nu": nu, "thickness": thickness, "box": box
        }  # fmt: skip
        self.green = SurfaceGreen(self.mask.shape, **self._block)
        self.pitch, self.box = float(pitch), float(box)

    @cached_property
    def largest(self) -> float:
        """Largest eigenvalue of the operator inside the mask, metres per pascal."""
        return self.green.norm(self.mask)

    @cached_property
    def shapes(self) -> tuple[F64, F64]:
        """Simple stresses inside the mask, from flat to peaked, shape (k, ny, nx), and what D and
        they do to u, shape (1 + k, ny nx).

        Each displaces by up to 1.
        """
        padded = np.pad(self.mask, 1).astype(np.uint8)
        depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1].astype(np.float64)
        t = depth / depth.max()
        stress = np.stack([(t * (2 - t)) ** power for power in SHAPES])
        images = np.stack([self.green.apply(s) for s in stress])
        scale = (1 / images.max(axis=(1, 2)))[:, None, None]
        moved = -(images * scale).reshape(len(stress), -1)
        return stress * scale, np.concatenate([np.ones((1, t.size)), moved])

    def measured(
        self, ux: ArrayLike, sd: ArrayLike | None, *, needs_outside: bool = True
    ) -> MeasuredField:
        """A field with its uncertainty: per point, or one number, or by default that of
        `noise_level`.

        Raises
        ------
        ValueError
            Another shape than the mask's, no point measured inside the mask, or too few outside to
            determine D.
        """
        ux = floats(ux)
        if ux.shape != self.mask.shape:
            raise ValueError(
                f"inversion: a field of shape {ux.shape} was given for a mask of shape"
                f" {self.mask.shape}; use the same grid"
            )
        sd = self.noise_level(ux) if sd is None else sd
        ux, sd = in_step("inversion", ux=ux, sd=sd)
        valid = np.isfinite(ux) & (sd > 0) & np.isfinite(sd)
        inside, outside = int((valid & self.mask).sum()), int((valid & ~self.mask).sum())
        if inside == 0 or (needs_outside and outside < MIN_OUTSIDE_POINTS):
            raise ValueError(
                f"inversion: {inside} points inside the mask and {outside} outside were measured;"
                f" some inside are needed, and {MIN_OUTSIDE_POINTS} outside for the displacement"
                " far away"
            )
        _, known = self.shapes
        seen = known * valid.ravel()
        u = np.where(valid, ux, 0.0)
        simple = np.linalg.lstsq(seen @ known.T, seen @ u.ravel())[0] @ known
        trust = _trust(u - simple.reshape(u.shape), sd, valid)
        weight = np.divide(trust, sd * sd, out=np.zeros(ux.shape), where=valid)
        return MeasuredField(u, weight, float(trust.sum()))

    def noise_level(self, ux: F64) -> float:
        """Standard deviation of the noise of a point, metres, from second differences both ways
        between boxes that share no pixel.

        Raises
        ------
        ValueError
            The field is too small, has too many holes, or no noise.
        """
        step = max(math.ceil(self.box / self.pitch * (1 - 1e-9)), 1)
        bent = ux[: -2 * step] - 2 * ux[step:-step] + ux[2 * step :]
        bent = bent[:, : -2 * step] - 2 * bent[:, step:-step] + bent[:, 2 * step :]
        differences = bent[np.isfinite(bent)]
        level = robust_sd(differences) / 6 if differences.size else 0.0
        if not level > 0:
            raise ValueError(
                f"inversion: {differences.size} differences of the field do not reveal its noise;"
                " give its standard uncertainty"
            )
        return level

    def is_silent(self, field: MeasuredField, D: float | None = None) -> bool:
        """Whether no stress stands out of a field's noise: simple stresses explain it hardly better
        than D alone, which is fitted where it is not given.
        """
        _, known = self.shapes
        seen = known * field.weight.ravel()
        amounts = np.linalg.lstsq(seen @ known.T, seen @ field.u.ravel())[0]
        best = field.chi2(field.u - (amounts @ known).reshape(field.u.shape))
        drop = field.chi2(field.u - (field.mean(field.u) if D is None else D)) - best
        sharing = max(1.0, (BOX_OF_NOISE * self.box / self.pitch) ** 2)
        return drop * field.count <= MIN_CHI2_DROP * sharing * max(best, 1.0)

    def covers(self, field: MeasuredField) -> bool:
        """Whether the measured part of a field covers the mask."""
        rim = np.pad(np.zeros([n - 2 for n in self.mask.shape], np.bool_), 1, constant_values=True)
        holes = float(np.mean(field.weight[self.mask] <= 0))
        return holes <= LARGEST_HOLE and not (self.mask & rim).any()

    def result(
        self,
        sigma: F64,
        D: float,
        field: MeasuredField,
        residual: F64,
        iterations: int,
        stopped: EndOfInversion,
        *,
        D_sd: float = math.nan,
        chi2: float | None = None,
        across: MeasuredField | None = None,
    ) -> Inversion:
        """The result of an iterative method, with its flags; that of both components has the `chi2`
        of both, and says where the other one, `across`, is silent or not covered, too.
        """
        fields = [field] if across is None else [field, across]
        chi2 = field.chi2(residual) if chi2 is None else chi2
        given = D if D_sd == 0 else None
        if chi2 <= LARGEST_CHI2 and all(self.is_silent(one, given) for one in fields):
            stopped = EndOfInversion.SILENT
        is_covered = all(self.covers(one) for one in fields)
        notes = [] if is_covered else [NOT_COVERED]
        if stopped is EndOfInversion.SILENT:
            notes.append(NOT_SEEN)
        if chi2 > LARGEST_CHI2:
            after = f" after {iterations} iterations" if iterations else ""
            notes.append(
                f"inversion: stopped ({stopped}){after} with a residual of"
                f" {math.sqrt(chi2):.3g} times the noise; check the mask, D and the uncertainty"
            )
        return Inversion(
            sigma=sigma,
            sigma_sd=np.full(sigma.shape, np.nan),
            D=D,
            D_sd=D_sd,
            Q=float(sigma.sum()) * self.pitch**2,
            Q_sd=math.nan,
            residual=np.where(field.weight > 0, residual, np.nan),
            chi2=chi2,
            iterations=iterations,
            stopped=stopped,
            is_covered=is_covered,
            is_converged=chi2 <= LARGEST_CHI2 and stopped is not EndOfInversion.SILENT,
            notes=tuple(notes),
        )


def _trust(rest: F64, sd: F64, valid: Bool) -> F64:
    """Weight of each point, 1 up to four standard deviations from the median of its neighbourhood,
    then falling with the fourth power.

    `rest` is what simple stresses leave of the field: slopes would bend the median at the rim. A
    point is compared with its neighbours, not with a finished fit, so that its weight depends
    neither on the method nor on how far it has come; the standard deviation is the stated one or,
    if that is larger, that of the typical point.
    """
    if not valid.all():
        nearest = tuple(
            ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
        )
        rest, sd = rest[nearest], sd[nearest]
    unit = float(np.median(sd))
    size = np.abs(rest - unit * cv2.medianBlur((rest / unit).astype(np.float32), 5)) / sd
    limit = OUTLYING * max(1.0, robust_sd(size[valid]))
    return np.where(valid, np.minimum(1.0, limit / np.maximum(size, limit)) ** 4, 0.0)
