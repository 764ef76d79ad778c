"""Displacement fields in files: read as a series from whatever holds them, and written as
tables.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import compress
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import F64
from analysis.contact.orientation import ALONG_X, Direction
from analysis.dic import Field, Status
from analysis.undistorted import ideal_places
from app.evaluation.undistorted_fields import undistorted
from app.files.text_tables import LENGTH, NUMBER, TextTable, read_table
from app.records.record_types import DisplacementField, Phase
from app.session.field_series import is_session, read_fields_file
from app.session.reader import SessionReader
from app.settings.config import settings_of
from app.system.errors import UserError
from app.system.outputs import write_csv

COLUMNS = "frame,x_px,y_px,ux_px,uy_px,status,zncc,ux_sd_px,uy_sd_px"
UNEVEN = 1e-3  # points of a regular grid may lie off by this share of a pitch

STATED = ("pixel", "box", "noise_box")
_PLACE = LENGTH | {"px": 1.0}
_QUANTITIES = {
    "frame": NUMBER,
    **dict.fromkeys(("x", "y", "ux", "u", "ux_std", "ux_sd", "lens"), _PLACE),
    "pixel": LENGTH,
    **{key: {"px": 1.0} for key in STATED[1:]},
}
_ALIASES = {"u": "ux", "ux_sd": "ux_std"}
# how older tables state it, in a line above the header
_STATED = re.compile(
    r"# a pixel is (\S+) um, a displacement the mean over (\S+) px, its noise (\S+)"
)
_STATED_BEFORE = re.compile(r"# a pixel is (\S+) um")


@dataclass(frozen=True, slots=True)
class FieldSeries:
    """Fields of u_x on one regular grid, in metres, read one at a time.

    Attributes
    ----------
    x_m, y_m : ndarray, shape (nx,) and (ny,)
    frames : tuple of int
        Number of each field.
    fields : callable
        Makes an iterator over number, displacement along `direction` against the lens and its
        standard uncertainty, both of shape (ny, nx), of each field at the places of the material at
        the reference; NaN where not measured, and where no uncertainty is known.
    box_m, noise_box_m : float
        Side of the box whose average a displacement is, and of that over which noise is correlated.
    across : callable or None
        Makes an iterator over the displacement across `direction` and its uncertainty, of the same
        fields; None where it is not known.
    centre_m : (float, float) or None
        Centre of the contact, (x, y); None where it is not known.
    direction : Direction
        Of the drive, x and y along the axes of the grid.
    contact : mapping
        What is known of the contact, by names of `app.settings.sections.ContactSettings`, in SI
        units.
    notes : tuple of str
        What was taken from the file without being asked for, and what it does not say.

    Raises
    ------
    UserError
        There are too few points.
    """

    path: Path
    x_m: F64
    y_m: F64
    frames: tuple[int, ...]
    fields: Callable[[], Iterator[tuple[int, F64, F64]]]
    box_m: float
    noise_box_m: float
    across: Callable[[], Iterator[tuple[F64, F64]]] | None = None
    centre_m: tuple[float, float] | None = None
    direction: Direction = ALONG_X
    contact: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if min(len(self.x_m), len(self.y_m)) < 2:
            raise UserError(
                f"{self.path}: a grid of {len(self.x_m)} x {len(self.y_m)} points found; two or"
                " more each way are needed"
            )

    @property
    def pitch_m(self) -> float:
        """Distance between neighbouring points along x."""
        return float(self.x_m[1] - self.x_m[0])

    def only(self, frames: Collection[int]) -> FieldSeries:
        """The series of the fields with these numbers.

        Raises
        ------
        UserError
            There is no field of such a number.
        """
        missing = sorted(set(frames) - set(self.frames))
        if missing:
            raise UserError(
                f"--frame: {missing[0]} is not there; the file has fields {min(self.frames)} to"
                f" {max(self.frames)}"
            )
        across = self.across
        chosen = [number in frames for number in self.frames]
        return replace(
            self,
            frames=tuple(compress(self.frames, chosen)),
            fields=lambda: compress(self.fields(), chosen),
            across=across and (lambda: compress(across(), chosen)),
        )


def read_fields(
    path: Path, pixel_m: float | None, box_m: float | None = None, frames: Collection[int] = ()
) -> FieldSeries:
    """The fields of the drive of a session, or those in a file of ``slipscope dic`` (.h5, .csv) or
    in a table with columns x, y, ux and their units.

    Parameters
    ----------
    pixel_m : float or None
        Size of a pixel, needed where the file counts in pixels and does not state it.
    box_m : float or None
        Side of the box whose average a displacement is; None: that of a session's correlation, or
        two pitches of the grid.
    frames : collection of int
        Only the fields with these numbers; none: all.

    Raises
    ------
    UserError
        The file cannot be read, is not what it should be, or has no field of such a number.
    """
    if path.suffix.lower() == ".csv":
        found = _from_table(read_table(path, _QUANTITIES), pixel_m)
    elif is_session(path):
        found = _from_session(path, pixel_m, frames)
    else:
        held = read_fields_file(path)
        pixel = _known_pixel(path, pixel_m)
        x, y, ux, sd = (part * pixel for part in (held.x_px, held.y_px, held.ux_px, held.sd_px))
        found = _series(path, x, y, held.frames, ux, sd)
    found = found.only(frames) if frames else found
    return found if box_m is None else replace(found, box_m=box_m, noise_box_m=box_m)


def _from_session(path: Path, pixel_m: float | None, frames: Collection[int]) -> FieldSeries:
    with SessionReader(path) as session:
        config = settings_of(session)
        contact, results = session.contact(), session.results()
        x_px, y_px = session.header.grid_x_px, session.header.grid_y_px
        rows = np.flatnonzero((results["phase"] == Phase.DRIVE) & session.have_fields()).tolist()
    if not rows:
        raise UserError(
            f"{path}: it holds no displacement field of a drive; if there was one, `slipscope"
            " replay SESSION --set recording.results=fields -o ANALYSIS` measures them"
        )
    sample, dic, pixel = config.sample, config.dic, pixel_m or config.camera.pixel
    angle = results["drive_angle_rad"][rows]
    known = angle[np.isfinite(angle)]
    direction = Direction.at(float(known[-1])) if len(known) else ALONG_X
    centre = None
    if contact is not None:
        camera = config.camera
        x, y = ideal_places(*contact.centre_px, camera.distortion, camera.shape)
        centre = float(x) * pixel, float(y) * pixel

    # no other is read; where one of them is not there, `FieldSeries.only` says so
    asked = [row for row in rows if results["frame"][row] in frames]
    wanted = asked if frames and len(asked) == len(set(frames)) else rows

    def held() -> Iterator[tuple[int, F64, F64, F64, F64]]:
        with SessionReader(path) as session:
            for row in wanted:
                found = session.snapshot(row).field
                assert found is not None
                yield row, *undistorted(config, found, x_px, y_px)

    def fields() -> Iterator[tuple[int, F64, F64]]:
        for row, ux, uy, sd, _ in held():
            u = direction.along(ux, uy)
            yield int(results["frame"][row]), u * pixel - results["lens_m"][row], sd * pixel

    def across() -> Iterator[tuple[F64, F64]]:
        for _, ux, uy, _, sd in held():
            yield direction.across(ux, uy) * pixel, sd * pixel

    return FieldSeries(
        path,
        x_px * pixel,
        y_px * pixel,
        tuple(results["frame"][wanted].tolist()),
        fields,
        box_m=dic.averaging_box_px * pixel,
        noise_box_m=dic.noise_box_px * pixel,
        across=across,
        centre_m=centre,
        direction=direction,
        contact={
            # of some twenty frames
            "normal_force": np.median(results["normal_force_n"][rows[:: len(rows) // 20 or 1]]),
            "modulus": sample.young_modulus,
            "poisson": sample.poisson,
            "radius": sample.lens_radius,
            "roughness": sample.roughness,
            "thickness": sample.thickness,
        },
    )


def _series(
    path: Path, x_m: F64, y_m: F64, frames: tuple[int, ...], ux_m: F64, sd_m: F64
) -> FieldSeries:
    if not np.isfinite(ux_m).any():
        raise UserError(f"{path}: no point of it was measured; correlate again with other settings")
    box = 2 * float(x_m[1] - x_m[0]) if len(x_m) > 1 else math.nan
    return FieldSeries(
        path, x_m, y_m, frames, lambda: zip(frames, ux_m, sd_m, strict=True), box, box
    )


def _known_pixel(path: Path, pixel_m: float | None) -> float:
    if pixel_m is None:
        raise UserError(
            f"{path}: it counts in pixels, and the size of one is not known; give --pixel in um"
        )
    return pixel_m


def stated(pixel_m: float, box_px: float, noise_box_px: float) -> dict[str, float]:
    """What the fields of a session are measured in, as each row of its table of fields says: the
    size of a pixel, the box over which a displacement is the mean, and that of its noise.
    """
    return {"pixel_um": pixel_m * 1e6, "box_px": box_px, "noise_box_px": noise_box_px}


def _stated_in(table: TextTable) -> tuple[float, ...]:
    """The size of a pixel in metres and, of newer tables, of the two boxes in pixels; nothing where
    a table does not state them.
    """
    if "pixel" in table.numbers:
        held = [float(table.numbers[name][0]) for name in STATED if name in table.numbers]
        return tuple(held) if len(held) == len(STATED) and held[0] > 0 else ()
    with table.path.open(encoding="utf-8-sig", errors="replace") as file:
        first = file.readline(1000)
    found = _STATED.match(first) or _STATED_BEFORE.match(first)
    try:
        pixel_um, *boxes = (float(text.rstrip(",;")) for text in (found.groups() if found else ()))
    except ValueError:  # nothing, or no numbers
        return ()
    return (pixel_um * 1e-6, *boxes) if 0 < pixel_um < math.inf else ()


def _from_table(table: TextTable, pixel_m: float | None) -> FieldSeries:
    """The points of a table on the grid on which they lie."""
    path, notes, known = table.path, [], _stated_in(table)
    if pixel_m is None and known and "px" in table.units.values():
        pixel_m = known[0]
        notes.append(f"a pixel is {pixel_m * 1e6:.6g} um, as {path.name} states")
    columns = {
        _ALIASES.get(name, name): values
        * (_known_pixel(path, pixel_m) if table.units[name] == "px" else 1.0)
        for name, values in table.numbers.items()
        if name not in STATED
    }
    bare = [name for name in table.header if name.lower() in _QUANTITIES and name != "frame"]
    if bare:
        raise UserError(
            f"{path}: column {bare[0]} has no unit; name it {bare[0]}_px, {bare[0]}_um,"
            f" {bare[0]}_mm or {bare[0]}_m"
        )
    missing = [name for name in ("x", "y", "ux") if name not in columns]
    if missing:
        raise UserError(
            f"{path}: the header has no column {', '.join(missing)}; name them like x_px, y_px,"
            " ux_px or x_mm, y_mm, ux_um"
        )
    columns.setdefault("frame", np.zeros(table.rows))
    if not all(np.isfinite(columns[name]).all() for name in ("frame", "x", "y")):
        raise UserError(
            f"{path}: there are points without a place; write frame, x and y of every point"
        )
    frames, which = np.unique(columns["frame"], return_inverse=True)
    (x, column), (y, row) = (_axis(path, name, columns[name]) for name in ("x", "y"))
    if len(frames) * len(x) * len(y) > 4 * len(column) + 64:
        raise UserError(
            f"{path}: {len(column)} points do not fill a grid of {len(x)} x {len(y)}; give points"
            " on a regular grid"
        )
    ux, sd = np.full((2, len(frames), len(y), len(x)), math.nan)
    ux[which, row, column] = columns["ux"]
    if "ux_std" in columns:
        sd[which, row, column] = columns["ux_std"]
    if "lens" in columns:
        ux[which, row, column] -= columns["lens"]
        notes.append(f"the motion of the lens is taken off, as {path.name} states it")
    elif known:
        notes.append(f"the motion of the lens is left in: {path.name} does not state it")
    found = _series(path, x, y, tuple(int(n) for n in frames), ux, sd)
    if pixel_m and len(known) == 3:
        found = replace(found, box_m=known[1] * pixel_m, noise_box_m=known[2] * pixel_m)
    return replace(found, notes=tuple(notes))


def _axis(path: Path, name: str, values: F64) -> tuple[F64, NDArray[np.intp]]:
    """Evenly spaced coordinates of a grid along one axis, and the index of each point's."""
    places = np.unique(values)
    steps = np.diff(places)
    # the same place may be written with other last digits
    differs = steps > UNEVEN * steps.max(initial=0.0)
    places = places[np.concatenate([[True], differs])]
    if len(places) > 1:
        pitch = float(np.median(np.diff(places)))
        number = np.rint((values - places[0]) / pitch)
        if np.abs(values - places[0] - number * pitch).max() <= 10 * UNEVEN * pitch:
            return places[0] + pitch * np.arange(int(number.max()) + 1), number.astype(np.intp)
    raise UserError(
        f"{path}: the points have {len(places)} different {name}, not evenly spaced; give two or"
        " more on a regular grid"
    )


