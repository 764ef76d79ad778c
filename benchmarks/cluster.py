"""Sessions of full resolution analysed on a Dask cluster of this computer: the time of a session,
the bytes that come back, and whether they are those of one process.

    python -m benchmarks cluster FOLDER [--workers 2] [--preset finest]

FOLDER holds the sessions, as `python -m benchmarks analyze --keep FOLDER` makes them.
"""

from __future__ import annotations

import logging
import tempfile
import time
from pathlib import Path

from app.session.reader import SessionReader
from app.study.analysis_plan import plan_analysis, programs
from app.study.analyzing import analyze
from app.study.cluster import part_of
from benchmarks.report import Report

SUBJECT = "Analysis on a cluster"


def measure(report: Report, folder: Path, *, workers: int = 2, preset: str = "finest") -> int:
    """Analyse on the cluster and in one process."""
    from distributed import LocalCluster

    sessions = sorted(folder.glob("load-*.h5"))
    with tempfile.TemporaryDirectory() as temporary:
        there, here = (
            plan_analysis(sessions, Path(temporary) / name, preset=preset)
            for name in ("there.h5", "here.h5")
        )
        began, used = time.monotonic(), time.process_time()
        part = part_of(here.tasks[0], programs())
        assert isinstance(part, bytes)
        report.table("One session, in one process")
        with SessionReader(sessions[0]) as session:
            report.add("images", len(session.triggers()), "")
        report.add("read", sessions[0].stat().st_size / 1e6, "MB")
        report.add("comes back", len(part) / 1e6, "MB")
        report.add("time", time.monotonic() - began, "s")
        report.add("processor time", time.process_time() - used, "s")
        with LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster:
            began = time.monotonic()
            analyze(there, scheduler=cluster.scheduler_address)
            spent = time.monotonic() - began
        analyze(here, jobs=1)
        is_same = there.output.read_bytes() == here.output.read_bytes()
        report.table(f"{len(sessions)} sessions, {workers} workers")
        report.add("time", spent, "s")
        report.add("time of a session and worker", spent * workers / len(sessions), "s")
        report.add("file of results", there.output.stat().st_size / 1e6, "MB")
        report.add("the same bytes as of one process", str(is_same), "")
    return 0 if is_same else 1
