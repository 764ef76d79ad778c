"""Sessions analysed together: the same to the bit however it is done, and taken up again where it
was left.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import h5py
import psutil
import pytest
from short_run import without_budget
from study_plans import TWO_THREADS, asked

from app.records.record_types import End, Outcome
from app.session.results import read_results
from app.study import one, worker
from app.study.analysis_plan import RECORDED
from app.study.analyzing import AnalysisFailed, analyze
from app.study.noise import NOTHING
from app.study.parts import Parts
from app.system.errors import UserError

PATIENCE_S = 240.0


def command(*arguments):
    """A `slipscope analyze` that runs."""
    return subprocess.Popen(
        [sys.executable, "-m", "app", "analyze", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_the_runs_come_by_load_with_what_they_have_in_common(once, sessions):
    results = read_results(once)
    assert [run.origin.session for run in results.runs] == ["load-0.06.h5", "load-0.09.h5"]
    forces = [run.summary.normal_force_n for run in results.runs]
    assert forces == pytest.approx([0.06, 0.09], rel=0.01)
    for run in results.runs:
        assert len(run.instants.frame) == 6
        assert run.noise.sigma_px[0] > run.noise.sigma_px[-1] > 0
        assert (run.noise.sigma_px > 0.8 * run.noise.floor_px).all()
        assert run.noise.direct_px[2] > 1.2 * run.noise.sigma_px[2]  # 20 px, the paper's method
        assert len(run.origin.checksum) == 64
    assert results.joint.young_modulus_pa == pytest.approx(3.43e6, rel=0.03)
    assert results.joint.mu == pytest.approx(0.93, rel=0.01)
    assert results.made_with["preset"] == RECORDED
    assert not Parts(once).folder.exists()


@pytest.fixture
def known(results):
    """What each session gave, by its name: for tests in which it need not be computed again."""
    return {run.origin.session: run for run in results.runs}


def test_an_interrupted_analysis_goes_on(once, sessions, known, tmp_path, monkeypatch):
    plan, begun, give_up = asked(sessions, tmp_path / "left.h5"), [], time.monotonic() + 120
    shares = []

    def leave(text, share):
        shares.append((text, share))
        if text.startswith("1 of 2") and len(begun) == 2:
            raise KeyboardInterrupt

    def counted(path, overrides, on_progress, threads):
        begun.append(path)
        while len(begun) == 2 and time.monotonic() < give_up:  # until it is interrupted
            on_progress(0.5)
            time.sleep(0.01)
        return known[path.name]

    monkeypatch.setattr(worker, "run_result", counted)
    with pytest.raises(KeyboardInterrupt):
        analyze(plan, jobs=1, on_progress=leave)
    assert not plan.output.exists()
    assert shares[0] == ("0 of 2 sessions", 0.0)
    shares.clear()
    analyze(plan, jobs=1, on_progress=lambda text, share: shares.append((text, share)))
    assert len(begun) == 3
    assert plan.output.read_bytes() == once.read_bytes()
    assert shares[-1] == ("2 of 2 sessions", 1.0)
    assert sorted(share for _, share in shares) == [share for _, share in shares]


def test_other_settings_do_not_go_on_from_there(sessions, tmp_path):
    plain, other = (
        asked(sessions, tmp_path / "keys.h5", *changed)
        for changed in ((), ("sample.roughness=0.6",))
    )
    assert not {task.key for task in plain.tasks} & {task.key for task in other.tasks}


def test_a_killed_command_leaves_no_process_and_goes_on(once, sessions, tmp_path):
    """And two processes give the same bytes as one, in any order of the sessions."""
    output = tmp_path / "killed.h5"
    arguments = (
        *sessions[::-1],
        "-o",
        output,
        "--preset",
        RECORDED,
        "--jobs",
        2,
        "--set",
        TWO_THREADS,
    )
    process = command(*arguments)
    parts = Parts(output).folder
    until = time.monotonic() + PATIENCE_S
    while not list(parts.glob("*.h5")) and time.monotonic() < until:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    _, alive = psutil.wait_procs(children, timeout=60)
    assert not alive
    again = command(*arguments, "--json")
    said, errors = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0, errors
    assert output.read_bytes() == once.read_bytes()
    told = json.loads(said)
    assert [run["session"] for run in told["runs"]] == ["load-0.06.h5", "load-0.09.h5"]
    assert told["joint"]["length_m"] == pytest.approx(0.8e-6, rel=0.2)


def test_a_session_that_fails_costs_only_itself(sessions, known, tmp_path, monkeypatch):
    plan = asked(sessions, tmp_path / "half.h5")

    def failing(path, *_):
        if path.name == sessions[0].name:
            raise OSError("the disk is gone")
        return known[path.name]

    monkeypatch.setattr(worker, "run_result", failing)
    with pytest.raises(
        AnalysisFailed, match=r"the disk is gone; .* 1 other session are kept.* from there$"
    ):
        analyze(plan, jobs=1)
    assert not plan.output.exists()
    assert len(Parts(plan.output).done(plan.tasks)) == 1


def test_a_session_of_which_no_image_can_be_read_is_a_sentence(sessions, tmp_path):
    spoiled = shutil.copy(sessions[0], tmp_path / "spoiled.h5")
    with h5py.File(spoiled, "r+") as file:
        file["/entry/triggers/checksum"][:] = 1
    plan = asked([spoiled], tmp_path / "none.h5")
    with pytest.raises(
        AnalysisFailed,
        match=r"spoiled.h5: none of its images is the one that was.*; nothing is kept$",
    ):
        analyze(plan, jobs=1)


@pytest.mark.slow
def test_altered_images_are_left_out_with_a_note(sessions, tmp_path, monkeypatch):
    monkeypatch.setattr(one, "box_noise", lambda *_: NOTHING)
    spoiled = shutil.copy(sessions[0], tmp_path / "spoiled.h5")
    with h5py.File(spoiled, "r+") as file:
        file["/entry/triggers/checksum"][60:62] = 1
    plan = asked([spoiled], tmp_path / "left.h5")
    with without_budget():
        analyze(plan, jobs=1)
    (run,) = read_results(plan.output).runs
    assert run.summary.notes[0].startswith("2 images are not those that were recorded")
    assert not {60, 61} & set(run.frames["frame"].tolist())


def test_two_commands_do_not_make_the_same_results(sessions, tmp_path):
    plan = asked(sessions, tmp_path / "one.h5")
    with Parts(plan.output).held(), pytest.raises(UserError, match="another program is making"):
        analyze(plan, jobs=1)


def test_a_failed_run_is_analysed_with_a_note(sessions, tmp_path, monkeypatch):
    from app.session.reader import SessionReader

    failed = property(lambda self: Outcome(End.FAILED, "Q came near its limit", None, None))
    monkeypatch.setattr(SessionReader, "outcome", failed)
    plan = asked(sessions[:1], tmp_path / "failed.h5")
    assert plan.notes == (
        "load-0.06.h5: the run ended as failed (Q came near its limit); its images are analysed",
    )
