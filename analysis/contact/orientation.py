"""How the picture lies to the drive: the direction in which the block moves, far from the contact.

A camera may be turned by any angle or mirrored. Everything about the contact but this direction is
the same then: ring means along the drive do not know on which side of it a point lies.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, Bool, all_floats, in_step

MIN_FAR_POINTS = 20  # outside the contact; with fewer all points count
MAX_OBLIQUE = 0.1  # sine of the angle between drive and rows up to which a field is along x


class Direction(NamedTuple):
    """A unit vector in the picture: x to the right, y down."""

    x: float
    y: float

    @classmethod
    def at(cls, angle: float) -> Direction:
        """The direction at an angle in radians, from +x towards +y."""
        # whole quarters to the bit, so that a picture along the drive is not touched
        quarters = {0.0: (1.0, 0.0), 0.5: (0.0, 1.0), 1.0: (-1.0, 0.0), -0.5: (0.0, -1.0)}
        turn = 1.0 if angle == -math.pi else angle / math.pi
        return cls(*quarters.get(turn, (math.cos(angle), math.sin(angle))))

    @property
    def angle(self) -> float:
        """In radians, from +x towards +y, -pi to pi."""
        return math.atan2(self.y, self.x)

    @property
    def is_along_rows(self) -> bool:
        """Whether a displacement along this direction counts as one along the rows of a picture."""
        return abs(self.y) <= MAX_OBLIQUE

    @property
    def reversed(self) -> Direction:
        """The opposite direction."""
        return Direction(-self.x, -self.y)

    @property
    def mirrored(self) -> Direction:
        """The direction on the other side of +x: it turns components back."""
        return Direction(self.x, -self.y)

    def along(self, x: ArrayLike, y: ArrayLike) -> F64:
        """Component along this direction; shape of `x`."""
        x, y = all_floats(x, y)
        if self.y == 0:
            return self.x * x
        return np.asarray(self.x * x + self.y * y)

    def across(self, x: ArrayLike, y: ArrayLike) -> F64:
        """Component across it, positive where this direction is turned towards +y."""
        return Direction(-self.y, self.x).along(x, y)


ALONG_X = Direction(1.0, 0.0)


def drive_direction(
    ux: ArrayLike, uy: ArrayLike, outside: Bool, *, least: float
) -> Direction | None:
    """Direction in which the block has moved; None while it has moved by less than `least`.

    Parameters
    ----------
    ux, uy : array_like, shape (ny, nx)
        Displacement in the picture, in any unit; NaN where not measured.
    outside : ndarray of bool, shape (ny, nx)
        Points outside the contact, where the block is hardly held back.
    least : float
        Motion, in that unit, from which the direction is taken: it is known within the error of
        the mean motion over it.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> ux = np.full((6, 8), -4.0)
    >>> outside = np.ones(ux.shape, bool)
    >>> analysis.drive_direction(ux, np.zeros(ux.shape), outside, least=1.0).x
    -1.0
    """
    u, v = in_step("direction of the drive", ux=ux, uy=uy)
    known = np.isfinite(u) & np.isfinite(v)
    far = known & outside
    if far.sum() < MIN_FAR_POINTS:
        far = known
    if not far.any():
        return None
    x, y = float(np.median(u[far])), float(np.median(v[far]))
    size = math.hypot(x, y)
    return Direction(x / size, y / size) if size >= least else None
