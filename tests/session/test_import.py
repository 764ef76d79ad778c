"""Images and forces of other benches become sessions that replay to the bit; what they leave open
must be given as an option.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import short_run
import whole_runs
from PIL import Image

from app.cli import file_commands as files
from app.files.exporting import export
from app.files.frames import Sources
from app.files.importing import Imported, import_files
from app.records.record_types import (
    Phase,
)
from app.records.snapshot_numbers import series_of
from app.session.reader import SessionReader
from app.settings.config import ConfigError
from app.system.errors import UserError
from tests.same_results import difference

SHORT = (*short_run.SHORT, "sample.lens_compliance=1.5")
LOST = 20
KNOWN: dict[str, Any] = {"pixel_um": 7.04, "rate_hz": 1000, "divisor": 125}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated experiment in which one trigger was lost."""
    path = tmp_path_factory.mktemp("original") / "original.h5"
    outcome = whole_runs.recorded(path, *SHORT, f'sim.faults=["lost-trigger {LOST}"]')
    assert outcome.counts.frames_lost == 1
    return path


@pytest.fixture(scope="module")
def exported(original: Path) -> Path:
    """Its images and forces as files."""
    folder = original.with_name("exported")
    export(original, folder)
    return folder


@pytest.fixture(scope="module")
def few(original: Path) -> Path:
    """Images alone, 16 to 23, as another program would name them: shot_17.png to shot_24.png
    without 21.
    """
    folder = original.with_name("few")
    folder.mkdir()
    with SessionReader(original) as session:
        for index, _, image in session.frames():
            if 16 <= index < 24:
                Image.fromarray(image).save(folder / f"shot {index + 1}.png")
    return folder


def replayed(path: Path) -> tuple[int, int, str]:
    comparison = whole_runs.replayed(path).comparison()
    return comparison.frames, comparison.identical, comparison.first_difference


def imported(output: Path, *images: Path, **given: Any) -> Imported:
    return import_files(Sources(images=images, **given), output)


@pytest.mark.slow
def test_export_and_import_give_the_same_results(
    original: Path, exported: Path, tmp_path: Path
) -> None:
    back = imported(tmp_path / "back.h5", exported)
    assert (back.outcome.counts.frames_lost, back.outcome.counts.samples_lost) == (1, 0)
    with SessionReader(original) as a, SessionReader(tmp_path / "back.h5") as b:
        assert (
            a.header.config_toml.split("[run]")[1].split("[camera]")[0]
            == b.header.config_toml.split("[run]")[1].split("[camera]")[0]
        )
        for name in ("divisor", "exposure_samples", "pixel_m", "first_trigger"):
            assert getattr(a.header, name) == getattr(b.header, name)
        assert (
            a.triggers()[["index", "sample", "received"]].tolist()
            == b.triggers()[["index", "sample", "received"]].tolist()
        )
        assert a.lost_frames() == b.lost_frames()
        np.testing.assert_array_equal(a.triggers()["stamp"], b.triggers()["stamp"])
        np.testing.assert_array_equal(a.forces().volts, b.forces().volts)
        np.testing.assert_array_equal(a.forces().forces, b.forces().forces)
        for x, y in zip(a.snapshots(), b.snapshots(), strict=True):
            travel_m = x.conditions.travel_m
            assert y.conditions.travel_m == pytest.approx(travel_m, abs=1e-9)
            same = replace(y, conditions=replace(y.conditions, travel_m=travel_m))
            assert not difference(x, same)  # to the bit
        first, second = a.outcome.summary, b.outcome.summary
        assert first is not None
        assert second is not None
        np.testing.assert_equal(
            (second.mu_s, second.onset_time_s, second.notes),
            (first.mu_s, first.onset_time_s, first.notes),
        )
    assert replayed(tmp_path / "back.h5") == (
        back.outcome.counts.frames_analysed,
        back.outcome.counts.frames_analysed,
        "",
    )


