"""`slipscope campaign` run by run: what it does, what it leaves alone, and what stops it."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from html.parser import HTMLParser
from pathlib import Path

import pytest
from command_line import given
from short_run import SHORT
from small_campaign import (
    SESSIONS,
    TWO_LOADS,
    Command,
    Write,
    copied,
    mark,
    sessions_in,
)

from app.campaigns import state
from app.campaigns.plan import read_campaign
from app.campaigns.state import RunState, find_session, keep
from app.cli import campaign as campaigns
from app.cli.inspect import info
from app.records.record_types import Outcome
from app.report import figures
from app.report.figures import write_picture
from app.session import recorder
from app.session.reader import SessionReader
from app.session.repair import whole
from app.settings.config import from_record
from drivers.bench import Bench
from drivers.errors import DeviceError

WEAK = "limits.shear_force = 0.002"  # Q passes it early in the drive


class Page(HTMLParser):
    """The rows of a page, the files that it refers to, and whether all of its tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.links: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if name in ("href", "src") and value]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data


def test_a_campaign_does_its_runs_and_only_those_that_are_not_done(
    campaign: Command, write: Write, tiny: Path
) -> None:
    file = write(*TWO_LOADS, 'settings.about.operator = "Élise <b>"', "settings.about.note = 'x'")
    first = campaign(file, "--only", "2")
    assert first.exit_code == 0, first.output
    assert "tiny: 2 runs, 1 to do: 0.0" in first.stderr
    assert sessions_in(tiny) == SESSIONS[1:]
    before = mark(tiny / SESSIONS[1])
    second = campaign(file)
    assert second.exit_code == 0
    assert "2 runs, 1 to do" in second.stderr
    assert "2 of 2 runs done" in second.stdout
    assert mark(tiny / SESSIONS[1]) == before
    third = json.loads(campaign(file, "--json").stdout)
    assert [run["state"] for run in third["runs"]] == ["done", "done"]
    assert [run["settings"] for run in third["runs"]] == [
        {"run.normal_force": 0.03},
        {"run.normal_force": 0.04},
    ]
    for name, load in zip(SESSIONS, (0.03, 0.04), strict=True):
        with SessionReader(tiny / name) as session:
            config = from_record(session.header.config_toml, "")
            assert (config.run.normal_force, session.header.operator) == (load, "Élise <b>")
            assert session.outcome.is_complete
        assert info(tiny / name, as_json=True, verify=True) == 0


def test_a_picture_that_a_kill_has_left_out_is_drawn_when_the_campaign_goes_on(
    campaign: Command, two_done: Path, tmp_path: Path, tiny: Path
) -> None:
    """A session is done once it has its name; its picture is drawn after that."""
    file = copied(two_done, tmp_path)
    files = sorted(path.name for path in tiny.iterdir())
    for n, name in enumerate(SESSIONS):
        picture = (tiny / name).with_suffix(".png")
        picture.unlink()
        before = mark(tiny / name)
        assert campaign(file, *["--only", n + 1] * n).exit_code == 0
        assert picture.exists()
        assert mark(tiny / name) == before
    assert sorted(path.name for path in tiny.iterdir()) == files
    (tiny / SESSIONS[0]).with_suffix(".png").unlink()
    assert campaign(file, "--check").exit_code == 0
    assert not (tiny / SESSIONS[0]).with_suffix(".png").exists()


@pytest.mark.slow
def test_the_page_shows_every_run_its_numbers_and_its_picture(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "write_picture", write_picture)
    file = write(
        'vary.about.sample = ["a & <i>b</i>", "c"]', 'sessions = "{name} {number}"', "repeats = 1"
    )
    slides = [*SHORT, "stress.method=none", "recording.results=fields", "camera.divisor=125"]
    options = given(*slides)
    assert campaign(file, "--only", "1", *options).exit_code == 0
    text = (tiny / "index.html").read_text(encoding="utf-8")
    page = Page(text)
    headings, first, second = page.rows
    wanted = ("session", "P (N)", "state", "mu_d", "a (mm)")
    columns = {name: headings.index(name) for name in wanted}
    assert [first[i] for i in columns.values()][:3] == ["tiny 1", "0.03", "done"]
    assert [second[i] for i in columns.values()] == ["tiny 2", "0.03", "waiting", "", ""]
    with SessionReader(tiny / "tiny 1.h5") as session:
        summary = session.outcome.summary
    assert float(first[columns["mu_d"]].split()[0]) == pytest.approx(summary.mu_d, abs=2e-3)
    assert first[headings.index("about.sample")] == "a & <i>b</i>"
    assert set(page.links) == {"tiny%201.h5", "tiny%201.png"}
    assert "refresh" not in text  # it is over for now
    assert (tiny / "tiny 1.png").stat().st_size > 10_000


