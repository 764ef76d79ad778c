"""The file is what layout.py says, and a NeXus program finds its way in it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
from nexusformat import nexus
from numpy.testing import assert_array_equal
from session_material import CONTACT, SHAPE, Session, finish, make_snapshot, make_writer

from app.records.pixel_pattern import PixelPattern
from app.records.record_types import (
    ContactResult,
    Counts,
    Event,
    Gap,
    Header,
    Position,
    Samples,
    SourceSession,
)
from app.records.schema import TEXT, columns_of, values
from app.records.summary import Summary
from app.session import layout
from docs import reference

# sides of arrays that have no coordinates, only a length, for netCDF and xarray
LENGTHS = (
    *("/entry/contact/pair", "/entry/rings/rings", "/entry/stress/radii", "/entry/summary/rim"),
    *(f"/entry/summary/{name}" for name in ("pair", "cycles", "reversals", "contributions")),
)


def test_file_holds_the_layout_and_nothing_else(session: Session) -> None:
    assert_laid_out(session.path, without=("/entry/source", "/entry/auxiliary", "/entry/pattern"))


def test_a_further_analysis_names_its_source(tmp_path: Path) -> None:
    writer = make_writer(
        tmp_path / "b.h5",
        source=SourceSession("a.h5", "2026-11-21T12:00:00+00:00"),
        pattern=PixelPattern(np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)),
    )
    finish(writer, CONTACT)
    assert_laid_out(tmp_path / "b.h5", without=("/entry/auxiliary",))


def assert_laid_out(path: Path, without: tuple[str, ...]) -> None:
    found: dict[str, h5py.Dataset] = {}
    groups: dict[str, str] = {}

    def look(name: str, thing: h5py.Dataset | h5py.Group) -> None:
        if isinstance(thing, h5py.Dataset):
            found[f"/{name}"] = (
                thing.ndim,
                thing.dtype.kind,
                thing.attrs.get("units", ""),
                thing.attrs["long_name"],
                thing.attrs.get("interpretation", ""),
            )
        else:
            groups[f"/{name}"] = thing.attrs["NX_class"]

    with h5py.File(path, "r") as file:
        file.visititems(look)
        assert file.attrs[layout.FORMAT_ATTRIBUTE] == layout.FORMAT_VERSION == 9
    kinds = {TEXT: "O", layout.IMAGE: "u"}
    expected = {
        i.path: (
            len(i.shape),
            kinds.get(i.dtype) or np.dtype(i.dtype).kind,
            i.unit,
            i.meaning,
            "image" if i.dtype == layout.IMAGE else "",
        )
        for i in layout.COLUMNS
        if i.group not in without
    }
    length = (1, "f", "", "names a side of other datasets; its values are none", "")
    assert found == expected | dict.fromkeys(LENGTHS, length)
    assert groups == {
        group.path: group.nx_class for group in layout.GROUPS if group.path not in without
    }


def test_every_number_has_a_unit_and_no_text_has() -> None:
    for item in layout.COLUMNS:
        assert bool(item.unit) == (item.dtype != TEXT), item.path
        assert item.meaning


def test_uncertainties_are_beside_what_they_belong_to() -> None:
    paths = {item.path: item for item in layout.COLUMNS}
    errors = [path for path in paths if path.endswith("_errors")]
    assert len(errors) == 25
    for path in errors:
        base = paths[path.removesuffix("_errors")]
        assert (paths[path].shape, paths[path].unit) == (base.shape, base.unit)


def test_every_field_of_the_results_has_a_place() -> None:
    snapshot = make_snapshot(0)
    stored = {column.attribute for column, _ in values(snapshot)}
    parts = (getattr(snapshot, field.name) for field in dataclasses.fields(snapshot))
    held = {f.name for p in parts if dataclasses.is_dataclass(p) for f in dataclasses.fields(p)}
    assert stored == held | {"frame", "sample"}
    for kind in (Header, Samples, Gap, Position, Event, ContactResult, Summary, Counts):
        lacks = {f.name for f in dataclasses.fields(kind)} - {
            column.attribute for column in columns_of(kind)
        }
        assert lacks <= {
            "first",
            "reason",
            "frame_shape",
            "frame_dtype",
            "versions",
            "source",
            "compression",
            "auxiliary",
            "pattern",
        }


def test_default_plot_is_the_load_curve(session: Session) -> None:
    data = nexus.nxload(session.path).plottable_data
    assert (data.nxsignal.nxname, [axis.nxname for axis in data.nxaxes]) == (
        "shear_force",
        ["stage_displacement"],
    )
    assert (data.nxsignal.attrs["units"], data.nxaxes[0].attrs["units"]) == ("N", "m")
    assert_array_equal(
        data.nxsignal.nxvalue, [s.conditions.shear_force_n for s in session.snapshots]
    )
    assert_array_equal(data.nxaxes[0].nxvalue, [s.conditions.travel_m for s in session.snapshots])


@pytest.mark.parametrize(
    ("group", "signal", "shape"),
    [
        ("forces", "shear_force", (1003,)),
        ("fields", "ux", (4, 2, 3)),
        ("rings", "ux", (6, 5)),
        ("profile", "grey", (3,)),
    ],
)
def test_every_plot_resolves(
    session: Session, group: str, signal: str, shape: tuple[int, ...]
) -> None:
    data = nexus.nxload(session.path)["entry"][group].plottable_data
    assert (data.nxsignal.nxname, data.nxsignal.shape) == (signal, shape)
    assert [len(axis) for axis in data.nxaxes] == list(shape)


def test_images_are_raw_chunks_that_any_program_opens(session: Session) -> None:
    with h5py.File(session.path, "r") as file:
        images = file["/entry/instrument/camera/data"]
        assert images.chunks == (1, 12, 16)
        assert images.id.get_create_plist().get_nfilters() == 0
        assert images.id.get_num_chunks() == len(session.images)
        assert_array_equal(images[3], session.images[4])  # trigger 3 gave no image


def test_the_table_of_the_format_names_every_dataset() -> None:
    table = reference.session_datasets().splitlines()
    assert len(table) == 2 + len(layout.COLUMNS)
    assert all(line.count(" | ") == 4 for line in table[2:])
