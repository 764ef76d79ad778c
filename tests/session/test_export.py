"""What `slipscope export` writes, read back by other programs' readers, is what went into the
session.
"""

from __future__ import annotations

import base64
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io
from command_line import rows_of
from numpy.testing import assert_array_equal
from PIL import Image
from session_material import GRID_X, GRID_Y, SHAPE, Session, finish, make_writer, record

from app.cli import file_commands as files
from app.evaluation.setup import forces_of
from app.files.array_files import Array, write_mat
from app.files.exporting import export, frame_range
from app.files.field_files import read_fields
from app.files.frames import Sources
from app.files.importing import understood
from app.files.text_tables import FRAMES, read_table
from app.records.analog_channels import Channels
from app.records.record_types import ZERO, Event, Phase, Samples
from app.records.snapshot_numbers import numbers_of, series_of
from app.settings.config import load, to_toml
from app.system.errors import UserError
from app.system.outputs import cell_of, text_of
from drivers.protocols import Frame, LostFrame

PIXEL = 7.04e-6


def number(cell: str) -> float:
    return float(cell) if cell else math.nan


def everything_in(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_images_come_back_to_the_bit_with_the_fate_of_every_frame(
    session: Session, tmp_path: Path
) -> None:
    assert "7 images, 1 lost" in export(session.path, tmp_path / "images")
    rows = rows_of(tmp_path / "images" / "metadata.csv")
    assert [int(row["frame"]) for row in rows] == list(range(8))
    for frame, row in enumerate(rows):
        sample = 5 + 125 * frame
        assert (int(row["sample"]), float(row["time_s"])) == (sample, sample / 1000)
        exposed = session.forces[sample : sample + 10]
        assert float(row["P_N"]) == pytest.approx(exposed[:, 0].mean(), abs=1e-12)
        assert float(row["Q_N"]) == pytest.approx(exposed[:, 1].mean(), abs=1e-12)
        if frame == 3:
            assert (row["file"], row["reason"]) == ("", "no image within 0.5 s")
        else:
            assert row["file"] == f"{frame:06d}.tiff"
            assert_array_equal(
                np.asarray(Image.open(tmp_path / "images" / row["file"])), session.images[frame]
            )
    at, metres = zip(*session.positions, strict=True)
    assert float(rows[5]["stage_um"]) == pytest.approx(
        np.interp(5 + 125 * 5 + 5, at, metres) * 1e6, rel=1e-12
    )
    assert [row["phase"] for row in rows][:3] == ["phase 0 µ", "phase 1 µ", "phase 2 µ"]
    assert [row["phase_sample"] for row in rows][:3] == ["0", "125", "250"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        *("=1+1", "@SUM(1)", "+1", "-2", "\t=1", "\r=1", "\n=1", " =1", "＝1", "'=1", "''@1"),
        *("", "'", "it's", "no image within 0.5 s", "5-3", "µ = 1"),
    ],
)
def test_no_cell_runs_in_a_spreadsheet_and_each_comes_back(text: str, tmp_path: Path) -> None:
    cell = cell_of(text)
    assert not cell.strip().startswith(("=", "@", "+", "-", "＝"))
    assert text_of(cell) == text
    writer = make_writer(tmp_path / "a.h5")
    writer.append(LostFrame(0, 5, text.strip() or "x"))
    finish(writer)
    export(tmp_path / "a.h5", tmp_path / "out")
    table = read_table(tmp_path / "out" / "metadata.csv", FRAMES)
    assert table.texts["reason"] == [text.strip() or "x"]
    (row,) = rows_of(tmp_path / "out" / "metadata.csv")
    assert row["reason"] == cell_of(text.strip() or "x")


def test_sixteen_bits_stay_sixteen_bits(tmp_path: Path) -> None:
    image = np.arange(SHAPE[0] * SHAPE[1], dtype=np.uint16).reshape(SHAPE) * 300
    writer = make_writer(tmp_path / "deep.h5", frame_dtype="uint16")
    writer.append(Frame(0, 5, image))
    writer.close()
    export(tmp_path / "deep.h5", tmp_path / "deep")
    found = np.asarray(Image.open(tmp_path / "deep" / "000000.tiff"))
    assert found.dtype == np.uint16
    assert_array_equal(found, image)


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("", range(8)),
        ("4", [4]),
        ("1:6:2", [1, 3, 5]),
        ("5:", [5, 6, 7]),
        (":2", [0, 1]),
        ("::3", [0, 3, 6]),
    ],
)
def test_frames_can_be_chosen(
    session: Session, tmp_path: Path, text: str, frames: list[int]
) -> None:
    export(session.path, tmp_path / "some", frames=text)
    assert [int(row["frame"]) for row in rows_of(tmp_path / "some" / "metadata.csv")] == list(
        frames
    )
    names = {f"{frame:06d}.tiff" for frame in frames if frame != 3}
    assert {path.name for path in (tmp_path / "some").glob("*.tiff")} == names