def write_foreign_forces(original: Path, path: Path) -> None:
    """Forces as another program writes them: 100 rows a second at uneven times in ms, mN with
    decimal commas, a column more.
    """
    with SessionReader(original) as session:
        newtons = session.forces().forces
    rng = np.random.default_rng(4)
    lines = ["time_ms;P_mN;Q_mN;operator"]
    for sample in range(0, len(newtons), 10):
        at = sample + (rng.uniform(-0.3, 0.3) if sample else 0.0)
        lines.append(
            f"{at:.4f};{newtons[sample, 0] * 1e3:.5f};{newtons[sample, 1] * 1e3:.5f};x".replace(
                ".", ","
            )
        )
    path.write_text("\n".join(lines), encoding="utf-8-sig")


@pytest.mark.slow
def test_foreign_images_and_forces(original: Path, exported: Path, tmp_path: Path) -> None:
    """Without settings and metadata: the numbers in the names, a table with its own clock and
    units, the drive where Q rises.
    """
    folder = tmp_path / "images"
    folder.mkdir()
    for path in exported.glob("*.tiff"):
        Image.open(path).save(folder / f"a{int(path.stem) + 1}.png")  # a2 comes before a10
    write_foreign_forces(original, tmp_path / "table.csv")
    back = imported(
        tmp_path / "foreign.h5",
        folder,
        forces=tmp_path / "table.csv",
        background=3,
        reference=16,
        overrides=("sample.lens_compliance=1.5",),
        **KNOWN,
    )
    with SessionReader(original) as a, SessionReader(tmp_path / "foreign.h5") as b:
        assert [(index, sample) for index, sample, _ in b.lost_frames()] == [(LOST, LOST * 125)]
        began = {event.text: event.sample for event in a.events() if event.kind == "phase"}
        found = {event.text: event.sample for event in b.events() if event.kind == "phase"}
        assert found["drive"] == pytest.approx(began["drive"], abs=20)  # 20 ms are 0.1 um of travel
        assert found["reference"] == 16 * 125
        for index, sample, image in b.frames():
            assert sample == index * 125
            np.testing.assert_array_equal(image, a.frame(index)[2])
        P, Q = (series_of(b.snapshots(), name) for name in ("normal_force_n", "shear_force_n"))
        P0, Q0 = (series_of(a.snapshots(), name) for name in ("normal_force_n", "shear_force_n"))
        # read off a line between points 10 ms apart
        np.testing.assert_allclose(P[4:], P0[4 : len(P)], atol=1e-4)
        np.testing.assert_allclose(Q, Q0[: len(Q)], atol=1e-4)
        # nobody said where the stage was
        assert np.isnan(series_of(b.snapshots(), "travel_m")).all()
        summary = a.outcome.summary
    assert summary is not None
    assert back.outcome.summary is not None
    assert back.outcome.summary.mu_s == pytest.approx(summary.mu_s, rel=2e-3)
    assert back.outcome.summary.apparent_radius_m == pytest.approx(
        summary.apparent_radius_m, rel=0.02
    )
    frames, identical, unlike = replayed(tmp_path / "foreign.h5")
    assert (frames, identical, unlike) == (back.outcome.counts.frames_analysed, frames, "")


def test_images_alone(few: Path, tmp_path: Path) -> None:
    back = imported(tmp_path / "few.h5", few, **KNOWN)
    assert any("no forces" in remark for remark in back.remarks)
    with SessionReader(tmp_path / "few.h5") as session:
        assert [(index, sample) for index, sample, _ in session.lost_frames()] == [(4, 500)]
        assert session.gaps() == [(0, 7 * 125 + 10)]
        *_, last = session.snapshots()
        assert (last.frame, last.conditions.phase) == (7, Phase.DRIVE)
        assert np.isfinite(last.field.ux_px).mean() > 0.9
        assert np.isnan(last.conditions.normal_force_n)
    assert replayed(tmp_path / "few.h5") == (7, 7, "")


