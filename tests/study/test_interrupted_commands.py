"""Ctrl-C and the signal to end: each command that computes is over soon, says one sentence and
leaves what was there before it, whatever it is at.
"""

import json
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import psutil
import pytest
from command_line import call

from app.study import worker
from app.system import interrupting, outputs

resource = pytest.importorskip("resource", reason="signals of POSIX")

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
MOST_CPU_S = 2.0

STUCK = """
import os
import time
from pathlib import Path

def stuck(self, target):
    # all was written, and a function of a library hears no Ctrl-C
    said = 0
    while True:
        try:
            if not said:
                said = 1
                os.write(1, b"at work\\n")
            time.sleep(60)
        except KeyboardInterrupt:
            pass

Path.replace = stuck
from app.cli import main
main()
"""


@pytest.fixture(scope="module")
def images(sessions, tmp_path_factory):
    from app.files.exporting import export

    folder = tmp_path_factory.mktemp("images") / "images"
    export(sessions[0], folder, "images", frames="0:40")
    return folder


def begun(words, code=("-m", "app")):
    """A command that hears Ctrl-C, which a suite that runs in the background does not."""
    return subprocess.Popen(
        [sys.executable, *code, *map(str, words)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


def ended(process, number):
    """What it says after a signal, its exit code, the seconds of processor time until its end, and
    which of its processes are left.
    """
    program = psutil.Process(process.pid)
    family = [program, *program.children(recursive=True)]

    def spent():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = spent() + sum(sum(one.cpu_times()[:2]) for one in family)
    process.send_signal(number)
    try:
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    _, left = psutil.wait_procs(family, timeout=10.0)
    return out, said, process.returncode, spent() - before, left


def held_in(folder):
    """Its files, but for what an analysis has of each session."""
    files = [path for path in folder.rglob("*") if path.is_file() and ".parts" not in str(path)]
    return {path: path.read_bytes() for path in files}


REASONS = {"SIGINT": "Ctrl-C", "SIGTERM": "the signal to end", "SIGHUP": "a closed terminal"}


@pytest.mark.parametrize(
    "name", ["SIGINT", *(pytest.param(name, marks=pytest.mark.slow) for name in [*REASONS][1:])]
)
def test_an_interrupted_command_ends_soon_and_leaves_what_was_there(name, tmp_path):
    target = tmp_path / "out.csv"
    target.write_text("earlier")
    process = begun(["model", "-o", target, "--overwrite"], ("-c", STUCK))
    assert process.stdout.readline() == "at work\n", process.communicate()
    out, said, code, cpu_s, left = ended(process, getattr(signal, name))
    assert (code, out, left) == (1, "", [])
    (sentence,) = said.splitlines()
    kept = "files that were there before are unchanged"
    assert sentence == f"slipscope: {REASONS[name]}: left before the end; {kept}"
    assert cpu_s < MOST_CPU_S
    assert held_in(tmp_path) == {target: b"earlier"}


@pytest.mark.parametrize("command", ["analyze", "dic", "export", "film", "figures", "import"])
def test_each_command_that_computes_is_watched_and_known_by_what_it_has_not_finished(
    command, sessions, once, results, images, tmp_path, monkeypatch
):
    """So that it ends as the one above does."""
    image, field = sorted(images.glob("*.tif*")), tmp_path / "field.csv"
    field.write_text("x_um,y_um,ux_um\n" + "".join(f"{x},0,{x / 100}\n" for x in range(0, 90, 9)))
    words, name = {
        "analyze": ([sessions[0], "--jobs", 1], "out.h5"),
        "dic": ([image[0], image[1]], "out.csv"),
        "export": ([sessions[0], "--what", "rings"], "out.csv"),
        "film": ([sessions[0], "--what", "ux"], "out.gif"),
        "figures": ([once, "--only", 5], "out"),
        "import": ([images], "out.h5"),
    }[command]
    target = tmp_path / name
    if is_folder := not target.suffix:
        target.mkdir()
    (target / "fig05.png" if is_folder else target).write_text("earlier")
    before, at_the_end, place = held_in(tmp_path), [], Path.replace

    def left(path, to):
        if ".part" not in str(path) or ".parts" in str(path):
            return place(path, to)
        assert path.exists()
        outputs.remove_unfinished()
        threads = [thread.name for thread in threading.enumerate()]
        at_the_end.append(("slipscope-interrupt" in threads, held_in(tmp_path)))
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", left)
    monkeypatch.setattr(worker, "run_result", lambda *_: results.runs[0])
    command = "export" if command == "film" else command
    said = call(command, *words, "-o", target, "--overwrite")
    assert said.exit_code == 1
    assert "slipscope: Ctrl-C: left before the end; " in said.stderr
    assert at_the_end == [(True, before)]
    assert held_in(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_analysis_in_the_midst_of_its_work_ends_with_all_its_processes(jobs, sessions, tmp_path):
    target = tmp_path / "out.h5"
    process = begun(["analyze", *sessions, "-o", target, "--jobs", jobs, "--json"])
    program, busy = psutil.Process(process.pid), []
    while len(busy) < jobs:
        assert process.poll() is None
        time.sleep(0.01)
        workers = program.children() if jobs > 1 else [program]
        busy = [one for one in workers if sum(one.cpu_times()[:2]) > 2.5]
    out, said, code, cpu_s, left = ended(process, signal.SIGTERM)
    assert (code, said.splitlines(), left) == (1, said.splitlines()[:1], [])
    assert "the signal to end" in (said or json.loads(out)["error"])
    assert cpu_s < MOST_CPU_S
    assert not target.exists()


SLOW_TO_END = """
import atexit
import signal
import sys

def interrupted():
    signal.raise_signal(getattr(signal, sys.argv[1]))

for _ in range(2):
    atexit.register(interrupted)
from app.cli import main, program

program.main = interrupted
main()
"""


@pytest.mark.parametrize("name", REASONS)
def test_a_second_signal_while_the_interpreter_ends_changes_no_exit_code(name):
    process = begun([name], ("-c", SLOW_TO_END))
    _, said = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, said) == (1, f"slipscope: {REASONS[name]}: nothing was done\n")


GIVES_UP = """
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil

from app.system import interrupting, outputs

interrupting.GRACE_S = 0.2
interrupting.heed_signal_to_end()
fault, folder = sys.argv[1], Path(sys.argv[2])
children = [subprocess.Popen([sys.executable, "-c", "input()"], stdin=-1) for _ in range(3)]
listed, is_ready = psutil.Process.children, False

def children_of(self, recursive=False):
    found = listed(self, recursive)
    if fault == "a child has just ended":
        for child in children[:2]:
            child.kill()
            child.wait()
    return found

def tell(reason):
    if fault == "what would say it is closed":
        raise ValueError("I/O operation on closed file")
    if fault == "what would say it is of no use":
        raise SystemExit(0)
    print(reason, "x" * 100_000 if fault == "nobody reads" else "", flush=True)

psutil.Process.children = children_of
with (
    interrupting.ending_soon(tell),
    outputs.new_file(folder / "first.csv", False) as first,
    outputs.new_file(folder / "second.csv", False) as second,
):
    first.touch()
    second.touch()
    if fault == "a file cannot be removed":
        removed = outputs._remove
        def remove(path):
            if path == first:
                raise PermissionError(13, "in use", str(path))
            removed(path)
        outputs._remove = remove
    while True:
        try:
            if not is_ready:
                print(*(child.pid for child in children), file=sys.stderr, flush=True)
                is_ready = True
            if fault == "nobody reads":
                os.write(1, b"x" * 100_000)
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""


@pytest.mark.parametrize(
    "fault",
    [
        "none",
        "nobody reads",
        "what would say it is closed",
        "what would say it is of no use",
        "a child has just ended",
        "a file cannot be removed",
    ],
)
def test_whatever_fails_meanwhile_the_program_ends_with_its_processes_and_files(fault, tmp_path):
    process = begun([fault, tmp_path], ("-c", GIVES_UP))
    children = [psutil.Process(int(pid)) for pid in process.stderr.readline().split()]
    try:
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 1
        assert psutil.wait_procs(children, timeout=10.0)[1] == []
        says_why = process.stdout.read().startswith("the signal to end")
        assert says_why == (fault in ("none", "a child has just ended", "a file cannot be removed"))
        left = [path.name.partition(".")[0] for path in tmp_path.iterdir()]
        assert left == (["first"] if fault == "a file cannot be removed" else [])
        assert "Traceback" not in process.stderr.read()
    finally:
        for one in (*children, process):
            with suppress(psutil.NoSuchProcess):
                one.kill()
        process.communicate()


def test_another_signal_ends_nothing(monkeypatch):
    monkeypatch.setattr(interrupting, "GRACE_S", 0.0)
    came, told = [], []
    monkeypatch.setattr(interrupting.os, "_exit", told.append)
    former = signal.signal(signal.SIGUSR1, lambda *_: came.append(True))
    try:
        with interrupting.ending_soon(told.append):
            signal.raise_signal(signal.SIGUSR1)
            time.sleep(0.2)
    finally:
        signal.signal(signal.SIGUSR1, former)
    assert (came, told) == ([True], [])