def test_the_page_is_there_and_loads_itself_again_while_the_campaign_goes_on(
    pages: list[str],
) -> None:
    tables = [Page(text).rows for text in pages]
    states = [[row[rows[0].index("state")] for row in rows[1:]] for rows in tables]
    assert states == [["under way", "waiting"], ["done", "under way"]]
    assert all('http-equiv="refresh"' in text for text in pages)
    assert "the time left is known after the first left" not in pages[0]
    assert re.search(r"1 of 2 runs done, about \d+ s left", pages[1])


# ---------------------------------------------------------------------- failures and operators


def test_a_run_that_fails_does_not_keep_the_others_and_is_done_again_if_asked(
    campaign: Command, write: Write, tiny: Path
) -> None:
    runs = ('sessions = "{name}-{number}"', "[[runs]]", WEAK, "[[runs]]")
    result = campaign(write(*runs))
    assert result.exit_code == 1
    assert "limit: the shear force reached" in result.stderr
    assert "1 failed; --retry does them again" in result.stderr
    assert "1 of 2 runs done" in result.stdout
    assert sessions_in(tiny) == ["tiny-1.h5", "tiny-2.h5"]
    failed, done = (mark(tiny / f"tiny-{n}.h5") for n in (1, 2))
    again = campaign(write(*runs))  # as it is: nothing is tried again
    assert again.exit_code == 1
    assert mark(tiny / "tiny-1.h5") == failed
    mended = ('sessions = "{name}-{number}"', "[[runs]]", "[[runs]]")
    result = campaign(write(*mended), "--retry")
    assert result.exit_code == 0, result.stderr
    assert mark(tiny / "tiny-2.h5") == done
    assert mark(tiny / "kept/tiny-1.h5") == failed
    with SessionReader(tiny / "tiny-1.h5") as session:
        assert session.outcome.is_complete


def test_the_operator_is_told_what_to_do_and_decides(
    campaign: Command, write: Write, tiny: Path
) -> None:
    file = write(
        "pauses = true",
        'sessions = "{name}-{sample}"',
        "[[runs]]",
        'about.sample = "A"',
        WEAK,
        "[[runs]]",
        'about.sample = "B"',
        "run.normal_force = 0.04",
        "[[runs]]",
        'about.sample = "C"',
    )
    # begin; what failed once more, then go on; skip B; an answer that is none, then leave
    result = campaign(file, answers="\nr\n\ns\nwhat\nq\n")
    assert result.exit_code == 1
    said = result.stderr
    assert "next, run 1 of 3, tiny-A: sample A; P = 0.03 N, 5 um/s" in said
    assert said.count("tiny-A has failed. Enter: go on with the next; r: repeat it; q: leave") == 2
    assert "next, run 2 of 3, tiny-B: mount sample B; P = 0.04 N, 5 um/s" in said
    assert "'what' is none of these: Enter: lift the block, then begin; s: skip it; q: " in said
    assert sessions_in(tiny) == ["tiny-A.h5"]
    assert sessions_in(tiny / "kept") == ["tiny-A.h5"]
    # the failed one is not asked for again; B is done, and then nobody answers
    result = campaign(file, answers="\n")
    assert "nobody answers: the standard input is at its end" in result.stderr
    assert sessions_in(tiny) == ["tiny-A.h5", "tiny-B.h5"]


def test_ctrl_c_while_a_complete_run_is_closed_ends_the_campaign_behind_it(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared_run = campaigns.prepared_run

    def interrupted(*arguments, **options):
        made = prepared_run(*arguments, **options)
        wait = made.source.wait

        def and_press(timeout: float | None = None) -> Outcome | None:
            outcome = wait(timeout)
            if outcome is not None and timeout:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.2)
            return outcome

        monkeypatch.setattr(made.source, "wait", and_press)
        return made

    monkeypatch.setattr(campaigns, "prepared_run", interrupted)
    file = write(*TWO_LOADS)
    result = campaign(file)
    assert result.exit_code == 1
    assert "Ctrl-C was pressed after tiny-0.03N; the same command goes on" in result.stderr
    assert sessions_in(tiny) == SESSIONS[:1]
    states = [find_session(run).state for run in read_campaign(file).runs]
    assert states == [RunState.DONE, RunState.WAITING]


