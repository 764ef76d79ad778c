"""Frames of which it is not certain which trigger took them are recorded, shown and left out of the
results.
"""

from dataclasses import replace

import pytest
from short_run import SMALL

from app import config, live
from app.gui.cells import Tone, count_cells
from app.offline.replay import Replay
from app.session.reader import SessionReader
from drivers.protocols import Frame


def run_with(path, is_doubtful):
    run = live.make_run(config.load(None, SMALL), path, pace=None)
    read = run._bench.camera.read

    def doubt(timeout_s):
        answer = read(timeout_s)
        if isinstance(answer, Frame) and is_doubtful(answer.index):
            answer = replace(answer, last=answer.index + 1, doubt="a count is missing")
        return answer

    run._bench.camera.read = doubt
    run.start()
    return run, run.wait(300)


@pytest.mark.parametrize(
    ("share", "words"),
    [(range(60, 70), "the results do without them"), (range(200), "the results rest on them too")],
)
def test_uncertain_frames_are_told_and_left_out_if_they_are_few(tmp_path, share, words):
    path = tmp_path / "a.h5"
    run, outcome = run_with(path, lambda index: index in share)
    counts, uncertain = outcome.counts, run.health().uncertain
    assert uncertain == min(len(share), counts.frames_recorded)
    note = next(note for note in outcome.summary.notes if "is uncertain" in note)
    assert note.startswith(f"camera: the trigger of {uncertain} of {counts.frames_analysed} frames")
    assert note.endswith(words)
    assert "uncertain" in (cell := count_cells(counts, uncertain)[1]).detail
    assert cell.tone is Tone.WARN
    with SessionReader(path) as session:
        texts = [event.text for event in session.events() if event.kind == "camera"]
        recorded = session.outcome.summary
    assert texts[0] == f"from frame {share[0]} on: a count is missing"
    replay = Replay(path, pace=None)
    replay.start()
    assert replay.wait(300).summary.notes == recorded.notes
    assert replay.wait(300).summary.mu_s == pytest.approx(recorded.mu_s, rel=1e-12, nan_ok=True)
    assert replay.comparison().all_identical


def test_a_doubt_changes_no_displacement(tmp_path):
    _, plain = run_with(tmp_path / "a.h5", lambda index: False)
    _, doubtful = run_with(tmp_path / "b.h5", lambda index: index == 60)
    # t_s lies between two frames, of which one is missing now
    assert doubtful.summary.mu_s == pytest.approx(plain.summary.mu_s, rel=5e-3)
    assert not any("uncertain" in note for note in plain.summary.notes)
