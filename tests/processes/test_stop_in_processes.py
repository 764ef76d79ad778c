"""A stop of a run in another process answers what became of it, also when that process is gone."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import psutil
import pytest
from processes.launched import (
    PATIENT_S,
    SETTINGS,
    OutsideStage,
    bench_of,
    drives,
    kill,
    launched,
    wait_until,
    whole,
)
from python_program import python

import slipscope
from app.cli import run_commands as commands
from app.processes import bench_client, folder as folders, launch, urgent
from app.processes.calls import Gone, Server, Silent
from app.processes.folder import RunningBench
from app.processes.supervisor import Watch, _stop
from app.session.repair import repair
from app.system.errors import UserError
from app.system.stopping import (
    CUT_POWER,
    Stop,
    at_rest,
    failed,
    not_connected,
    of_all,
    sent_from_outside,
    sent_to,
)
from drivers.errors import DeviceFault

NO_MORE = (psutil.STATUS_STOPPED, psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


def test_a_stop_whose_line_is_cut_has_failed(tmp_path, capfd):
    outside = OutsideStage()
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        other = launch.attached(run.bench.name)
        outside.line.cut()
        answer = other.stop_motion()
        assert answer.kind is Stop.FAILED
        assert answer.sentence.startswith(f"{CUT_POWER}: SMC100: ")
        outcome = run.wait(PATIENT_S)
        assert outcome.state == "failed"
        assert run.stop_motion().kind is Stop.FAILED
    assert outside.stage.is_moving()


def log_out():
    """Delete the folder of the benches while they write in it."""
    gone = folders.root().with_name("gone")
    folders.root().rename(gone)
    shutil.rmtree(gone)


def test_a_stop_from_a_terminal_is_confirmed_by_the_position(
    tmp_path, short_path, monkeypatch, capfd
):
    """So it is of a run whose folder a logout has deleted."""
    monkeypatch.setattr(folders, "MEMORY", short_path)
    outside = OutsideStage()
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        assert run.look().stop is None
        run.start()
        wait_until(lambda: drives(run), "the drive")
        if sys.platform != "win32":
            log_out()
            assert wait_until(folders.running, "its folder") == [folders.refreshed(run.bench)]
        assert commands.stop(str(tmp_path / "a.h5")) == 0
        said = " ".join(capfd.readouterr().err.split())
        assert "STOP MOTION: the SMC100 is at rest at 12.50" in said
        assert outside.stops()
        outcome = run.wait(PATIENT_S)
        assert (outcome.state, outcome.reason) == ("done", "STOP MOTION was pressed")
        assert run.look().stop.kind is Stop.AT_REST
        answer = run.stop_motion()
        assert answer.kind is Stop.NOT_CONNECTED
        assert "the run has ended" in answer.sentence
    assert not outside.stage.is_moving()
    whole(tmp_path / "a.h5")
    with pytest.raises(UserError, match="stop: no bench of yours runs"):
        commands.stop(None)
    outside.line.cut()


def listening_threads():
    return sum(thread.name == "slipscope-calls" for thread in threading.enumerate())


@posix
def test_a_run_of_a_script_is_found_shown_and_stopped_like_one_of_the_command(
    tmp_path, short_path, monkeypatch, capfd
):
    monkeypatch.setattr(folders, "MEMORY", short_path)
    outside, path, listening = OutsideStage(), tmp_path / "a.h5", listening_threads()
    with ThreadPoolExecutor(1) as script:
        ends = script.submit(slipscope.run, path, None, [*SETTINGS, *outside.settings], pace=1.0)
        bench = wait_until(lambda: ends.done() or bench_of(path), "the bench")
        wait_until(lambda: [b.name for b in launch.under_way()] == [bench.name], "its beginning")
        window = launch.attached(bench.name)
        wait_until(lambda: drives(window), "the drive")
        assert window.look(0).image is not None
        log_out()
        wait_until(folders.running, "its folder")
        assert commands.stop(None) == 0
        said = " ".join(capfd.readouterr().err.split())
        assert "STOP MOTION: the SMC100 is at rest at 12.50" in said
        assert window.wait(PATIENT_S).reason == "STOP MOTION was pressed"
        with ends.result(PATIENT_S) as session:
            assert (session.state, session.reason) == ("stopped", "STOP MOTION was pressed")
    outside.line.cut()
    assert not list(folders.root().iterdir())
    # the thread of the folder that was deleted stays
    wait_until(lambda: listening_threads() <= listening + 1, "the end of its thread")


def runs_no_more(pid):
    """Whether a signal has arrived, which on a busy machine it does after `kill` has returned."""
    try:
        return psutil.Process(pid).status() in NO_MORE
    except psutil.NoSuchProcess:
        return True


@posix
@pytest.mark.parametrize(("number", "over"), [(signal.SIGKILL, "pty"), (signal.SIGSTOP, "tcp")])
def test_the_supervisor_stops_the_stage_and_answers_for_a_bench_that_is_gone(
    tmp_path, number, over
):
    outside = OutsideStage(over)
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run, 10), "the drive")
        assert not outside.stops()
        os.kill(run.bench.pid, number)
        wait_until(lambda: runs_no_more(run.bench.pid), "the end of its threads")
        if over == "tcp":  # nobody asks
            wait_until(outside.stops, "the stop")
            assert run.wait(PATIENT_S).state == "failed"
        answer = run.stop_motion()
        assert answer.kind is Stop.SENT, answer
        assert "by the supervisor" in answer.sentence
        assert outside.stops()
        wait_until(lambda: not outside.stage.is_moving(), "the standstill")
        here = outside.stage.position()
        outcome = run.wait(PATIENT_S)
        assert outcome.state == "failed"
        assert "a stop was sent to its stage from outside" in outcome.reason
        assert run.look().stop == answer
    time.sleep(0.3)
    assert outside.stage.position() == here < 12.5 + 0.060  # which it had 10 s to go to
    outside.line.cut()


@posix
def test_a_bench_that_is_gone_without_a_supervisor_could_not_be_stopped(tmp_path):
    """It is a failure by name, and its session can be repaired."""
    path = tmp_path / "a.h5"
    with launched(path, "actuator.source=processes.unknown_stage:UnknownStage") as run:
        run.start()
        wait_until(lambda: drives(run, 20), "the drive")
        other = launch.attached(run.bench.name)  # which has not looked at it yet
        received = run.look().health.counts.frames_received
        kill(run.bench.pid)
        outcome = run.wait(PATIENT_S)
        for asks in (run, other):
            answer = asks.stop_motion()
            assert answer.kind is Stop.FAILED
            assert "no supervisor watches its stage" in answer.sentence
    assert outcome.state == "failed"
    assert "has ended" in outcome.reason
    assert f"`slipscope repair {path.resolve()} -o REPAIRED.h5`" in outcome.reason
    repair(path, tmp_path / "b.h5")
    recorded, _ = whole(tmp_path / "b.h5")
    assert recorded.counts.frames_recorded > received - 10


class Refuses:
    """A way to the stage that is cut at first, as while its port is another program's."""

    def __init__(self, times):
        self.times = times

    def stop(self):
        self.times -= 1
        if self.times >= 0:
            raise DeviceFault("SMC100: 'ST' cannot be sent, the line is dead")


