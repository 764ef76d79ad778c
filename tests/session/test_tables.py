"""The tables of a session are what its file holds, read by h5py alone, in the units that the names
of their columns say.
"""

from __future__ import annotations

import csv
import io
import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from command_line import call, columns_of, numbers, refused
from numpy.testing import assert_array_equal
from session_material import COUNTS, SUMMARY, Session, make_writer, session_of_format
from typer.testing import CliRunner

from app.cli import app
from app.files.exporting import KINDS, export
from app.files.field_files import read_fields
from app.files.text_tables import write_table
from app.records.analog_channels import Channels
from app.records.record_types import Samples
from app.records.snapshot_numbers import NUMBERS
from app.session.tables import SESSION, budget_columns, rows_of, slide_columns, spelled
from app.system.errors import UserError
from app.system.outputs import cell_of, text_of
from slipscope import Session as Opened

UNIT = {"mm": 1e-3, "um": 1e-6, "kPa": 1e3, "GPa_per_m": 1e9, "uJ": 1e-6}
# those that the session of these tests has nothing for
ABSENT = ("law", "cycles", "slides")


@pytest.fixture
def tables(session: Session, tmp_path: Path) -> Path:
    """A folder of all tables."""
    said = export(session.path, tmp_path / "tables", "tables")
    assert said.endswith(f"; nothing for {', '.join(ABSENT)}")
    names = {path.stem for path in (tmp_path / "tables").iterdir()}
    assert names == set(SESSION) - set(ABSENT)
    return tmp_path / "tables"


@pytest.mark.parametrize(
    ("what", "group", "columns"),
    [
        ("rings", "rings", {"r_mm": "radius", "ux_um": "ux", "ux_sd_um": "ux_errors"}),
        (
            "stress",
            "stress",
            {"r_mm": "radius", "sigma_kPa": "stress", "sigma_sd_kPa": "stress_errors"},
        ),
    ],
)
def test_profiles_have_a_row_for_each_ring_and_frame(
    session: Session, tables: Path, what: str, group: str, columns: dict[str, str]
) -> None:
    table = columns_of(tables / f"{what}.csv")
    with h5py.File(session.path) as file:
        entry = file["entry"]
        counter = {"rings": "ring_count", "stress": "stress_count"}[group]
        frames, count = entry["results/frame"][:], entry[f"results/{counter}"][:]
        assert_array_equal(numbers(table["frame"]), np.repeat(frames, count))
        assert_array_equal(numbers(table["time_s"]), np.repeat(entry["results/time"][:], count))
        for column, name in columns.items():
            held = [row[:n] for row, n in zip(entry[f"{group}/{name}"][:], count, strict=True)]
            unit = UNIT[column.rpartition("_")[2]]
            assert_array_equal(numbers(table[column]), np.concatenate(held) / unit)
    assert "" in table[list(columns)[1]] or what == "stress"  # NaN is an empty cell


def test_the_numbers_of_frames_and_their_units(session: Session, tables: Path) -> None:
    table = columns_of(tables / "results.csv")
    with h5py.File(session.path) as file:
        for name, column in NUMBERS.items():
            cells = table[spelled(name)]
            dataset = file[column.path]
            if name == "phase":
                assert cells == ["background", "background", "drive", "drive", "drive", "drive"]
                continue
            unit = {"N": 1, "m": 1e-6, "Pa": 1e3}.get(dataset.attrs["units"], 1)
            if "radius" in name:
                unit = 1e-3
            assert_array_equal(numbers(cells), dataset[:] / unit, err_msg=name)
    assert list(table)[:6] == ["frame", "sample", "phase", "time_s", "P_N", "Q_N"]


