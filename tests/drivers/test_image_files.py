"""A small image file cannot take more memory than is allowed."""

from __future__ import annotations

import io
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image

from app.files.grey_images import read_image
from app.system.errors import UserError
from drivers.cameras import image_files
from drivers.cameras.image_files import MOST_BYTES, decoded, page_count


def png_bomb(width: int, height: int, bits: int = 16, colour: int = 6) -> bytes:
    """A PNG of zeros: a thousandth of what it holds."""
    line = 1 + width * bits // 8 * (4 if colour == 6 else 1)
    deflate = zlib.compressobj(1)
    parts = [deflate.compress(bytes(line)) for _ in range(height)]
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)

    def chunk(kind: bytes, content: bytes) -> bytes:
        tail = struct.pack(">I", zlib.crc32(kind + content))
        return struct.pack(">I", len(content)) + kind + content + tail

    data = chunk(b"IDAT", b"".join(parts) + deflate.flush())
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + data + chunk(b"IEND", b"")


def tiff(**changed: int) -> bytes:
    """A grey TIFF of 8 x 8 pixels, with some of its tags changed."""
    tags = {"256": 8, "257": 8, "258": 8, "259": 1, "262": 1, "273": 200, "277": 1, "278": 8}
    held = {int(tag): value for tag, value in (tags | {"279": 64} | changed).items()}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, held[tag]) for tag in sorted(held))
    directory = struct.pack("<H", len(held)) + entries + bytes(4)
    return (b"II*\0" + struct.pack("<I", 8) + directory).ljust(200, b"\0") + bytes(range(64))


def bmp(red: int = 1) -> bytes:
    """A BMP of OS/2, whose header is short: 16 x 16 pixels of all grey levels, or of less red."""
    header = struct.pack("<IHHHH", 12, 16, 16, 1, 24)
    pixels = b"".join(bytes([level, level, level // red]) for level in range(256))
    return b"BM" + struct.pack("<IHHI", 26 + len(pixels), 0, 0, 26) + header + pixels


@pytest.mark.parametrize(
    "content",
    [
        lambda: png_bomb(9000, 9000),
        lambda: tiff(**{"256": 60000, "257": 60000}),
        lambda: tiff(**{"322": 60000, "323": 60000, "324": 200, "325": 64}),
        lambda: tiff(**{"258": 64, "277": 60000, "256": 512, "257": 512}),
    ],
    ids=["png", "tiff", "tile", "samples"],
)
def test_a_bomb_is_refused_by_its_header(content: Callable[[], bytes], tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    path.write_bytes(content())
    before, began = psutil.Process().memory_info().rss, time.monotonic()
    with pytest.raises(UserError, match=r"bomb\.png: an image of \d+ x \d+ px, which takes .* MB"):
        read_image(path)
    assert psutil.Process().memory_info().rss - before < MOST_BYTES / 4
    assert time.monotonic() - began < 5


def test_what_is_like_the_first_image_is_read_and_nothing_larger(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(png_bomb(1000, 1000, 8, 0))
    assert decoded(path, 10**6).shape == (1000, 1000)
    with pytest.raises(ValueError, match="more than the 1 MB that are read"):
        decoded(path, 10**6 - 1)


def test_a_plain_tiff_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(tiff())
    np.testing.assert_array_equal(decoded(path), np.arange(64).reshape(8, 8))


def test_a_picture_of_os2_is_read_and_none_of_a_file_that_is_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.bmp"
    path.write_bytes(bmp())
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)[::-1]  # the lowest row is the first
    np.testing.assert_array_equal(decoded(path), levels)
    with pytest.raises(ValueError, match="an image of 16 x 16 px, which takes"):
        decoded(path, 1023)
    monkeypatch.setattr(image_files, "MOST_BYTES", len(bmp()) - 9)
    with pytest.raises(ValueError, match="an image of 16 x 16 px, which takes"):
        decoded(path, 1024)


def test_colours_of_a_picture_of_os2_are_no_grey_levels(tmp_path: Path) -> None:
    path = tmp_path / "a.bmp"
    path.write_bytes(bmp(red=2))
    with pytest.raises(UserError, match=r"a\.bmp: a colour image \(3 channels\)"):
        read_image(path)


@pytest.mark.parametrize("kind", ["png", "tiff"])
def test_several_pictures_are_not_decoded(kind: str, tmp_path: Path) -> None:
    pictures = [Image.new("L", (8, 8), n) for n in range(3)]
    held = io.BytesIO()
    pictures[0].save(held, kind, save_all=True, append_images=pictures[1:])
    (tmp_path / "a").write_bytes(held.getvalue())
    with pytest.raises(ValueError, match="several images in one file"):
        decoded(tmp_path / "a")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"II*\0",
        b"MM\0*\xff\xff\xff\xff",
        b"\x89PNG\r\n\x1a\n",
        tiff()[:90],
        tiff().replace(struct.pack("<HH", 273, 4), struct.pack("<HH", 274, 4)),  # no pixels
        tiff().replace(struct.pack("<HH", 256, 4), struct.pack("<HH", 254, 4)),  # no width
        b"BM" + bytes(99),
        bmp()[:20],
    ],
)
def test_what_is_none_is_told(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(ValueError, match="not an image that can be read"):
        decoded(tmp_path / "a")


@pytest.mark.parametrize("place", [1 << 62, (1 << 64) - 1])
def test_a_place_that_no_file_has_is_told(place: int, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"II+\0" + struct.pack("<HHQ", 8, 0, place))
    assert page_count(tmp_path / "a") == 1
    with pytest.raises(ValueError, match="not an image that can be read"):
        decoded(tmp_path / "a")


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("is_big", [False, True])
def test_any_page_of_a_tiff_of_many_is_read(order: str, is_big: bool, tmp_path: Path) -> None:
    place, count, entry, head = ("Q", "Q", "HHQQ", 16) if is_big else ("I", "H", "HHII", 8)
    pages = [np.arange(64, dtype=np.uint8).reshape(8, 8) + n for n in range(3)]
    magic = {"<": b"II", ">": b"MM"}[order] + struct.pack(order + "H", 43 if is_big else 42)
    content = magic + (struct.pack(order + "HH", 8, 0) if is_big else b"")
    content += struct.pack(order + place, head)
    for n, page in enumerate(pages):
        tags = {256: 8, 257: 8, 258: 8, 259: 1, 262: 1, 273: 0, 277: 1, 278: 8, 279: 64}
        size = struct.calcsize("=" + count) + len(tags) * struct.calcsize("=" + entry)
        end = len(content) + size + struct.calcsize("=" + place)
        tags[273] = end
        content += struct.pack(order + count, len(tags))
        for tag, value in tags.items():
            content += struct.pack(order + entry, tag, 16 if is_big else 4, 1, value)
        content += struct.pack(order + place, end + 64 if n < 2 else 0) + page.tobytes()
    (tmp_path / "a").write_bytes(content)
    assert page_count(tmp_path / "a") == 3
    for n, page in enumerate(pages):
        np.testing.assert_array_equal(decoded(tmp_path / "a", page=n), page)
