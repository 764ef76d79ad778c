"""Whatever the disk does, and whenever: nothing earlier is lost, nothing is altered, and a program
ends with a sentence.
"""

from __future__ import annotations

import re
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from faulty_disk import COMPILER, FAULTS, FaultyDisk, build, environment, make_control
from killed_recorder import Recording
from python_program import python

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="loads a library first"),
    pytest.mark.skipif(COMPILER is None, reason="there is no C compiler"),
]

OFFLINE = """
import sys
from pathlib import Path
from app.system.errors import UserError
from app.records.record_types import Event
from app.session.files import new_session
from app.session.writer import SessionWriter
from session_material import make_header
try:
    with new_session(Path(sys.argv[1]), False) as path:
        writer = SessionWriter.create(path, make_header())
        try:
            writer.append(Event(0, "phase", "one"))
            writer.close()
        except BaseException:
            writer.discard()
            raise
except UserError as error:
    print(error)
"""
WRITES = """
import os, sys
for name in ("kept", "torn"):
    with open(name, "wb", buffering=0) as file:
        file.write(b"a" * 5000)
        os.fsync(file.fileno())
        file.write(b"b" * 5000)
os.rename("torn", "kept")
"""


@pytest.mark.slow
def test_some_operations_of_each_scenario() -> None:
    """Of `benchmarks/faults.py`, which goes through all of them."""
    words = ["recording", "repair", "--every", "1000", "--workers", "1"]
    done = python("-m", "benchmarks", "faults", *words, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"of them wrong +0 ", done.stdout)
    for scenario, fault in product(("recording", "repair"), FAULTS):
        assert re.search(rf"^ +{fault}, {scenario} +[1-9]", done.stdout, re.MULTILINE)


def test_a_slow_disk_holds_nothing_back_from_a_kill(tmp_path: Path) -> None:
    """Where no sync comes to an end any more."""
    make_control(tmp_path / "control")
    disk = FaultyDisk(tmp_path / "control", str(tmp_path / "case"))
    disk.arm(FAULTS["error"], 0)
    (tmp_path / "case").mkdir()
    slow = environment(build(tmp_path), tmp_path / "control")
    with Recording(tmp_path / "case/killed.h5", 50.0, (64, 96), slow) as recording:
        recording.wait_until_sent(1)
        disk.arm(FAULTS["error"], 0, delay_s=1000.0)
        sent = len(recording.sent) + 50  # more than a second, in which each file would be synced
        recording.wait_until_sent(sent)
        recording.wait_until_held(sent)
        kill = recording.kill()
    assert min(kill.lost + kill.forces_lost, default=sent) >= sent


def test_a_write_that_hdf5_was_not_told_of_is_the_reason_that_is_given(tmp_path: Path) -> None:
    """HDF5 reads back what is not there, and says that a filter has failed."""
    make_control(tmp_path / "control")
    FaultyDisk(tmp_path / "control", str(tmp_path / "case")).arm(FAULTS["error"], 4)
    (tmp_path / "case").mkdir()
    faulty = environment(build(tmp_path), tmp_path / "control")
    done = python("-c", OFFLINE, tmp_path / "case/made.h5", environment=faulty)
    assert re.search(r"made\.h5: it cannot be written: Input/output error", done.stdout)
    assert list((tmp_path / "case").iterdir()) == []


def run(folder: Path, fault: str, at: int) -> tuple[int, FaultyDisk]:
    """The exit code of a small program that writes to such a disk."""
    (folder / "case").mkdir(parents=True)
    control = folder / "control"
    make_control(control)
    disk = FaultyDisk(control, str(folder / "case"))
    disk.arm(FAULTS[fault], at)
    faulty = environment(build(folder), control)
    done = python("-c", WRITES, cwd=folder / "case", environment=faulty)
    return done.returncode, disk


def test_the_disk_fails_where_it_is_told_to(tmp_path: Path) -> None:
    code, disk = run(tmp_path / "0", "error", 0)
    assert (code, disk.count, disk.hit) == (0, 9, "")
    code, disk = run(tmp_path / "1", "error", 2)
    assert code == 1
    assert disk.hit.startswith("write ")
    assert (tmp_path / "1/case/kept").read_bytes() == b""
    assert run(tmp_path / "2", "killed in it", 4)[0] == -9
    assert (tmp_path / "2/case/kept").read_bytes() == b"a" * 5000 + b"b" * 2500


@pytest.mark.parametrize("seed", range(4))
def test_a_power_cut_takes_what_was_not_synced_and_nothing_else(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    code, disk = run(tmp_path, "power cut", 9)  # the rename
    disk.lose(rng, tmp_path / "case")
    kept = (tmp_path / "case/kept").read_bytes()
    assert code == -9
    assert kept[:5000] == b"a" * 5000
    assert kept[5000:].strip(b"b\0") == b""
    if (tmp_path / "case/torn").exists():
        assert (tmp_path / "case/torn").read_bytes()[:5000] == b"a" * 5000


def test_what_a_failed_sync_has_lost_is_seen_past_the_cache(tmp_path: Path) -> None:
    code, disk = run(tmp_path, "lost by a failed sync", 1)
    assert code == 1
    assert (tmp_path / "case/kept").read_bytes() == b"a" * 5000
    disk.lose_failed(tmp_path / "case")
    assert (tmp_path / "case/kept").read_bytes() == bytes(5000)