def test_forces_from_before_a_zero_are_imported_as_they_were(tmp_path: Path) -> None:
    config = load(None, ["camera.width=64", "camera.height=64", "dic.box=20", "dic.step=10"])
    volts, zero = np.linspace(0, [1, 2], 200), Event(100, ZERO, "", normal_v=0.05, shear_v=-0.02)
    forces = forces_of(config, volts, [zero])
    about = {"config_toml": to_toml(config), "auxiliary": Channels(("stage",), ("mm",))}
    writer = make_writer(tmp_path / "a.h5", frame_shape=(64, 64), **about)
    writer.append(Event(0, "phase", str(Phase.REFERENCE)))
    writer.append(zero)
    writer.append(Samples(0, volts, forces, np.ones((200, 1))))
    writer.append(Frame(0, 5, np.ones((64, 64), np.uint8)))
    writer.close()
    export(tmp_path / "a.h5", tmp_path / "images")
    back = understood(Sources(images=(tmp_path / "images",)))
    found = forces_of(back.config, back.measured.volts, back.measured.events)
    np.testing.assert_allclose(found, forces, atol=1e-12)


@pytest.mark.parametrize("text", ["x", "1:2:0", "-1", "1:2:3:4", "1.5", "9" * 40])
def test_frames_that_are_none(text: str) -> None:
    with pytest.raises(UserError, match="first:end:step"):
        frame_range(text)


def test_forces_with_all_their_digits_and_gaps_as_empty_cells(
    session: Session, tmp_path: Path
) -> None:
    export(session.path, tmp_path / "forces.csv", "forces")
    rows = rows_of(tmp_path / "forces.csv")
    assert [int(row["sample"]) for row in rows] == list(range(1003))
    assert [row["time_s"] for row in rows[:3]] == ["0.0", "0.001", "0.002"]
    for names, values in (
        (("P_N", "Q_N"), session.forces),
        (("normal_V", "shear_V"), session.volts),
    ):
        assert_array_equal([[number(row[name]) for name in names] for row in rows], values)
    assert rows[501]["P_N"] == rows[501]["shear_V"] == ""


def test_fields_as_a_table_that_invert_reads(session: Session, tmp_path: Path) -> None:
    export(session.path, tmp_path / "fields.csv")
    (constants,) = {
        (row["pixel_um"], row["box_px"], row["noise_box_px"])
        for row in rows_of(tmp_path / "fields.csv")
    }
    assert constants[0] == "7.04"
    found = read_fields(tmp_path / "fields.csv", None)
    assert found.notes[0] == "a pixel is 7.04 um, as fields.csv states"
    assert found.box_m == pytest.approx(float(constants[1]) * PIXEL)
    assert found.noise_box_m == pytest.approx(float(constants[2]) * PIXEL)
    measured = [snapshot for snapshot in session.snapshots if snapshot.field]
    assert found.frames == tuple(snapshot.frame for snapshot in measured)
    np.testing.assert_allclose(found.x_m, GRID_X * PIXEL)
    lens = [s.motion.lens_m * np.cos(np.nan_to_num(s.motion.drive_angle_rad)) for s in measured]
    np.testing.assert_allclose(
        [ux for _, ux, _ in found.fields()],
        np.stack([s.field.ux_px * PIXEL - x for s, x in zip(measured, lens, strict=True)]),
        atol=1e-6 * PIXEL,
    )
    first = rows_of(tmp_path / "fields.csv")[2]
    status = ("ok", "low_contrast", "out_of_image", "decorrelated", "not_converged")[
        measured[0].field.status[0, 2]
    ]
    assert (first["x_px"], first["y_px"], first["status"]) == (
        str(GRID_X[2]),
        str(GRID_Y[0]),
        status,
    )
    assert float(first["uy_sd_px"]) == pytest.approx(
        float(measured[0].field.uy_std_px[0, 2]), abs=1e-6
    )


def test_results_as_a_table(session: Session, tmp_path: Path) -> None:
    export(session.path, tmp_path / "results.csv", "results")
    rows = rows_of(tmp_path / "results.csv")
    for row, snapshot in zip(rows, session.snapshots, strict=True):
        assert (int(row["frame"]), row["phase"]) == (snapshot.frame, snapshot.conditions.phase)
        for column, name, unit in (
            ("stick_radius_mm", "stick_radius_m", 1e-3),
            ("Q_N", "shear_force_n", 1),
            ("lens_um", "lens_m", 1e-6),
        ):
            assert_array_equal(number(row[column]), numbers_of(snapshot)[name] / unit)


