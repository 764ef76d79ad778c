"""The tables of a file of results are what h5py alone reads in it, and programs for NeXus find
their way.
"""

import h5py
import numpy as np
import pytest
from command_line import call, columns_of, numbers, refused
from nexus_definitions import faults
from nexusformat import nexus
from numpy.testing import assert_array_equal
from results_files import write_results
from silx.io import nxdata
from typer.testing import CliRunner

from app.cli import app
from app.files.exporting import RESULTS, export
from app.records.study_results import Joint, StudyResults
from app.session.result_tables import OF_RUNS, TABLES
from app.system.errors import UserError
from slipscope import Results

JOINT = Joint(length_m=3e-7, length_sd_m=1e-8, mu=0.93, mu_sd=0.01, notes=("=one, two",))


@pytest.fixture(scope="module")
def written(results, tmp_path_factory):
    path = tmp_path_factory.mktemp("results") / "results.h5"
    made = StudyResults(
        runs=results.runs, joint=JOINT, made_with={"slipscope": "0.1.0", "preset": "fast"}
    )
    write_results(path, made)
    return path


@pytest.fixture(scope="module")
def tables(written, tmp_path_factory):
    """The folder of all tables, and what was said of it."""
    folder = tmp_path_factory.mktemp("tables") / "all"
    return folder, export(written, folder)


def test_a_folder_gets_every_table_that_has_something_in_it(tables):
    folder, said = tables
    absent = said.partition("nothing for ")[2].split(", ")
    assert "cycles" in absent
    assert {path.stem for path in folder.iterdir()} == set(TABLES) - set(absent)


@pytest.mark.parametrize(
    ("what", "columns"),
    [
        ("rings", {"r_mm": "radius", "ux_um": "ux", "ux_sd_um": "ux_errors"}),
        (
            "stress",
            {"r_mm": "stress_radius", "sigma_kPa": "stress", "sigma_sd_kPa": "stress_errors"},
        ),
    ],
)
def test_profiles_of_all_runs_are_below_one_another(written, tables, what, columns):
    table = columns_of(tables[0] / f"{what}.csv")
    unit = {"mm": 1e-3, "um": 1e-6, "kPa": 1e3}
    with h5py.File(written) as file:
        held = [file[f"run_{n:06d}/rings"] for n in (1, 2)]
        there = [np.isfinite(run[columns["r_mm"]][:]) for run in held]
        for column, name in columns.items():
            expected = [run[name][:][known] for run, known in zip(held, there, strict=True)]
            assert_array_equal(
                numbers(table[column]), np.concatenate(expected) / unit[column.split("_")[-1]]
            )
        counts = [int(known.sum()) for known in there]
        assert min(counts) > 100
        assert_array_equal(numbers(table["run"]), np.repeat([1, 2], counts))
        loads = [file[f"run_{n:06d}/summary/normal_force"][()] for n in (1, 2)]
        assert_array_equal(numbers(table["P_N"]), np.repeat(loads, counts))
        frames = [
            np.broadcast_to(file[f"run_{n:06d}/frames/frame"][:][:, None], known.shape)[known]
            for n, known in zip((1, 2), there, strict=True)
        ]
        assert_array_equal(numbers(table["frame"]), np.concatenate(frames))


def test_the_points_of_the_master_curve(written, tables):
    table = columns_of(tables[0] / "law.csv")
    with h5py.File(written) as file:
        slip = [file[f"run_{n:06d}/law/slip"][:] for n in (1, 2)]
        radii = [file[f"run_{n:06d}/summary/pressure_radius"][:] for n in (1, 2)]
        assert_array_equal(
            numbers(table["slip_um"]), np.concatenate([part.ravel() for part in slip]) / 1e-6
        )
        places = [np.tile(r, len(part)) for r, part in zip(radii, slip, strict=True)]
        assert_array_equal(numbers(table["r_mm"]), np.concatenate(places) / 1e-3)
        ratio = np.concatenate([file[f"run_{n:06d}/law/ratio"][:].ravel() for n in (1, 2)])
        assert_array_equal(numbers(table["ratio"]), ratio)
        assert np.isfinite(ratio).any()


def test_fields_at_the_instants(written, tables):
    table = columns_of(tables[0] / "fields.csv")
    with h5py.File(written) as file:
        held = file["run_000002/instants"]
        shape = held["ux"].shape
        mine = numbers(table["run"]) == 2
        row = np.flatnonzero(mine)[np.ravel_multi_index((3, 5, 7), shape)]
        assert int(table["frame"][row]) == held["frame"][3]
        assert float(table["x_mm"][row]) == held["x"][7] / 1e-3
        assert float(table["y_mm"][row]) == held["y"][5] / 1e-3
        assert_array_equal(
            numbers(table["uy_um"])[mine], (held["uy"][:] / 1e-6).ravel().astype(np.float64)
        )
        assert_array_equal(
            numbers(table["sigma_kPa"])[mine], (held["stress"][:] / 1e3).ravel().astype(np.float64)
        )


def test_frames_keep_their_own_normal_force(written, tables):
    table = columns_of(tables[0] / "results.csv")
    with h5py.File(written) as file:
        for column, name, unit in (
            ("P_N", "normal_force", 1.0),
            ("Q_N", "shear_force", 1.0),
            ("travel_um", "stage_displacement", 1e-6),
            ("peak_radius_mm", "peak_radius", 1e-3),
        ):
            held = [file[f"run_{n:06d}/frames/{name}"][:] for n in (1, 2)]
            assert_array_equal(numbers(table[column]), np.concatenate(held) / unit)


