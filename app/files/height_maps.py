"""Maps of heights in files: text, NumPy arrays, TIFF and PNG images, Digital Surf's .sur.

A file may come from anywhere: what it claims is checked against its length before it is believed.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arrays import F64, Array
from analysis.options import number_in
from app.files.grey_images import read_image
from app.system.errors import UserError
from app.system.inputs import check_ends

MOST_HEIGHTS = 1 << 24
MOST_BYTES = 1 << 29
UNITS_OF_SUR = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}
UNEQUAL = 1e-3  # relative difference of the pitch along x and y
TEXTS, IMAGES = (".csv", ".txt", ".asc", ".dat"), (".tif", ".tiff", ".png")
ENDINGS = (*TEXTS, ".npy", *IMAGES, ".sur")
_HEADER = 512
_MISSING = {"", "nan", "bad", "***", "---", "null", "none"}


@dataclass(frozen=True, slots=True)
class HeightMap:
    """Heights in metres, shape (ny, nx), NaN where missing; the pitch in metres."""

    z: F64
    pitch: float


def read_height_map(path: Path, pitch: float = 0.0, scale: float = 0.0) -> HeightMap:
    """The map in a file.

    Parameters
    ----------
    pitch : float
        Of the grid, metres; 0: the one in the file, which only .sur has.
    scale : float
        Metres that a number in the file is; 0 as above.

    Raises
    ------
    UserError
        The file cannot be read, is no map, is too large or cut short, or says neither pitch nor
        scale.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise UserError(f"{path}: not a map of heights that can be read; give {', '.join(ENDINGS)}")
    try:
        check_ends(path)
        if path.stat().st_size > MOST_BYTES:
            raise UserError(
                f"{path}: {path.stat().st_size} bytes, more than the {MOST_BYTES} that are read;"
                " give a part of the map"
            )
        if ending == ".sur":
            z, own_pitch, own_scale = _sur(path)
            return HeightMap(z * (scale / own_scale if scale else 1.0), pitch or own_pitch)
        for name, value in (("pitch", pitch), ("scale", scale)):
            if not 0 < value < math.inf:
                raise UserError(
                    f"{path}: a {ending} file does not say the {name} of its heights; give"
                    f" --{name} in um"
                )
        numbers = _text(path) if ending in TEXTS else _array(path, ending)
    except OSError as error:
        raise UserError(
            f"{path}: the file cannot be read ({error.strerror or error}); check the name"
        ) from None
    except (ValueError, EOFError, struct.error, zlib.error) as error:
        raise UserError(f"{path}: no map of heights: {error}; export it again") from None
    return HeightMap(numbers * scale, pitch)


def _array(path: Path, ending: str) -> F64:
    if ending in IMAGES:
        held: Array = read_image(path, MOST_BYTES)
    else:
        held = np.load(path, mmap_mode="r", allow_pickle=False)  # reads nothing yet
    _check_shape(held.shape)
    if held.dtype.kind not in "fiu":
        raise ValueError(f"its numbers are of the kind {held.dtype}")
    return np.array(held, dtype=np.float64)


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or min(shape) < 2:
        raise ValueError(f"an array of shape {shape}, where rows and columns are needed")
    if math.prod(shape) > MOST_HEIGHTS:
        raise ValueError(f"{math.prod(shape)} heights, more than the {MOST_HEIGHTS} that are read")


