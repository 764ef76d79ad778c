"""What the columns of a session say of a sample or a frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from app.records import Samples


def samples_of(
    first: int,
    columns: Mapping[str, NDArray[np.float64]],
    auxiliary: NDArray[np.float64] | None,
) -> Samples:
    """A block of samples from the columns of the forces."""
    volts = np.column_stack([columns["normal_sensor"], columns["shear_sensor"]])
    newtons = np.column_stack([columns["normal_force"], columns["shear_force"]])
    return Samples(first, volts, newtons, auxiliary)


def span_of(index: int, first: int, last: int) -> tuple[int, int] | None:
    """The triggers that a frame can belong to; None where it is certain."""
    return None if first == index == last else (first, last)
