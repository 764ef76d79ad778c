"""What the points around a point of a field say of it."""

from __future__ import annotations

import cv2
import numpy as np

from analysis.arrays import F32, F64, U8, Array, Bool
from analysis.dic.status import LOW_CONTRAST, MASKED, OK
from analysis.dic.threads import Rows
from analysis.kernels import compiled


def filled(field: F64, valid: Bool) -> F64:
    """A field, shape (.., ny, nx), with its holes (the points that are not valid) filled smoothly
    from the values around them.

    Averages over 2 x 2 points, then over 2 x 2 of those and so on, until every hole has a value
    (Gortler et al. 1996, "pull-push"). All zero if no point is valid.
    """
    out = np.where(valid, field, 0.0)
    if valid.all() or valid.size == 1:
        return out
    size = tuple((n + 1) // 2 for n in valid.shape[::-1])
    weight = cv2.resize(valid.astype(np.float64), size, interpolation=cv2.INTER_AREA)
    known = weight > 0
    halved = np.stack([cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in out])
    halved = halved / np.where(known, weight, 1.0)
    coarse = filled(halved.reshape(len(out), *known.shape), known)
    fine = [cv2.resize(p, valid.shape[::-1], interpolation=cv2.INTER_LINEAR) for p in coarse]
    return np.where(valid, out, np.reshape(fine, out.shape))


@compiled
def neighbour_median(shift: Array, valid: Bool, least: int) -> tuple[Array, Bool]:
    """Median displacement (2, ny, nx) of the valid points among the 8 neighbours of each point, and
    where at least `least` of them are valid; 0 elsewhere.
    """
    _, ny, nx = shift.shape
    median = np.zeros_like(shift)
    known = np.zeros((ny, nx), np.bool_)
    near = np.empty(8, shift.dtype)
    for axis in range(2):
        for i in range(ny):
            for j in range(nx):
                n = 0
                for k in range(max(0, i - 1), min(ny, i + 2)):
                    for m in range(max(0, j - 1), min(nx, j + 2)):
                        if valid[k, m] and (k != i or m != j):
                            at = n  # insertion keeps `near` sorted
                            while at > 0 and near[at - 1] > shift[axis, k, m]:
                                near[at] = near[at - 1]
                                at -= 1
                            near[at] = shift[axis, k, m]
                            n += 1
                if n >= least:
                    median[axis, i, j] = near[n // 2]
                    known[i, j] = True
    return median, known


@compiled
def contradicted(u: F32, status: U8, tolerance: float, rows: Rows, out: Bool) -> None:
    """Mark, in some rows of `out`, shape (ny, nx), the OK points that no neighbour confirms: none
    is OK and displaced alike, within `tolerance` px, although some neighbour has contrast.
    """
    for i in range(rows[0], rows[1]):
        for j in range(u.shape[2]):
            out[i, j] = status[i, j] == OK and _is_contradicted(u, status, tolerance, i, j)


@compiled
def _is_contradicted(u: F32, status: U8, tolerance: float, i: int, j: int) -> bool:
    is_alone = True
    for k in range(max(0, i - 1), min(u.shape[1], i + 2)):
        for m in range(max(0, j - 1), min(u.shape[2], j + 2)):
            if k == i and m == j:
                continue
            if status[k, m] == OK:
                apart = max(abs(u[0, k, m] - u[0, i, j]), abs(u[1, k, m] - u[1, i, j]))
                if apart <= tolerance:
                    return False
            is_alone &= status[k, m] == LOW_CONTRAST or status[k, m] == MASKED
    return not is_alone
