"""Displacement fields from anybody's files: a session, the HDF5 of ``slipscope dic``, or a table
(CSV) with a header.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.session.fields import read_fields_file

F64 = NDArray[np.float64]

IN_METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
UNEVEN = 1e-3  # of a pitch: a grid's points may lie off by this
_COLUMN = re.compile(r"^(frame|x|y|ux|u|ux_std|ux_sd|status)(?:_(px|m|mm|um|nm))?$")


@dataclass(frozen=True, slots=True)
class MeasuredFields:
    """Fields of u_x on one regular grid, SI units.

    Attributes
    ----------
    x_m, y_m : ndarray, shape (nx,) and (ny,)
    ux_m, sd_m : ndarray, shape (frames, ny, nx)
        NaN where not measured; `sd_m` is all NaN where the file has no uncertainties.
    frames : tuple of int
        Number of each field in its file.
    """

    x_m: F64
    y_m: F64
    ux_m: F64
    sd_m: F64
    frames: tuple[int, ...]

    @property
    def pitch_m(self) -> tuple[float, float]:
        """Distance between points, along x and y."""
        return float(self.x_m[1] - self.x_m[0]), float(self.y_m[1] - self.y_m[0])


def read_fields(path: Path, pixel_m: float | None) -> MeasuredFields:
    """The fields in a file of ``slipscope dic`` (.h5, .csv), or in a table with columns x, y, ux
    and their units.

    Parameters
    ----------
    pixel_m : float or None
        Size of a pixel, needed where the file counts in pixels.

    Raises
    ------
    UserError
        The file can not be read, or is not what it should be.
    """
    if path.suffix.lower() == ".csv":
        return _from_table(path, pixel_m)
    found = read_fields_file(path)
    scale = _pixel(path, pixel_m)
    return _checked(
        path,
        MeasuredFields(
            found.x_px * scale,
            found.y_px * scale,
            found.ux_px * scale,
            found.sd_px * scale,
            found.frames,
        ),
    )


def _pixel(path: Path, pixel_m: float | None) -> float:
    if pixel_m is None:
        raise UserError(
            f"{path}: it counts in pixels, and the size of one is not known; give --pixel in um"
        )
    return pixel_m


def _from_table(path: Path, pixel_m: float | None) -> MeasuredFields:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for line in file if line.strip() and not line.lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: can not be read: {error}; give a table in UTF-8 text") from None
    rows = list(csv.reader(lines))
    columns = {}
    for i, name in enumerate(rows[0] if rows else []):
        match = _COLUMN.match(name.strip().lower())
        if match:
            columns[{"u": "ux", "ux_sd": "ux_std"}.get(match[1], match[1])] = (i, match[2])
    missing = [name for name in ("x", "y", "ux") if name not in columns]
    if missing:
        raise UserError(
            f"{path}: the header has no column {', '.join(missing)}; name them like x_px, y_px,"
            " ux_px or x_mm, y_mm, ux_um"
        )
    table: dict[str, F64] = {}
    for name, (i, unit) in columns.items():
        try:
            values = np.array([float(row[i]) for row in rows[1:]])
        except (ValueError, IndexError):
            if name == "status":
                continue
            raise UserError(
                f"{path}: column {rows[0][i]} holds something that is no number; write numbers, nan"
                " where there is none"
            ) from None
        if name not in ("frame", "status"):
            if unit is None:
                raise UserError(
                    f"{path}: column {rows[0][i]} has no unit; name it {name}_px, {name}_um,"
                    f" {name}_mm or {name}_m"
                )
            values = values * (_pixel(path, pixel_m) if unit == "px" else IN_METRES[unit])
        table[name] = values
    return _gridded(path, table)


def _gridded(path: Path, table: dict[str, F64]) -> MeasuredFields:
    """The points of a table on the grid on which they lie."""
    if not len(table["x"]) or not (np.isfinite(table["x"]) & np.isfinite(table["y"])).all():
        raise UserError(
            f"{path}: it has no points, or points without a place; write x and y of every point"
        )
    frame = table.get("frame", np.zeros(len(table["x"])))
    frames, which = np.unique(frame, return_inverse=True)
    (x, column), (y, row) = (_axis(path, name, table[name]) for name in ("x", "y"))
    if len(frames) * len(x) * len(y) > 4 * len(column) + 64:
        raise UserError(
            f"{path}: {len(column)} points do not fill a grid of {len(x)} x {len(y)}; give points"
            " on a regular grid"
        )
    fields = np.full((2, len(frames), len(y), len(x)), math.nan)
    fields[0, which, row, column] = table["ux"]
    if "ux_std" in table:
        fields[1, which, row, column] = table["ux_std"]
    return _checked(path, MeasuredFields(x, y, fields[0], fields[1], tuple(int(n) for n in frames)))


def _axis(path: Path, name: str, values: F64) -> tuple[F64, NDArray[np.intp]]:
    """Evenly spaced places of a grid's points along one axis, and the number of each point's place."""
    places = np.unique(values)
    steps = np.diff(places)
    near = steps > UNEVEN * steps.max(initial=0.0)  # the same place, written with other last digits
    places = places[np.concatenate([[True], near])]
    pitch = float(np.median(np.diff(places))) if len(places) > 1 else math.nan
    number = np.rint((values - places[0]) / pitch) if len(places) > 1 else np.zeros(len(values))
    off = np.abs(values - places[0] - number * pitch).max() if len(places) > 1 else 0.0
    if len(places) < 2 or off > 10 * UNEVEN * pitch:
        raise UserError(
            f"{path}: the points have {len(places)} different {name}, not evenly spaced; give two"
            " or more on a regular grid"
        )
    return places[0] + pitch * np.arange(int(number.max()) + 1), number.astype(np.intp)


def _checked(path: Path, fields: MeasuredFields) -> MeasuredFields:
    if min(len(fields.x_m), len(fields.y_m)) < 2:
        raise UserError(
            f"{path}: a grid of {len(fields.x_m)} x {len(fields.y_m)} points found; two or more"
            " each way are needed"
        )
    if not np.isfinite(fields.ux_m).any():
        raise UserError(f"{path}: no point of it was measured; correlate again with other settings")
    return fields
