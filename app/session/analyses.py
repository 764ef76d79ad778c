"""The further analyses of a session: the files beside it that hold other results of its images."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from app.errors import UserError
from app.records import Source
from app.session.reader import SessionReader


def analyses_of(session: Path) -> list[Path]:
    """Files in the folder of `session` that are further analyses of it, by name; files that can not
    be read are left out.
    """
    with SessionReader(session) as reader:
        source = Source(session.name, reader.header.started)
    found = []
    for path in sorted(session.parent.glob("*.h5")):
        with suppress(UserError, OSError), SessionReader(path) as other:
            if other.header.source == source:
                found.append(path)
    return found
