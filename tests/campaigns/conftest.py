"""Campaigns of small runs, and `slipscope campaign` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_campaign import Command, Write, called, text_of, work_in


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the file of a campaign of tiny runs."""

    def written(*lines: str) -> Path:
        path = tmp_path / "campaign.toml"
        path.write_text(text_of(*lines), encoding="utf-8")
        return path

    return written


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`slipscope campaign`, as fast as possible, in an empty folder and without a window."""
    work_in(tmp_path, monkeypatch)
    return called
