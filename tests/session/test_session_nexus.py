"""Programs that display NeXus files find every plot of a session by themselves, with its axes and
its uncertainties.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from nexus_definitions import faults
from nexusformat import nexus
from session_material import SHAPE, Session, make_writer
from silx.io import nxdata

from app.records.pixel_pattern import PixelPattern
from app.session import layout

MAP = "/entry/pattern"  # where it was calibrated
PLOTS = {group.path: group for group in layout.GROUPS if group.signal and group.path != MAP}


def test_the_definitions_of_nexus_are_kept(session: Session) -> None:
    assert faults(session.path) == []


def test_what_the_definitions_forbid_is_found(session: Session) -> None:
    with h5py.File(session.path, "r+") as file:
        file.create_group("odd").attrs["NX_class"] = "NXcollection"
    assert faults(session.path) == ["NXcollection is an invalid class in NXroot"]


def test_the_defaults_lead_to_the_load_curve(session: Session) -> None:
    """The chain of @default attributes, as the NeXus manual tells a program to follow it."""
    with h5py.File(session.path, "r") as file:
        place = file
        while "default" in place.attrs:
            place = place[place.attrs["default"]]
        assert (place.name, place.attrs["NX_class"], place.attrs["signal"]) == (
            "/entry/results",
            "NXdata",
            "shear_force",
        )
        assert list(place.attrs["axes"]) == ["stage_displacement"]
        assert place["stage_displacement"].shape == place["shear_force"].shape


def test_the_map_of_the_pixels_is_an_image(tmp_path: Path) -> None:
    gain, dark = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    make_writer(tmp_path / "a.h5", pattern=PixelPattern(gain, dark)).close()
    assert faults(tmp_path / "a.h5") == []
    assert nexus.nxload(tmp_path / "a.h5")[MAP].plottable_data.nxsignal.nxname == "gain"
    with h5py.File(tmp_path / "a.h5") as file:
        found = nxdata.NXdata(file[MAP])
        assert found.is_image
        assert found.signal_dataset_name == "gain"


@pytest.mark.parametrize("path", PLOTS)
def test_nexpy_finds_the_plot(session: Session, path: str) -> None:
    group = PLOTS[path]
    data = nexus.nxload(session.path)[path].plottable_data
    assert data.nxsignal.nxname == group.signal
    assert [len(axis) for axis in data.nxaxes] == list(data.nxsignal.shape)
    assert [
        axis.nxname for axis, name in zip(data.nxaxes, group.axes, strict=False) if name != "."
    ] == [name for name in group.axes if name != "."]
    for name, thing in nexus.nxload(session.path)[path].items():
        if name.endswith("_errors"):
            assert (
                thing.shape == nexus.nxload(session.path)[path][name.removesuffix("_errors")].shape
            )


@pytest.mark.parametrize(
    "path", [path for path in PLOTS if path in {"/entry/rings", "/entry/stress", "/entry/fields"}]
)
def test_nexpy_finds_the_uncertainty_of_the_signal(session: Session, path: str) -> None:
    data = nexus.nxload(session.path)[path]
    assert data.nxerrors is not None
    assert data.nxerrors.shape == data.nxsignal.shape


def test_silx_finds_every_plot(session: Session) -> None:
    with h5py.File(session.path, "r") as file:
        default = nxdata.get_default(file)
        assert (default.group.name, default.signal_dataset_name, default.axes_dataset_names) == (
            "/entry/results",
            "shear_force",
            ["stage_displacement"],
        )
        kinds = {}
        for path, group in PLOTS.items():
            found = nxdata.NXdata(file[path])
            assert (found.is_valid, found.issues, found.signal_dataset_name) == (
                True,
                [],
                group.signal,
            )
            kinds[path] = (
                "curve"
                if found.is_curve
                else "image"
                if found.is_image
                else "stack"
                if found.is_stack
                else ""
            )
            assert (found.errors is not None) == (f"{path}/{group.signal}_errors" in file)
    curves = dict.fromkeys(["/entry/forces", "/entry/results", "/entry/profile"], "curve")
    assert kinds == curves | {
        "/entry/rings": "image",
        "/entry/stress": "image",
        "/entry/fields": "stack",
    }