@pytest.mark.parametrize(("times", "kind"), [(99, Stop.FAILED), (3, Stop.SENT)])
def test_a_supervisor_whose_way_is_cut_ends_the_bench_and_tries_again(
    tmp_path, monkeypatch, times, kind
):
    killed = []
    monkeypatch.setattr("os.kill", lambda *what: killed.append(what))
    _stop(Watch(Refuses(times), 12345, 1.0, 1e-4, tmp_path / "stop.json"), and_kill=False)
    assert killed
    monkeypatch.setattr("app.processes.folder.root", lambda: tmp_path.parent)
    from app.processes.folder import read_stop_answer

    answer = read_stop_answer(tmp_path.name)
    assert answer.kind is kind
    assert ("'ST' cannot be sent, the line is dead" in answer.sentence) == (kind is Stop.FAILED)


class FakeCaller:
    """The connection to a run in another process, by the name of its bench."""

    def __init__(self, address, key):
        self.name = address

    def __call__(self, method):
        if self.name == "gone":
            raise Gone(f"{method}: the other process is gone")
        if method == "stop_answer":
            return at_rest("stage X", 12.5e-3)
        assert method == "stop_motion"
        if self.name == "silent":
            raise Silent("stop_motion: no answer within 5 s")
        return sent_to("stage X")


