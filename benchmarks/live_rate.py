"""How fast the live chain is on a recorded camera, headless: a recorded experiment is played faster
than it was, recorded again and analysed live, in the processes of `slipscope run`.

    python -m benchmarks live_rate [--seconds 20] [--burners 0] [--set key=value]...

1600 x 1200, 60/s     with step 10 on all cores of the machine
2448 x 2048, 24/s     5 megapixels, step 10
--burners N           so many processes that use all the processor they get, for the same rates and
                      with dic.quality = "auto"
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from app import config
from app.processes.client import LaunchedRun
from app.records import Phase
from app.session.reader import SessionReader
from benchmarks.report import Report
from benchmarks.simulated import account, experiment

SUBJECT = "Rate of the live chain"
DIVISOR = 42
SIZES = {"1600 x 1200, 60/s": (1600, 1200, 60.0), "2448 x 2048, 24/s": (2448, 2048, 24.0)}


@contextmanager
def burning(n: int) -> Iterator[None]:
    """So many other processes that use the processor."""
    command = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(command) for _ in range(n)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def recorded(folder: Path, width: int, height: int, seconds: float) -> Path:
    """A session of the simulated bench, as fast as the machine makes it."""
    path = folder / f"{width}.h5"
    settings = [
        f"camera.width={width}",
        f"camera.height={height}",
        f"camera.divisor={DIVISOR}",
        f"run.travel={5 * seconds:g}",
        "recording.results=forces",
    ]
    outcome = experiment(path, settings, pace=None).outcome()
    assert outcome.state == "done", outcome.reason
    return path


def measure(
    report: Report, *, seconds: float = 20.0, burners: int = 0, set_: Sequence[str] = ()
) -> None:
    """Play each size at its rate."""
    for name, (width, height, rate) in SIZES.items():
        pace = rate * DIVISOR / 1000
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            source = recorded(folder, width, height, seconds * pace)
            sources = [f"{table}.source=replay" for table in ("forces", "camera", "actuator")]
            with SessionReader(source) as session:
                held = config.from_record(session.header.config_toml, str(source))
            settings = config.load(
                None,
                [
                    *(
                        f"camera.{side}={getattr(held.camera, side)}"
                        for side in ("width", "height")
                    ),
                    f"camera.divisor={DIVISOR}",
                    f"run.travel={5 * seconds * pace:g}",
                    *sources,
                    # the reference takes a second, which is more by the clock of the recording
                    "limits.age=10",
                    f"replay.session='{source.as_posix()}'",
                    *(["dic.quality=auto"] if burners else []),
                    *set_,
                ],
            )
            output = folder / "live.h5"
            with burning(burners):
                run = LaunchedRun(settings, output, pace=pace, overwrite=False)
                run.start()
                outcome = run.wait()
            assert outcome is not None
            report.table(f"{name}, {os.cpu_count()} cores, {burners} burners")
            account(report, outcome, {"frames lost": 0, "frames not analysed live": 0})
            report_frames(report, output, rate)


def report_frames(report: Report, path: Path, rate: float) -> None:
    """How late the results of a session were, and what was left out."""
    with SessionReader(path) as session:
        results = session.results()
    driven = results[results["phase"] == str(Phase.DRIVE)]
    late = driven["waited_s"] + driven["took_s"]
    report.add("analysis of a frame, median", 1e3 * np.median(driven["took_s"]), "ms", 1e3 / rate)
    report.add("from its arrival to its result, median", 1e3 * np.median(late), "ms")
    report.add("from its arrival to its result, 99 %", 1e3 * np.percentile(late, 99), "ms", 250)
    report.add("from its arrival to its result, longest", 1e3 * late.max(), "ms")
    for step in range(1, 5):
        share = 100 * np.mean(driven["shed"] == step)
        if share:
            report.add(f"frames of which {step} steps were left out", share, "%")
