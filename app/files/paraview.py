"""Displacement fields as a series of images of points for ParaView."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from analysis.arrays import Array
from app.records.record_types import DisplacementField, Header, Snapshot

_TYPES = {"f": "Float32", "u": "UInt8"}


def write_pvd(
    path: Path,
    folder: Path,
    folder_name: str,
    header: Header,
    fields: Iterable[tuple[Snapshot, DisplacementField]],
) -> None:
    """Write each field to ``FRAME.vti`` in `folder`, and at `path` their list with times in s from
    sample 0, in which the folder is called `folder_name`.

    ParaView draws y upwards: points lie at (x, -y) in metres and displacements are (u_x, -u_y, 0),
    so that it shows what the camera sees.
    """
    from xml.sax.saxutils import quoteattr  # with all that reads pages of the web

    lines = []
    for snapshot, field in fields:
        name = f"{snapshot.frame:06d}.vti"
        (folder / name).write_text(_image_data(header, field), encoding="ascii")
        time_s = (snapshot.sample + header.exposure_samples / 2) / header.sample_rate_hz
        lines.append(
            f'<DataSet timestep="{time_s!r}" group="" part="0"'
            f" file={quoteattr(f'{folder_name}/{name}')}/>\n"
        )
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1"'
        ' byte_order="LittleEndian">\n<Collection>\n'
    )
    path.write_text(head + "".join(lines) + "</Collection>\n</VTKFile>\n", encoding="utf-8")


def _image_data(header: Header, field: DisplacementField) -> str:
    """One field in the XML of VTK,
    https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html.
    """
    pixel, nothing = np.float32(header.pixel_m), np.zeros_like(field.ux_px)
    x, y = header.grid_x_px * header.pixel_m, header.grid_y_px * header.pixel_m
    dx, dy = (float(axis[1] - axis[0]) if len(axis) > 1 else header.pixel_m for axis in (x, y))
    arrays: dict[str, Array] = {
        "displacement_m": np.stack([field.ux_px, -field.uy_px, nothing], axis=-1) * pixel,
        "displacement_std_m": np.stack([field.ux_std_px, field.uy_std_px, nothing], -1) * pixel,
        "zncc": field.zncc,
        "status": field.status,
    }
    extent = f"0 {len(x) - 1} 0 {len(y) - 1} 0 0"
    parts = [
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian"'
        f' header_type="UInt64">\n<ImageData WholeExtent="{extent}" Origin="{x[0]!s} {-y[-1]!s} 0"'
        f' Spacing="{dx!r} {dy!r} 1">\n<Piece Extent="{extent}">\n<PointData'
        ' Vectors="displacement_m" Scalars="zncc">\n'
    ]
    for name, values in arrays.items():
        upwards = np.ascontiguousarray(values[::-1], values.dtype.newbyteorder("<"))
        data = np.uint64(upwards.nbytes).astype("<u8").tobytes() + upwards.tobytes()
        components = f' NumberOfComponents="{values.shape[2]}"' if values.ndim == 3 else ""
        parts.append(
            f'<DataArray type="{_TYPES[values.dtype.kind]}" Name="{name}"{components}'
            f' format="binary">\n{base64.b64encode(data).decode()}\n</DataArray>\n'
        )
    parts.append("</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n")
    return "".join(parts)
