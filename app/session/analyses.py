"""The further analyses of a session: the files beside it that hold other results of its images."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from app.errors import UserError
from app.session.reader import SessionReader


def analyses_of(session: Path) -> list[Path]:
    """Files in the folder of `session` that are further analyses of it, by name; what can not be
    read is passed over.
    """
    with SessionReader(session) as reader:
        started = reader.started
    found = []
    for path in sorted(session.parent.glob("*.h5")):
        with suppress(UserError, OSError), SessionReader(path) as other:
            if other.source is not None and (other.source.session, other.source.started) == (
                session.name,
                started,
            ):
                found.append(path)
    return found
