"""What the columns of a session say of a sample or a frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.records import Samples

if TYPE_CHECKING:
    from app.session.reader import SessionReader


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


def uncertain_triggers(reader: SessionReader) -> list[int]:
    """Numbers of the triggers of which it is not certain that they took the image that they have,
    or that it is they who have none. Reads nothing else, which may be damaged.
    """
    paths = [f"/entry/triggers/{name}" for name in ("index", "first", "last")]
    if not reader.file.has(paths[-1]):
        return []
    columns = [reader.file.read(reader.dataset(path)) for path in paths]
    rows = min(map(len, columns))
    index, first, last = (column[:rows] for column in columns)
    numbers: list[int] = index[first != last].tolist()
    return numbers
