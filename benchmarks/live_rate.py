"""How fast the live chain is on a recorded camera, headless: a recorded experiment is played at its
own rate, recorded again and analysed live, in the processes of `slipscope run`.

    python -m benchmarks live_rate [--seconds 20]

1600 x 1200, 62.5/s   with step 10 on all cores of the machine
2448 x 2048, 24.4/s   5 megapixels, step 10
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from app.processes.client import LaunchedRun
from app.records.record_types import Phase
from app.session.reader import SessionReader
from app.settings import config
from benchmarks.report import Report
from benchmarks.simulated import account, experiment

SUBJECT = "Rate of the live chain"
SIZES = {"1600 x 1200, 62.5/s": (1600, 1200, 16), "2448 x 2048, 24.4/s": (2448, 2048, 41)}


def camera_of(width: int, height: int, divisor: int) -> list[str]:
    """Settings of a camera that can do that."""
    numbers = {"width": width, "height": height, "divisor": divisor, "max_rate": 100, "exposure": 5}
    return [f"camera.{name}={value}" for name, value in numbers.items()]


def measure(report: Report, *, seconds: float = 20.0) -> None:
    """Play each size at its rate."""
    for name, (width, height, divisor) in SIZES.items():
        both = [*camera_of(width, height, divisor), f"run.travel={5 * seconds:g}"]
        with tempfile.TemporaryDirectory() as made:
            source, output = Path(made) / "source.h5", Path(made) / "live.h5"
            quick = experiment(source, [*both, "recording.results=forces"], pace=None).outcome()
            assert quick.state == "done", quick.reason
            sources = [f"{table}.source=replay" for table in ("forces", "camera", "actuator")]
            played = [*both, *sources, f"replay.session='{source.as_posix()}'"]
            run = LaunchedRun(config.load(None, played), output, pace=1.0, overwrite=False)
            run.start()
            outcome = run.wait()
            assert outcome is not None
            report.table(f"{name}, {os.cpu_count()} cores")
            account(report, outcome, {"frames lost": 0, "frames not analysed live": 0})
            report_frames(report, output, 1000 / divisor)


def report_frames(report: Report, path: Path, rate: float) -> None:
    """How late the results of a session were."""
    with SessionReader(path) as session:
        results = session.results()
    at_rest = results[results["phase"] == str(Phase.REFERENCE)]
    report.add("taking the reference", at_rest["took_s"].max(), "s")
    driven = results[results["phase"] == str(Phase.DRIVE)]
    late = driven["waited_s"] + driven["took_s"]
    report.add("analysis of a frame, median", 1e3 * np.median(driven["took_s"]), "ms", 1e3 / rate)
    report.add("from its arrival to its result, median", 1e3 * np.median(late), "ms")
    report.add("from its arrival to its result, 99 %", 1e3 * np.percentile(late, 99), "ms", 250)
    report.add("from its arrival to its result, longest", 1e3 * late.max(), "ms")
