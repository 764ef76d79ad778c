"""Who gives way to whom, also for an ordinary user and in a program that was started with a
niceness of its own.
"""

import os
import sys

import pytest
from python_program import python

# an ordinary user cannot lower a niceness again, the administrator can
PROGRAM = """
import os, threading
from app.system.priority import give_way

if os.getuid() == 0:
    os.setuid(65534)
os.nice({start})
found = []

def look(niceness):
    give_way(niceness)
    found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
    deeper = threading.Thread(target=lambda: found.append(os.nice(0)))
    deeper.start()
    deeper.join()

for niceness in {asked}:
    thread = threading.Thread(target=look, args=(niceness,))
    thread.start()
    thread.join()
print(found, os.nice(0))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a niceness for each thread")
@pytest.mark.parametrize("start", [0, 10, 19])
def test_threads_give_way_to_the_program_as_it_was_started(start):
    said = python("-c", PROGRAM.format(start=start, asked=(3, 5, 10)))
    began = min(19, os.nice(0) + start)
    twice = [min(19, began + n) for n in (3, 5, 10) for _ in range(2)]
    assert said.stdout.strip() == f"{twice} {began}"


@pytest.mark.skipif(sys.platform != "linux", reason="a niceness for each thread")
def test_a_process_that_is_started_by_who_gives_way_does_not_give_way_twice():
    asked = """
import os, subprocess, sys, threading
child = "import os; from app.system.priority import give_way; give_way(10, to=os.getppid())"
child += "; print(os.nice(0))"
def start():
    from app.system.priority import give_way
    give_way(10)
    subprocess.run([sys.executable, "-c", child], check=True)
thread = threading.Thread(target=start)
thread.start()
thread.join()
"""
    said = python("-c", asked)
    assert int(said.stdout) == min(19, os.nice(0) + 10)


def test_what_the_system_forbids_is_left(monkeypatch):
    from app.system import priority

    def forbidden(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "setpriority", forbidden, raising=False)
    priority.give_way(3)
