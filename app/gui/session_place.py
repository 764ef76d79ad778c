"""Where the next run is recorded, in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.replay.archive import ENDINGS
from app.session.files import check_new_session, next_free
from app.system.errors import UserError


@dataclass(frozen=True, slots=True)
class Place:
    """Where the next run would be recorded.

    Attributes
    ----------
    session : Path or None
        As the operator has named it; None: by date and time.
    sentence : str
        The full path and whether it is free, or why it cannot be used.
    is_usable : bool
    """

    session: Path | None
    sentence: str
    is_usable: bool = True


def named(text: str) -> Path | None:
    """The session that somebody means by this text: without an ending it is an HDF5 file."""
    text = text.strip()
    if not text:
        return None
    path = Path(text).expanduser()
    return path if path.suffix.lower() in ENDINGS else path.with_name(f"{path.name}.h5")


def place_of(session: Path | None) -> Place:
    """Where a run would be recorded that is begun now; files of that name are never replaced."""
    if session is None:
        return Place(None, f"{Path.cwd()}: named by date and time when the run begins")
    taken = next_free(session)
    try:
        check_new_session(taken, overwrite=False)
    except UserError as error:
        return Place(session, str(error), is_usable=False)
    full = taken.absolute()
    if taken != session:
        return Place(session, f"{full} is the next free name; {session.name} is there already")
    return Place(session, f"{full} is free")