def test_a_broken_image_is_a_named_loss(few: Path, tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(few, folder)
    (folder / "shot 19.png").write_bytes(b"not an image")
    Image.new("L", (100, 100)).save(folder / "shot 20.png")
    assert imported(tmp_path / "b.h5", folder, **KNOWN).outcome.counts.frames_lost == 3
    with SessionReader(tmp_path / "b.h5") as session:
        reasons = {index: reason for index, _, reason in session.lost_frames()}
    assert "not an image" in reasons[2]
    assert reasons[3] == "'shot 20.png' is 100 x 100 uint8, the first image 400 x 300 uint8"


def test_metadata_says_which_image_is_which(few: Path, tmp_path: Path) -> None:
    """Times in s at an uneven pace, images in another order than their names, one that is not
    there.
    """
    (tmp_path / "list.csv").write_text(
        "frame,time_s,file,phase\n0,0.2,shot 24.png,contact\n1,0.35,shot"
        " 17.png,reference\n2,0.6,gone.png,reference\n"
        "3,0.7,shot 18.png,drive\n"
    )
    back = imported(
        tmp_path / "m.h5", few, metadata=tmp_path / "list.csv", pixel_um=7.04, rate_hz=1000
    )
    assert any("4 images that" in remark for remark in back.remarks)
    with SessionReader(tmp_path / "m.h5") as session:
        assert [(int(row["index"]), int(row["sample"])) for row in session.triggers()] == [
            (0, 200),
            (1, 350),
            (2, 600),
            (3, 700),
        ]
        assert session.lost_frames() == [(2, 600, "'gone.png' is not there")]
        np.testing.assert_array_equal(
            session.frame(3)[2], np.asarray(Image.open(few / "shot 18.png"))
        )
        assert [s.conditions.phase for s in session.snapshots()] == [
            Phase.CONTACT,
            Phase.REFERENCE,
            Phase.DRIVE,
        ]
        assert session.header.divisor == 150
    assert replayed(tmp_path / "m.h5")[1:] == (3, "")


def test_a_gap_in_the_forces_stays_a_gap(few: Path, tmp_path: Path) -> None:
    rows = [f"{n},0.5,{0.001 * max(0, n - 200):.6f}" for n in range(900) if not 300 <= n < 350]
    rows[100] = "100,,"
    (tmp_path / "f.csv").write_text("sample,P_N,Q_N\n" + "\n".join(rows))
    imported(tmp_path / "g.h5", few, forces=tmp_path / "f.csv", drive=3, **KNOWN)
    with SessionReader(tmp_path / "g.h5") as session:
        assert session.gaps() == [(100, 1), (300, 50)]
        newtons = session.forces().forces
        assert np.flatnonzero(np.isnan(newtons).any(axis=1)).tolist() == [100, *range(300, 350)]
        known = np.isfinite(newtons[:, 0])
        np.testing.assert_allclose(
            newtons[known, 1], 0.001 * np.maximum(0, np.flatnonzero(known) - 200), atol=1e-9
        )
        assert {event.text.split(":")[0] for event in session.events() if event.kind == "gap"} == {
            "1 sample lost",
            "50 samples lost",
        }


NUMBERS = "sample,P_N,Q_N\n0,0.5,0\n"


@pytest.mark.parametrize(
    ("given", "table", "words"),
    [
        ({"rate_hz": 1000, "divisor": 125}, None, "size of a pixel.*--pixel"),
        ({"pixel_um": 7.0, "divisor": 125}, None, "--rate"),
        ({"pixel_um": 7.0, "rate_hz": 1000}, None, "--divisor"),
        (KNOWN | {"reference": 4}, None, "--reference: frame 4 .* no image"),
        (KNOWN | {"background": 99}, None, "--background: frame 99"),
        (KNOWN | {"background": 3, "reference": 2}, None, "does not come before the reference"),
        (KNOWN | {"reference": 2, "drive": 2}, None, "--drive: frame 2"),
        (KNOWN | {"reference": 2}, NUMBERS + "255,0.5,0\n", "--reference: frame 2 has no forces"),
        (KNOWN | {"pixel_um": -1.0}, None, "camera.pixel must be"),
        (KNOWN, "P,Q\n1,2\n", "neither P_N and Q_N nor normal_V"),
        (KNOWN | {"rate_hz": None}, "P_N,Q_N\n1,2\n", "neither sample nor time_s"),
        (KNOWN, "", "it has no rows"),
        (KNOWN, NUMBERS + "1,x,0\n", "'x' in column P_N, row 2, is no number"),
        (KNOWN, NUMBERS + "1,inf,0\n", "'inf' in column P_N"),
        (KNOWN, NUMBERS + "1,0.5\n", "row 2 has 2 cells"),
        (KNOWN, NUMBERS + "0,0.5,0\n", "sample of row 2 is 0, not after 0 of the row before; put"),
        (KNOWN, NUMBERS + "1e12,0.5,0\n", "row 2 comes 1e\\+09 s after"),
        (KNOWN, "time_s,P_N,Q_N\n1.7e9,1,0\n1.7e9,1,0\n", "not after|comes 1.7e\\+09 s"),
        (
            KNOWN,
            "time_s,P_N,Q_N\n" + "".join(f"{n / 5000},1,0\n" for n in range(5000)),
            "give --rate 5000",
        ),
        (KNOWN, "sample,P_N,Q_N,p_mN\n0,1,1,1\n", "names a quantity twice"),
        (
            KNOWN,
            "sample,P_N,Q_N\n" + "".join(f"{n},0.5,0.001\n" for n in range(900)),
            "Q does not rise.*--drive",
        ),
        (
            KNOWN,
            "sample,P_N,Q_N,normal_V,shear_V\n0,0.5,0,0.5,0\n1,0.5,0,0.5,0\n",
            "from those in newtons",
        ),
    ],
)
def test_what_is_missing_or_can_not_be_is_a_sentence(
    few: Path, tmp_path: Path, given: dict[str, Any], table: str | None, words: str
) -> None:
    if table is not None:
        (tmp_path / "table.csv").write_text(table)
        given = given | {"forces": tmp_path / "table.csv"}
    with pytest.raises((UserError, ConfigError), match=words):
        imported(tmp_path / "no.h5", few, **given)
    assert [path.name for path in tmp_path.iterdir() if path.name != "table.csv"] == []


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("frame,sample,file\n0,0,a.png\n", r"not one of the images .*'a\.png' is not there"),
        ("frame,sample\n0,0\n1,125\n", "2 rows for 7 images; add a column file"),
        ("frame,sample,file\n0,0,shot 17.png\n0,125,shot 18.png\n", "must be whole"),
        ("frame,sample,file\n0,0,shot 17.png\n1000000000,125,shot 18.png\n", "number the frames"),
        ("frame,sample,file,phase\n0,0,shot 17.png,rest\n", "phase 'rest' of frame 0 is not known"),
        ("frame,sample,file,phase\n0,0,shot 17.png,drive\n", "no frame is of phase reference"),
        ("frame,time_s,file\n0,0,shot 17.png\n1,nan,shot 18.png\n", "row 2: time_s is empty"),
    ],
)
def test_metadata_that_can_not_be(few: Path, tmp_path: Path, table: str, words: str) -> None:
    (tmp_path / "list.csv").write_text(table)
    with pytest.raises(UserError, match=words):
        imported(tmp_path / "no.h5", few, metadata=tmp_path / "list.csv", **KNOWN)
    assert [path.name for path in tmp_path.iterdir()] == ["list.csv"]


