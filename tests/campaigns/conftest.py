"""Campaigns of small runs, and `slipscope campaign` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_campaign import Command, Write, text_of
from typer.testing import CliRunner, Result

from app.cli import app
from app.report import figures


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
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(figures, "write_picture", blank)  # a drawn one takes as long as the run

    def call(*arguments: object, answers: str = "") -> Result:
        told = ["campaign", *map(str, arguments), "--headless", "--pace", "max"]
        return CliRunner().invoke(app, told, input=answers)

    return call


def blank(_figure: object, path: Path) -> None:
    """A file in the place of the picture of a run."""
    path.write_bytes(b"a picture")