def test_what_the_run_comes_down_to(session: Session, tables: Path) -> None:
    table = columns_of(tables / "summary.csv")
    rows = {
        cells[0]: dict(zip(table, cells, strict=True))
        for cells in zip(*table.values(), strict=True)
    }
    a = rows["apparent radius"]
    assert (a["symbol"], a["unit"], float(a["value"])) == ("a", "mm", 2e-3 / 1e-3)
    assert float(a["sd_noise"]) == pytest.approx(1e-2)
    assert a["sd_inputs"] == ""
    mu = rows["friction of the local law"]
    assert (mu["value"], mu["sd_noise"], mu["unit"]) == ("", "", "")
    assert float(rows["static friction"]["value"]) == SUMMARY.mu_s
    assert float(rows["onset of sliding"]["value"]) == 31.25
    assert rows["sliding velocity"]["unit"] == "um/s"
    assert float(rows["reduced chi2 of the local law"]["value"]) == 1.25
    budget = columns_of(tables / "budget.csv")
    assert (budget["quantity"], budget["input"]) == (["law_mu"] * 2, ["pixel", "k_T"])
    assert_array_equal(numbers(budget["relative_sd"]), [-0.01, 0.002])
    pressure = columns_of(tables / "pressure.csv")
    assert_array_equal(numbers(pressure["r_mm"]), np.array([1e-4, 2e-4]) / 1e-3)
    assert_array_equal(numbers(pressure["p_kPa"]), [50, math.nan])
    assert pressure["k_GPa_per_m"] == ["", ""]
    assert columns_of(tables / "notes.csv")["note"] == list(SUMMARY.notes)


def test_the_budget_gives_each_input_its_share_of_each_quantity() -> None:
    summary = replace(
        SUMMARY,
        budget_inputs=("pixel", "k_T", "E"),
        budget_quantities=("mu_s", "law_length"),
        budget=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0),  # pixel: 1 of mu_s, 2 of L; then k_T, then E
    )
    table = budget_columns(summary)
    rows = list(zip(*(table[name].tolist() for name in table), strict=True))
    assert rows[1] == ("law_length", "pixel", 2.0)
    assert rows[4] == ("mu_s", "E", 5.0)
    assert rows == [(q, i, summary.shares(q)[i]) for q, i, _ in rows]


def test_a_slide_after_a_hold_is_a_row() -> None:
    summary = replace(
        SUMMARY,
        slide_step=(3, 5),
        slide_hold_s=(0.0, 10.0),
        slide_velocity_m_s=(5e-6, 5e-6),
        slide_peak=(0.93, 0.97),
        slide_peak_sd=(0.01, 0.02),
        slide_mu_d=(0.92, 0.93),
        slide_mu_d_sd=(0.001, 0.002),
        slide_rise=(math.nan, 0.04),
        slide_rise_sd=(math.nan, 0.02),
    )
    table = slide_columns(summary)
    assert {name: values[1] for name, values in table.items()} == {
        **{"step": 5, "velocity_um_per_s": 5e-6 / 1e-6, "hold_s": 10, "peak": 0.97},
        **{"peak_sd": 0.02, "mu_d": 0.93, "mu_d_sd": 0.002, "rise": 0.04, "rise_sd": 0.02},
    }


def test_what_a_file_holds_beyond_the_end_of_a_profile_is_not_read(session: Session) -> None:
    with h5py.File(session.path, "r+") as file:
        file["entry/rings/radius"][:] = 1.0
        file["entry/rings/ux"][:] = 1.0
        count = int(file["entry/results/ring_count"][:].sum())
    with Opened(session.path) as s:
        assert len(s.table("rings")["r_mm"]) == count
        assert np.isfinite(s.rings.ux_m).sum() == count


def test_what_happened(session: Session, tables: Path) -> None:
    events = columns_of(tables / "events.csv")
    assert events["text"] == [event.text for event in session.events]
    assert_array_equal(numbers(events["time_s"]), [event.sample / 1000 for event in session.events])
    assert columns_of(tables / "gaps.csv") == {
        "sample": ["500"],
        "time_s": ["0.5"],
        "samples": ["3"],
    }
    counts = columns_of(tables / "counts.csv")
    assert (
        dict(zip(counts["count"], map(int, counts["value"]), strict=True))["frames_lost"]
        == COUNTS.frames_lost
    )
    triggers = columns_of(tables / "triggers.csv")
    assert (triggers["received"], triggers["reason"][3]) == (
        ["1", "1", "1", "0", "1", "1", "1", "1"],
        "no image within 0.5 s",
    )
    stage = columns_of(tables / "stage.csv")
    assert_array_equal(
        numbers(stage["stage_um"]), np.array([metres for _, metres in session.positions]) / 1e-6
    )
    assert columns_of(tables / "profile.csv")["grey_counts"] == ["10.0", "", "12.0"]
    run = columns_of(tables / "run.csv")
    assert dict(zip(run["name"], run["value"], strict=True))["state"] == "done"


