"""Windows removes and replaces no file that is open: what the program does where that is so."""

from __future__ import annotations

import errno
import os
import sys
import time
from io import FileIO
from pathlib import Path
from typing import Any

import pytest

from app.system import disk
from app.system.disk import AppendedFile, replace_file
from app.system.outputs import new_file


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names of files that are open: they can neither be removed nor replaced."""
    names: set[str] = set()
    unlink, replace, close = Path.unlink, Path.replace, AppendedFile.close

    def refuse(path: Path) -> None:
        if path.name in names:
            raise PermissionError(13, "it is open", str(path))

    def unlinked(path: Path, missing_ok: bool = False) -> None:
        refuse(path)
        unlink(path, missing_ok)

    def replaced(path: Path, target: Any) -> Path:
        refuse(Path(target))
        return replace(path, target)

    def closed(file: AppendedFile) -> None:
        names.discard(file.path.name)
        close(file)

    monkeypatch.setattr(Path, "unlink", unlinked)
    monkeypatch.setattr(Path, "replace", replaced)
    monkeypatch.setattr(AppendedFile, "close", closed)
    return names


def test_a_recording_that_is_discarded_leaves_no_file(opened: set[str], tmp_path: Path) -> None:
    file = AppendedFile(tmp_path / "a", overwrite=False)
    opened.add("a")
    file.remove()
    assert os.listdir(tmp_path) == []


def test_a_file_that_cannot_be_removed_is_let_go_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What has failed before is reported, and not that its file stays."""
    file = AppendedFile(tmp_path / "a", overwrite=False, locked=True)

    def refused(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "the disk is read-only", str(path))

    monkeypatch.setattr(Path, "unlink", refused)
    file.remove()
    assert not disk.is_locked(tmp_path / "a")


def test_the_lock_of_a_file_that_one_may_only_read_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of what another user records in a folder of all. Who looks keeps nobody from looking."""

    def read_only(path: Path, mode: str = "r") -> FileIO:
        if mode != "r":
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return FileIO(path)

    file = AppendedFile(tmp_path / "a", overwrite=False, locked=True)
    with monkeypatch.context() as limited:
        limited.setattr(disk, "FileIO", read_only)
        assert disk.is_locked(tmp_path / "a")
        file.close()
        assert not disk.is_locked(tmp_path / "a")
    if sys.platform != "win32":  # which has no such locks
        with FileIO(tmp_path / "a") as looked_at:
            disk._lock(looked_at, is_shared=True)
            assert not disk.is_locked(tmp_path / "a")


def test_a_file_that_is_not_wanted_goes_when_it_is_closed(opened: set[str], tmp_path: Path) -> None:
    file = AppendedFile(tmp_path / "a", overwrite=False)
    opened.add("a")
    file.unlink()
    assert os.listdir(tmp_path) == ["a"]
    file.close()
    assert os.listdir(tmp_path) == []
    (tmp_path / "a").write_text("of another program")
    file.close()
    assert os.listdir(tmp_path) == ["a"]


def test_a_file_in_the_place_of_one_that_is_not_wanted_stays(
    opened: set[str], tmp_path: Path
) -> None:
    file = AppendedFile(tmp_path / "a", overwrite=False)
    opened.add("a")
    file.unlink()
    os.replace(file.path, tmp_path / "moved away")
    (tmp_path / "a").write_text("of another program")
    file.close()
    assert (tmp_path / "a").read_text() == "of another program"


def test_a_disk_that_does_not_remove_a_file_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "the file system is read-only")

    file = AppendedFile(tmp_path / "a", overwrite=False)
    monkeypatch.setattr(Path, "unlink", fail)
    with pytest.raises(OSError, match="the file system is read-only"):
        file.unlink()
    file.close()


def test_a_file_that_was_removed_is_not_removed_again(tmp_path: Path) -> None:
    file = AppendedFile(tmp_path / "a", overwrite=False)
    file.unlink()
    (tmp_path / "a").write_text("of another program")
    file.close()
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("how", ["record", "output"])
def test_a_file_that_somebody_reads_is_replaced_when_it_is_read(
    how: str, opened: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, new = tmp_path / "bench.json", tmp_path / "new"
    place.write_text("old")
    opened.add("bench.json")
    monkeypatch.setattr(time, "sleep", lambda _: opened.clear())
    if how == "record":
        new.write_text("new")
        replace_file(new, place)
    else:
        with new_file(place, overwrite=True) as unfinished:
            unfinished.write_text("new")
    assert place.read_text() == "new"
    assert os.listdir(tmp_path) == ["bench.json"]


def test_a_file_that_stays_open_is_reported(
    opened: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_text("new")
    opened.add("b")
    monkeypatch.setattr(disk, "READ_S", 0.05)
    began = time.monotonic()
    with pytest.raises(PermissionError):
        replace_file(tmp_path / "a", tmp_path / "b")
    assert time.monotonic() - began < 5
    assert (tmp_path / "a").exists()
