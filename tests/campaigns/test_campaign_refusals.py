"""What `slipscope campaign` refuses before anything moves, and never replaces."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_campaign import SESSIONS, TWO_LOADS, Command, Write, copied, mark

from app.campaigns.state import LOCK
from app.cli import campaign as campaigns
from app.system.disk import AppendedFile


def test_a_campaign_that_changed_so_that_a_done_run_is_another_is_refused(
    campaign: Command, write: Write, two_done: Path, tmp_path: Path, tiny: Path
) -> None:
    copied(two_done, tmp_path)
    before = mark(tiny / SESSIONS[0])
    refused = campaign(write(*TWO_LOADS, "settings.run.velocity = 6"))
    assert refused.exit_code == 2
    assert refused.stderr == (
        "slipscope: tiny/tiny-0.03N.h5: recorded with run.velocity = 5.0, which is not what run 1"
        " of the campaign says now; give another folder with -o, or undo the change\n"
    )
    assert mark(tiny / SESSIONS[0]) == before
    samples = (
        "[[runs]]",
        'about.sample = "A"',
        "run.normal_force = 0.03",
        "[[runs]]",
        'about.sample = "B"',
        "run.normal_force = 0.04",
    )
    another = campaign(write(TWO_LOADS[1], *samples))  # a session is that of one sample
    assert another.exit_code == 2
    assert 'tiny-0.03N.h5: recorded with about.sample = ""' in another.stderr
    # what does not concern what was measured, and further runs, are no other experiment
    more = "vary.run.normal_force = [0.03, 0.04, 0.05]"
    going_on = campaign(write(more, TWO_LOADS[1], 'settings.about.note = "later"'), "--only", "1,2")
    assert going_on.exit_code == 0
    assert "has changed since tiny was begun: 2 of its runs are done as it says now" in (
        " ".join(going_on.stderr.split())
    )
    assert mark(tiny / SESSIONS[0]) == before
    assert (
        "has changed"
        not in campaign(
            write(more, TWO_LOADS[1], 'settings.about.note = "later"'), "--only", "1,2"
        ).stderr
    )


def _foreign(folder: Path) -> None:
    (folder / SESSIONS[1]).write_text("a diary")


def _page(folder: Path) -> None:
    (folder / "index.html").write_text("<html>a diary</html>")


def _copy(folder: Path) -> None:
    (folder / "campaign.toml").write_text("# a diary")


def _picture(folder: Path) -> None:
    (folder / "tiny-0.04N.png").write_text("a drawing")


def _no_folder(folder: Path) -> None:
    folder.rmdir()
    folder.write_text("a diary")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_foreign, "tiny-0.04N.h5: cannot be read, it is not an HDF5 file"),
        (_page, "index.html: not written by `slipscope campaign`; give another folder with -o"),
        (_copy, "campaign.toml: not written by `slipscope campaign`; give another folder with -o"),
        (_picture, "put tiny-0.04N.h5 back, or move the picture away"),
        (_no_folder, "tiny: a folder is needed, this is a file; give another one with -o"),
    ],
)
def test_what_is_there_already_is_never_replaced(
    campaign: Command, write: Write, tmp_path: Path, tiny: Path, spoil, words: str
) -> None:
    tiny.mkdir()
    spoil(tiny)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    refused = campaign(write(*TWO_LOADS))
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert words in refused.stderr.splitlines()[-1]
    after = {path: path.read_bytes() for path in before}
    assert before == after
    assert not (tiny / SESSIONS[0]).exists()


def test_a_disk_without_room_for_all_runs_is_told_before_anything_moves(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaigns, "free_bytes", lambda path: 60_000_000)
    refused = campaign(write(*TWO_LOADS))
    assert refused.exit_code == 2
    assert "tiny: the 2 runs need about 0.1 GB, the disk has 0.1 GB free; make room, or begin" in (
        refused.stderr
    )
    assert not tiny.exists()
    assert campaign(write(*TWO_LOADS), "--only", "1", "--check").exit_code == 0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run.travel = [8, -8]", "run.travel = -8 um goes against +x, which the simulated"),
        ("sim.thickness = [0, 2]", "[sim]: "),
        ("forces.block = [10, 10000]", "forces.block = 10000 samples last longer than"),
    ],
)
def test_a_run_that_can_not_be_made_is_told_by_its_number_before_anything_moves(
    campaign: Command, write: Write, tiny: Path, line: str, words: str
) -> None:
    refused = campaign(write(f"vary.{line}"))
    assert refused.exit_code == 2
    assert f"campaign.toml, run 2: {words}" in refused.stderr
    assert not tiny.exists()


def test_two_campaigns_do_not_work_in_one_folder(
    campaign: Command, write: Write, tiny: Path
) -> None:
    tiny.mkdir()
    lock = AppendedFile(tiny / LOCK, overwrite=True, locked=True)
    refused = campaign(write(*TWO_LOADS))
    lock.remove()
    assert refused.exit_code == 2
    assert "tiny: another slipscope campaign works in this folder; wait for its end" in (
        refused.stderr
    )


def test_check_does_nothing_and_shows_what_would_be_done(
    campaign: Command, write: Write, tiny: Path
) -> None:
    result = campaign(write(*TWO_LOADS), "--check")
    assert result.exit_code == 0
    assert "tiny-0.04N" in result.stdout
    assert "waiting" in result.stdout
    assert not tiny.exists()