def test_a_notebook_gets_the_same_tables(session: Session, tables: Path) -> None:
    with Opened(session.path) as s:
        for what in set(SESSION) - set(ABSENT):
            columns, cells = s.table(what), columns_of(tables / f"{what}.csv")
            assert list(columns) == list(cells)
            assert len({len(values) for values in columns.values()}) == 1
            for name, values in columns.items():
                if values.dtype.kind in "fiub":
                    assert_array_equal(numbers(cells[name]), values, err_msg=f"{what} {name}")
                else:
                    assert cells[name] == values.tolist()
        assert set(s.table("rings", range(4, 5))["frame"]) == {4}


def test_pandas_takes_a_table_as_it_is(session: Session) -> None:
    pandas = pytest.importorskip("pandas")
    with Opened(session.path) as s:
        frame = pandas.DataFrame(s.table("rings"))
        assert frame.groupby("frame")["ux_um"].count().sum() == frame["ux_um"].notna().sum()
        assert list(pandas.DataFrame(s.table("events"))["kind"].unique()) == ["phase"]


def test_xarray_takes_a_table_through_pandas(session: Session) -> None:
    """As the docstring of `table` says: a variable for each column."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    with Opened(session.path) as s:
        table = s.table("rings")
    held = xarray.Dataset.from_dataframe(pandas.DataFrame(table))
    assert list(held.data_vars) == list(table)
    for name, values in table.items():
        assert_array_equal(held[name].to_numpy(), values)


def test_every_exported_table_is_one_line_of_names_and_rows_as_long(
    session: Session, tables: Path, tmp_path: Path
) -> None:
    """So that pandas.read_csv, R and a spreadsheet read it as it is."""
    export(session.path, tmp_path / "images")
    export(session.path, tmp_path / "fields.csv")
    files = [*tables.glob("*.csv"), *(tmp_path / "images").glob("*.csv"), tmp_path / "fields.csv"]
    assert {path.name for path in files} >= {"forces.csv", "metadata.csv", "fields.csv"}
    for path in files:
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        assert rows, path
        assert all(re.fullmatch(r"[A-Za-z][\w.]*", name) for name in header), path
        assert {len(row) for row in rows} == {len(header)}, path
        assert path.read_bytes().endswith(b"\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name")
@pytest.mark.parametrize("ending", [".csv", ".mat"])
def test_the_name_of_a_session_may_be_any_bytes(
    session: Session, tmp_path: Path, ending: str
) -> None:
    renamed = session.path.rename(tmp_path / "m\udcfcller.h5")  # in Latin-1, as on an old disk
    export(renamed, path := tmp_path / f"run{ending}", "run" if ending == ".csv" else "")
    if ending == ".csv":
        names = columns_of(path)["value"]
    else:
        names = [name.rstrip() for name in scipy.io.loadmat(path)["run_value"]]
    assert names[0] == "m\\udcfcller.h5"


def test_pandas_reads_the_exported_tables_as_they_are(
    session: Session, tables: Path, tmp_path: Path
) -> None:
    pandas = pytest.importorskip("pandas")
    export(session.path, tmp_path / "images")
    forces = pandas.read_csv(tmp_path / "images" / "forces.csv")
    assert_array_equal(forces[["P_N", "Q_N"]].to_numpy(), session.forces)
    frames = pandas.read_csv(tmp_path / "images" / "metadata.csv")
    assert frames["frame"].tolist() == list(range(8))
    assert frames["P_N"].dtype == float
    rings = pandas.read_csv(tables / "rings.csv")
    assert rings["ux_um"].dtype == float


def test_a_further_channel_takes_no_column_of_another(tmp_path: Path) -> None:
    """Nor has it a name that MATLAB refuses."""
    names = ("P", "stage", "gap", "R", "flow", "flow_m", "stage", "q")
    units = ("N", "um", "µm", "Ω", "m/s", "s", "mm", "mN")
    writer = make_writer(tmp_path / "a.h5", auxiliary=Channels(names, units))
    further = np.arange(8.0) + np.zeros((5, 8))
    writer.append(Samples(0, np.ones((5, 2)), np.full((5, 2), 9.0), further))
    writer.close()
    export(tmp_path / "a.h5", tmp_path / "forces.csv", "forces")
    found = columns_of(tmp_path / "forces.csv")
    assert found["P_N"] == ["9.0"] * 5
    labels = ["aux_P_N", "aux_stage_um", "gap_um", "R__", "flow_m_s", "aux_flow_m_s"]
    labels += ["aux_stage_mm", "aux_q_mN"]  # which an import takes for the stage and for Q
    assert [float(found[label][0]) for label in labels] == [0, 1, 2, 3, 4, 5, 6, 7]
    export(tmp_path / "a.h5", tmp_path / "a.mat")
    assert {f"forces_{label}" for label in labels} <= set(scipy.io.loadmat(tmp_path / "a.mat"))


def test_a_field_is_a_table(session: Session) -> None:
    with Opened(session.path) as s:
        field = s.fields[3]
        table = field.table()
        assert len(table["x_mm"]) == field.ux_m.size
        row = 4  # of two rows of three points
        assert table["x_mm"][row] == field.x_m[1] / 1e-3
        assert table["y_mm"][row] == field.y_m[1] / 1e-3
        assert table["ux_um"][row] == field.ux_m[1, 1] / 1e-6
        assert table["uy_sd_um"][row] == field.uy_sd_m[1, 1] / 1e-6


def test_rings_in_a_notebook_are_arrays_over_the_results(session: Session) -> None:
    with Opened(session.path) as s:
        assert s.rings.ux_m.shape == (6, 5)
        assert s.rings.stress_pa.shape == (6, 7)
        for n, snapshot in enumerate(session.snapshots):
            count = len(snapshot.rings.ux_m) if snapshot.rings else 0
            if count:
                assert_array_equal(s.rings.radius_m[n, :count], snapshot.rings.radius_m)
                assert_array_equal(s.rings.ux_sd_m[n, :count], snapshot.rings.sd_m)
                assert_array_equal(s.rings.stress_sd_pa[n, : count + 2], snapshot.stress.sd_pa)
            assert np.isnan(s.rings.ux_m[n, count:]).all()
        assert (s.counts, s.state) == (COUNTS, "done")
        assert_array_equal(s.stage.position_m, [metres for _, metres in session.positions])


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_arrays_have_the_columns_of_every_table(
    session: Session, tmp_path: Path, ending: str
) -> None:
    export(session.path, tmp_path / f"all{ending}")
    load: Any = (
        np.load if ending == ".npz" else lambda path: scipy.io.loadmat(path, squeeze_me=True)
    )
    found = load(tmp_path / f"all{ending}")
    with Opened(session.path) as s:
        assert_array_equal(found["rings_ux_um"], s.rings.ux_m / 1e-6)
        assert_array_equal(found["stress_sigma_sd_kPa"], s.rings.stress_sd_pa / 1e3)
        assert_array_equal(found["rings_frame"], s.results["frame"])
        assert_array_equal(found["budget_relative_sd"], [-0.01, 0.002])
        assert list(found["events_kind"]) == [event.kind for event in s.events]


def test_a_text_that_a_spreadsheet_would_run_is_no_formula() -> None:
    file = io.StringIO()
    write_table(file, {"text": np.array(["=1+1", "a, b", '"', "@x"])}, lambda share: None)
    assert file.getvalue().splitlines() == ["text", "'=1+1", '"a, b"', '""""', "'@x"]
    for text in (
        "=1",
        "+1",
        "-1",
        "@x",
        "＝1",
        "＠x",
        "＋1",
        "－1",
        "\t1",
        "\r1",
        "\n1",
        " +1",
        "'+1",
    ):
        assert cell_of(text) == f"'{text}"
        assert text_of(cell_of(text)) == text
    assert cell_of("1+1") == "1+1"


