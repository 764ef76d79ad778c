"""A campaign that is killed at any moment, or interrupted, goes on where it was: in the end every
run is done and nothing that was there has been written to.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from processes.launched import kill, wait_until
from small_campaign import SESSIONS, TWO_LOADS, Command, Write, sessions_in

from app.processes.folder import running
from app.session.repair import repair, whole

ROOT = Path(__file__).parents[2]
LOADS = ("vary.run.normal_force = [0.03, 0.04, 0.05]", 'sessions = "{name}-{load}N"'), TWO_LOADS
NAMES = ["tiny-0.03N", "tiny-0.04N", "tiny-0.05N"]
JOURNAL = (".h5.journal", ".h5.images", ".h5.results")


def started(
    folder: Path, file: Path, *options: str, pace: str = "max", shows: bool = False
) -> subprocess.Popen[str]:
    """`slipscope campaign` in a process of its own, with a window if it `shows` one."""
    command = [sys.executable, "-m", "app", "campaign", str(file), "--pace", pace, *options]
    return subprocess.Popen(
        command if shows else [*command, "--headless"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "QT_QPA_PLATFORM": "offscreen"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finished(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, error = process.communicate()
    return process.returncode, out, error


def marks(folder: Path) -> dict[tuple[int, int], Any]:
    """What tells each session and recording from any other, and from itself once it is written
    to; wherever it lies.
    """
    files = [p for p in folder.rglob("*") if p.name.endswith((".h5", *JOURNAL))]
    return {
        (p.stat().st_dev, p.stat().st_ino): (p.stat().st_size, p.stat().st_mtime_ns) for p in files
    }


def is_any(folder: Path, *endings: str) -> bool:
    return any(path.name.endswith(endings) for path in folder.glob("*"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "kills"), [(0, 1), *(pytest.param(n, 4, marks=pytest.mark.long) for n in range(1, 4))]
)
def test_kills_at_any_moment_cost_one_run_each_and_overwrite_nothing(
    campaign: Command, tmp_path: Path, write: Write, seed: int, kills: int
) -> None:
    rng, folder = random.Random(seed), tmp_path / "tiny"
    file, names = write(*LOADS[kills < 4]), NAMES[: min(kills + 1, 3)]
    complete: dict[Path, Any] = {}
    for _ in range(kills):
        process = started(tmp_path, file)
        # at any moment of a run, or of what comes between two of them
        wait_until(lambda p=process: is_any(folder, *JOURNAL) or p.poll() is not None, "a run")
        time.sleep(rng.uniform(0.0, 1.5))
        process.kill()
        process.communicate()
        for path, mark in complete.items():
            assert (path.stat().st_ino, path.stat().st_mtime_ns) == mark
        for path in folder.glob("*.h5"):
            if whole(path) and not is_any(folder, f"{path.name}.images"):
                complete.setdefault(path, (path.stat().st_ino, path.stat().st_mtime_ns))
    left = marks(folder)
    result = campaign(file)
    assert result.exit_code == 0, result.stderr
    assert f"{len(names)} of {len(names)} runs done" in result.stdout
    assert sorted(path.stem for path in folder.glob("*.h5")) == names
    assert not is_any(folder, *JOURNAL)
    for path in folder.glob("*.h5"):
        assert whole(path)
        if path in complete:
            assert (path.stat().st_ino, path.stat().st_mtime_ns) == complete[path]
    # all that a kill has left is there still, as it was
    now = marks(folder)
    kept = {place: mark for place, mark in left.items() if place in now}
    assert kept == {place: now[place] for place in kept}
    gone = len(left) - len(kept)
    assert gone <= 2  # journal and results of a session that was complete
    for journal in (folder / "kept").glob("*.journal"):
        session = journal.with_suffix("")
        if journal.stat().st_size > 2000:  # it was killed after its header
            repaired = repair(session, tmp_path / f"{session.stem}-repaired.h5")
            assert repaired.found.is_whole


def test_ctrl_c_stops_the_run_in_good_order_and_the_same_command_goes_on(
    campaign: Command, tmp_path: Path, write: Write
) -> None:
    file, folder = write(*TWO_LOADS, "settings.run.travel = 60"), tmp_path / "tiny"
    file.write_text(file.read_text().replace("settings.run.travel = 8\n", ""))
    process = started(tmp_path, file, "--json")
    wait_until(lambda: is_any(folder, ".h5.images"), "a run")
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    code, _, error = finished(process)
    assert code == 1
    assert "tiny-0.03N: Ctrl-C was pressed; the same command goes on with this run" in error
    assert [path.stem for path in folder.glob("*.h5")] == NAMES[:1]
    assert whole(folder / "tiny-0.03N.h5")
    assert campaign(file, "--only", "1").exit_code == 0
    assert sessions_in(folder) == SESSIONS[:1]
    assert [path.name for path in (folder / "kept").glob("*.h5")] == ["tiny-0.03N.h5"]


@pytest.mark.slow
def test_a_run_that_outlives_its_campaign_is_followed_to_its_end(
    tmp_path: Path, write: Write
) -> None:
    """At the pace of a bench the run has processes of its own, which a kill does not reach."""
    file, folder = write(*TWO_LOADS, "pauses = true", "settings.limits.age = 10"), tmp_path / "tiny"
    process = started(tmp_path, file, "--only", "1", pace="1")
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()
    wait_until(lambda: is_any(folder, ".h5.images"), "a run")
    process.kill()
    process.communicate()
    session = str((folder / "tiny-0.03N.h5").resolve())
    bench = next(bench for bench in running() if bench.session == session)
    try:
        code, out, error = finished(started(tmp_path, file, "--only", "1", pace="1"))
    finally:
        kill(bench.pid)
    assert code == 0, error  # nobody was asked, who would not have answered
    assert "1 of 2 runs done" in out
    assert not (folder / "kept").exists()
    assert whole(Path(session))


@pytest.mark.slow
def test_each_run_has_its_window_which_closes_for_the_next(tmp_path: Path, write: Write) -> None:
    pytest.importorskip("PySide6.QtWidgets", exc_type=ImportError)  # a minimal Linux
    file = write(*TWO_LOADS)
    code, out, error = finished(started(tmp_path, file, shows=True))
    assert code == 0, error
    assert "going on without a window" not in error
    assert "2 of 2 runs done" in out
    assert sorted(path.stem for path in (tmp_path / "tiny").glob("*.png")) == NAMES[:2]
