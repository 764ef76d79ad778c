"""Where the folders of benches of a test lie."""

import pytest

from app.processes import folder as folders


@pytest.fixture
def memory(short_path, monkeypatch):
    monkeypatch.setattr(folders, "MEMORY", short_path)
    return short_path