def load_mat(path: Path) -> dict[str, Any]:
    found = scipy.io.loadmat(path, squeeze_me=True)
    return {name: values for name, values in found.items() if not name.startswith("__")}


@pytest.mark.parametrize(("ending", "load"), [(".npz", np.load), (".mat", load_mat)])
def test_arrays(session: Session, tmp_path: Path, ending: str, load: Any) -> None:
    export(session.path, tmp_path / f"all{ending}")
    found = load(tmp_path / f"all{ending}")
    measured = [snapshot for snapshot in session.snapshots if snapshot.field]
    for name in ("ux_px", "uy_px", "ux_std_px", "uy_std_px", "zncc", "status"):
        assert_array_equal(
            found[f"fields_{name.replace('std', 'sd')}"],
            np.stack([getattr(s.field, name) for s in measured]),
        )
    assert_array_equal(found["fields_frame"], [s.frame for s in measured])
    assert_array_equal(found["fields_x_px"], GRID_X)
    assert_array_equal(found["forces_P_N"], session.forces[:, 0])
    assert_array_equal(found["forces_shear_V"], session.volts[:, 1])
    metres = np.array([metres for _, metres in session.positions])
    assert_array_equal(found["stage_stage_um"], metres / 1e-6)
    assert_array_equal(found["results_frame"], [s.frame for s in session.snapshots])
    centre = series_of(session.snapshots, "centre_ux_m")
    assert_array_equal(found["results_centre_ux_um"], centre / 1e-6)
    assert (float(found["pixel_m"]), float(found["sample_rate_Hz"])) == (PIXEL, 1000.0)


