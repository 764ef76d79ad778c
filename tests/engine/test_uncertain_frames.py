"""Frames of which it is not certain which trigger took them are recorded, shown and left out of the
results.
"""

import csv
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from short_run import SMALL
from whole_runs import replayed

from app.files.exporting import export
from app.gui.cells import Tone, count_cells
from app.records.record_types import REVOKED, Event
from app.runs import live
from app.session.datasets import uncertain_triggers, with_revocations
from app.session.reader import SessionReader
from app.session.tables import session_table
from app.settings import config
from drivers.protocols import Frame

SETTINGS = (*SMALL, "run.travel=40")


def run_with(path, is_doubtful, *settings):
    run = live.make_run(config.load(None, (*SETTINGS, *settings)), path, pace=None)
    read = run._bench.camera.read

    def doubt(timeout_s):
        answer = read(timeout_s)
        if isinstance(answer, Frame) and is_doubtful(answer.index):
            answer = replace(answer, last=answer.index + 1, doubt="a count is missing")
        return answer

    run._bench.camera.read = doubt
    run.start()
    return run, run.wait(300)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "words"),
    [(range(60, 70), "the results do without them"), (range(200), "the results rest on them too")],
)
def test_uncertain_frames_are_told_and_left_out_if_they_are_few(tmp_path, share, words):
    path = tmp_path / "a.h5"
    run, outcome = run_with(path, lambda index: index in share)
    counts, uncertain = outcome.counts, run.health().uncertain
    health = replace(run.health(), counts=counts)
    assert uncertain == min(len(share), counts.frames_recorded)
    note = next(note for note in outcome.summary.notes if "is uncertain" in note)
    assert note.startswith(f"camera: the trigger of {uncertain} of {counts.frames_analysed} frames")
    assert note.endswith(words)
    assert "uncertain" in (cell := count_cells(health)[1]).detail
    assert cell.tone is Tone.WARN
    with SessionReader(path) as session:
        texts = [event.text for event in session.events() if event.kind == "camera"]
        recorded = session.outcome.summary
    ends = [f"from frame {share[-1] + 1} on: no more doubt"] * (share[-1] < counts.frames_recorded)
    assert texts == [f"from frame {share[0]} on: a count is missing", *ends]
    replay = replayed(path)
    assert replay.outcome().summary.notes == recorded.notes
    assert replay.outcome().summary.mu_s == pytest.approx(recorded.mu_s, rel=1e-12, nan_ok=True)
    assert replay.comparison().all_identical


@pytest.fixture(scope="module")
def revoked_run(tmp_path_factory):
    @cache
    def revoked(first):
        path = tmp_path_factory.mktemp("revoked") / "a.h5"
        run = live.make_run(config.load(None, SETTINGS), path, pace=None)
        run._bench.camera.uncertain_from = lambda: first
        run.start()
        return path, run, run.wait(300)

    return revoked


@pytest.mark.slow
def test_a_doubt_changes_no_displacement(tmp_path, small_run):
    plain = small_run[1]
    _, doubtful = run_with(tmp_path / "b.h5", lambda index: index == 60, *SMALL)
    # t_s lies between two frames, of which one is missing now
    assert doubtful.summary.mu_s == pytest.approx(plain.summary.mu_s, rel=5e-3)
    assert not any("uncertain" in note for note in plain.summary.notes)


@pytest.mark.slow
@pytest.mark.parametrize("first", [60, None])
def test_an_account_that_does_not_hold_revokes_certainty(revoked_run, first):
    path, run, outcome = revoked_run(first)
    frames = outcome.counts.frames_analysed
    wanted = list(range(60, frames)) if first else []
    assert run.health().uncertain == len(wanted)
    notes = [note for note in outcome.summary.notes if "is uncertain" in note]
    with SessionReader(path) as session:
        assert uncertain_triggers(session) == wanted
        texts = [event.text for event in session.events() if event.kind == REVOKED]
    assert len(notes) == len(texts) == bool(first)
    replay = replayed(path)
    assert replay.outcome().summary.notes == outcome.summary.notes
    assert replay.health().uncertain == len(wanted)
    assert replay.comparison().all_identical
    if first:
        assert "from frame 60 on because the account does not hold" in notes[0]
        assert f"{len(wanted)} triggers are uncertain" in outcome.resources["receipt"]


def test_tables_show_revoked_frames_as_uncertain(tmp_path, revoked_run):
    path, _, outcome = revoked_run(60)
    count = outcome.counts.triggers
    with SessionReader(path) as session:
        table = session_table(session, "triggers")
        export(path, tmp_path / "images")
    with (tmp_path / "images" / "metadata.csv").open(encoding="utf-8") as file:
        exported = [(int(row["first"]), int(row["last"])) for row in csv.DictReader(file)]
    spans = list(zip(table["first"].tolist(), table["last"].tolist(), strict=True))
    assert spans == exported == [(n, n) for n in range(60)] + [(60, count)] * (count - 60)


@pytest.mark.parametrize("revoked", [0, 3, 4])
def test_each_revoked_frame_can_be_more_than_one(revoked):
    kinds = [(name, "i8") for name in ("index", "first", "last")]
    rows = np.array([(n, n - (n == 3) * 3, n + (n == 1)) for n in range(5)], kinds)
    told = with_revocations(
        rows, [Event(0, REVOKED, f"{revoked}: the account does not hold", revoked)]
    )
    assert told[:revoked].tolist() == rows[:revoked].tolist()
    assert (told["last"][revoked:] == 5).all()
    assert told["first"][revoked:].tolist() == [0 if n == 3 else revoked for n in range(revoked, 5)]
    assert rows["last"].tolist() == [0, 2, 2, 3, 4]
