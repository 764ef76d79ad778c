"""Displacement fields read back from the files that people have."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from changed_files import put

from app.files.field_files import FieldSeries, read_fields
from app.files.inverting import with_centre
from app.session.field_series import fields_file
from app.system import disk
from app.system.disk import DiskError
from app.system.errors import UserError

X, Y = np.array([10.0, 20, 30, 40]), np.array([15.0, 25, 35])
UX = np.arange(24.0).reshape(2, 3, 4) / 7


def write_table(path: Path, header: str, *, rows=None, order=1) -> Path:
    x, y = np.meshgrid(X, Y)
    lines = [
        f"{frame},{x[j, i]},{y[j, i]},{float(UX[frame - 1, j, i])!r},0.01"
        for frame in (1, 2)
        for j in range(3)
        for i in range(4)
        if rows is None or rows(frame, j, i)
    ]
    path.write_text("# a comment\n" + "\n".join([header, *lines[::order]]) + "\n")
    return path


def arrays(series: FieldSeries) -> tuple[np.ndarray, np.ndarray]:
    """u_x and its standard uncertainty of all fields, shape (frames, ny, nx)."""
    _, ux, sd = zip(*series.fields(), strict=True)
    return np.stack(ux), np.stack(sd)


@pytest.mark.parametrize("order", [1, -1])
def test_a_table_in_pixels_in_any_order(tmp_path: Path, order: int) -> None:
    path = write_table(
        tmp_path / "t.csv",
        "frame,x_px,y_px,ux_px,ux_std_px",
        order=order,
        rows=lambda f, j, i: (j, i) != (1, 2),
    )
    found = read_fields(path, 2e-6)
    np.testing.assert_allclose(found.x_m, X * 2e-6)
    np.testing.assert_allclose(found.y_m, Y * 2e-6)
    expected = UX.copy() * 2e-6
    expected[:, 1, 2] = np.nan
    ux, sd = arrays(found)
    np.testing.assert_allclose(ux, expected)
    assert np.nanmax(np.abs(sd - 2e-8)) < 1e-20
    assert found.frames == (1, 2)
    assert found.pitch_m == pytest.approx(2e-5)
    (number, second, _), *none = found.only([2]).fields()
    assert (number, none) == (2, [])
    np.testing.assert_array_equal(second, ux[1])
    with pytest.raises(UserError, match="--frame: 7 is not there; the file has fields 1 to 2"):
        found.only([7])


def test_a_table_in_units_of_length_needs_no_pixel(tmp_path: Path) -> None:
    path = write_table(tmp_path / "t.csv", "frame,x_mm,y_mm,u_um,ux_sd_nm")
    found = read_fields(path, None)
    np.testing.assert_allclose(found.x_m, X * 1e-3)
    ux, sd = arrays(found)
    np.testing.assert_allclose(ux, UX * 1e-6)
    np.testing.assert_allclose(sd, 1e-11)


class Field:
    ux_px = uy_px = ux_std_px = uy_std_px = zncc = np.ones((3, 4), np.float32)
    status = iterations = np.zeros((3, 4), np.uint8)


@pytest.mark.parametrize("room", [0, 9000])
def test_a_disk_that_is_full_is_an_error_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    """HDF5, which would break the program, is not told of it."""
    path = tmp_path / "f.h5"
    write_all, taken = disk._write_all, 0

    def limited(write: Callable[[memoryview], int | None], content: memoryview) -> None:
        nonlocal taken
        taken += len(content)
        if taken > room:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_all(write, content)

    monkeypatch.setattr(disk, "_write_all", limited)
    with (
        pytest.raises(DiskError, match="No space left"),
        fields_file(path, ["a.tif"], X, Y, ["ok"], {"reference": "r.tif"}, {}) as append,
    ):
        append(Field())
    path.unlink()  # nothing holds it


def test_a_file_of_slipscope_dic(tmp_path: Path) -> None:
    settings = {"reference": "r.tif"}
    with fields_file(tmp_path / "f.h5", ["a.tif"], X, Y, ["ok"], settings, {}) as append:
        append(Field())
    found = read_fields(tmp_path / "f.h5", 1e-6)
    np.testing.assert_allclose(arrays(found), 1e-6)
    np.testing.assert_allclose(found.y_m, Y * 1e-6)
    with pytest.raises(UserError, match="--pixel"):
        read_fields(tmp_path / "f.h5", None)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "no rows"),
        ("a_px,b\n1,2\n", "no column x, y, ux"),
        ("x_px,y_px\n1,2\n", "no column ux"),
        ("x_px,y_px,ux_px\n", "no rows"),
        ("x_px,y_px,ux_px\n1,2,a\n", "no number"),
        ("x_px,y_px,ux_px\n1,2\n", "row 1 has 2 cells, the header 3"),
        ("x_px,y_px,ux_px\n1,2,inf\n", "no number"),
        ("x_px,y_px,ux_px\nnan,2,1\n", "without a place"),
        ("frame,x_px,y_px,ux_px\nnan,1,2,1\n", "without a place"),
        ("x,y,ux\n1,2,1\n2,3,1\n", "no unit"),
        ("x_px,y_px,ux_px\n1,2,1\n", "two or more"),
        ("x_px,y_px,ux_px\n1,2,1\n2,3.0,1\n3.4,2,1\n1,3,2\n", "evenly spaced"),
        ("x_px,y_px,ux_px\n1,2,nan\n2,2,nan\n1,3,nan\n2,3,nan\n", "no point of it was measured"),
        ("x_px,y_px,ux_px\n" + "".join(f"{n},{n},1\n" for n in range(100)), "do not fill"),
    ],
)
def test_a_table_that_is_none_is_refused_in_a_sentence(
    tmp_path: Path, text: str, word: str
) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(UserError, match=word):
        read_fields(tmp_path / "t.csv", 1e-6)


def test_files_that_can_not_be_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["numbers"] = [1, 2]
    with pytest.raises(UserError, match=r"other.h5: an HDF5 file without displacement fields"):
        read_fields(tmp_path / "other.h5", None)
    (tmp_path / "bad.h5").write_bytes(b"no HDF5")
    for name in ("bad.h5", "none.h5", "none.csv"):
        with pytest.raises(UserError, match="read"):
            read_fields(tmp_path / name, 1e-6)


@pytest.mark.parametrize(
    ("name", "value"), [("x", np.nan), ("y", 1e308), ("x", 0.0), ("frame", -7), ("frame", 2**62)]
)
def test_a_grid_that_is_none_is_refused(tmp_path: Path, name: str, value: float) -> None:
    path = tmp_path / "f.h5"
    settings = {"reference": "r.tif"}
    with fields_file(path, ["a.tif", "b.tif"], X, Y, ["ok"], settings, {}):
        pass
    put(f"/entry/fields/{name}", value, 1)(path)
    with pytest.raises(UserError, match=r"f\.h5: its grid or its frames do not increase"):
        read_fields(path, 2e-6)


def test_the_centre_is_where_the_contact_is_now() -> None:
    """The block has slid by a third of the contact's radius over the lens, which holds the surface
    back around its own place.
    """
    pitch, slid, centre = 70e-6, 0.5e-3, (3.1e-3, 2.2e-3)
    x, y = np.arange(80) * pitch, np.arange(60) * pitch
    X, Y = np.meshgrid(x, y)
    away = (X + slid - centre[0]) ** 2 + (Y - centre[1]) ** 2
    ux = slid - 1e-5 * np.exp(-away / 0.9e-3**2)
    series = FieldSeries(
        Path("a.h5"), x, y, (1,), lambda: iter([(1, ux, 1e-8 + 0 * ux)]), 2 * pitch, 2 * pitch
    )
    found = with_centre(series).centre_m
    assert found == pytest.approx(centre, abs=0.2 * pitch)