@pytest.mark.parametrize(
    "name", ["{outside}", "../outside.png", "below/../../outside.png", "link.png", "linked/one.png"]
)
def test_metadata_names_only_images_of_their_folder(few: Path, tmp_path: Path, name: str) -> None:
    folder, outside = tmp_path / "folder", tmp_path / "outside.png"
    for path in (folder / "below" / "one.png", tmp_path / "away" / "one.png", outside):
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(few / "shot 17.png", path)
    (folder / "list.csv").write_text(
        f"frame,sample,file\n0,0,{name.format(outside=outside)}\n", encoding="utf-8"
    )
    if "link" in name:
        try:
            (folder / "link.png").symlink_to(outside)
            (folder / "linked").symlink_to(tmp_path / "away", target_is_directory=True)
        except OSError:  # Windows needs a right for that
            return
    given = {"metadata": folder / "list.csv"} | KNOWN
    with pytest.raises(UserError, match=r"name only files in|is not in the folder"):
        imported(tmp_path / "no.h5", folder / "below" / "one.png", **given)


@pytest.mark.parametrize("file", ["shot 99.png", "forces.csv", "settings.toml"])
def test_no_link_in_a_folder_leads_out_of_it(few: Path, tmp_path: Path, file: str) -> None:
    folder = Path(shutil.copytree(few, tmp_path / "folder"))
    (tmp_path / "outside").write_text("secret", encoding="utf-8")
    try:
        (folder / file).symlink_to(tmp_path / "outside")
    except OSError:
        return
    with pytest.raises(UserError, match="is not in the folder"):
        imported(tmp_path / "no.h5", folder, **KNOWN)