def test_numbers_come_back_to_the_bit() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=9000) * 10.0 ** rng.integers(-30, 30, 9000)
    file = io.StringIO()
    told: list[float] = []
    assert write_table(file, {"x_um": values}, told.append) == 9000
    file.seek(0)
    assert_array_equal(np.loadtxt(file, skiprows=1), values)
    assert told == [0, 8192 / 9000]


def test_points_beyond_the_end_of_a_profile_are_no_rows() -> None:
    table = rows_of(
        {
            "frame": np.array([[3], [4]]),
            "r_mm": np.array([[1.0, 2.0], [1.0, math.nan]]),
            "ux_um": np.array([[5.0, math.nan], [6.0, 7.0]]),
        }
    )
    assert table["frame"].tolist() == [3, 3, 4]
    assert_array_equal(table["ux_um"], [5, math.nan, 6])


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("nonsense", "nonsense cannot be written so; '.csv' takes fields, results, forces, rings"),
        ("law", "a session does not hold its points; `slipscope analyze`"),
        ("cycles", "the block was not driven back and forth"),
    ],
)
def test_a_table_that_is_not_there_is_told(
    session: Session, tmp_path: Path, what: str, words: str
) -> None:
    result = call("export", session.path, "-o", tmp_path / "t.csv", "--what", what)
    refused(result, words)
    assert not list(tmp_path.glob("t*"))


