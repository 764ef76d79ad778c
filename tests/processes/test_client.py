"""What a window holds of a run in another process: all that the bench answers, however late."""

from dataclasses import replace

import numpy as np
import pytest

from app.processes import bench_client
from app.processes.calls import Gone, Silent
from app.processes.client import RemoteRun
from app.processes.folder import RunningBench
from app.records.bench_view import Health
from app.records.record_types import Conditions, Counts, End, Outcome, Phase, Snapshot
from app.records.run_view import RunView
from app.settings import config
from app.system.stopping import Stop, at_rest

REAL = ["actuator.source=smc100", "actuator.port=COM3"]
HEALTH = Health("running", "", "drive", Counts(), 0.0, 4.0, 0, 0, 0.5)
ENDED = Outcome(End.COMPLETE, "it is enough", Counts(), None)
SNAPSHOTS = tuple(
    Snapshot(n, 100 * n, Conditions(Phase.DRIVE, 0.0, 0.5, 0.1, 1e-6 * n)) for n in range(5)
)


class Bench:
    """A bench that answers as it is told."""

    def __init__(self):
        self.is_slow = self.is_gone = False
        self.outcome, self.stop, self.unanswered = None, None, ()
        self.asked, self.closed = [], 0

    def __call__(self, method, *arguments, answer_s=5.0):
        if method in self.unanswered:
            raise Silent(f"{method}: no answer within {answer_s:g} s")
        if self.is_gone:
            raise Gone("it is gone")
        if method == "about":
            return config.load(None, REAL), "the bench", HEALTH
        seen, _ = arguments
        self.asked.append(seen)
        if seen < 0:
            return RunView(HEALTH, self.outcome, self.stop), {}
        if self.is_slow:
            raise Silent("look: no answer within 5 s")
        samples = np.arange(3)
        forces = samples, 0.5 + 0.0 * samples, 0.1 * samples
        return RunView(HEALTH, self.outcome, snapshots=SNAPSHOTS[seen:], forces=forces), {}

    def close(self, *, waits):
        assert not waits
        self.closed += 1


@pytest.fixture
def bench(monkeypatch):
    made = Bench()
    monkeypatch.setattr(bench_client, "Caller", lambda address, key: made)
    return made


@pytest.fixture
def run(bench):
    return RemoteRun(RunningBench("one", "the bench", "a.h5", "x", "", 1, 0.0))


def test_each_look_asks_for_what_is_new_and_gives_what_its_caller_does_not_know(run, bench):
    assert len(run.look(0).snapshots) == 5
    assert [snapshot.frame for snapshot in run.look(3).snapshots] == [3, 4]
    assert run.look().snapshots == ()
    assert bench.asked == [0, 5, -1]
    assert len(run.look().forces[0]) == 3  # as read before


def test_snapshots_that_two_looks_have_brought_are_held_once(run, bench):
    answers = [run._ask(is_whole=True, is_shown=True) for _ in range(2)]
    for answer in answers:
        run._hold(*answer)
    assert bench.asked == [0, 0]
    assert [snapshot.frame for snapshot in run.look(0).snapshots] == [0, 1, 2, 3, 4]


def test_a_bench_that_is_too_slow_for_all_shows_its_state(run, bench):
    bench.is_slow = True
    assert run.look(0).health == HEALTH
    assert bench.asked == [0, -1]
    bench.outcome = ENDED
    assert run.look(0).outcome == ENDED
    assert bench.closed == 5


def test_a_bench_that_does_not_answer_is_told_once_in_a_sentence(run, bench, caplog):
    said = (
        "bench: what is shown of a.h5 stands still, as it has not answered within 5 s; its process"
        " (number 1) has no turn on this computer, or hangs: "
    )
    for times in (1, 2):
        bench.is_slow = True
        for _ in range(3):
            run._ask(is_whole=True, is_shown=True)
        told = [record.getMessage() for record in caplog.records]
        assert len(told) == times
        assert told[-1].startswith(said)
        bench.is_slow = False
        run.look(0)


@pytest.mark.parametrize("method", ["about", "note"])
def test_a_command_that_a_bench_does_not_answer_names_it_and_what_to_do(run, bench, method):
    bench.unanswered = (method,)
    said = rf"^the bench: {method}: no answer within 5 s; its process \(number 1\) has no turn"
    with pytest.raises(Silent, match=f"{said}.* ends it"):
        RemoteRun(run.bench).note("dry")


def test_all_of_a_run_that_has_ended_is_held_and_its_bench_let_go(run, bench):
    bench.outcome = ENDED
    assert run.wait(0.0) == ENDED
    assert bench.closed == 5
    assert len(run.look(0).snapshots) == 5
    assert bench.asked == [-1, 0]


def test_what_was_known_of_a_stop_is_no_answer_to_the_next_of_a_bench_that_is_silent(run, bench):
    run._view = replace(run._view, stop=at_rest("stage X", 2e-3))
    bench.unanswered = ("look", "stop_motion")
    answer = run.stop_motion()
    assert (answer.kind, answer.is_final) == (Stop.FAILED, False)
    assert run.look().stop is None
    bench.unanswered = ("stop_motion",)
    bench.stop = at_rest("stage X", 3e-3)
    assert run.stop_motion() == bench.stop


@pytest.mark.parametrize("now", [HEALTH, replace(HEALTH, state="stopping", sample=1)])
def test_a_bench_that_dies_unseen_was_not_at_rest_for_certain(run, bench, now):
    """Who has just attached knows what the bench was at."""
    run._view = replace(run._view, health=now)
    bench.is_gone = True
    answer = run.stop_motion()
    assert answer.kind is Stop.FAILED
    assert run.look().outcome.state == "failed"
    reason = run.look().health.reason
    assert "nothing was sent to its stage from outside; what was recorded is safe" in reason


@pytest.mark.parametrize("state", ["armed", "stopping"])  # before its first sample
def test_of_a_bench_that_dies_before_it_records_nothing_is_to_be_repaired(run, bench, state):
    run._view = replace(run._view, health=replace(HEALTH, state=state))
    bench.is_gone = True
    assert run.stop_motion().kind is Stop.NOT_CONNECTED
    assert run.look().health.reason.endswith("outside; it had recorded nothing yet")


@pytest.mark.parametrize("source", ["sim", "replay"])
def test_nobody_is_told_to_cut_the_power_of_a_stage_that_is_none(run, bench, source):
    """It has no supervisor, and ends with its process."""
    run.config = config.load(None, [f"actuator.source={source}", "replay.session=a.h5"])
    bench.is_gone = True
    answer = run.stop_motion()
    assert answer.kind is Stop.NOT_CONNECTED
    assert answer.sentence.endswith("and with it its stage, which was no real one.")
    assert run.look().outcome.state == "failed"