def test_names_that_count_nothing_are_remarked_on(few: Path, tmp_path: Path) -> None:
    for path, name in zip(sorted(few.iterdir()), ("at 1000", "at 1777", "at 900000"), strict=False):
        shutil.copy(path, tmp_path / f"{name}.png")
    back = imported(tmp_path / "s.h5", *tmp_path.glob("*.png"), **KNOWN)
    assert any("do not count them" in remark for remark in back.remarks)
    assert (back.outcome.counts.triggers, back.outcome.counts.frames_lost) == (3, 0)


def test_a_session_is_not_overwritten_without_the_option_and_stays_if_the_import_fails(
    few: Path, tmp_path: Path
) -> None:
    (tmp_path / "old.h5").write_bytes(b"precious")
    with pytest.raises(UserError, match="--overwrite"):
        imported(tmp_path / "old.h5", few, **KNOWN)

    def broken(text: str, share: float) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(UserError, match="No space left"):
        import_files(
            Sources(images=[few], **KNOWN), tmp_path / "old.h5", overwrite=True, on_progress=broken
        )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"old.h5": b"precious"}


def test_the_command_tells_what_was_assumed(
    few: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert files.import_([few], tmp_path / "c.h5", overrides=["dic.step=20"], **KNOWN) == 0
    said = capsys.readouterr().out
    assert "imported: 7 images given, 1 missing, from" in said
    assert "the reference is frame 0" in said
    assert "no settings" in said
    with SessionReader(tmp_path / "c.h5") as session:
        assert np.diff(session.header.grid_x_px)[0] == 20


@pytest.mark.parametrize(
    ("name", "head", "cells"),
    [("metadata", "sample,stage_um", "1"), ("forces", "sample,P_N,Q_N", "0.03,0.01")],
)
def test_a_few_rows_over_hours_are_refused(
    few: Path, tmp_path: Path, name: str, head: str, cells: str
) -> None:
    """Every sample between them takes memory: a table of a hundred bytes could take all there
    is.
    """
    rows = [f"{n * 3_500_000},{cells}" for n in range(7)]
    (tmp_path / "table.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    with pytest.raises(
        UserError,
        match=r"table\.csv: 7 rows cover 2\.1e\+07 samples at 1000 Hz; give a lower --rate",
    ):
        imported(tmp_path / "new.h5", few, **{name: tmp_path / "table.csv"}, **KNOWN)
    assert not (tmp_path / "new.h5").exists()


def test_a_name_that_no_disk_can_hold_and_a_phase_out_of_this_world(
    few: Path, tmp_path: Path
) -> None:
    rows = [
        f"{125 * n},{phase},{began},{name}"
        for n, (phase, began, name) in enumerate(
            [
                ("reference", "0", "shot 17.png"),
                ("drive", "1e300", "shot 18.png"),
                ("drive", "", "x" * 5000),
            ]
        )
    ]
    (tmp_path / "table.csv").write_text(
        "\n".join(["sample,phase,phase_sample,file", *rows]), encoding="utf-8"
    )
    imported(tmp_path / "new.h5", few, metadata=tmp_path / "table.csv", **KNOWN)
    with SessionReader(tmp_path / "new.h5") as session:
        assert session.lost_frames() == [(2, 250, f"'{'x' * 5000}' is not there")]
        assert [(event.sample, event.text) for event in session.events() if event.kind == "phase"][
            :2
        ] == [(0, "reference"), (125, "drive")]


def test_triggers_that_are_uncertain_stay_so(few: Path, tmp_path: Path) -> None:
    rows = ["0,0,0,shot 17.png", "1,,,shot 18.png", "2,1,3,", "3,2,3,shot 19.png"]
    table = tmp_path / "table.csv"
    table.write_text("\n".join(["frame,first,last,file", *rows]), encoding="utf-8")
    imported(tmp_path / "new.h5", few, metadata=table, **KNOWN)
    with SessionReader(tmp_path / "new.h5") as session:
        spans = session.triggers()[["first", "last"]].tolist()
    assert spans == [(0, 0), (1, 1), (1, 3), (2, 3)]
    table.write_text(table.read_text(encoding="utf-8").replace("2,3,", "4,3,"), encoding="utf-8")
    with pytest.raises(UserError, match="columns first and last must be the triggers"):
        imported(tmp_path / "none.h5", few, metadata=table, **KNOWN)


@pytest.mark.parametrize("earlier_s", [0, 1])
def test_stage_of_images_without_times_belongs_to_their_numbers(
    few: Path, tmp_path: Path, earlier_s: int
) -> None:
    rows = [f"{n},{2.5 * n},shot {17 + n}.png" for n in (0, 1, 2, 3)]
    (tmp_path / "table.csv").write_text("\n".join(["frame,stage_um,file", *rows]), encoding="utf-8")
    given: dict[str, Any] = {"metadata": tmp_path / "table.csv", **KNOWN}
    if earlier_s:  # the forces begin before the images: sample 0 is theirs
        rows = [f"{n / 1000},0.03,0.0" for n in range(2000)]
        (tmp_path / "f.csv").write_text("\n".join(["time_s,P_N,Q_N", *rows]), encoding="utf-8")
        given |= {"forces": tmp_path / "f.csv", "offset_s": -float(earlier_s), "drive": 2}
    imported(tmp_path / "new.h5", few, **given)
    with SessionReader(tmp_path / "new.h5") as session:
        samples, metres = session.positions()
    at = samples - 1000 * earlier_s - 10 / 2  # of the exposure
    np.testing.assert_allclose(metres, 2.5e-6 * np.clip(at / KNOWN["divisor"], 0, 3), atol=1e-12)


def test_forces_that_never_rest_do_not_tell_where_the_drive_begins(
    few: Path, tmp_path: Path
) -> None:
    q = np.concatenate([np.full(150, 0.4), np.full(150, -0.4), np.full(400, 1.0)])
    rows = [f"{n},0.03,{value}" for n, value in enumerate(np.tile(q, 2))]
    (tmp_path / "forces.csv").write_text("\n".join(["sample,P_N,Q_N", *rows]), encoding="utf-8")
    with pytest.raises(
        UserError,
        match=r"Q does not rise after the reference .* say where the drive begins with --drive",
    ):
        imported(tmp_path / "new.h5", few, forces=tmp_path / "forces.csv", **KNOWN)
