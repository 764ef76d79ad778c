"""Bad input: one clear sentence, exit code 2, nothing overwritten."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from command_line import given, refused
from PIL import Image
from short_run import RIGID
from typer.testing import Result

from app.cli.names import parse_pace
from app.cli.run_and_replay import EndedRuns, print_reports
from app.runs.live import check_run, expected_bytes
from app.session.files import next_free
from app.settings.config import load
from app.settings.sections import Config
from app.system.errors import UserError

Command = Callable[..., Result]


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("command", [("info",), ("replay", "--headless")])
def test_a_missing_session(slipscope: Command, command: tuple[str, ...]) -> None:
    refused(slipscope(*command, "nowhere.h5"), "nowhere.h5", "no such session")


def test_whether_a_file_can_be_read_is_found_by_reading_it(
    slipscope: Command, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_, **__: False)
    assert slipscope("info", session).exit_code == 0
    output = session.with_name("mine.csv")
    output.write_text("mine")
    refused(
        slipscope("export", session, "--overwrite", "-o", output),
        "mine.csv: it cannot be written: Permission denied; choose another place",
    )


@pytest.mark.parametrize("command", [("info",), ("replay", "--headless")])
def test_a_truncated_session(slipscope: Command, session: Path, command: tuple[str, ...]) -> None:
    content = session.read_bytes()
    session.write_bytes(content[: len(content) // 2])
    refused(slipscope(*command, session), "session.h5", "cut short")
    assert files_of(session.parent) == {"session.h5": content[: len(content) // 2]}


@pytest.mark.parametrize("command", [("info",), ("replay", "--headless")])
def test_a_foreign_hdf5(slipscope: Command, tmp_path: Path, command: tuple[str, ...]) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["entry/data"] = np.zeros(3)
    refused(slipscope(*command, "other.h5"), "not a SlipScope session")


@pytest.mark.skipif(sys.platform == "win32", reason="the words of POSIX")
@pytest.mark.parametrize("command", [("info",), ("dic", "b.png", "-o", "f.csv")])
def test_a_name_that_is_too_long_is_told_in_words(
    slipscope: Command, tmp_path: Path, command: tuple[str, ...]
) -> None:
    name = str(tmp_path / ("a" * 260))
    # Python 3.14 calls such a file one that is not there
    said = ("File name too long; check the name and the place", "there is no such ")
    result = slipscope(command[0], name, *command[1:])
    refused(result, f"{name}: {said[sys.version_info >= (3, 14)]}")


def test_a_file_that_is_no_hdf5(slipscope: Command, tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text("not at all", encoding="utf-8")
    refused(slipscope("info", "text.h5"), "not an HDF5 file")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("forces.source=ni_dac", "no driver is called 'ni_dac'"),
        ("camera.source=rdlake", "no driver is called 'rdlake'"),
        ("actuator.source=newprt", "no driver is called 'newprt'"),
        ("run.travel=nan", "a finite number is needed; found nan"),
        ("run.travl=3", "the nearest known one is 'run.travel'"),
        ("run.travel=-50", "goes against +x, which the simulated world does not model"),
        ("run.travel=0", "run.travel = 0 um is no drive"),
        ("forces.block=1000", "last longer than limits.age = 0.8 s"),
        ("run.normal_force=11", "more than 0 and at most 10 N; found 11"),
    ],
)
def test_settings_that_can_not_be_used(
    slipscope: Command, tmp_path: Path, setting: str, words: str
) -> None:
    refused(slipscope("run", "--headless", "--set", setting), words)
    assert files_of(tmp_path) == {}


@pytest.mark.parametrize(
    ("pace", "setting", "words"),
    [
        (None, "camera.source=pylon", "a bench with a real device runs at pace 1, not max"),
        (2.0, "camera.source=pylon", "a bench with a real device runs at pace 1, not 2"),
        (0.5, "forces.block=400", "forces.block = 400 samples last longer than limits.age"),
    ],
)
def test_a_pace_that_the_bench_can_not_have(
    tmp_path: Path, pace: float | None, setting: str, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        check_run(load(None, [setting]), tmp_path / "a.h5", pace, overwrite=False)


def test_a_disk_without_room_for_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = SimpleNamespace(free=expected_bytes(Config()) - 1)
    monkeypatch.setattr("app.system.disk.shutil.disk_usage", lambda folder: room)
    with pytest.raises(UserError, match=r"a\.h5: the run needs about .* GB free; make room"):
        check_run(Config(), tmp_path / "a.h5", 1.0, overwrite=False)


def test_a_missing_settings_file(slipscope: Command) -> None:
    refused(slipscope("run", "nowhere.toml", "--headless"), "nowhere.toml", "cannot be read")


@pytest.mark.parametrize("existing", ["mine.h5", "mine.png"])
def test_neither_a_session_nor_its_picture_is_overwritten_without_the_option(
    slipscope: Command, tmp_path: Path, existing: str
) -> None:
    (tmp_path / existing).write_bytes(b"precious")
    refused(slipscope("run", "--headless", "-o", "mine.h5"), existing, "exists", "--overwrite")
    assert files_of(tmp_path) == {existing: b"precious"}


def test_a_failed_run_with_overwrite_is_not_taken_for_the_session_before_it(
    slipscope: Command, session: Path
) -> None:
    before = session.read_bytes()
    refused(
        slipscope(
            "run", "--headless", "-o", session, "--overwrite", "--set", "camera.source=rdlake"
        ),
        "rdlake",
    )
    assert session.read_bytes() == before


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("nowhere/a.h5", "the folder nowhere does not exist"),
        (".", "this is a folder"),
        ("a.png", "a.png: the name of a session ends in .h5, '.png' was asked; use a.h5"),
        ("x.txt", "x.txt: the name of a session ends in .h5, '.txt' was asked; use x.h5"),
        ("x", "x: the name of a session ends in .h5, '' was asked; use x.h5"),
    ],
)
def test_an_output_that_can_not_be_written(
    slipscope: Command, tmp_path: Path, output: str, words: str
) -> None:
    refused(slipscope("run", "--headless", "-o", output), words)
    assert files_of(tmp_path) == {}


@pytest.mark.parametrize("pace", ["0", "-1", "nan", "inf", "fast"])
def test_a_pace_that_is_none(slipscope: Command, pace: str) -> None:
    refused(slipscope("run", "--headless", f"--pace={pace}"), f"'{pace}' is not a pace")


def test_paces() -> None:
    assert (parse_pace("1"), parse_pace("2.5"), parse_pace("max")) == (1.0, 2.5, None)


def test_machines_get_the_sentence_as_json(slipscope: Command) -> None:
    for command in (
        ["info", "nowhere.h5"],
        ["replay", "nowhere.h5", "--headless"],
        ["run", "--headless", "--set", "run.x=1"],
    ):
        result = slipscope(*command, "--json")
        assert (result.exit_code, result.stderr) == (2, "")
        assert list(json.loads(result.stdout)) == ["error"]


def test_a_further_run_in_the_same_window_takes_the_next_free_name(tmp_path: Path) -> None:
    session = tmp_path / "a.h5"
    assert next_free(session) == session
    session.touch()
    (tmp_path / "a-2.png").touch()
    assert next_free(session) == tmp_path / "a-3.h5"
    (tmp_path / "a-3.h5.journal").touch()
    assert next_free(session) == tmp_path / "a-4.h5"


def test_a_journal_that_was_left_behind_is_not_written_over(
    slipscope: Command, tmp_path: Path
) -> None:
    (tmp_path / "mine.h5.journal").touch()
    refused(
        slipscope("run", "--headless", "-o", "mine.h5"),
        "mine.h5.journal",
        "journal of a session that was cut short",
        "--overwrite",
    )


def test_an_error_nobody_thought_of_is_one_sentence_too(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise KeyError("surprise")

    monkeypatch.setattr("app.session.reader.SessionReader", broken)
    result = slipscope("info", "a.h5")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == (
        "slipscope: unexpected KeyError: 'surprise'; `slipscope --debug ...` shows where it came"
        " from\n"
    )
    assert isinstance(slipscope("--debug", "info", "a.h5").exception, KeyError)


# ---------------------------------------------------------------------- image files


def save(path: Path, image: np.ndarray) -> str:
    Image.fromarray(image).save(path)
    return path.name


@pytest.fixture
def grey(tmp_path: Path) -> str:
    return save(
        tmp_path / "reference.png",
        np.random.default_rng(1).integers(0, 255, (80, 100), dtype=np.uint8),
    )


def test_images_that_do_not_belong_together(slipscope: Command, tmp_path: Path, grey: str) -> None:
    rng = np.random.default_rng(2)
    other_size = save(tmp_path / "size.png", rng.integers(0, 255, (80, 120), dtype=np.uint8))
    colour = save(tmp_path / "colour.png", rng.integers(0, 255, (80, 100, 3), dtype=np.uint8))
    deep = save(tmp_path / "deep.tif", rng.random((80, 100)).astype(np.float32))
    (tmp_path / "text.png").write_text("not at all", encoding="utf-8")
    before = files_of(tmp_path)
    refused(slipscope("dic", grey, other_size, "-o", "f.csv"), "size.png", "120")
    refused(slipscope("dic", grey, colour, "-o", "f.csv"), "colour.png", "colour")
    refused(slipscope("dic", grey, deep, "-o", "f.csv"), "deep.tif")
    refused(slipscope("dic", grey, "text.png", "-o", "f.csv"), "text.png")
    refused(slipscope("dic", grey, "nowhere.png", "-o", "f.csv"), "nowhere.png")
    assert files_of(tmp_path) == before


def test_an_empty_image_list_is_a_usage_error(slipscope: Command, grey: str) -> None:
    refused(slipscope("dic", grey, "-o", "f.csv"), "there are no images to correlate with it")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-o", "f.txt"), "f.txt"),
        (("-o", "nowhere/f.csv"), "the folder nowhere does not exist"),
        (
            ("-o", "f.csv", "--box", "3"),
            "--box must be a whole number at least 4 and at most 200 px; found 3",
        ),
        (
            ("-o", "f.csv", "--method", "lk"),
            "--method must be 'shared' or 'icgn' or 'direct'; found \"lk\"",
        ),
        (("-o", "f.csv", "--min-contrast", "nan"), "--min-contrast: a finite number is needed"),
        (
            ("-o", "f.csv", "--update-every", "0"),
            "--update-every must be a whole number at least 1 images; found 0",
        ),
        (
            ("-o", "f.csv", "--method", "icgn", "--order", "2"),
            "dic: order 2 in icgn asked, which only earlier versions did; set dic.order=1, or a",
        ),
        (
            ("-o", "f.csv", "--roi", "0", "0", "200", "50"),
            "the region from (0, 0) to (200, 50) px does not lie in an image of 100 x 80 px",
        ),
        (
            ("-o", "f.csv", "--roi", "10", "10", "20", "20", "--method", "direct"),
            "a mask or region asked of method 'direct'",
        ),
        (("-o", "f.csv", "--mask", "nowhere.png"), "nowhere.png"),
        (("-o", "f.csv", "--box", "100"), "100"),
    ],
)
def test_a_correlation_that_can_not_be_done(
    slipscope: Command, tmp_path: Path, grey: str, options: tuple[str, ...], words: str
) -> None:
    refused(slipscope("dic", grey, grey, *options), words)
    assert list(files_of(tmp_path)) == [grey]


def test_fields_are_not_overwritten_without_the_option(
    slipscope: Command, tmp_path: Path, grey: str
) -> None:
    (tmp_path / "f.csv").write_bytes(b"precious")
    refused(slipscope("dic", grey, grey, "-o", "f.csv"), "f.csv", "--overwrite")
    assert (tmp_path / "f.csv").read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sim.law=viscous", ("sim.law", "'table'")),
        ("sim.law=table", ("sim.law_table", "none is named")),
        ("sim.thickness=15", ("finite thickness", "'elasto-plastic'")),
        ("sim.pressure=greenwood-tripp", ("rough contact", "sim.pressure = 'hertz'")),
        ("sim.law_table=bad.csv", ("never falling",)),
        ("sim.law_table=nowhere.csv", ("nowhere.csv", "two columns")),
        ("sim.law_table=three.csv", ("3 columns",)),
    ],
)
def test_a_world_that_can_not_be(
    slipscope: Command, tmp_path: Path, setting: str, words: tuple[str, ...]
) -> None:
    (tmp_path / "bad.csv").write_text("0,0\n1,0.5\n2,0.4\n3,1\n")
    (tmp_path / "three.csv").write_text("0,0,0\n")
    others = ("sim.law=table",)
    if setting.startswith("sim.law="):
        others = ()
    elif setting.startswith(("sim.thickness", "sim.pressure")):
        others = RIGID
    settings = given(*others, setting)
    # in this process
    refused(slipscope("run", "--headless", "--pace", "max", "-o", "w.h5", *settings), *words)
    assert not (tmp_path / "w.h5").exists()


@pytest.mark.parametrize("words", [("info",), ("replay",), ("invert",), ("export", "-o", "x.csv")])
@pytest.mark.parametrize("folder", [".", "/"])
def test_a_folder_in_place_of_a_session(
    slipscope: Command, words: tuple[str, ...], folder: str
) -> None:
    refused(slipscope(words[0], folder, *words[1:]), "this is a folder, not a ")


def test_config_names_all_that_it_knows(slipscope: Command) -> None:
    refused(slipscope("config", "nope"), "nothing is called 'nope'; known: ", "six-loads")


@pytest.mark.parametrize("command", ["run", "check", "config", "calibrate forces -o c.zip"])
@pytest.mark.parametrize("has_folder", [False, True])
def test_the_name_of_a_campaign_in_place_of_a_bench(
    slipscope: Command, tmp_path: Path, monkeypatch: Any, command: str, has_folder: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    if has_folder:  # of the sessions of that campaign
        Path("six-loads").mkdir()
    result = slipscope(*command.split(), "six-loads", "--set", "run.travel=100")
    refused(result, "six-loads", "of the plan of a campaign", "`slipscope campaign six-loads`")
    assert not [*tmp_path.glob("*.h5")]


@pytest.mark.parametrize("command", ["stop", "answer", "note", "attach"])
def test_a_command_that_finds_no_bench_speaks_of_itself(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: str
) -> None:
    monkeypatch.setattr("app.processes.folder.root", lambda: tmp_path)
    words = (
        ("yes",)
        if command in ("answer", "note")
        else ("--headless",)
        if command == "attach"
        else ()
    )
    refused(slipscope(command, *words), f"{command}: no bench of yours runs")


def test_images_in_which_no_point_is_found_are_a_failure(
    slipscope: Command, tmp_path: Path
) -> None:
    even = save(tmp_path / "even.png", np.full((200, 240), 90, np.uint8))
    result = slipscope("dic", even, even, "-o", tmp_path / "f.csv")
    assert result.exit_code == 1
    assert "f.csv: no point of any image was measured; --min-contrast" in result.stderr


@pytest.mark.parametrize(
    ("report", "code"),
    [
        ({"state": "stopped", "session": "a.h5"}, 0),
        ({"state": "stopped", "session": None}, 1),
        ({"state": "stopped", "session": "a.h5", "comparison": {"agrees": True}}, 1),
        ({"state": "done", "session": "a.h5", "comparison": {"agrees": True}}, 0),
        ({"state": "done", "session": "a.h5", "comparison": {"agrees": False}}, 1),
        ({"state": "failed", "session": "a.h5"}, 1),
    ],
)
def test_what_was_stopped_is_done_only_if_it_is_of_use(report: dict[str, Any], code: int) -> None:
    assert print_reports(EndedRuns([report], ""), as_json=False) == code
