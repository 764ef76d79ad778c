"""The log: a file beside each recorded session, and the terminal with --verbose."""

import errno
import io
import json
import logging
import sys
import threading
from logging.handlers import QueueHandler
from pathlib import Path

import pytest
from python_program import python
from short_run import SHORT
from whole_runs import recorded

from app.acquisition.ending import Ending
from app.cli import app
from app.runs import live
from app.settings import config
from app.system import logs

QUICK = (*SHORT, "stress.method=none", "run.travel=4")


def log_files():
    """What the program logs to at this moment."""
    return [h for h in logging.getLogger("app").handlers if isinstance(h, QueueHandler)]


def test_the_log_beside_a_session_tells_what_the_run_did(tmp_path):
    session = tmp_path / "sample7.h5"
    outcome = recorded(session, *QUICK, "sim.faults=['lost-trigger 9']")
    log = (tmp_path / "sample7.h5.log").read_text(encoding="utf-8")
    for phase in ("background", "contact", "reference", "drive", "end"):
        assert f": phase: {phase} (sample " in log
    assert "simulated forces: two sensors at 1000 Hz" in log
    assert ": trigger 9 has no image: " in log
    assert f": done; triggers {outcome.counts.triggers}; frames received " in log
    assert outcome.reason in log
    assert "read back as they were written" in log
    assert log.count("\n") < 60, "one line per thing that happened, none per frame"
    assert not log_files(), "the file is let go of when the run has ended"


def test_an_exception_that_ends_a_run_is_in_the_log_with_its_traceback(tmp_path):
    session = tmp_path / "failed.h5"
    run = live.make_run(config.load(None, list(QUICK)), session, pace=None)
    run._experiment.advance = lambda now: 1 / 0
    run.start()
    assert run.wait(400).state == "failed"
    log = (tmp_path / "failed.h5.log").read_text(encoding="utf-8")
    assert "Traceback" in log
    assert "ZeroDivisionError" in log


def test_a_log_that_can_not_be_written_changes_nothing(tmp_path):
    (tmp_path / "x.h5.log").mkdir()
    with logs.beside(tmp_path / "x.h5"):
        logging.getLogger("app.test").warning("nobody reads this")
    assert not log_files()


class StandingDisk(logs._Lines):
    """A log file on a disk that takes nothing until `goes_on` is set."""

    goes_on = threading.Event()

    def write(self, record):
        assert self.goes_on.wait(60)
        super().write(record)


def test_a_stop_waits_for_no_disk_that_stands_still(tmp_path, monkeypatch):
    monkeypatch.setattr(logs, "_Lines", StandingDisk)
    stopped = threading.Event()
    ending = Ending(stopped.set)
    with logs.beside(tmp_path / "x.h5"):
        threading.Thread(
            target=ending.call, args=("P is too large",), kwargs={"failed": True}
        ).start()
        was_stopped = stopped.wait(10)
        StandingDisk.goes_on.set()
    assert was_stopped
    log = (tmp_path / "x.h5.log").read_text(encoding="utf-8")
    assert "ERROR" in log
    assert "P is too large" in log, "it is written as soon as the disk goes on"


def test_a_log_that_fills_the_disk_is_given_up(tmp_path, monkeypatch):
    class FullDisk(io.StringIO):
        def write(self, text):
            tried.append(text.rpartition(": ")[2])
            raise OSError(errno.ENOSPC, "No space left on device")

    tried = []
    monkeypatch.setattr(Path, "open", lambda *_, **__: FullDisk())
    with logs.beside(tmp_path / "x.h5"):
        for n in range(3):
            logging.getLogger("app.test").warning("line %d", n)
    assert tried == ["line 0\n"]


STANDS = """
import logging, os, sys
from pathlib import Path
from app.system import logs
logs.WRITES_S = 0.3
session = Path(sys.argv[1])
os.mkfifo(f"{session}.log")
os.open(f"{session}.log", os.O_RDONLY | os.O_NONBLOCK)  # which never reads
with logs.beside(session):
    for n in range(100):
        logging.getLogger("app.test").warning("x" * 10_000)
print("done")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="pipes with a name")
def test_a_log_on_a_disk_that_never_comes_back_does_not_keep_the_program(tmp_path):
    done = python("-c", STANDS, tmp_path / "x.h5", timeout=60)
    assert (done.returncode, done.stdout) == (0, "done\n")
    assert done.stderr == (
        f"slipscope: {tmp_path / 'x.h5.log'}: the log is incomplete, because its disk had not"
        " taken all lines after 0.3 s\n"
    )


def test_verbose_shows_the_log_on_standard_error_and_nothing_else_changes(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    overrides = [part for setting in QUICK for part in ("--set", setting)]
    run = ["run", "--headless", "--pace", "max", "--json", "-o", "a.h5", *overrides]
    with pytest.raises(SystemExit) as ended:
        app(["--verbose", *run])
    (shown,) = log_files()
    shown.close()
    out, error = capsys.readouterr()
    assert not ended.value.code, error
    assert json.loads(out)["state"] == "done"
    assert "INFO" in error
    assert ": phase: drive (sample " in error
