"""Whoever reads what the program prints, and whatever a terminal can print: a good run stays
one.
"""

import errno
import gc
import io
import json
import os
import queue
import subprocess
import sys
import time
import weakref
from pathlib import Path

import pytest
from command_line import given
from short_run import BLIND, SHORT

from app.cli import run_and_replay
from app.cli.run_and_replay import _follow, _Operator, _Reports
from app.cli.streams import steady_streams
from app.cli.terminal import TypedLines, print_line, print_rows, print_table, say
from app.processes import urgent
from app.records.bench_view import Health
from app.records.record_types import Counts
from app.records.run_view import RunView
from app.runs.run_source import PreparedSource
from app.session.reader import SessionReader
from app.system.stopping import not_connected

ROOT = Path(__file__).parents[2]
RUN = (
    *(sys.executable, "-m", "app", "run", "--headless", "--pace", "max"),
    *given(*SHORT, *BLIND, "run.travel=8"),
)


def _in_a_table(text):
    print_table(["it says"], [[text]], texts=["it says"])


def environment(**more):
    return os.environ | {"PYTHONPATH": str(ROOT)} | more


@pytest.mark.slow
def test_a_closed_pipe_does_not_end_a_run(tmp_path):
    process = subprocess.Popen(
        [*RUN, "-o", "a.h5"],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    assert process.stdout.readline()  # of its progress
    process.stdout.close()
    assert process.wait() == 0
    with SessionReader(tmp_path / "a.h5") as session:
        assert session.outcome.reason == "the drive of 8 um is complete"


@pytest.mark.parametrize(
    "put",
    [say, print_line, lambda text: print_rows("", [("a", "", text)]), _in_a_table],
)
def test_what_a_device_says_steers_no_terminal(capsys, put):
    put("SMC100: it answered \x1b[2J\x9b1;1H\x07")
    told = capsys.readouterr()
    assert r"it answered \x1b[2J\x9b1;1H\x07" in told.out + told.err


def test_the_answer_to_a_stop_steers_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr(urgent, "stop", lambda name: (["it answered \x1b[2J"], True))
    assert urgent.at_once(["stop"]) == 1
    assert capsys.readouterr().err == "slipscope: it answered \\x1b[2J\n"


@pytest.mark.slow
def test_a_name_that_can_not_be_printed_is_written_with_escapes(tmp_path):
    # bytes that are no text can be a name on Linux only
    name = f"ü$a^${os.fsdecode(bytes([255])) if sys.platform == 'linux' else ''}.h5"

    def call(*words):
        about = {"cwd": tmp_path, "env": environment(PYTHONIOENCODING="ascii")}
        return subprocess.run(words, capture_output=True, check=False, **about)

    done = call(*RUN, "--json", "-o", name)
    assert (done.returncode, done.stderr) == (0, b"")
    said = json.loads(done.stdout.decode("ascii"))
    assert said["session"] == name
    assert (tmp_path / name).with_suffix(".png").exists()
    told = call(sys.executable, "-m", "app", "info", name)
    assert (told.returncode, told.stderr) == (0, b"")
    assert rb"\xb1" in told.stdout  # the sign before an uncertainty


class Full(io.RawIOBase):
    """A disk without room."""

    def __init__(self, number):
        self.number = number

    def writable(self):
        return True

    def write(self, data):
        raise OSError(self.number, os.strerror(self.number))


@pytest.mark.parametrize(("number", "code"), [(errno.EPIPE, 0), (errno.ENOSPC, 1)])
def test_what_is_missing_in_a_file_is_told(monkeypatch, number, code):
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BufferedWriter(Full(number)), "utf-8"))
    told = io.StringIO()
    monkeypatch.setattr(sys, "stderr", told)

    def program():
        with steady_streams():
            print("results" * 10000)
            sys.exit(0)

    with pytest.raises(SystemExit) as ended:
        program()
    assert ended.value.code == code
    assert ("No space left" in told.getvalue()) == bool(code)


def test_a_run_that_was_reported_is_let_go(monkeypatch):
    class Source:
        has_ended = False

        def __init__(self, n):
            self.n = n

        def outcome(self):
            return "ended" if self.has_ended else None

        def wait(self, timeout=None):
            return self.outcome()

    monkeypatch.setattr(run_and_replay, "report_end", lambda one, _: {"run": one.source.n})
    made = [PreparedSource(Source(n)) for n in range(3)]
    runs, reports = [weakref.ref(one.source) for one in made], _Reports(made, as_json=True)
    for n in (0, 2):
        runs[n]().has_ended = True
    assert reports.of_all() == [{"run": 0}, {"run": 2}]
    gc.collect()
    assert [run() is None for run in runs] == [True, False, True]
    made[0].source.has_ended = True
    assert [report["run"] for report in reports.of_all()] == [0, 2, 1]


def test_a_terminal_that_fails_is_named_as_the_reason():
    class Source:
        stays, reasons = False, ()

        def start(self):
            raise ValueError("no such colour")

        def request_stop(self, reason):
            self.reasons = (*self.reasons, reason)

        def stop_motion(self):
            self.request_stop("STOP MOTION was pressed")
            return not_connected("the run has not begun")

        def look(self):
            return RunView(Health("idle", "", "", Counts(), 0, 4, 0, 0, 0))

        def wait(self, timeout):
            return None

    source = Source()
    with pytest.raises(ValueError, match="no such colour"):
        _follow(source, as_json=True, signals=[])
    assert source.reasons[0] == "the terminal failed (ValueError: no such colour)"


class Terminal(io.StringIO):
    """A terminal at which somebody types, line by line."""

    def __init__(self):
        super().__init__()
        self.lines, self.readers, self.most = queue.SimpleQueue(), 0, 0

    def isatty(self):
        return True

    def readline(self, *_):
        self.readers += 1
        self.most = max(self.most, self.readers)
        line = self.lines.get()
        self.readers -= 1
        return line


def test_a_question_that_was_answered_elsewhere_leaves_no_reader_behind(monkeypatch):
    class Source:
        def __init__(self):
            self.answers = []

        def answer(self, text, asked):
            assert asked == question
            self.answers.append(text)

    typed, source, typing = TypedLines(), Source(), Terminal()
    monkeypatch.setattr(sys, "stdin", typing)
    monkeypatch.setattr("app.cli.run_and_replay.TYPED", typed)
    operator = _Operator(source)

    def until(condition):
        give_up = time.monotonic() + 60
        while not condition():
            assert time.monotonic() < give_up
            operator.ask(question)
            time.sleep(0.001)

    question = "Is it dry?"
    until(lambda: typing.readers == 1)
    question = ""  # the window has answered it
    operator.ask(question)
    question = "Is it clean?"
    until(lambda: operator._asked == question)
    typing.lines.put("very\n")
    until(lambda: source.answers)
    assert source.answers == ["very"]  # once, and to the question that stood
    assert typing.most == 1

    question = "Is it warm?"
    until(lambda: typing.readers == 1)
    question = ""
    operator.ask(question)
    typing.lines.put("to nobody\n")
    until(lambda: typing.readers == 0 and typed._lines.empty())
    question = "Go on?"
    until(lambda: typing.readers == 1)
    assert source.answers == ["very"]
    typing.lines.put("\n")
    until(lambda: len(source.answers) == 2)
    assert source.answers == ["very", "yes"]
    assert typing.most == 1
