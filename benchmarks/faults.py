"""Faults of the disk at every operation. A session is recorded over an earlier one, a session that
was cut short is repaired over an earlier output, and images are imported over one: 20 small frames
with forces, results and events. With each write, sync, change of a name or of a size, and each
file made or removed, one thing goes wrong in turn: an error, a disk that is dead or full from there
on, a sync that fails and loses what it should have brought to the disk, a kill in the middle of it
or after it, and a power cut. Afterwards the earlier output is there as it was or the new one is
whole, everything that was recorded (before a power cut: that was synced) comes back to the bit, the
program has ended with a sentence, and nothing else is left of one that was not killed.

    python -m benchmarks faults [SCENARIO...] [--every K] [--faults "power cut" ...]

Linux, with a C compiler.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.report import ROOT, Report

sys.path += [str(ROOT / "tests"), str(ROOT / "tests/session")]

from faulty_disk import FAULTS, LIBRARY, build, environment, make_control

assert sys.platform != "win32", "it asks what a system of POSIX knows of a process"

SUBJECT = "Faults of the disk"
SCENARIOS = ("recording", "repair", "import")


@dataclass(frozen=True, slots=True)
class Case:
    """What came of one fault at one operation."""

    scenario: str
    fault: str
    at: int
    hit: str
    ended: str
    wrong: str
    seconds: float

    @property
    def verdict(self) -> str:
        """What is wrong with it; empty if nothing is."""
        killed = FAULTS[self.fault].kills and self.ended == f"signal {signal.SIGKILL}"
        if self.ended and not self.ended.startswith("refused: ") and not killed:
            return self.ended
        return self.wrong


def cases(folder: Path, scenario: str, faults: Sequence[str], first: int, step: int) -> list[Case]:
    """Every `step`-th operation of a scenario with each of the faults, in a program of its own; in
    a folder beside the library.
    """
    folder.mkdir()
    control = folder / "control"
    make_control(control)
    program = ROOT / "tests/session/faulted.py"
    command = [sys.executable, program, folder, scenario, str(first), str(step), *faults]
    paths = [ROOT, ROOT / "tests", ROOT / "tests/session"]
    own = {
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "SLIPSCOPE_HOME": str(folder / "case-state"),
        "OPENBLAS_NUM_THREADS": "1",
    }
    done = []
    with (
        (folder / "errors").open("w+") as errors,
        subprocess.Popen(
            command,
            env=os.environ | own | environment(folder.with_name(LIBRARY), control),
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        ) as running,
    ):
        for line in running.stdout or ():
            case = Case(scenario, **json.loads(line))
            done.append(case)
            if case.verdict:
                print(
                    f"{scenario}, {case.fault} at {case.at}, {case.hit}: {case.verdict}", flush=True
                )
    if running.returncode:
        told = (folder / "errors").read_text(encoding="utf-8")[-2000:]
        raise RuntimeError(f"{scenario}: exit code {running.returncode}: {told}")
    return done


def measure(
    report: Report,
    scenarios: Sequence[str] = SCENARIOS,
    *,
    every: int = 1,
    faults: Sequence[str] = tuple(FAULTS),
    workers: int = 2,
) -> int:
    """Go through all operations; 1 if a case went wrong."""
    asked = list(itertools.product(scenarios or SCENARIOS, range(workers)))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as threads:
        build(Path(folder))

        def run(scenario: str, part: int) -> list[Case]:
            own = Path(folder) / f"{scenario}-{part}"
            return cases(own, scenario, faults, part * every, every * workers)

        done = [case for part in threads.map(lambda one: run(*one), asked) for case in part]
    wrong = [case for case in done if case.verdict]
    report.add("cases", len(done))
    report.add("of them wrong", len(wrong), at_most=0)
    report.add("slowest", max((case.seconds for case in done), default=0.0), "s")
    report.table("Cases by fault")
    for (fault, scenario), number in Counter((c.fault, c.scenario) for c in done).items():
        report.add(fault, number, column=scenario)
    return int(bool(wrong) or not done)
