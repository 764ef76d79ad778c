"""Where the grey scale of an image ends, by the image itself: a camera of 12 bits writes files of
16, whose type says nothing of it.
"""

from __future__ import annotations

import numpy as np

from analysis.arrays import Array

END_OF_16_BIT = 65535
MIN_PIXELS, MIN_SHARE = 20, 5e-5  # pixels, and of all, that must share the greatest grey level
LEVELS = 8  # number of levels below the highest that it is compared with
MIN_PEAK_RATIO = 5.0  # times that number: no tail of a histogram ends so


def end_of_scale(image: Array, full_scale: float) -> float:
    """The grey level at and above which pixels are saturated: `full_scale`, unless that is the end
    of 16 bits and many pixels share a lower maximum, at which they must have been cut off.
    """
    if image.dtype != np.uint16 or full_scale < END_OF_16_BIT or not image.size:
        return full_scale
    top = int(image.max())
    shared = int(np.count_nonzero(image == top))
    if top >= full_scale or shared < max(MIN_PIXELS, MIN_SHARE * image.size):
        return full_scale
    below = np.bincount(image.ravel(), minlength=top + 1)[:top]
    usual = below[below > 0][-LEVELS:]
    return (
        float(top)
        if len(usual) and shared > MIN_PEAK_RATIO * float(np.median(usual))
        else full_scale
    )