def fake_bench(name):
    return RunningBench(name, f"bench {name}", f"/data/{name}.h5", name, "", 1, 0.0)


def test_a_stop_without_a_name_stops_all_and_each_has_its_answer(monkeypatch, capfd):
    benches = [fake_bench(name) for name in ("one", "silent", "gone", "two")]
    monkeypatch.setattr(bench_client, "Caller", FakeCaller)
    monkeypatch.setattr(urgent, "reachable", lambda: benches)
    assert commands.stop(None) == 1
    said = " ".join(capfd.readouterr().err.split())
    rests = "STOP MOTION: the stage X is at rest at 12.5000 mm; its position was read twice. (bench"
    assert f"{rests} one, which records one.h5)" in said
    assert f"{rests} two, which records two.h5)" in said
    assert f"{CUT_POWER}: bench: stop_motion: no answer within 5 s (bench silent" in said
    assert "nothing was sent, because its process has just ended. (bench gone" in said
    del benches[1]
    assert commands.stop(None) == 0
    worst = of_all(launch.stopped([fake_bench("one"), fake_bench("silent")]))
    assert worst.kind is Stop.FAILED
    assert "records one.h5" in worst.sentence
    assert worst.sentence.startswith(CUT_POWER)
    some = [at_rest("stage X", 0.0), sent_to("stage Y"), not_connected("it has ended")]
    assert of_all(some).kind is Stop.SENT
    assert of_all([*some, failed("it moves")]).kind is Stop.FAILED
    assert of_all([some[2], some[0]]).kind is Stop.AT_REST


