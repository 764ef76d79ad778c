"""The folders of benches: what a dead one has left stays as long as somebody may ask for it."""

import os
import subprocess
import sys
import time

import pytest

from app.processes import folder as folders
from app.processes.folder import ANSWER, KEPT_S, RunningBench, new_folder, publish, tell, told
from app.stopping import sent_from_outside


@pytest.fixture
def dead(tmp_path, monkeypatch):
    """Makes the folder of a bench that has died, with the number of its supervisor."""
    monkeypatch.setattr(folders, "MEMORY", tmp_path)

    def make(supervisor):
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        folder = new_folder()
        bench = RunningBench(folder.name, "a", "a.h5", "", "", ended.pid, 1.0, 0, supervisor)
        publish(folder, bench)
        return folder

    return make


def age(folder, seconds):
    then = time.time() - seconds
    os.utime(folder, (then, then))


def test_a_supervisor_that_is_still_there_can_answer_however_many_runs_begin(dead):
    folder = dead(os.getpid())
    age(folder, 10 * KEPT_S)  # the bench ran for long
    new_folder()
    tell(folder / ANSWER, sent_from_outside())
    new_folder()
    assert told(folder.name) == sent_from_outside()


def test_an_answer_stays_for_those_who_ask_for_it_and_not_for_ever(dead):
    folder = dead(0)
    tell(folder / ANSWER, sent_from_outside())
    new_folder()
    assert told(folder.name) == sent_from_outside()
    age(folder, KEPT_S + 1)
    new_folder()
    assert not folder.exists()
