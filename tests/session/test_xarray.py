"""xarray opens every group of a session and of a file of results, with the names, the units and the
coordinates of its sides.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import GRID_X, GRID_Y, SHAPE, Session, make_writer

from app.records.analog_channels import Channels
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import Samples
from app.session import layout
from app.session.reader import SessionReader
from drivers.protocols import Frame, LostFrame

# side of the arrays -> what xarray calls it; 2 is that of a pair
NAMES = {
    **{"samples": "time", "frames": "frame", "rows": "y", "columns": "x"},
    **{"fields": "frame", "ny": "y", "nx": "x", "results": "frame", "rings": "rings"},
    **{"radii": "radii", "triggers": "index", "positions": "sample", "events": "sample"},
    **{"gaps": "first", "channels": "name", "programs": "name", "profile": "radius"},
    **{"rim": "pressure_radius", "slides": "slide_step", "inputs": "budget_inputs"},
    **{"quantities": "budget_quantities", "notes": "notes", "cycles": "cycles"},
    **{"reversals": "reversals", "contributions": "contributions", 2: "pair"},
}
LATER = {"/entry/source", "/entry/auxiliary", "/entry/pattern"}
GROUPS = [group.path for group in layout.GROUPS if group.path not in LATER]
# of the session of the tests, whose summary has a pressure but no stiffness
EMPTY = {"interface_stiffness", "interface_stiffness_errors", "precursor_slip"}


def opened(path: Path, group: str) -> Any:
    """The group as xarray has it; without a side that it names by itself, of which it warns."""
    import xarray  # with pandas; each process of the suite collects this file

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xarray.open_dataset(path, group=group, engine="h5netcdf") as data:
            return data.load()


def assert_named(path: Path, group: str, data: Any, without: set[str]) -> None:
    with h5py.File(path) as file:
        columns = [c for c in layout.columns_in(group) if c.name not in without]
        for column in columns:
            found, held = data[column.name], file[column.path]
            assert found.dims == tuple(NAMES[side] for side in column.shape), column.path
            assert found.shape == held.shape
            assert found.attrs["long_name"] == column.meaning
            assert found.attrs.get("units", "") == column.unit
        lines = {column.shape[0]: column.name for column in columns if len(column.shape) == 1}
        named = {NAMES[side] for side, name in lines.items() if NAMES[side] in data.variables}
        assert named <= set(data.coords)


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_each_group_has_the_sides_of_the_layout(recorded_once: Session, group: str) -> None:
    data = opened(recorded_once.path, group)
    assert {column.name for column in layout.columns_in(group)} <= set(data.variables)
    assert_named(recorded_once.path, group, data, EMPTY)


def test_an_array_that_was_not_measured_is_empty(recorded_once: Session) -> None:
    """It has a side of its own, not the radii of the pressure with values that nobody measured."""
    data = opened(recorded_once.path, "/entry/summary")
    assert data.sizes["pressure_radius"] == 2
    for name in EMPTY:
        assert data[name].sizes == {"rim": 0}


@pytest.mark.slow
def test_coordinates_are_places_and_times(recorded_once: Session) -> None:
    path = recorded_once.path
    forces, fields = opened(path, "/entry/forces"), opened(path, "/entry/fields")
    assert_array_equal(forces["time"], np.arange(1003) / 1000.0)
    assert forces["time"].attrs["units"] == "s"
    assert_array_equal(forces["shear_force"], recorded_once.forces[:, 1])
    for name, values in (("x", GRID_X), ("y", GRID_Y), ("frame", [2, 4, 6, 7])):
        assert_array_equal(fields[name], values)
    for group in ("/entry/rings", "/entry/stress", "/entry/results"):
        assert_array_equal(opened(path, group)["frame"], [0, 1, 2, 4, 6, 7])
    camera = opened(path, "/entry/instrument/camera")
    assert_array_equal(camera["frame"], [0, 1, 2, 4, 5, 6, 7])  # 3 was lost
    for frame, image in recorded_once.images.items():
        assert_array_equal(camera["data"].sel(frame=frame), image)
    for name, size in zip("yx", SHAPE, strict=True):
        assert_array_equal(camera[name], np.arange(size))


@pytest.mark.slow
def test_fields_and_results_are_joined_by_their_frames(recorded_once: Session) -> None:
    fields = opened(recorded_once.path, "/entry/fields")
    results = opened(recorded_once.path, "/entry/results")
    both = fields[["ux"]].merge(results[["shear_force"]], join="inner")
    assert_array_equal(both["frame"], [2, 4, 6, 7])
    assert_array_equal(
        both["shear_force"], [s.conditions.shear_force_n for s in recorded_once.snapshots[2:]]
    )


def test_what_only_some_sessions_have(tmp_path: Path) -> None:
    """Further channels, and the map of the pixels, whose coordinates lie in other groups."""
    writer = make_writer(
        tmp_path / "a.h5",
        pattern=PixelPattern(np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)),
        auxiliary=Channels(("heat", "light"), ("K", "V")),
    )
    values = np.arange(14.0).reshape(7, 2)
    writer.append(Samples(0, values, values, values))
    writer.close()
    further, pattern = (
        opened(tmp_path / "a.h5", f"/entry/{name}") for name in ("auxiliary", "pattern")
    )
    assert_named(tmp_path / "a.h5", "/entry/auxiliary", further, set())
    assert_named(tmp_path / "a.h5", "/entry/pattern", pattern, set())
    assert_array_equal(further["value"].sel(name="light"), values[:, 1])
    assert_array_equal(further["time"], np.arange(7) / 1000.0)
    assert_array_equal(pattern["x"], np.arange(SHAPE[1]))


@pytest.mark.parametrize("compression", ["none", "gzip"])
def test_images_in_place_are_numbered(tmp_path: Path, compression: str) -> None:
    """So many bytes of images stay where they were recorded, unless they are compressed."""
    shape = (160, 200)
    writer = make_writer(tmp_path / "a.h5", frame_shape=shape, compression=compression)
    writer.append(Frame(0, 5, np.full(shape, 10, np.uint8)))
    writer.append(LostFrame(1, 130, "no image"))
    for frame in (2, 3):
        writer.append(Frame(frame, 5 + 125 * frame, np.full(shape, 10 + frame, np.uint8)))
    writer.close()
    camera = opened(tmp_path / "a.h5", "/entry/instrument/camera")
    assert camera["frame"].values.tolist() == [0, 2, 3]
    assert camera["data"].sel(frame=3).values.max() == 13


def test_a_session_without_them_is_read_as_before(session: Session, tmp_path: Path) -> None:
    """As a program wrote it that did not name the sides."""

    def contents(path: Path) -> list[Any]:
        with SessionReader(path) as reader:
            return [
                reader.forces().forces.tobytes(),
                reader.results().tobytes(),
                reader.header.divisor,
            ]

    before = contents(session.path)
    with h5py.File(session.path, "r+") as file:
        for path in layout.DERIVED:
            del file[path]
        for dataset in file["/entry/fields"].values():
            for name in ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST"):
                dataset.attrs.pop(name, None)
    assert contents(session.path) == before
