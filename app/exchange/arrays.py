"""The results of a session as arrays for NumPy and MATLAB, and as images of points for ParaView."""

from __future__ import annotations

import base64
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
import scipy.io
from numpy.typing import NDArray

from analysis.dic import Status
from app.errors import UserError
from app.records import NUMBERS, DisplacementField, Header, Snapshot, numbers_of
from app.schema import columns_of
from app.session.reader import SessionReader

MAT_BYTES = 2**31  # largest array of a MATLAB 5 file
_VTK_TYPES = {"f": "Float32", "u": "UInt8"}


@dataclass(frozen=True, slots=True)
class _Array:
    """An array to write: its name with the unit, and its values in consecutive blocks of the first
    axis.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    blocks: Iterable[NDArray[Any]]


def _whole(name: str, values: Any) -> _Array:
    array = np.asarray(values)
    return _Array(name, array.shape, array.dtype, [array])


def _arrays(
    reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> Iterator[_Array]:
    """Forces, stage, results and fields, each when it is its turn."""
    forces = reader.forces()
    samples, metres = reader.positions()
    yield _whole("sample_rate_hz", reader.header.sample_rate_hz)
    yield _whole("pixel_m", reader.header.pixel_m)
    yield _whole("force_P_N", forces.forces[:, 0])
    yield _whole("force_Q_N", forces.forces[:, 1])
    yield _whole("normal_sensor_V", forces.volts[:, 0])
    yield _whole("shear_sensor_V", forces.volts[:, 1])
    yield _whole("stage_sample", samples)
    yield _whole("stage_m", metres)
    numbers, measured, frames = [], [], []
    for n, i in enumerate(rows):
        tell("results", n / len(rows))
        snapshot = reader.snapshot(i)
        numbers.append(numbers_of(snapshot))
        if snapshot.field is not None:
            measured.append(i)
            frames.append(snapshot.frame)
    for name in NUMBERS:
        held = [one[name] for one in numbers] if numbers else np.empty(0)
        yield _whole(f"result_{name}", held)
    yield _whole("field_frame", np.array(frames, np.int64))
    x_px, y_px = reader.header.grid_x_px, reader.header.grid_y_px
    yield _whole("field_x_px", x_px)
    yield _whole("field_y_px", y_px)
    yield _whole("field_status_names", [status.label for status in Status])
    for column in columns_of(DisplacementField):
        yield _Array(
            f"field_{column.attribute}",
            (len(measured), len(y_px), len(x_px)),
            np.dtype(column.dtype),
            _planes(reader, measured, column.attribute, tell),
        )


def _planes(
    reader: SessionReader, rows: list[int], name: str, tell: Callable[[str, float], None]
) -> Iterator[NDArray[Any]]:
    for n, i in enumerate(rows):
        tell(f"fields of {name}", n / len(rows))
        yield getattr(reader.snapshot(i).field, name)[np.newaxis]


def write_npz(
    path: Path, reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> str:
    """What was written; NumPy reads it with ``numpy.load``.

    Fields have the shape (field_frame, y, x); one is in memory at a time.
    """
    names = []
    with zipfile.ZipFile(path, "x") as archive:
        for array in _arrays(reader, rows, tell):
            names.append(array.name)
            with archive.open(f"{array.name}.npy", "w", force_zip64=True) as file:
                header = {
                    "descr": np.lib.format.dtype_to_descr(array.dtype),
                    "fortran_order": False,
                    "shape": array.shape,
                }
                np.lib.format.write_array_header_1_0(file, header)
                for block in array.blocks:
                    file.write(np.ascontiguousarray(block, array.dtype).tobytes())
    return f"{len(names)} arrays"


def write_mat(
    path: Path, reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> str:
    """What was written, for MATLAB's ``load``. One array at a time is in memory whole.

    Raises
    ------
    UserError
        An array is larger than the format allows.
    """
    count = 0
    with path.open("xb") as file:
        for array in _arrays(reader, rows, tell):
            nbytes = int(np.prod(array.shape, dtype=np.int64)) * array.dtype.itemsize
            if nbytes >= MAT_BYTES:
                raise UserError(
                    f"export: {array.name} takes {nbytes / 1e9:.1f} GB, a .mat file holds arrays of"
                    " 2.1 GB; give fewer --frames, or .npz"
                )
            values, at = np.empty(array.shape, array.dtype), 0
            for block in array.blocks:
                if not array.shape:
                    values[()] = block
                    continue
                values[at : at + len(block)] = block
                at += len(block)
            # goes on where the file is
            scipy.io.savemat(cast(Any, file), {array.name: values}, oned_as="column")
            count += 1
    return f"{count} arrays"


def write_pvd(
    path: Path, folder: Path, folder_name: str, reader: SessionReader, snapshots: Iterable[Snapshot]
) -> int:
    """Number of fields written: ``FRAME.vti`` in `folder` each, and at `path` their list with times
    in s from sample 0.

    ParaView draws y upwards: points lie at (x, -y) in metres and displacements are (u_x, -u_y, 0),
    so that it shows what the camera sees.
    """
    lines = []
    for snapshot in snapshots:
        if snapshot.field is not None:
            name = f"{snapshot.frame:06d}.vti"
            (folder / name).write_text(_image_data(reader.header, snapshot.field), encoding="ascii")
            middle = snapshot.sample + reader.header.exposure_samples / 2
            lines.append(
                f'<DataSet timestep="{middle / reader.header.sample_rate_hz!r}" group="" part="0"'
                f" file={quoteattr(f'{folder_name}/{name}')}/>\n"
            )
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1"'
        ' byte_order="LittleEndian">\n<Collection>\n'
    )
    path.write_text(head + "".join(lines) + "</Collection>\n</VTKFile>\n", encoding="utf-8")
    return len(lines)


def _image_data(header: Header, field: DisplacementField) -> str:
    """One field in the XML of VTK,
    https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html.
    """
    pixel = np.float32(header.pixel_m)
    x, y = header.grid_x_px * header.pixel_m, header.grid_y_px * header.pixel_m
    spacing = [float(axis[1] - axis[0]) if len(axis) > 1 else header.pixel_m for axis in (x, y)]
    nothing = np.zeros_like(field.ux_px)
    arrays: dict[str, NDArray[Any]] = {
        "displacement_m": np.stack([field.ux_px, -field.uy_px, nothing], axis=-1) * pixel,
        "displacement_std_m": np.stack([field.ux_std_px, field.uy_std_px, nothing], axis=-1)
        * pixel,
        "zncc": field.zncc,
        "status": field.status,
    }
    extent = f"0 {len(x) - 1} 0 {len(y) - 1} 0 0"
    image = f'Origin="{x[0]!s} {-y[-1]!s} 0" Spacing="{spacing[0]!r} {spacing[1]!r} 1"'
    parts = [
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian"'
        ' header_type="UInt64">\n',
        f'<ImageData WholeExtent="{extent}" {image}>\n<Piece Extent="{extent}">\n<PointData'
        ' Vectors="displacement_m" Scalars="zncc">\n',
    ]
    for name, values in arrays.items():
        upwards = np.ascontiguousarray(values[::-1], values.dtype.newbyteorder("<"))
        data = np.uint64(upwards.nbytes).astype("<u8").tobytes() + upwards.tobytes()
        components = f' NumberOfComponents="{values.shape[2]}"' if values.ndim == 3 else ""
        kind = _VTK_TYPES[values.dtype.kind]
        parts.append(
            f'<DataArray type="{kind}" Name="{name}"{components}'
            f' format="binary">\n{base64.b64encode(data).decode()}\n</DataArray>\n'
        )
    parts.append("</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n")
    return "".join(parts)
