"""What a camera and the glass before it add to every picture, as a session keeps it."""

from __future__ import annotations

from analysis.arrays import F32
from app.records.schema import column, record


@record("/entry/pattern", shape=("rows", "columns"), since=9)
class PixelPattern:
    """Dark level and relative gain of each pixel, which are undone before a picture is
    correlated; pictures are kept as they came.
    """

    gain: F32 = column("gain", "1", "gain of each pixel over the mean; NaN: it shows nothing")
    dark: F32 = column("dark", "counts", "grey level of each pixel without light")
