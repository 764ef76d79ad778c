"""Names and places of the files that a command writes, checked before anything else is done."""

from __future__ import annotations

import math
import os
import tempfile
from datetime import datetime
from pathlib import Path

from app.errors import UserError
from app.session.journal import journal_of


def parse_pace(text: str) -> float | None:
    """Simulated seconds per second; None for "max".

    Raises
    ------
    UserError
        Neither "max" nor a positive number.
    """
    if text == "max":
        return None
    try:
        pace = float(text)
    except ValueError:
        pace = math.nan
    if not (math.isfinite(pace) and pace > 0):
        raise UserError(
            f"--pace: '{text}' is not a pace; give 1 (real time), max (as fast as possible), or"
            " another number above 0"
        )
    return pace


def new_session_name(now: datetime) -> Path:
    """``slipscope-YYYYmmdd-HHMMSS.h5`` in the current folder."""
    return Path(f"slipscope-{now:%Y%m%d-%H%M%S}.h5")


def next_free(session: Path) -> Path:
    """`session`, or the first of ``name-2``, ``name-3`` ... for which neither a session nor its
    picture or journal exists.
    """
    candidate, number = session, 1
    while any(path.exists() for path in (candidate, picture_of(candidate), journal_of(candidate))):
        number += 1
        candidate = session.with_stem(f"{session.stem}-{number}")
    return candidate


def picture_of(session: Path) -> Path:
    """Where the picture of a session lies: beside it, under the same name."""
    return session.with_suffix(".png")


def mark_of(path: Path) -> tuple[int, int, int] | None:
    """What distinguishes a file from a later one of the same name; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def check_writable(path: Path) -> None:
    """Refuse an output file that can not be written, before anything else is done.

    Raises
    ------
    UserError
        It is a folder, its folder does not exist or can not be written to.
    """
    if path.is_dir():
        raise UserError(f"{path}: this is a folder; add a file name")
    folder = path.parent
    if not folder.is_dir():
        raise UserError(f"{path}: the folder {folder} does not exist; create it or choose another")
    try:
        if path.exists() and not os.access(path, os.W_OK):
            raise PermissionError(13, "Permission denied")
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise UserError(
            f"{path}: it can not be written: {error.strerror}; choose another place"
        ) from None


def check_session_and_picture(session: Path, overwrite: bool) -> None:
    """Refuse a session if it, its picture or its journal can not be written or exists already."""
    check_writable(session)
    picture = picture_of(session)
    if picture == session:
        raise UserError(
            f"{session}: the session would have the name of its own picture; choose another ending,"
            " such as .h5"
        )
    for path, what in (
        (session, "session"),
        (picture, "picture"),
        (journal_of(session), "journal of a session that was cut short"),
    ):
        check_writable(path)
        if path.exists() and not overwrite:
            raise UserError(
                f"{path}: a {what} of that name exists; choose another name or give --overwrite"
            )
