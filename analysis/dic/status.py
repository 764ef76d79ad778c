"""What became of each point of a field."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from analysis.arrays import I64, U8, Array
from analysis.kernels import compiled


class Status(IntEnum):
    """Whether a point's displacement can be used, and if not, why; only OK points carry numbers."""

    OK = 0  #: the displacement can be used
    LOW_CONTRAST = 1  #: the box is too uniform to be recognised, in the reference or in the image
    OUT_OF_IMAGE = 2  #: the displaced box, or one of the eight around it, leaves the image
    DECORRELATED = 3  #: the best correlation stays below the limit, or no neighbour agrees with it
    NOT_CONVERGED = 4  #: there is no peak within the search, or the iteration did not converge
    SATURATED = 5  #: too many pixels of the box are at full scale, in the reference or in the image
    MASKED = 6  #: the point was not requested, or too few pixels of its box may be used

    @property
    def label(self) -> str:
        """The name as it is written to files: ``ok``, ``low_contrast`` ..."""
        return self.name.lower()


# plain integers, which kernels take as constants
OK, LOW_CONTRAST, OUT_OF_IMAGE, DECORRELATED, NOT_CONVERGED, SATURATED, MASKED = map(int, Status)


@compiled
def explain(
    image: Array,
    left: I64,
    top: I64,
    box: int,
    min_contrast: float,
    full_scale: float,
    max_saturated: float,
    status: U8,
) -> None:
    """Set OK points whose boxes lack contrast to LOW_CONTRAST, or are overexposed to SATURATED.

    The corners `left` and `top` of the boxes, and `status`, have shape (ny, nx). `min_contrast` is
    the least standard deviation of the grey levels, `max_saturated` the largest number of pixels
    at `full_scale` or above.
    """
    rows, columns = image.shape
    for i in range(status.shape[0]):
        for j in range(status.shape[1]):
            if status[i, j] != OK:
                continue
            y, x = min(max(top[i, j], 0), rows - box), min(max(left[i, j], 0), columns - box)
            total, squares, full = 0.0, 0.0, 0
            for r in range(y, y + box):
                for c in range(x, x + box):
                    # `float` of a kernel would keep single precision
                    g: float = np.float64(image[r, c])
                    total += g
                    squares += g * g
                    full += g >= full_scale
            n = box * box
            if math.sqrt(max(0.0, squares / n - (total / n) ** 2)) < min_contrast:
                status[i, j] = LOW_CONTRAST
            elif full > max_saturated:
                status[i, j] = SATURATED
