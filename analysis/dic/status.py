"""What became of each point of a field."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Whether a point's displacement can be used, and if not, why; only OK points carry numbers."""

    OK = 0  #: the displacement can be used
    LOW_CONTRAST = 1  #: the box is too uniform to be recognised, in the reference or in the image
    OUT_OF_IMAGE = 2  #: the displaced box, or one of the eight around it, leaves the image
    DECORRELATED = 3  #: the best correlation stays below the limit, or no neighbour agrees with it
    NOT_CONVERGED = 4  #: there is no peak within the search, or the iteration did not converge
    SATURATED = 5  #: too many pixels of the box are at full scale, in the reference or in the image
    MASKED = 6  #: the point was not requested, or too few pixels of its box may be used
    AMBIGUOUS = 7  #: the pattern repeats itself: the peak may be that of another period

    @property
    def label(self) -> str:
        """The name as it is written to files: ``ok``, ``low_contrast`` ..."""
        return self.name.lower()


# plain integers, which kernels take as constants
(
    OK,
    LOW_CONTRAST,
    OUT_OF_IMAGE,
    DECORRELATED,
    NOT_CONVERGED,
    SATURATED,
    MASKED,
    AMBIGUOUS,
) = map(int, Status)
