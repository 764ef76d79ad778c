"""Campaigns of small runs, and `slipscope campaign` as a user calls it."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_once import made_once
from small_campaign import TWO_LOADS, Command, Write, called, text_of, work_in

from app.cli import campaign as campaigns


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the file of a campaign of tiny runs."""

    def written(*lines: str) -> Path:
        path = tmp_path / "campaign.toml"
        path.write_text(text_of(*lines), encoding="utf-8")
        return path

    return written


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """The folder of the sessions of that campaign, which makes it."""
    return tmp_path / "tiny"


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`slipscope campaign`, as fast as possible, in an empty folder and without a window."""
    work_in(tmp_path, monkeypatch)
    return called


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder with a campaign of two runs, which are done, to be read only; what its page said
    before each of them.
    """

    def make(folder: Path) -> tuple[Path, list[str]]:
        pages, prepared_run = [], campaigns.prepared_run

        def watched(*arguments, **options):
            pages.append((folder / "tiny/index.html").read_text(encoding="utf-8"))
            return prepared_run(*arguments, **options)

        (folder / "campaign.toml").write_text(text_of(*TWO_LOADS), encoding="utf-8")
        with pytest.MonkeyPatch.context() as patch:
            work_in(folder, patch)
            patch.setattr(campaigns, "prepared_run", watched)
            assert called("campaign.toml").exit_code == 0
        return folder, pages

    return made_once(tmp_path_factory, "campaign-of-two", make)


@pytest.fixture
def two_done(made: tuple[Path, list[str]]) -> Path:
    """The folder."""
    return made[0]


@pytest.fixture
def pages(made: tuple[Path, list[str]]) -> list[str]:
    """The pages."""
    return made[1]