def read_vti(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Attributes of the image and its arrays, (y, x) or (y, x, component)."""
    image = ET.parse(path).getroot().find("ImageData")
    assert image is not None
    _, nx, _, ny, _, _ = map(int, image.attrib["WholeExtent"].split())
    arrays = {}
    for data in image.iter("DataArray"):
        raw = base64.b64decode(data.text or "")
        values = np.frombuffer(raw[8:], {"Float32": "<f4", "UInt8": "u1"}[data.attrib["type"]])
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        arrays[data.attrib["Name"]] = values.reshape(
            ny + 1, nx + 1, *([3] if "NumberOfComponents" in data.attrib else [])
        )
    return image.attrib, arrays


def test_paraview_sees_what_the_camera_saw(session: Session, tmp_path: Path) -> None:
    export(session.path, tmp_path / "fields.pvd")
    listed = list(ET.parse(tmp_path / "fields.pvd").getroot().iter("DataSet"))
    measured = [snapshot for snapshot in session.snapshots if snapshot.field]
    assert [float(entry.attrib["timestep"]) for entry in listed] == [
        (s.sample + 5) / 1000 for s in measured
    ]
    for entry, snapshot in zip(listed, measured, strict=True):
        image, arrays = read_vti(tmp_path / entry.attrib["file"])
        x0, y0, _ = map(float, image["Origin"].split())
        dx, dy, _ = map(float, image["Spacing"].split())
        np.testing.assert_allclose(x0 + dx * np.arange(3), GRID_X * PIXEL)
        np.testing.assert_allclose(-(y0 + dy * np.arange(2)), GRID_Y[::-1] * PIXEL)  # y points up
        moved = arrays["displacement_m"][::-1]
        np.testing.assert_allclose(moved[..., 0], snapshot.field.ux_px * PIXEL, rtol=1e-6)
        np.testing.assert_allclose(moved[..., 1], -snapshot.field.uy_px * PIXEL, rtol=1e-6)
        np.testing.assert_allclose(
            arrays["displacement_std_m"][::-1, :, 1], snapshot.field.uy_std_px * PIXEL, rtol=1e-6
        )
        assert_array_equal(arrays["status"][::-1], snapshot.field.status)
        assert_array_equal(arrays["zncc"][::-1], snapshot.field.zncc)


def test_a_disk_without_room_is_told_in_a_unit_that_shows_it(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.files.exporting.shutil.disk_usage", lambda _: SimpleNamespace(free=50))
    with pytest.raises(UserError, match=r"need [1-9]\d* kB, 0 kB are free; make room"):
        export(session.path, tmp_path / "images")


OUTPUTS = ["images", "fields.csv", "all.npz", "all.mat", "fields.pvd"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_nothing_is_overwritten_without_the_option(
    session: Session, tmp_path: Path, name: str
) -> None:
    target = tmp_path / "out" / name
    target.parent.mkdir()
    if not target.suffix:
        target.mkdir()
    (target if target.suffix else target / "000099.tiff").write_text("precious")
    (target.parent / "mine.txt").write_text("mine")
    before = everything_in(target.parent)
    with pytest.raises(UserError, match="--overwrite"):
        export(session.path, target)
    assert everything_in(target.parent) == before
    export(session.path, target, overwrite=True)
    after = everything_in(target.parent)
    assert after["mine.txt"] == b"mine"
    # no frame of an export before is left among the new ones
    assert b"precious" not in after.values()
    assert not [name for name in after if ".part" in name]


def test_an_export_for_paraview_replaces_fields_only(session: Session, tmp_path: Path) -> None:
    """Not the pictures of an export, or of a laboratory, in the folder that it is named after."""
    export(session.path, tmp_path / "all")
    before = everything_in(tmp_path / "all")
    (tmp_path / "all/000099.vti").write_text("of an export before")
    export(session.path, tmp_path / "all.pvd", overwrite=True)
    after = everything_in(tmp_path / "all")
    assert "000001.tiff" in before
    assert {name: after[name] for name in after if not name.endswith(".vti")} == before
    assert "000099.vti" not in after


@pytest.mark.parametrize("name", OUTPUTS)
def test_an_export_that_fails_leaves_nothing(session: Session, tmp_path: Path, name: str) -> None:
    (tmp_path / "out").mkdir()
    calls = 0

    def full_disk(text: str, share: float) -> None:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise OSError(28, "No space left on device")

    with pytest.raises(UserError, match="No space left"):
        export(session.path, tmp_path / "out" / name, on_progress=full_disk)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "what", "frames", "words"),
    [
        ("a.xlsx", "", "", "ending '.xlsx' is not known"),
        ("a.npz", "forces", "", "cannot be written so"),
        ("a.csv", "forces", "1:4", "leave --frames out"),
        ("a", "", "70:90", "none of the frames"),
        ("a.csv", "", "0:2", "no displacement field"),
        ("a.pvd", "", "5", "no displacement field"),
        ("a.csv", "results", "5", "none of these frames was analysed"),
        ("no/where.csv", "", "", "does not exist"),
    ],
)
def test_what_can_not_be_exported_says_so(
    session: Session, tmp_path: Path, name: str, what: str, frames: str, words: str
) -> None:
    before = everything_in(tmp_path)
    with pytest.raises(UserError, match=words):
        export(session.path, tmp_path / name, what, frames=frames)
    assert everything_in(tmp_path) == before


def test_the_session_itself_is_not_replaced(session: Session, tmp_path: Path) -> None:
    link = tmp_path / "same.csv"
    link.hardlink_to(session.path)
    with pytest.raises(UserError, match="the session itself"):
        export(session.path, link, overwrite=True)


def test_a_session_cut_short_can_be_exported(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "cut.h5")
    writer.close()
    export(written.path, tmp_path / "images")
    assert len(list((tmp_path / "images").glob("*.tiff"))) == 7


@pytest.mark.parametrize(("ending", "load"), [(".npz", np.load), (".mat", load_mat)])
def test_a_session_without_a_frame_gives_its_forces(tmp_path: Path, ending: str, load: Any) -> None:
    writer, written = make_writer(tmp_path / "none.h5"), tmp_path / f"all{ending}"
    finish(writer)
    export(tmp_path / "none.h5", written)
    found = load(written)
    assert found["fields_frame"].size == found["results_frame"].size == 0
    assert found["sample_rate_Hz"] == 1000.0


@pytest.mark.parametrize("texts", [["", "", ""], ["", "late", ""]])
def test_texts_of_a_mat_file_have_a_row_each(tmp_path: Path, texts: list[str]) -> None:
    """Of a column in which no row says anything MATLAB had no row."""
    values = np.array(texts)
    write_mat(tmp_path / "t.mat", [Array("reason", values.shape, values.dtype, [values])])
    found = scipy.io.loadmat(tmp_path / "t.mat")["reason"]
    assert [text.rstrip() for text in found] == texts


def test_the_command_says_what_it_wrote(
    session: Session, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        files.export(session.path, tmp_path / "f.csv", "", "2:5", overwrite=False, as_json=False)
        == 0
    )
    assert capsys.readouterr().out == f"{tmp_path / 'f.csv'}: 2 fields of 6 points\n"
