"""The files of a session: where they may lie, and which of them are somebody's at this moment."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from app.session import trust
from app.session.journal import IMAGES_SUFFIX, RESULTS_SUFFIX, journal_of
from app.system.disk import DiskError, free_bytes, is_locked
from app.system.errors import UserError
from app.system.outputs import check_output, new_file

# what a disk must have left, beside room for what the journal and the results take once more in the
# session, for the recording to go on
ENDING = ".h5"
RESERVE_BYTES = 32 << 20


def picture_of(session: Path) -> Path:
    """Where the picture of a session lies: beside it, under the same name."""
    return session.with_suffix(".png")


def images_of(session: Path) -> Path:
    """Where the images of a session lie while it is recorded."""
    return session.with_name(session.name + IMAGES_SUFFIX)


def has_images(session: Path) -> bool:
    """Whether images of a session lie beside it; not where a power cut in its close has left it
    their name, too.
    """
    images = images_of(session)
    return images.exists() and not (session.exists() and images.samefile(session))


def results_of(session: Path) -> Path:
    """Where the results of a session lie while it is recorded."""
    return session.with_name(session.name + RESULTS_SUFFIX)


def unfinished_of(session: Path) -> Path:
    """Where a session is made whose images have to be copied."""
    return session.with_name(f"{session.name}.made")


def files_of(session: Path) -> dict[str, Path]:
    """The files that may belong to a session, by what they are."""
    return {
        "session": session,
        "journal of a session that was cut short": journal_of(session),
        "images of a session that was cut short": images_of(session),
        "results of a session that was cut short": results_of(session),
        "unfinished copy of a session that was cut short": unfinished_of(session),
        "picture": picture_of(session),
    }


def remove_recorded(session: Path) -> None:
    """Remove what a session was made of, or what was left of one that it replaces; the journal
    last, without which the rest is nothing.
    """
    for left in (
        unfinished_of(session),
        images_of(session),
        results_of(session),
        journal_of(session),
    ):
        left.unlink(missing_ok=True)


def check_room(path: Path, nbytes: int) -> None:
    """Refuse to write so much to a disk that needs what it has left; OSError."""
    free = free_bytes(path)
    if free < RESERVE_BYTES + nbytes:
        raise DiskError(
            errno.ENOSPC, f"the disk is full, {free / 1e6:.0f} MB are left; make room", str(path)
        )


def new_session_name(now: datetime) -> Path:
    """``slipscope-YYYYmmdd-HHMMSS.h5`` in the current folder."""
    return Path(f"slipscope-{now:%Y%m%d-%H%M%S}.h5")


def next_free(session: Path) -> Path:
    """`session`, or the first of ``name-2``, ``name-3`` ... of which no file exists."""
    candidate, number = session, 1
    while any(path.exists() for path in files_of(candidate).values()):
        number += 1
        candidate = session.with_stem(f"{session.stem}-{number}")
    return candidate


def check_new_session(
    session: Path, overwrite: bool, *, read: Iterable[Path] = (), has_picture: bool = True
) -> None:
    """Refuse a name for a session if it or a file that belongs to it must not be written.

    Parameters
    ----------
    read : iterable of Path
        Sessions that are read meanwhile.
    has_picture : bool
        Whether a picture of the session will be drawn.

    Raises
    ------
    UserError
    """
    check_output(session, overwrite, what="session", inputs={"session": read})
    check_not_recorded(session)
    if session.suffix.lower() != ENDING:
        raise UserError(
            f"{session}: the name of a session ends in {ENDING}, '{session.suffix}' was asked; use"
            f" {session.with_suffix(ENDING).name}"
        )
    for what, path in files_of(session).items():
        if has_picture or what != "picture":
            check_output(path, overwrite, what=what)


def check_not_recorded(session: Path) -> None:
    """Refuse a session that a program is recording at this moment; UserError."""
    if is_locked(journal_of(session)):
        raise being_recorded(session)


def being_recorded(session: Path) -> UserError:
    """The error that says so."""
    return UserError(
        f"{session}: a program is recording this session; wait for its end or give another name"
    )


@contextmanager
def new_session(path: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside `path` for a session to write, which takes its place when the block ends.

    Whatever ends the block early, nothing is left of it, and a session that was at `path` before
    stays as it was.

    Raises
    ------
    UserError
        The session cannot be written, or is being recorded by another program.
    """
    with new_file(path, overwrite) as unfinished:
        yield unfinished
        check_not_recorded(path)
        checksum = trust.checksum_of(unfinished)
    if checksum is not None:
        trust.remember(path, checksum)
    remove_recorded(path)
