"""From the points of the material, where displacements are measured, to the places in the lab where
they act: the contact stays with the lens while the block slides through it.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from analysis.arrays import F64, in_step
from analysis.contact.orientation import ALONG_X, Direction
from analysis.contact.rings import Rings, ring_means

BEYOND = 8  # points


def as_seen(
    u: F64, sd: F64, pitch: float, direction: Direction = ALONG_X, moves: F64 | None = None
) -> tuple[F64, F64]:
    """A field and its uncertainty at the grid's points as the lens sees them; both (ny, nx).

    Parameters
    ----------
    u, sd : ndarray, shape (ny, nx)
        Displacement along `direction`, against the lens, at the places where the points of the
        material were at the reference, and its uncertainty; metres.
    pitch : float
        Of the square grid, metres.
    direction : Direction
        In which the material moves.
    moves : ndarray, shape (ny, nx), optional
        By how much it does, metres; default `u`.

    Returns
    -------
    u, sd : ndarray, shape (ny, nx)
        NaN outside what was measured, and next to points that were not.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> u = np.full((5, 6), 1e-4)
    >>> u[2, 2] = 2e-4
    >>> seen, _ = analysis.as_seen(u, np.full(u.shape, 1e-8), pitch=1e-4)
    >>> int(np.nanargmax(seen[2]))  # it moved by two points
    3
    """
    u, sd, moved = in_step("inversion", u=u, sd=sd, moves=u if moves is None else moves)
    if not np.isfinite(moved).any():
        return u, sd
    places = np.indices(u.shape, dtype=np.float64)
    steps = np.nan_to_num(moved, nan=float(np.nanmedian(moved))) / pitch
    ways = np.array([direction.y, direction.x])[:, None, None]
    now = places
    for _ in range(3):  # gradients are a few per cent
        now = places - ways * ndimage.map_coordinates(steps, now, order=1, mode="nearest")
    return _at(u, now, 3), _at(sd, now, 1)  # a spline through a jump of sd falls below 0


def evened(u: F64, sd: F64, off: F64) -> tuple[F64, F64]:
    """A field and its uncertainty, both (ny, nx), at the points of an even grid off which their own
    points lie by `off`, shape (2, ny, nx), in rows and columns; NaN as in `as_seen`.
    """
    now = places = np.indices(u.shape, dtype=np.float64)
    for _ in range(3):
        now = places - [ndimage.map_coordinates(way, now, order=1, mode="nearest") for way in off]
    return _at(u, now, 3), _at(sd, now, 1)


def rings_as_seen(x: F64, y: F64, u: F64, width: float, direction: Direction = ALONG_X) -> Rings:
    """Ring means, in metres, of a displacement about the contact's centre, each point where the
    material is now.

    Parameters
    ----------
    x, y, u : ndarray, shape (ny, nx)
        Places of the points at the reference, from the centre, and their displacement along
        `direction`, metres.
    width : float
        Of a ring, metres.
    """
    x, y = x + direction.x * u, y + direction.y * u
    theta = np.arctan2(direction.across(x, y), direction.along(x, y))
    return ring_means(np.hypot(x, y), u, width, theta=theta)


def _at(values: F64, places: F64, order: int) -> F64:
    """A field at other places, (row, column), by splines of that order; NaN outside and next to
    points that were not measured.
    """
    known = np.isfinite(values)
    if not known.any():
        return values
    # a slope goes on beyond the rim and into holes, where the spline would bend it
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    mirrored = np.clip(
        2 * nearest - np.indices(values.shape), 0, np.reshape(values.shape, (2, 1, 1)) - 1
    )
    edge, within = values[tuple(nearest)], values[tuple(mirrored)]
    filled = np.where(known, values, edge + np.where(np.isfinite(within), edge - within, 0.0))
    wide = min(BEYOND, min(values.shape) - 1)
    padded = np.pad(filled, wide, mode="reflect", reflect_type="odd")
    seen = ndimage.map_coordinates(padded, places + wide, order=order, mode="nearest")
    doubt = ndimage.map_coordinates((~known).astype(np.float64), places, order=1, cval=1.0)
    return np.where(doubt > 1e-9, np.nan, seen)