@pytest.fixture
def sleeper():
    """A process that does nothing."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


@posix
@pytest.mark.parametrize("number", [signal.SIGCONT, signal.SIGSTOP])
def test_a_stop_of_a_suspended_bench_says_which_and_what_the_operator_can_do(
    monkeypatch, capfd, sleeper, number
):
    is_suspended, pid = number == signal.SIGSTOP, sleeper.pid
    bench = replace(fake_bench("silent"), pid=pid, supervisor_pid=os.getpid())
    monkeypatch.setattr(bench_client, "Caller", FakeCaller)
    monkeypatch.setattr(urgent, "reachable", lambda: [bench])
    os.kill(pid, number)
    wait_until(lambda: bench.is_suspended == is_suspended, "its state")
    assert commands.stop(None) == 1
    said = " ".join(capfd.readouterr().err.split())
    found = "has no turn on this computer, or hangs:"
    if is_suspended:
        found = f"is suspended: kill -CONT {pid} resumes it and its run,"
    assert "no answer within 5 s (bench silent, which records silent.h5); its process" in said
    assert f"its process (number {pid}) {found} kill -KILL {pid} ends it, upon which its" in said
    assert "its supervisor stops the stage" in said
    assert "Traceback" not in said


@posix
@pytest.mark.parametrize("name", [None, "dead.h5"])
@pytest.mark.parametrize("answers", [True, False])
def test_a_stop_after_a_bench_has_died_says_what_became_of_its_stage(
    short_path, monkeypatch, capfd, name, answers
):
    monkeypatch.setattr(folders, "MEMORY", short_path)
    folder = folders.new_folder()
    dead = replace(
        fake_bench("dead"),
        name=folder.name,
        address=str(folder / "calls"),
        supervisor_pid=2**22 + 1,
        pid=2**22 + 1,
    )
    folders.publish(folder, dead)
    if answers:
        folders.write_stop_answer(folder / folders.ANSWER, sent_from_outside())
    assert commands.stop(name) == 1
    said = " ".join(capfd.readouterr().err.split())
    became = "STOP MOTION was sent by the supervisor, because the bench's process has ended"
    if not answers:
        became = f"{CUT_POWER}: bench: its process (number {dead.pid}) has ended, and so has its"
    assert became in said
    assert "(bench dead, which records dead.h5)" in said
    repairs = f"`slipscope repair {dead.session} -o REPAIRED.h5` gives back what it recorded"
    assert f"bench dead: {repairs}" in said
    assert "its run ends and saves" not in said
    server = Server(folder, b"key", dict)  # it is in a container, and its own to end
    assert folders.died() == []
    server.close()
    then = time.time() - folders.KEPT_S - 1
    for path in (*folder.iterdir(), folder):
        os.utime(path, (then, then))
    folders.new_folder()  # of the next bench
    with pytest.raises(UserError, match="stop: no bench of yours runs"):
        commands.stop(name)


HEAVY = (
    "numpy",
    "typer",
    "rich",
    "pydantic",
    "msgspec",
    "app.settings.config",
    "app.acquisition",
    "app.evaluation",
    "h5py",
)


def test_slipscope_stop_imports_nothing_that_takes_time(short_path):
    """It says that nothing runs, by itself, as soon as it has looked."""
    code = (
        "import sys, pathlib; from app.cli import main; from app.processes import folder\n"
        f"folder.MEMORY = pathlib.Path({str(short_path)!r})  # where nobody has a bench\n"
        "try:\n    main()\nfinally:\n"
        f"    print(sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    environment = {"TMPDIR": str(short_path)}
    done = python("-c", code, "stop", "no-such-bench", environment=environment)
    assert done.returncode == 2, done.stderr
    assert done.stdout.strip() == "[]"
    assert "stop: no" in done.stderr


def test_what_is_no_plain_stop_is_left_to_the_commands():
    for arguments in (["stop", "--help"], ["stop", "a", "b"], ["run"], [], ["--debug", "stop"]):
        assert urgent.at_once(arguments) is None


def test_a_plain_stop_answers_and_ends_with_its_code(monkeypatch, capfd):
    bench = fake_bench("one")
    monkeypatch.setattr(bench_client, "Caller", FakeCaller)
    monkeypatch.setattr(urgent, "reachable", lambda: [bench])
    monkeypatch.setattr(urgent, "running_as", lambda name, who: bench)
    assert urgent.at_once(["stop"]) == 0
    said = capfd.readouterr().err
    assert "slipscope: STOP MOTION: the stage X is at rest at 12.5000 mm" in said
    assert "slipscope: bench one: its run ends and saves one.h5" in said
    silent = fake_bench("silent")
    monkeypatch.setattr(urgent, "running_as", lambda name, who: silent)
    assert urgent.at_once(["stop", "silent"]) == 1
    assert f"slipscope: {CUT_POWER}: bench: stop_motion: no answer" in capfd.readouterr().err


def test_a_bench_that_is_gone_is_answered_by_its_supervisor(monkeypatch):
    answers = [None, None, failed("SMC100: the line is dead")]
    monkeypatch.setattr(
        bench_client,
        "read_stop_answer",
        lambda name: answers.pop(0) if len(answers) > 1 else answers[0],
    )
    monkeypatch.setattr(
        bench_client, "refreshed", lambda bench: replace(bench, supervisor_pid=os.getpid())
    )
    monkeypatch.setattr(bench_client, "Caller", FakeCaller)
    (answer,) = urgent.stopped([fake_bench("gone")])
    assert answer.kind is Stop.FAILED
    assert "the line is dead" in answer.sentence