def _text(path: Path) -> F64:
    """Rows of numbers; lines before the first that begins with a number are a header."""
    text = path.read_bytes().decode("utf-8-sig", errors="replace").splitlines()
    lines = [line for line in text if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise ValueError("it has no rows")
    middle = lines[len(lines) // 2]
    separator = next((one for one in "\t;," if one in middle), None)
    is_comma = separator in ("\t", ";", None) and "," in middle
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = (line.replace(",", ".") if is_comma else line).split(separator)
        if cells and separator and not cells[-1].strip():  # a separator at the end of each line
            cells.pop()
        try:
            row = [
                math.nan if cell.strip().lower() in _MISSING else number_in(cell) for cell in cells
            ]
        except ValueError:
            if not rows:
                continue
            raise ValueError(f"'{line[:40]}' in line {number} holds no numbers") from None
        if not rows and all(map(math.isnan, row)):
            continue
        rows.append(row)
        if len(row) != len(rows[0]):
            raise ValueError(f"line {number} has {len(row)} numbers, the first {len(rows[0])}")
    _check_shape((len(rows), len(rows[0]) if rows else 0))
    return np.array(rows, dtype=np.float64)


def _sur(path: Path) -> tuple[F64, float, float]:
    """Heights, pitch and height of a unit (m) in Digital Surf's format, as the help of
    MountainsMap describes it: a header of 512 bytes, a comment, a private zone, then 16 or 32 bit
    numbers, plain or in zlib streams.
    """
    content = path.read_bytes()
    if len(content) < _HEADER or content[:12] not in (b"DIGITAL SURF", b"DSCOMPRESSED"):
        raise ValueError("it does not begin as a Digital Surf file")
    kind = struct.unpack_from("<h", content, 18)[0]
    special = struct.unpack_from("<h", content, 86)[0]
    bits, low = struct.unpack_from("<hi", content, 98)
    columns, rows, total = struct.unpack_from("<3i", content, 108)
    steps = struct.unpack_from("<3f", content, 120)
    units = [
        content[at : at + 16].split(b"\0")[0].decode("latin-1").strip() for at in (180, 196, 212)
    ]
    ratios = struct.unpack_from("<3f", content, 276)
    comment, private = struct.unpack_from("<2h", content, 334)
    if kind != 2:
        raise ValueError(f"it holds a studiable of type {kind}, where 2, a surface, is needed")
    if bits not in (16, 32) or rows * columns != total or min(comment, private) < 0:
        raise ValueError(f"its header says {columns} x {rows} = {total} points of {bits} bits")
    _check_shape((rows, columns))
    lengths = []
    for name, step, unit, ratio in zip("xyz", steps, units, ratios, strict=True):
        if unit not in UNITS_OF_SUR or ratio != 1 or not 0 < step < math.inf:
            raise ValueError(
                f"steps of {step:g} '{unit}' times {ratio:g} along {name} mean nothing"
            )
        lengths.append(step * UNITS_OF_SUR[unit])
    if abs(lengths[0] / lengths[1] - 1) > UNEQUAL:
        raise ValueError(
            f"its pitch is {lengths[0]:g} m along x and {lengths[1]:g} m along y; make them equal"
        )
    length = total * bits // 8
    body = memoryview(content)[_HEADER + comment + private :]
    data = bytes(body[:length]) if content[:12] == b"DIGITAL SURF" else _inflated(body, length)
    if len(data) < length:
        raise ValueError(f"it is cut short: {len(data)} of {length} bytes of heights")
    counts = np.frombuffer(data, f"<i{bits // 8}", total).reshape(rows, columns)
    z = (counts.astype(np.float64) - low) * lengths[2]
    if special == 1:
        z[counts == low - 2] = np.nan
    return z, lengths[0], lengths[2]


def _inflated(body: memoryview, length: int) -> bytes:
    """The zlib streams one after the other, up to the length that the header says."""
    (count,) = struct.unpack_from("<I", body)
    if not 0 < count <= 1024:
        raise ValueError(f"it says that it holds {count} streams")
    sizes = struct.unpack_from(f"<{2 * count}I", body, 4)
    at, data = 4 + 8 * count, b""
    for packed in sizes[1::2]:
        stream = zlib.decompressobj()
        data += stream.decompress(body[at : at + packed], length - len(data) + 1)
        at += packed
        if len(data) > length:
            raise ValueError(f"it holds more than the {length} bytes that its header says")
        if not stream.eof:
            raise ValueError("it is cut short")
    return data
