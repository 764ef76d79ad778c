"""What can belong to a session: said once for who records it, who writes it and who repairs it."""

from __future__ import annotations

from analysis.arrays import Array
from app.records.record_types import Header, Samples, Snapshot
from app.records.schema import values

# missing samples are written as NaN; more than this is a wrong sample number, not a gap
LONGEST_GAP_S = 3600.0
# samples that all gaps may have together: a few bytes could ask for terabytes
MOST_MISSING = 1 << 22


def channels_of(header: Header) -> int:
    """How many further channels there are beside the forces."""
    return len(header.auxiliary.name) if header.auxiliary else 0


def check_place(sample: int, expected: int, header: Header) -> None:
    """Refuse samples that were there already or lie absurdly far ahead; ValueError."""
    if not 0 <= sample - expected <= LONGEST_GAP_S * header.sample_rate_hz:
        raise ValueError(
            f"session: samples from {sample} on cannot be placed, the next one is {expected}"
        )


def check_missing(count: int) -> None:
    """Refuse a session in which so many samples are missing in all; ValueError."""
    if count > MOST_MISSING:
        raise ValueError(f"{count} samples are missing")


def check_channels(block: Samples, header: Header) -> None:
    """Refuse samples whose further channels are others than those of the session; ValueError."""
    wanted = (len(block.volts), channels_of(header))
    if block.auxiliary is not None and block.auxiliary.shape != wanted:
        raise ValueError(f"session: further channels {block.auxiliary.shape} instead of {wanted}")


def check_image(image: Array, header: Header) -> None:
    """Refuse an image of another shape or type; ValueError."""
    if (image.shape, str(image.dtype)) != (header.frame_shape, header.frame_dtype):
        raise ValueError(
            f"session: images are {header.frame_shape} {header.frame_dtype}, but this one is"
            f" {image.shape} {image.dtype}"
        )


def check_snapshot(snapshot: Snapshot, header: Header) -> None:
    """Refuse results whose field is of another grid, or whose profiles are none; ValueError."""
    grid = (len(header.grid_y_px), len(header.grid_x_px))
    if snapshot.field is not None:
        for column, array in values(snapshot.field):
            if (array.shape, str(array.dtype)) != (grid, column.dtype):
                raise ValueError(
                    f"session: {column.path} takes {grid} {column.dtype}, but the array is"
                    f" {array.shape} {array.dtype}"
                )
    for profile in (snapshot.rings, snapshot.stress):
        shapes = set() if profile is None else {array.shape for _, array in values(profile)}
        if len(shapes) > 1 or any(len(shape) != 1 for shape in shapes):
            raise ValueError(f"session: a profile has arrays of the shapes {sorted(shapes)}")