def test_a_run_that_somebody_stops_ends_the_campaign_and_is_done_again(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared_run = campaigns.prepared_run

    def stopped(*arguments, **options):
        made = prepared_run(*arguments, **options)
        wait = made.source.wait

        def and_stop(timeout: float | None = None) -> Outcome | None:
            if made.source.health().phase == "drive":
                made.source.stop_motion()
            return wait(0.01 if timeout else timeout)

        monkeypatch.setattr(made.source, "wait", and_stop)
        return made

    monkeypatch.setattr(campaigns, "prepared_run", stopped)
    file = write(*TWO_LOADS)
    result = campaign(file)
    assert result.exit_code == 1
    assert "tiny-0.03N: STOP MOTION was pressed; the same command goes on with this run" in (
        result.stderr
    )
    assert sessions_in(tiny) == SESSIONS[:1]
    stopped_mark = mark(tiny / SESSIONS[0])
    assert "stopped" in (tiny / "index.html").read_text(encoding="utf-8")
    monkeypatch.setattr(campaigns, "prepared_run", prepared_run)
    assert campaign(file, "--only", "1").exit_code == 0
    assert sessions_in(tiny) == SESSIONS[:1]
    assert mark(tiny / "kept" / SESSIONS[0]) == stopped_mark


def test_a_device_that_is_not_there_fails_its_run_only(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Bench.open
    calls: list[int] = []

    def not_at_first(self: Bench) -> None:
        calls.append(1)
        if len(calls) == 1:
            raise DeviceError("stage: it does not answer; check its line")
        opened(self)

    monkeypatch.setattr(Bench, "open", not_at_first)
    result = campaign(write(*TWO_LOADS))
    assert result.exit_code == 1
    assert "tiny-0.03N: stage: it does not answer; check its line" in result.stderr
    assert sessions_in(tiny) == SESSIONS[1:]
    assert "stage: it does not answer" in (tiny / "index.html").read_text()
    assert campaign(write(*TWO_LOADS)).exit_code == 0


# ---------------------------------------------------------------------- what is left of a kill


def test_a_session_that_was_complete_when_its_close_was_cut_short_is_done(
    campaign: Command, write: Write, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last step of a close removes the journal."""
    monkeypatch.setattr(recorder, "remove_recorded", lambda session: None)
    file = write('sessions = "{name}"')
    assert campaign(file).exit_code == 0  # it sees that itself
    assert sessions_in(tiny) == ["tiny.h5"]
    assert not list(tiny.glob("*.journal"))
    assert not (tiny / "kept").exists()


def test_a_session_whose_images_have_not_yet_let_go_of_their_name_is_done(
    campaign: Command, write: Write, tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The step before: for an instant the session has two names."""
    for module in (recorder, state):
        monkeypatch.setattr(module, "remove_recorded", lambda session: None)
    file, session = write('sessions = "{name}"'), tiny / "tiny.h5"
    assert campaign(file).exit_code == 0
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    os.link(session, session.with_name("tiny.h5.images"))
    before = mark(session)
    assert find_session(read_campaign(file).runs[0]).state is RunState.DONE
    assert campaign(file).exit_code == 0
    assert mark(session) == before
    left = {path.suffix for path in session.parent.glob("tiny.h5.*")}
    assert not left & {".journal", ".images", ".results"}
    assert not (tiny / "kept").exists()
    assert whole(session)


@pytest.mark.parametrize("moves", range(5))
def test_a_move_that_was_cut_short_is_finished_where_it_began(
    write: Write, tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch, moves: int
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = tiny / "kept"
    kept.mkdir(parents=True)
    endings = ("journal", "images", "results", "log")
    for ending in endings:
        (kept / f"tiny.h5.{ending}").write_text("of another kill")
        (tiny / f"tiny.h5.{ending}").write_text("of this kill")
    run = read_campaign(write('sessions = "{name}"')).runs[0]
    rename, done = Path.rename, []

    def cut_short(path: Path, target: Path) -> Path:
        if len(done) == moves:
            raise KeyboardInterrupt
        done.append(path)
        return rename(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", cut_short)
        if moves < len(endings):
            with pytest.raises(KeyboardInterrupt):
                keep(run.session)
            assert find_session(run).state is RunState.CUT
    assert keep(run.session) == Path("tiny/kept/tiny-2.h5")
    assert find_session(run).state is RunState.WAITING
    held = {path.name: path.read_text() for path in kept.iterdir()}
    assert held == {f"tiny.h5.{ending}": "of another kill" for ending in endings} | {
        f"tiny-2.h5.{ending}": "of this kill" for ending in endings
    }


def test_a_session_from_elsewhere_with_the_same_settings_counts_as_done(
    campaign: Command, two_done: Path, tmp_path: Path, tiny: Path
) -> None:
    """What is done is told by the sessions, not by a record beside them."""
    file = copied(two_done, tmp_path)
    tiny.rename(tmp_path / "copied")
    for other in ("campaign.toml", SESSIONS[1]):
        (tmp_path / "copied" / other).unlink()
    for picture in (tmp_path / "copied").glob("*.png"):
        picture.unlink()
    result = campaign(file, "-o", "copied")
    assert result.exit_code == 0
    assert "2 runs, 1 to do" in result.stderr
    assert sessions_in(tmp_path / "copied") == SESSIONS
