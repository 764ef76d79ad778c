"""The further analyses of a session: the files beside it that hold other results of its images."""

from __future__ import annotations

import time
from pathlib import Path

from app.records.record_types import SourceSession
from app.session.reader import SessionReader
from app.system.errors import UserError

PATIENCE_S = 3.0


def analyses_of(session: Path) -> list[Path]:
    """Files in the folder of `session` that are further analyses of it, by name; files that cannot
    be read are left out, and what follows once they have taken `PATIENCE_S`.
    """
    with SessionReader(session) as reader:
        source = SourceSession(session.name, reader.header.started)
    found, patience = [], PATIENCE_S
    for path in sorted(session.parent.glob("*.h5")):
        began = time.monotonic()
        try:
            with SessionReader(path) as other:
                if other.header.source == source:
                    found.append(path)
        except (UserError, OSError):
            patience -= time.monotonic() - began
            if patience < 0:
                break
    return found
