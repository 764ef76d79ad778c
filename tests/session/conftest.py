"""A finished session on disk, for the tests of this folder."""

from __future__ import annotations

import shutil
from copy import deepcopy
from pathlib import Path

import pytest
from session_material import CONTACT, Session, finish, record


@pytest.fixture(scope="session")
def recorded_once(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A finished session and what went into it, for all tests: to be copied, not to be changed."""
    writer, written = record(tmp_path_factory.mktemp("session") / "session.h5")
    finish(writer, CONTACT)
    return written


@pytest.fixture
def session(recorded_once: Session, tmp_path: Path) -> Session:
    """A finished session of one's own and what went into it."""
    written = deepcopy(recorded_once)
    written.path = Path(shutil.copy(recorded_once.path, tmp_path / "session.h5"))
    return written