class FieldTable:
    """Writes displacement fields as a table with one line per point, the columns of `COLUMNS`.

    Parameters
    ----------
    file : TextIO
    x_px, y_px : ndarray, shape (nx,) and (ny,)
        Centres of the boxes.
    more : sequence of str
        Names of further columns.
    """

    def __init__(self, file: TextIO, x_px: F64, y_px: F64, more: Iterable[str]) -> None:
        self._file = file
        self._labels = [status.label for status in Status]
        self._x_px, self._y_px = (places.ravel().tolist() for places in np.meshgrid(x_px, y_px))
        write_csv(file, [[*COLUMNS.split(","), *more]])

    def append(self, frame: int, field: Field | DisplacementField, *more: Any) -> None:
        """Write the field of a frame; of each further column its array, or the one number or text
        of all points.
        """
        planes = (field.ux_px, field.uy_px, field.status, field.zncc, field.ux_std_px)
        further: list[Any] = [np.broadcast_to(values, field.status.shape) for values in more]
        numbers: list[list[Any]] = [
            values.ravel().tolist() for values in (*planes, field.uy_std_px, *further)
        ]
        numbers[2] = [self._labels[s] if s < len(self._labels) else s for s in numbers[2]]
        points = zip(self._x_px, self._y_px, *numbers, strict=True)
        write_csv(self._file, ((frame, *point) for point in points), missing="nan")
