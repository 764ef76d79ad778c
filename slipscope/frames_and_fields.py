"""The images and the displacement fields of a session as arrays that stay in its file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, SupportsIndex, overload

import numpy as np

from analysis.arrays import F32, F64, I64, Array
from app.records.record_types import DisplacementField
from app.session.reader import SessionReader
from app.session.tables import Columns, counted_from_0, in_units, rows_of
from app.system.errors import UserError
from slipscope.displays import axes_for
from slipscope.stack import Chosen, Stack, chosen

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class FieldInMetres(NamedTuple):
    """The displacement of one frame from the reference; NaN where it could not be measured.

    `x_m` (nx,) and `y_m` (ny,) are places in the image, counted from its first pixel, y down.
    `ux_m`, `uy_m`, their standard uncertainties `ux_sd_m`, `uy_sd_m` and the correlation `zncc`
    have the shape (ny, nx). The lens moves along the drive by `lens_m`, as far as its holder gives
    way; this motion is still in `ux_m`, and in `uy_m` where the drive is not along the rows.
    """

    frame: int
    x_m: F64
    y_m: F64
    ux_m: F64
    uy_m: F64
    ux_sd_m: F64
    uy_sd_m: F64
    zncc: F32
    lens_m: float

    def __repr__(self) -> str:
        return f"<FieldInMetres of frame {self.frame}, shape {self.ux_m.shape}>"

    def table(self) -> Columns:
        """A row for each point: x_mm, y_mm, ux_um, uy_um, ux_sd_um, uy_sd_um, zncc; for
        ``pandas.DataFrame``.
        """
        return rows_of(
            in_units(
                x_mm=self.x_m,
                y_mm=self.y_m[:, None],
                ux_um=self.ux_m,
                uy_um=self.uy_m,
                ux_sd_um=self.ux_sd_m,
                uy_sd_um=self.uy_sd_m,
                zncc=self.zncc,
            )
        )

    def plot(self, along: Literal["x", "y"] = "x", axes: Axes | None = None) -> Axes:
        """Draw the map of u_x or u_y in micrometres over the picture in millimetres, y down, with a
        colour bar; grey: not measured. The colours leave out the outermost 0.5 % of the values.

        Parameters
        ----------
        along : str
            ``"x"`` or ``"y"``, whose colours are centred on 0.
        axes : matplotlib.axes.Axes, optional
            Where; default: those of a new figure. They are returned.
        """
        from app.report.figures import draw_field, field_limits

        is_signed, axes = along == "y", axes_for(axes)
        values = np.float64(1e6) * (self.uy_m if is_signed else self.ux_m)
        draw_field(
            axes,
            values,
            1e3 * self.x_m,
            1e3 * self.y_m,
            label=f"$u_{along}$ (µm)",
            cut="",
            cmap="RdBu_r" if is_signed else "viridis",
            limits=field_limits(values, is_signed=is_signed),
        )
        axes.set_title(f"frame {self.frame}")
        return axes


class Frames(Stack):
    """The raw images, shape (triggers, rows, columns), each read when it is used: ``frames[10]`` is
    that of trigger 10, ``frames[10:20]`` an array of ten.

    A frame that was lost keeps its number: reading it is a UserError that says why it was lost;
    ``frames[frames.received]`` leaves such ones out.

    Attributes
    ----------
    received : ndarray, shape (n,)
        Numbers of the triggers that have an image.
    """

    def __init__(self, reader: SessionReader) -> None:
        self._reader, header = reader, reader.header
        triggers = reader.triggers()
        self._lost = {index: reason for index, _, reason in reader.lost_frames()}
        self.received: I64 = triggers["index"][triggers["received"]]
        super().__init__((len(triggers), *header.frame_shape), header.frame_dtype, self._image)

    def _image(self, index: SupportsIndex) -> Array:
        n = counted_from_0(self._reader.path, "frame", index.__index__(), len(self))
        if n in self._lost:
            raise UserError(
                f"{self._reader.path}: frame {n} was lost: {self._lost[n]}; `frames.received`"
                " lists the frames that are there"
            )
        return self._reader.frame(n)[2]


class Fields:
    """The displacement fields, one for each row of the results, each read when it is used.

    ``fields[i]`` is a `FieldInMetres`, and so is each of ``for field in fields``; ``fields[10:20]``
    are the fields of these rows. Of one quantity they are an array of shape (t, y, x):
    ``fields.ux_m[:, 40]``, or ``numpy.asarray(fields[10:20].ux_m)``. Rows without a field, such as
    those before the reference, are NaN there and in a loop; ``fields[i]`` of one is a UserError
    that says why. ``fields[fields.measured]`` leaves them out.

    Attributes
    ----------
    shape : (int, int, int)
        Number of rows, and of points along y and x.
    x_m : ndarray, shape (nx,)
    y_m : ndarray, shape (ny,)
        Places in the image, metres from its first pixel, y down.
    measured : ndarray, shape (n,)
        Which rows have a field, counted from 0.
    """

    def __init__(self, reader: SessionReader, rows: Sequence[int] | None = None) -> None:
        self._reader, header = reader, reader.header
        has_field = reader.have_fields()
        self._rows = range(len(has_field)) if rows is None else rows
        self.measured: I64 = np.flatnonzero(has_field[np.array(self._rows, int)])
        self.x_m: F64 = np.float64(header.pixel_m) * header.grid_x_px
        self.y_m: F64 = np.float64(header.pixel_m) * header.grid_y_px
        self.shape = len(self._rows), len(self.y_m), len(self.x_m)

    def __repr__(self) -> str:
        return f"<Fields of shape {self.shape}, {len(self.measured)} measured>"

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[FieldInMetres]:
        return (self._read(row) for row in self._rows)

    @overload
    def __getitem__(self, i: int | np.integer[Any], /) -> FieldInMetres: ...
    @overload
    def __getitem__(self, i: Chosen, /) -> Fields: ...
    def __getitem__(self, i: int | np.integer[Any] | Chosen, /) -> FieldInMetres | Fields:
        if isinstance(i, slice | list | np.ndarray):
            return Fields(self._reader, [self._rows[n] for n in chosen(i, len(self))])
        n = counted_from_0(self._reader.path, "field", int(i), len(self))
        if n not in self.measured:
            frame = self._reader.analysed_frames()[self._rows[n]]
            raise UserError(
                f"{self._reader.path}: result {self._rows[n]} has no field: frame {frame} came"
                " before the reference; use a later one"
            )
        return self._read(self._rows[n])

    @property
    def ux_m(self) -> Stack:
        """Displacement along x, metres; includes the motion of the lens."""
        return self._of_all("ux_m")

    @property
    def uy_m(self) -> Stack:
        """Displacement along y, metres."""
        return self._of_all("uy_m")

    @property
    def ux_sd_m(self) -> Stack:
        """Standard uncertainty of `ux_m`, metres."""
        return self._of_all("ux_sd_m")

    @property
    def uy_sd_m(self) -> Stack:
        """Standard uncertainty of `uy_m`, metres."""
        return self._of_all("uy_sd_m")

    @property
    def zncc(self) -> Stack:
        """Correlation at its peak."""
        return self._of_all("zncc", np.float32)

    def _of_all(self, name: str, dtype: type = np.float64) -> Stack:
        def plane(i: SupportsIndex) -> Array:
            n = counted_from_0(self._reader.path, "field", i.__index__(), len(self))
            values: Array = getattr(self._read(self._rows[n]), name)
            return values

        return Stack(self.shape, dtype, plane)

    def _read(self, row: int) -> FieldInMetres:
        """The field of a row of the results, NaN where it has none."""
        snapshot, pixel = self._reader.snapshot(row), np.float64(self._reader.header.pixel_m)
        nothing = np.full(self.shape[1:], math.nan, np.float32)
        not_measured = DisplacementField(
            nothing, nothing, nothing, nothing, nothing, np.ones(nothing.shape, np.uint8)
        )
        field = snapshot.field or not_measured
        return FieldInMetres(
            snapshot.frame,
            self.x_m,
            self.y_m,
            pixel * field.ux_px,
            pixel * field.uy_px,
            pixel * field.ux_std_px,
            pixel * field.uy_std_px,
            field.zncc,
            snapshot.motion.lens_m if snapshot.motion else math.nan,
        )
