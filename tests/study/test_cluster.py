"""Sessions analysed on a Dask cluster of two workers: the same to the bit, also when one of them is
killed.
"""

import os
import signal
import threading
import time

import pytest
from study_plans import asked

from app.study import cluster, worker
from app.study.analysis_plan import RECORDED, plan_analysis, programs
from app.study.analyzing import AnalysisFailed, analyze
from app.study.worker import Failed
from app.system.errors import UserError

PATIENCE_S = 240.0


@pytest.fixture(scope="module")
def workers():
    """Two processes on this computer."""
    from dask import config  # a quarter of a second, which collecting has no need of
    from distributed import LocalCluster

    with (
        config.set({"distributed.worker.profile.enabled": False}),
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=100,
        ) as held,
    ):
        yield held


def test_a_session_whose_worker_is_lost_goes_to_another(
    workers, sessions, results, tmp_path, monkeypatch
):
    here, there = (asked(sessions[:1], tmp_path / f"{name}.h5") for name in ("here", "there"))
    killed = []

    def kill_who_works():
        until = time.monotonic() + PATIENCE_S
        while not killed and time.monotonic() < until:
            for state in list(workers.scheduler.workers.values()):
                if state.processing and state.pid not in killed:
                    os.kill(workers.workers[state.name].pid, signal.SIGKILL)
                    killed.append(state.pid)
                    return
            time.sleep(0.05)

    thread = threading.Thread(target=kill_who_works)
    thread.start()
    told = []
    analyze(
        there,
        scheduler=workers.scheduler_address,
        on_progress=lambda text, share: told.append(text),
    )
    thread.join()
    assert killed
    assert told[-1] == "1 of 1 session"
    monkeypatch.setattr(worker, "run_result", lambda *_: results.runs[0])
    analyze(here, jobs=1)
    assert there.output.read_bytes() == here.output.read_bytes()


def test_a_session_that_no_worker_sees_is_a_sentence(workers, sessions, tmp_path, monkeypatch):
    plan = plan_analysis(sessions[:1], tmp_path / "unseen.h5", preset=RECORDED)
    import shutil
    from dataclasses import replace

    gone = shutil.copy(sessions[0], tmp_path / "gone.h5")
    tasks = (replace(plan.tasks[0], session=str(gone)),)
    os.remove(gone)
    with pytest.raises(AnalysisFailed, match=r"worker .*: it sees no .*gone.h5; share that folder"):
        analyze(replace(plan, tasks=tasks), scheduler=workers.scheduler_address)


def test_a_worker_with_other_versions_is_a_sentence(sessions, tmp_path):
    plan = plan_analysis(sessions[:1], tmp_path / "old.h5", preset=RECORDED)
    found = cluster.part_of(plan.tasks[0], programs() | {"numpy": "1.0"})
    assert isinstance(found, Failed)
    assert "it has another numpy" in found.sentence


def test_no_client_is_made_of_what_is_no_address(sessions, tmp_path, monkeypatch):
    monkeypatch.setattr("distributed.Client", None)  # which would end in a traceback after 10 s
    plan = plan_analysis(sessions[:1], tmp_path / "none.h5", preset=RECORDED)
    for address in ("nowhere", "tcp://nowhere", "http://127.0.0.1:9"):
        with pytest.raises(UserError, match="check the address"):
            analyze(plan, scheduler=address)


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_a_sentence_within_seconds(
    sessions, tmp_path, monkeypatch
):
    monkeypatch.setattr(cluster, "PATIENCE_S", 1.0)
    plan = plan_analysis(sessions[:1], tmp_path / "none.h5", preset=RECORDED)
    began = time.monotonic()
    with pytest.raises(UserError, match="no scheduler answers there within 1 s"):
        analyze(plan, scheduler="tcp://127.0.0.1:9")
    assert time.monotonic() - began < 60
