"""Height maps in files: what is in them, and files that lie about it."""

import io
import struct
import zlib

import cv2
import numpy as np
import pytest

from app.files.height_maps import ENDINGS, read_height_map
from app.system.errors import UserError

UM = 1e-6
MAP = np.arange(12.0).reshape(3, 4) - 5
MAP[1, 2] = np.nan


def sur(z=MAP, *, step=0.5, z_step=0.25, packed=False, **header):
    """A Digital Surf file of `z` in steps of `z_step` um."""
    counts = np.where(np.isnan(z), -12, z).astype("<i2")
    given = {
        "kind": 2, "special": 1, "bits": 16, "low": -10, "columns": z.shape[1], "rows": z.shape[0],
        "total": z.size, "x": step, "y": step, "unit": b"um", "ratio": 1.0, "comment": 7,
    } | header  # fmt: skip
    head = bytearray(512)
    head[:12] = b"DSCOMPRESSED" if packed else b"DIGITAL SURF"
    struct.pack_into("<h", head, 18, given["kind"])
    struct.pack_into("<h", head, 86, given["special"])
    struct.pack_into("<hii", head, 98, given["bits"], given["low"], 10)
    struct.pack_into("<3i", head, 108, given["columns"], given["rows"], given["total"])
    struct.pack_into("<3f", head, 120, given["x"], given["y"], z_step)
    for at in (180, 196, 212):
        head[at : at + len(given["unit"])] = given["unit"]
    struct.pack_into("<3f", head, 276, *[given["ratio"]] * 3)
    struct.pack_into("<2h", head, 334, given["comment"], 0)
    body = counts.tobytes()
    if packed:
        halves = [zlib.compress(body[:10]), zlib.compress(body[10:])]
        sizes = struct.pack("<I4I", 2, 10, len(halves[0]), len(body) - 10, len(halves[1]))
        body = sizes + b"".join(halves)
    return bytes(head) + b"comment" + body


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def text(separator=",", decimal=".", top=""):
    rows = (separator.join(f"{v:.3f}".replace(".", decimal) for v in row) for row in MAP)
    return (top + "\n".join(rows) + "\n").encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("map.csv", text()),
        ("map.csv", text(";", ",")),
        ("map.txt", text("\t", ",", "Height map\n# a comment\n")),
        ("map.asc", text(" ", top="pitch 0.5 um\n")),
        ("map.CSV", text(";").replace(b"\n", b";\n").replace(b"nan", b"")),
        ("map.npy", npy(MAP)),
        ("map.npy", npy(MAP.astype(np.float32))),
    ],
)
def test_numbers_in_files_times_the_scale(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    found = read_height_map(tmp_path / name, 0.5 * UM, 2 * UM)
    np.testing.assert_allclose(found.z, MAP * 2 * UM)
    assert found.pitch == 0.5 * UM


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_images_times_the_scale(tmp_path, dtype):
    image = (np.arange(12).reshape(3, 4) * 1000).astype(dtype)
    cv2.imwrite(str(tmp_path / "map.tif"), image)
    found = read_height_map(tmp_path / "map.tif", 0.5 * UM, 1e-3 * UM)
    np.testing.assert_allclose(found.z, image * 1e-9, rtol=1e-6)


@pytest.mark.parametrize("packed", [False, True])
def test_digital_surf_says_pitch_and_scale(tmp_path, packed):
    (tmp_path / "map.sur").write_bytes(sur(packed=packed))
    found = read_height_map(tmp_path / "map.sur")
    np.testing.assert_allclose(found.z, (MAP + 10) * 0.25 * UM)
    assert found.pitch == pytest.approx(0.5 * UM)
    again = read_height_map(tmp_path / "map.sur", 0.7 * UM, 1 * UM)
    np.testing.assert_allclose(again.z, (MAP + 10) * UM)
    assert again.pitch == 0.7 * UM


class Evil:
    def __reduce__(self):
        return (print, ("no",))


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("map.xyz", b"1 2", "give .csv"),
        ("map.csv", b"", "no rows"),
        ("map.csv", b"a,b\nc,d\n", "shape"),
        ("map.csv", b"1,2,3\n4,5\n", "line 2 has 2"),
        ("map.csv", b"1,2\n3,x\n", "no numbers"),
        ("map.npy", b"", "no map"),
        ("map.npy", npy(MAP)[:-8], "no map"),
        ("map.npy", npy(np.zeros(5)), "shape"),
        ("map.npy", npy(MAP > 0), "kind bool"),
        ("map.npy", npy(MAP + 1j), "kind complex"),
        ("map.npy", npy(np.array([[Evil()]], dtype=object)), "no map"),
        ("map.tif", b"II*\0" + b"\xff" * 50, "not an image"),
        ("map.sur", b"DIGITAL SURF", "does not begin"),
        ("map.sur", b"x" * 600, "does not begin"),
        ("map.sur", sur()[:-2], "cut short: 22 of 24"),
        ("map.sur", sur(kind=1), "type 1"),
        ("map.sur", sur(bits=64), "64 bits"),
        ("map.sur", sur(total=11), "= 11 points"),
        ("map.sur", sur(columns=1 << 30, rows=8, total=1 << 33 & 0x7FFFFFFF), "points"),
        ("map.sur", sur(columns=1 << 14, rows=1 << 14, total=1 << 28), "more than"),
        ("map.sur", sur(columns=-4, rows=-3), "shape"),
        ("map.sur", sur(y=0.6), "make them equal"),
        ("map.sur", sur(unit=b"inch"), "mean nothing"),
        ("map.sur", sur(ratio=2.0), "mean nothing"),
        ("map.sur", sur(x=float("nan")), "mean nothing"),
        ("map.sur", sur(comment=-3), "points"),
        ("map.sur", sur(packed=True)[:-4], "cut short|no map"),
        ("map.sur", sur(packed=True, rows=2, total=8), "more than the 16 bytes"),
    ],
)
def test_files_that_are_no_map(tmp_path, name, content, word):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=word) as told:
        read_height_map(tmp_path / name, UM, UM)
    assert str(tmp_path / name) in str(told.value)


@pytest.mark.parametrize("ending", [one for one in ENDINGS if one != ".sur"])
def test_pitch_and_scale_must_be_given(tmp_path, ending):
    path = tmp_path / f"map{ending}"
    path.write_bytes(text())
    with pytest.raises(UserError, match="--pitch"):
        read_height_map(path, 0.0, UM)
    with pytest.raises(UserError, match="--scale"):
        read_height_map(path, UM, 0.0)


def test_no_file(tmp_path):
    with pytest.raises(UserError, match="check the name"):
        read_height_map(tmp_path / "none.csv", UM, UM)
