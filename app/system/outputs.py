"""Output files: whether one may be written at a place, and files that appear only when complete."""

from __future__ import annotations

import io
import math
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

import psutil

from app.system.disk import DiskError, replace_file, sync_file, sync_folder
from app.system.errors import UserError

LEFT_S = 3600.0  # an unfinished file unchanged for so long is of a program that is gone
_being_written: list[Path] = []


def check_output(
    path: Path,
    overwrite: bool,
    *,
    what: str = "file",
    endings: Sequence[str] = (),
    inputs: Mapping[str, Iterable[Path]] | None = None,
) -> None:
    """Refuse a place for an output file that cannot or must not be written to.

    Parameters
    ----------
    overwrite : bool
        Whether a file that exists may be replaced.
    what : str
        What kind of file is to be written, for the message.
    endings : sequence of str
        Endings that the name may have, such as ``.csv``; none: any.
    inputs : mapping of str to paths
        Files that are read, by what they are ("session"): none of them is ever written to.

    Raises
    ------
    UserError
    """
    if endings and path.suffix.lower() not in endings:
        raise UserError(
            f"{path}: the ending '{path.suffix}' is not known; use one of {', '.join(endings)}"
        )
    if os.path.isdir(path):  # where Path.is_dir fails at a name that is too long
        raise UserError(f"{path}: a {what} is to be written, but this is a folder; add a file name")
    check_folder_of(path)
    for name, files in (inputs or {}).items():
        if path.exists() and any(file.exists() and path.samefile(file) for file in files):
            raise UserError(
                f"{path}: this is the {name} itself, which is never changed; give another name"
            )
    if path.exists() and not overwrite:
        raise UserError(
            f"{path}: a {what} of that name exists; choose another name or give --overwrite"
        )
    if path.exists() and not os.access(path, os.W_OK):
        raise UserError(f"{path}: it cannot be written: Permission denied; choose another place")


def check_output_folder(path: Path, overwrite: bool) -> None:
    """Refuse a place for an output folder that cannot be written to, or that holds something.

    Raises
    ------
    UserError
    """
    check_folder_of(path)
    if path.exists() and not path.is_dir():
        raise UserError(
            f"{path}: a folder is to be written, but a file of that name exists;"
            " choose another name"
        )
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise UserError(f"{path}: the folder is not empty; choose another name or give --overwrite")


def check_folder_of(path: Path) -> None:
    """Refuse a place in a folder that does not exist or cannot be written to, or a name that is too
    long for it.

    Raises
    ------
    UserError
    """
    try:
        with suppress(FileNotFoundError, NotADirectoryError):
            if path.name:  # neither the current folder nor the root
                _unfinished_name(path).lstat()  # refuses a name that is too long
        if not path.parent.is_dir():
            raise UserError(
                f"{path}: the folder {path.parent} does not exist; create it or choose another"
            )
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise UserError(
            f"{path}: it cannot be written: {error.strerror}; choose another place or name"
        ) from None


