"""Output files are refused before anything is done, or appear complete, or not at all."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.system.errors import UserError
from app.system.outputs import LEFT_S, check_output, check_output_folder, new_file, new_folder

OURS = re.compile(r"\d+\.txt")


def contents(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_a_place_that_can_not_be_written_is_refused_with_what_to_do(tmp_path: Path) -> None:
    taken, linked = tmp_path / "taken.csv", tmp_path / "linked.csv"
    taken.write_text("precious")
    linked.hardlink_to(taken)
    for path, overwrite, words in [
        (tmp_path / "a.txt", False, "the ending '.txt' is not known; use one of .csv, .npz"),
        (tmp_path / "none" / "a.csv", False, "none does not exist; create it"),
        (taken, False, "a table of that name exists; choose another name or give --overwrite"),
        (linked, True, "this is the session itself, which is never changed; give another name"),
    ]:
        with pytest.raises(UserError, match=re.escape(words)):
            check_output(
                path,
                overwrite,
                what="table",
                endings=(".csv", ".npz"),
                inputs={"session": [taken] if path is linked else []},
            )
    with pytest.raises(UserError, match="this is a folder; add a file name"):
        check_output(tmp_path, overwrite=True)
    check_output(tmp_path / "A.CSV", overwrite=False, endings=(".csv",))
    check_output(taken, overwrite=True)
    assert contents(tmp_path) == {"taken.csv": "precious", "linked.csv": "precious"}


@pytest.mark.skipif(sys.platform == "win32", reason="the words of POSIX")
def test_a_name_that_is_too_long_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """Also one that only the unfinished file cannot have."""
    for length in (245, 252, 300):
        with pytest.raises(UserError, match=r"a\.csv: it cannot be written: File name too long; c"):
            check_output(tmp_path / ("a" * length + ".csv"), overwrite=False)
    with pytest.raises(UserError, match="File name too long; choose another place or name"):
        check_output(tmp_path / ("a" * 300) / "a.csv", overwrite=False)


def test_a_folder_that_is_write_protected_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def protected(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("app.system.outputs.tempfile.TemporaryFile", protected)
    with pytest.raises(UserError, match=r"a\.csv: it cannot be written: Permission denied"):
        check_output(tmp_path / "a.csv", overwrite=False)


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    with new_file(target, overwrite=False) as unfinished:
        unfinished.write_text("new")
        assert unfinished.suffix == ".csv"
        assert not target.exists()
    assert contents(tmp_path) == {"a.csv": "new"}


def test_the_content_of_a_file_is_on_the_disk_before_it_replaces_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut between both would leave an empty file in place of the settings."""
    target, synced = tmp_path / "a.toml", []
    target.write_text("old")
    fsync = os.fsync

    def noted(file: int) -> None:
        synced.append((os.fstat(file).st_size, target.read_text()))
        fsync(file)

    monkeypatch.setattr(os, "fsync", noted)
    with new_file(target, overwrite=True) as unfinished:
        unfinished.write_text("newer")
    assert synced[0] == (5, "old")
    assert target.read_text() == "newer"


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left"), ValueError("odd"), KeyboardInterrupt()]
)
@pytest.mark.parametrize("is_folder", [False, True])
def test_what_ends_the_writing_leaves_an_earlier_file_as_it_was(
    tmp_path: Path, error: BaseException, is_folder: bool
) -> None:
    target = tmp_path / "out"
    if is_folder:
        target.mkdir()
    (target / "1.txt" if is_folder else target).write_text("earlier")
    before = contents(tmp_path)

    def write() -> None:
        writing = new_folder(target, True, OURS) if is_folder else new_file(target, True)
        with writing as unfinished:
            (unfinished / "2.txt" if is_folder else unfinished).write_text("half")
            raise error

    with pytest.raises((UserError, type(error))) as caught:
        write()
    if isinstance(error, OSError):
        assert "out: it cannot be written: No space left; choose" in str(caught.value)
    assert contents(tmp_path) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_disk_that_has_become_read_only_is_named_and_not_the_unfinished_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There a file that does not exist can neither be made nor removed."""

    def refused(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "unlink", refused)
    monkeypatch.setattr(Path, "write_text", refused)
    with (
        pytest.raises(UserError, match=r"a\.png: it cannot be written: Read-only .*; choose"),
        new_file(tmp_path / "a.png", overwrite=True) as unfinished,
    ):
        unfinished.write_text("new")


def test_what_has_appeared_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"

    def write() -> None:
        with new_file(target, overwrite=False) as unfinished:
            unfinished.write_text("mine")
            target.write_text("somebody else's")

    with pytest.raises(UserError, match="a file of that name exists"):
        write()
    assert contents(tmp_path) == {"a.csv": "somebody else's"}


def test_of_a_folder_only_our_own_files_are_replaced(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with new_folder(target, False, OURS) as unfinished:
        for name in ("1.txt", "2.txt"):
            (unfinished / name).write_text(name)
    (target / "notes.md").write_text("mine")
    with pytest.raises(UserError, match="the folder is not empty"):
        check_output_folder(target, overwrite=False)
    with new_folder(target, True, OURS) as unfinished:
        (unfinished / "2.txt").write_text("new")
    assert contents(target) == {"2.txt": "new", "notes.md": "mine"}
    with pytest.raises(UserError, match="a file of that name exists"):
        check_output_folder(target / "2.txt", overwrite=True)


def test_what_a_killed_program_left_goes_with_the_next(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with new_file(tmp_path / "b.csv", overwrite=False) as unfinished:
        mine = unfinished.name.replace("b.", "a.", 1)
        unfinished.write_text("whole")
    left = mine.replace(str(os.getpid()), str(dead.pid))
    others = {left.replace("a.", "b.", 1), f"elsewhere{left}", left.replace("a.", "a.elsewhere")}
    for name in {left, *others}:
        (tmp_path / name).write_text("half")
    with new_file(tmp_path / "a.csv", overwrite=False) as unfinished:
        assert unfinished.name == mine
        unfinished.write_text("whole")
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "b.csv", *others}


def test_what_a_program_killed_long_ago_left_goes_with_whatever_is_written_there(
    tmp_path: Path,
) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with new_file(tmp_path / "r.h5", overwrite=False) as unfinished:
        mine = unfinished.name
        unfinished.write_text("whole")
    killed, living = mine.replace(str(os.getpid()), str(dead.pid)), f"x{mine}"
    strangers = killed.replace("-", "x-", 1)  # of another computer
    folder = killed.replace(".h5", "")
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "1.png").touch()
    long_ago = time.time() - LEFT_S - 60
    for name in (killed, living, strangers, folder):
        if name != folder:
            (tmp_path / name).write_text("half")
        os.utime(tmp_path / name, (long_ago, long_ago))
    with new_file(tmp_path / "a.csv", overwrite=False) as unfinished:
        unfinished.write_text("whole")
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "r.h5", living, strangers}


def test_a_share_that_knows_no_sync_of_folders_takes_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: int) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", refuse)
    with new_file(tmp_path / "a.csv", overwrite=False) as unfinished:
        unfinished.write_text("whole")
    assert contents(tmp_path) == {"a.csv": "whole"}
