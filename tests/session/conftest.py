"""A finished session on disk, for the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from session_material import CONTACT, OUTCOME, Session, record


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A finished session and what went into it."""
    writer, written = record(tmp_path / "session.h5")
    writer.append(CONTACT)
    writer.append(OUTCOME)
    writer.close()
    return written
