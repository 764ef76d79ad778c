"""The files of a session: where they may lie, and how session and journal are made together, and
let go of where HDF5 can not go on.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

import h5py

from app.errors import UserError
from app.outputs import check_output, new_file
from app.session.journal import Journal, journal_of

# no image goes into the last of the disk: HDF5 needs it to close the file whole, and breaks it if
# it can not
RESERVE_BYTES = 32 << 20
METADATA_BYTES = 1 << 19  # and no chunks: HDF5's caches would grow for the first hours of a run
# checksummed headers, and no open-for-writing mark that would lock the file after a kill
_LIBVER = ("v108", "v108")


def picture_of(session: Path) -> Path:
    """Where the picture of a session lies: beside it, under the same name."""
    return session.with_suffix(".png")


def files_of(session: Path) -> dict[str, Path]:
    """The files that may belong to a session, by what they are."""
    return {
        "session": session,
        "journal of a session that was cut short": journal_of(session),
        "picture": picture_of(session),
    }


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
    if picture_of(session) == session:
        raise UserError(
            f"{session}: the session would have the name of its own picture; choose another ending,"
            " such as .h5"
        )
    for what, path in files_of(session).items():
        if has_picture or what != "picture":
            check_output(path, overwrite, what=what)


@contextmanager
def new_session(path: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside `path` for a session to write, which takes its place when the block ends.

    Whatever ends the block early, nothing is left of it, and a session that was at `path` before
    stays as it was.

    Raises
    ------
    UserError
        The session can not be written.
    """
    with new_file(path, overwrite) as unfinished:
        try:
            yield unfinished
        finally:
            journal_of(unfinished).unlink(missing_ok=True)
        journal_of(path).unlink(missing_ok=True)  # of the session that is replaced


def new_files(path: Path, overwrite: bool) -> tuple[Journal, h5py.File]:
    """An empty journal and an empty session.

    Raises
    ------
    UserError
        One of that name exists and may not be overwritten, or they can not be made there.
    """
    if not overwrite:
        for existing in (path, journal_of(path)):
            if existing.exists():
                raise UserError(
                    f"{existing}: a session of that name exists; choose another name or ask to"
                    " overwrite it"
                )
    try:
        # first: refused while another program records
        file = h5py.File(path, "w" if overwrite else "x", libver=_LIBVER, rdcc_nbytes=0)
        try:
            cache = file.id.get_mdc_config()
            cache.set_initial_size, cache.initial_size, cache.min_size, cache.max_size = (
                True,
                *3 * [METADATA_BYTES],
            )
            file.id.set_mdc_config(cache)
            return Journal(journal_of(path), overwrite=overwrite), file
        except BaseException:
            file.close()
            path.unlink(missing_ok=True)
            raise
    except OSError as error:
        cause = os.strerror(error.errno) if error.errno else str(error)
        raise UserError(
            f"{path}: the session can not be made there: {cause}; choose another folder or name"
        ) from None


def check_room(path: Path, nbytes: int) -> None:
    """Refuse to write so much to the disk of a session where too little would be left to close it
    whole; OSError.
    """
    free = shutil.disk_usage(path.absolute().parent).free
    if free < RESERVE_BYTES + nbytes:
        raise OSError(
            errno.ENOSPC, f"{path}: the disk is full, {free / 1e6:.0f} MB are left; make room"
        )


def abandon(file: h5py.File, on_disk: FileIO, journal: Journal) -> None:
    """Close a session as it is; what HDF5 still holds goes to nowhere: without room for it, its
    close would end the whole program.
    """
    with suppress(Exception), open(os.devnull, "r+b") as nowhere:
        os.dup2(nowhere.fileno(), file.id.get_vfd_handle())
    for thing in (file, on_disk, journal):
        with suppress(Exception):
            thing.close()