def test_numbers_of_the_runs_and_of_all(written, tables):
    folder, _ = tables
    summary = columns_of(folder / "summary.csv")
    rows = list(zip(summary["run"], summary["symbol"], summary["value"], strict=True))
    with h5py.File(written) as file:
        for n in (1, 2):
            held = file[f"run_{n:06d}/summary"]
            found = {symbol: float(value) for run, symbol, value in rows if run == str(n) and value}
            assert found["Q_s"] == held["static_force"][()]
            assert found["a"] == held["apparent_radius"][()] / 1e-3
    joint = columns_of(folder / "joint.csv")
    at = joint["name"].index("length")
    assert (joint["unit"][at], float(joint["value"][at]), float(joint["sd"][at])) == (
        "um",
        3e-7 / 1e-6,
        1e-8 / 1e-6,
    )
    assert joint["value"][joint["name"].index("young_modulus")] == ""
    assert columns_of(folder / "joint_notes.csv")["note"] == ["'=one, two"]
    assert columns_of(folder / "made_with.csv")["value"] == ["0.1.0", "fast"]
    assert columns_of(folder / "runs.csv")["session"] == ["load-0.06.h5", "load-0.09.h5"]


def test_a_notebook_gets_the_same(written, tables, results):
    with Results(written) as r:
        assert repr(r) == "<Results results.h5: 2 runs>"
        assert (r.joint.mu, r.made_with["preset"]) == (0.93, "fast")
        assert [run.summary.static_force_n for run in r.runs] == [
            run.summary.static_force_n for run in results.runs
        ]
        assert r.runs[-1] is r.runs[1]
        assert len(r.runs[:1]) == 1
        with pytest.raises(IndexError, match="there is no run 2; there are 2"):
            _ = r.runs[2]
        for path in tables[0].iterdir():
            columns, cells = r.table(path.stem), columns_of(path)
            assert list(columns) == list(cells)
            for name, values in columns.items():
                if values.dtype.kind != "U":
                    assert_array_equal(numbers(cells[name]), values, err_msg=f"{path.stem} {name}")
        some = r.table("rings", range(20, 30))
        assert set(some["frame"]) == set(range(20, 30))
        with pytest.raises(UserError, match="it has no table forces; there are results, rings"):
            r.table("forces")


def test_arrays_have_the_same_columns(written, tmp_path):
    export(written, tmp_path / "all.npz")
    with np.load(tmp_path / "all.npz") as found, Results(written) as r:
        assert_array_equal(found["law_ratio"], r.table("law")["ratio"])
        assert_array_equal(found["runs_session"], r.table("runs")["session"])


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("a.csv", "--what", "forces"), "forces cannot be written so; '.csv' takes summary"),
        (("a.csv", "--what", "cycles"), "no block was driven back and forth"),
        (("a.csv", "--what", "runs", "--frames", "1"), "leave --frames out"),
        (("a.csv", "--what", "law", "--frames", "900:901"), "none of these frames was analysed"),
        (("a.pvd",), "ending '.pvd' is not known"),
        (("results.h5",), "ending '.h5' is not known"),
    ],
)
def test_what_can_not_be_exported_says_so(written, tmp_path, more, words):
    output, *rest = more
    refused(call("export", written, "-o", tmp_path / output, *rest), words)
    assert not list(tmp_path.iterdir())


def test_what_exists_stays(written, tmp_path):
    (tmp_path / "summary.csv").write_text("mine")
    with pytest.raises(UserError, match="--overwrite"):
        export(written, tmp_path / "summary.csv")
    assert (tmp_path / "summary.csv").read_text() == "mine"
    (tmp_path / "notes.txt").write_text("mine")
    export(written, tmp_path, overwrite=True)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert len(columns_of(tmp_path / "summary.csv")) > 5


def test_the_help_names_every_table_of_results():
    said = CliRunner().invoke(app, ["export", "--help"], env={"COLUMNS": "400"}).output
    assert all(what in said for what in RESULTS[".csv"])
    assert set(OF_RUNS) < set(TABLES)


def test_a_program_for_nexus_opens_on_the_apparent_radius_over_the_loads(written, results):
    with h5py.File(written) as file:
        found = nxdata.get_default(file)
        assert (found.group.name, found.signal_dataset_name, found.axes_dataset_names) == (
            "/joint/loads",
            "apparent_radius",
            ["normal_force"],
        )
        assert found.errors is not None
        for n, run in enumerate(results.runs):
            assert file["joint/loads/static_force"][n] == run.summary.static_force_n
            assert file["joint/loads/mu_s_errors"][n] == run.summary.mu_s_sd
        assert file["joint/loads/mu_s"].dims[0][0] == file["joint/loads/normal_force"]
    data = nexus.nxload(written).plottable_data
    assert (data.nxsignal.nxname, data.nxaxes[0].nxname) == ("apparent_radius", "normal_force")


def test_the_definitions_of_nexus_are_kept(written):
    assert faults(written) == []


def test_every_plot_of_a_run_is_one(written):
    with h5py.File(written) as file:
        kinds, classes = {}, set()

        def look(name, thing):
            if isinstance(thing, h5py.Group):
                classes.add(thing.attrs["NX_class"])
                if thing.attrs["NX_class"] == "NXdata" and name.startswith("run_000001"):
                    plot = nxdata.NXdata(thing)
                    assert (plot.is_valid, plot.issues) == (True, [])
                    kinds[name.split("/")[1]] = (
                        "curve" if plot.is_curve else "image" if plot.is_image else "stack"
                    )

        file.visititems(look)
        assert file["run_000001"].attrs["default"] == "frames"
    assert classes == {"NXentry", "NXdata", "NXcollection"}
    assert kinds.pop("noise", "curve") == "curve"  # where it was measured
    assert kinds == {
        **{"frames": "curve", "profile": "curve", "instants": "stack"},
        **dict.fromkeys(("rings", "law", "pictures", "search"), "image"),
    }