@contextmanager
def new_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside `path`, with its ending, to write to.

    The file takes its place when the block ends and its content is on the disk. Whatever ends the
    block early, it is removed, and a file that was at `path` before stays as it was.

    Raises
    ------
    UserError
        The file cannot be written, or one of its name has appeared meanwhile.
    """
    with _unfinished(path) as unfinished:
        yield unfinished
        check_output(path, overwrite)
        sync_file(unfinished)
        replace_file(unfinished, path)
        sync_folder(path.absolute().parent)


@contextmanager
def new_folder(path: Path, overwrite: bool, ours: re.Pattern[str]) -> Iterator[Path]:
    """A new folder beside `path` to write files into, which takes its place when the block ends.

    Of a folder that exists only the files whose names match `ours` are replaced.

    Raises
    ------
    UserError
        It cannot be written, or `path` has got something in it meanwhile.
    """
    with _unfinished(path) as unfinished:
        unfinished.mkdir()
        yield unfinished
        check_output_folder(path, overwrite)
        if not path.exists():
            unfinished.replace(path)
            return
        written = [new.name for new in unfinished.iterdir()]
        for name in written:
            replace_file(unfinished / name, path / name)
        for old in [old for old in path.iterdir() if ours.fullmatch(old.name)]:
            if old.name not in written:
                old.unlink()


@contextmanager
def _unfinished(path: Path) -> Iterator[Path]:
    _remove_left(path)
    unfinished = _unfinished_name(path)
    _being_written.append(unfinished)
    try:
        yield unfinished
    except UserError:  # also of an input that is missing, which is an OSError too
        raise
    except OSError as error:
        reason = f"it cannot be written: {error.strerror or error}"
        if isinstance(error, DiskError) and error.filename:
            reason = str(error.strerror)
        raise UserError(f"{path}: {reason}; choose another place") from None
    finally:
        with suppress(OSError):  # where nothing can be written, nothing can be removed
            _remove(unfinished)
        _being_written.remove(unfinished)


def _computer() -> str:
    """What the names of unfinished files of this computer have in them."""
    return f".{re.sub('[^a-zA-Z0-9]', '', platform.node())}-"


def _unfinished_name(path: Path) -> Path:
    """Where this process writes what is to be at `path`."""
    return path.with_name(f"{path.stem}{_computer()}{os.getpid()}.part{path.suffix}")


def remove_unfinished() -> None:
    """Remove all that this process is writing, as nobody will finish it."""
    for unfinished in [*_being_written]:
        with suppress(OSError):
            _remove(unfinished)


def _remove_left(path: Path) -> None:
    """Remove what programs of this computer that were killed have left of this file, and of any
    other in its folder that was not written to for a while.
    """
    computer = _computer()
    with suppress(OSError):
        for left in path.parent.glob(f"*{computer}*.part*"):
            stem, _, rest = left.name.rpartition(computer)
            writer, _, ending = rest.partition(".")
            if not writer.isdecimal() or psutil.pid_exists(int(writer)):  # it may live
                continue
            is_same = (stem, ending) == (path.stem, f"part{path.suffix}")
            if is_same or time.time() - left.stat().st_mtime > LEFT_S:
                _remove(left)


def _remove(unfinished: Path) -> None:
    if unfinished.is_dir():
        shutil.rmtree(unfinished)
    unfinished.unlink(missing_ok=True)


# what a spreadsheet would run; it takes some wide characters for narrow ones
_FORMULA = re.compile(r"'*\s*[=@+\-＝＠＋－\t\r\n]")
_QUOTED = re.compile('[,"\\r\\n]')


def cell_of(text: str) -> str:
    """A text as a cell that no spreadsheet runs; `text_of` gives it back."""
    return f"'{text}" if _FORMULA.match(text) else text


def write_csv(
    file: TextIO, rows: Iterable[Iterable[Any]], *, digits: int = 9, missing: str = ""
) -> None:
    """Write rows of numbers and texts as CSV; the first one names the columns.

    A number has so many significant digits, or for 0 all of them, so that reading it gives the same
    bits; `missing` stands for NaN: "nan" in files that other programs read number by number. No
    spreadsheet runs a text.
    """
    number = f"%.{digits}g".__mod__ if digits else float.__repr__

    def cell(value: Any) -> str:
        if isinstance(value, float):
            return missing if math.isnan(value) else number(value)
        if not isinstance(value, str):
            return str(int(value))
        text = cell_of(value)
        return '"' + text.replace('"', '""') + '"' if _QUOTED.search(text) else text

    for row in rows:
        file.write((",".join(map(cell, row)) or '""') + "\n")


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """The same as a text."""
    write_csv(text := io.StringIO(), rows)
    return text.getvalue()


def text_of(cell: str) -> str:
    """The text in a cell that was written by `cell_of`, or by anybody else."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
