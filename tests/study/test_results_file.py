"""Results come back from their file as they were written; files that are none are refused."""

import warnings

import h5py
import numpy as np
import pytest
from changed_files import attribute, changing, removed, replaced
from results_files import write_results

from app.records.schema import values
from app.records.study_results import StudyResults
from app.session.reader import SessionReader
from app.session.results import ResultsReader, read_results
from app.session.results_layout import RECORDS_ATTRIBUTE, RESULTS_ATTRIBUTE, RUN_PARTS
from app.system.errors import UserError


@pytest.fixture
def written(results, tmp_path):
    write_results(tmp_path / "results.h5", results)
    return tmp_path / "results.h5"


def assert_same(one, other):
    """Every number and text of two runs."""
    assert one.frames.dtype == other.frames.dtype
    for name in one.frames.dtype.names:
        np.testing.assert_array_equal(one.frames[name], other.frames[name])
    for part in RUN_PARTS:
        a, b = getattr(one, part), getattr(other, part)
        for (column, x), (_, y) in zip(values(a), values(b), strict=True):
            np.testing.assert_array_equal(x, y, err_msg=column.path)
            assert isinstance(x, type(y)), column.path


def test_what_is_written_comes_back(results, written):
    back = read_results(written)
    assert len(back.runs) == len(results.runs)
    for one, other in zip(results.runs, back.runs, strict=True):
        assert_same(one, other)
    assert back.joint.notes == results.joint.notes
    assert back.made_with == results.made_with


@pytest.mark.slow
def test_xarray_names_the_sides_of_every_group(written):
    """With the lengths and the coordinates of the layout, and no name that it makes up."""
    import xarray  # with pandas; each process of the suite collects this file

    with h5py.File(written) as file:
        groups = []
        file.visititems(lambda name, one: groups.append(name) if hasattr(one, "keys") else None)
    opened = {}
    for group in groups:
        with (
            warnings.catch_warnings(action="error"),
            xarray.open_dataset(written, group=group, engine="h5netcdf") as data,
        ):
            opened[group] = data.load()
    run = "run_000002"
    assert {f"{run}/{part}" for part in (*RUN_PARTS, "frames", "profile")} <= set(opened)
    frames = opened[f"{run}/frames"]
    assert frames["shear_force"].dims == ("frame",)
    for part, name, dims in (
        ("rings", "ux", ("frame", "rings")),
        ("rings", "stress", ("frame", "radii")),
        ("law", "ratio", ("frame", "pressure_radius")),
        ("instants", "ux", ("frame", "y", "x")),
        ("noise", "sigma", ("box",)),
        ("pictures", "background", ("y0", "x0")),
        ("profile", "grey", ("radius",)),
        ("summary", "pressure", ("pressure_radius",)),
    ):
        assert opened[f"{run}/{part}"][name].dims == dims
    for part in ("rings", "law"):
        np.testing.assert_array_equal(opened[f"{run}/{part}"]["frame"], frames["frame"])
    assert opened[f"{run}/instants"]["x"].attrs["units"] == "m"
    assert opened["joint/loads"]["mu_s"].dims == ("normal_force",)
    assert opened["made_with"]["value"].sel(name="slipscope") == "0.1.0"


def test_a_run_without_a_contact_comes_back(results, tmp_path):
    from dataclasses import replace

    bare = replace(results.runs[0], contact=None)
    write_results(
        tmp_path / "bare.h5", StudyResults(runs=(bare,), joint=results.joint, made_with={})
    )
    assert read_results(tmp_path / "bare.h5").runs[0].contact is None


def test_one_part_of_a_run_can_be_read(results, written):
    with ResultsReader(written) as file:
        kind = RUN_PARTS["summary"]
        assert file.part(kind, 1).static_force_n == results.runs[1].summary.static_force_n


def test_arrays_that_older_results_lack_are_unknown_in_each_place(written):
    with h5py.File(written, "r+") as file:
        file.attrs[RESULTS_ATTRIBUTE] = 2
        file.attrs[RECORDS_ATTRIBUTE] = 6
        for run in ("run_000001", "run_000002"):
            del file[f"{run}/noise/direct"]
    for run in read_results(written).runs:
        np.testing.assert_array_equal(run.noise.direct_px, np.full(run.noise.box_px.shape, np.nan))
        assert run.summary.slide_peak == ()


def test_the_same_results_are_the_same_bytes(results, written, tmp_path):
    write_results(tmp_path / "again.h5", results)
    assert (tmp_path / "again.h5").read_bytes() == written.read_bytes()


def test_a_file_that_exists_is_not_replaced_unasked(results, written):
    before = written.read_bytes()
    with pytest.raises(UserError, match="exists"):
        write_results(written, results)
    assert written.read_bytes() == before


def _text(path):
    path.write_text("a,b\n1,2\n")


def _cut(path):
    path.write_bytes(path.read_bytes()[:-4000])


def _flipped(path):
    with h5py.File(path, "r") as file:
        place = file["run_000001/rings/ux"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place + 100] ^= 64
    path.write_bytes(content)


@changing
def _shorter(file):
    held = file["run_000001/law/slip"][:-1]
    del file["run_000001/law/slip"]
    file["run_000001/law/slip"] = held


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (attribute(RESULTS_ATTRIBUTE, 99), "written by a newer SlipScope"),
        (removed("run_000002/rings/ux"), "damaged at /run_000002/rings/ux: it is missing"),
        (_text, "not an HDF5 file"),
        (_cut, "cut short"),
        (_flipped, "damaged at /run_000001/rings/ux: the bytes are not those"),
        (_shorter, "damaged at /run_000001/law"),
        (
            replaced("run_000001/summary/mu_s", data="high"),
            "damaged at /run_000001/summary/mu_s: it is 0-dimensional text",
        ),
    ],
)
def test_a_spoiled_file_is_a_sentence(written, spoil, said):
    spoil(written)
    with pytest.raises(UserError, match=said) as error:
        read_results(written)
    assert "\n" not in str(error.value)
    assert str(written) in str(error.value)


def test_a_session_is_no_file_of_results_and_the_other_way_round(sessions, written):
    with pytest.raises(UserError, match="a session, but not a file of results"):
        read_results(sessions[0])
    with pytest.raises(UserError, match="analyze`, but not a SlipScope session"):
        SessionReader(written)