@pytest.mark.parametrize(
    ("content", "words"),
    [("text", "it is not an HDF5 file"), ("hdf5", "an HDF5 file, but not a SlipScope session")],
)
def test_a_file_that_is_neither_session_nor_results_is_told(
    tmp_path: Path, content: str, words: str
) -> None:
    if content == "text":
        (tmp_path / "a.h5").write_text("frame,ux_px\n")
    else:
        h5py.File(tmp_path / "a.h5", "w").close()
    result = call("export", tmp_path / "a.h5", "-o", tmp_path / "t.csv", "--what", "rings")
    refused(result, words)


def test_a_session_cut_short_says_what_it_lacks(tmp_path: Path) -> None:
    make_writer(tmp_path / "cut.h5").close()
    for what in ("results", "rings", "stress", "pressure", "summary", "budget", "profile"):
        with pytest.raises(UserError, match=f"there is nothing for a table of {what}: "):
            export(tmp_path / "cut.h5", tmp_path / "a.csv", what)
    export(tmp_path / "cut.h5", tmp_path / "gaps.csv", "gaps")
    assert (tmp_path / "gaps.csv").read_text() == "sample,time_s,samples\n"


def test_what_is_not_of_frames_takes_no_frames(session: Session, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="events are not of single frames; leave --frames out"):
        export(session.path, tmp_path / "a.csv", "events", frames="1:3")
    export(session.path, tmp_path / "r.csv", "rings", frames="4:6")
    assert set(columns_of(tmp_path / "r.csv")["frame"]) == {"4"}


def test_tables_of_earlier_spellings_are_still_imported(session: Session, tmp_path: Path) -> None:
    export(session.path, tmp_path / "new.csv")
    text = (tmp_path / "new.csv").read_text(encoding="utf-8")
    assert "ux_sd_px" in text
    (tmp_path / "old.csv").write_text(text.replace("_sd_px", "_std_px"), encoding="utf-8")
    new, old = (read_fields(tmp_path / f"{name}.csv", 7e-6) for name in ("new", "old"))
    for (_, ux, sd), (_, old_ux, old_sd) in zip(new.fields(), old.fields(), strict=True):
        assert_array_equal(ux, old_ux)
        assert_array_equal(sd, old_sd)
        assert np.isfinite(sd).any()


def test_the_help_names_every_table() -> None:
    said = CliRunner().invoke(app, ["export", "--help"], env={"COLUMNS": "400"}).output
    for what in KINDS[".csv"]:
        assert re.search(rf"\b{what}\b", said), what


def test_a_session_older_than_the_tractions_has_none(
    recorded_once: Session, tmp_path: Path
) -> None:
    with Opened(session_of_format(2, tmp_path)) as s:
        assert s.rings.stress_pa.shape == (6, 0)
        assert_array_equal(s.rings.ux_m[3, :4], recorded_once.snapshots[3].rings.ux_m)
        with pytest.raises(UserError, match="no shear traction was computed"):
            s.table("stress")
