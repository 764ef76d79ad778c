"""Sessions analysed on this computer, several at a time, each in a process of its own."""

from __future__ import annotations

import pickle
import queue
import subprocess
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from app.processes.starting import start_process, wait_until_ready
from app.study.analysis_plan import Task
from app.study.parts import Parts
from app.study.worker import Failed, analysed
from app.system.progress import ShareDone

POLL_S = 0.5
TRIES = 2  # attempts at a session whose process died


class TaskReport(NamedTuple):
    """What is heard of a session: the share that is done, why it failed, or None at its end."""

    task: Task
    what: float | Failed | None


def results_of(tasks: Sequence[Task], parts: Parts, jobs: int) -> Iterator[TaskReport]:
    """Analyse sessions into their parts, `jobs` at a time; a single job in a thread of this
    process.
    """
    jobs = max(1, min(jobs, len(tasks)))
    reports: queue.SimpleQueue[TaskReport | BaseException] = queue.SimpleQueue()
    workers = [_Worker() for _ in range(jobs)] if jobs > 1 else []
    idle: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)
    is_over = threading.Event()

    def work(task: Task) -> None:
        def tell(share: float) -> None:
            if is_over.is_set():
                raise KeyboardInterrupt
            reports.put(TaskReport(task, share))

        try:
            if workers:
                worker = idle.get()
                failed = worker.analysed(task, parts.place(task), tell)
                idle.put(worker)
            else:
                failed = analysed(task, parts.place(task), tell, threads=None)
            reports.put(TaskReport(task, failed))
        except BaseException as error:
            reports.put(error)

    pool = ThreadPoolExecutor(jobs, "slipscope-analyze")
    try:
        for task in tasks:
            pool.submit(work, task)
        count = len(tasks)
        while count:
            try:
                one = reports.get(timeout=POLL_S)  # Ctrl-C is seen in between, on every system
            except queue.Empty:
                continue
            if isinstance(one, BaseException):
                raise one
            count -= not isinstance(one.what, float)
            yield one
    finally:
        is_over.set()
        for worker in workers:
            worker.end()
        pool.shutdown(cancel_futures=True)
        for worker in workers:
            worker.end()  # one that was begun meanwhile


class _Worker:
    """A process that analyses one session after the other; it begins with the first."""

    def __init__(self) -> None:
        self._is_over = False
        self._process: subprocess.Popen[bytes] | None = None

    def analysed(self, task: Task, place: Path, on_progress: ShareDone) -> Failed | None:
        """Analyse a session into a part, in a new process if one dies; why it could not be."""
        code = 0
        for _ in range(TRIES):
            if self._is_over:
                break
            if self._process is None:
                self._process = start_process("app.study.worker", None)
                wait_until_ready(self._process)
            process: Any = self._process
            try:
                pickle.dump((task, place), process.stdin)
                process.stdin.flush()
                while isinstance(what := pickle.load(process.stdout), float):
                    on_progress(what)
            except (EOFError, OSError, pickle.UnpicklingError):
                code = process.wait()
                self._let_go()
            else:
                return what  # type: ignore[no-any-return]
        return Failed(
            f"{task.session}: its process ended with code {code}, as for want of memory; give"
            " fewer --jobs"
        )

    def end(self) -> None:
        """End the process, whatever it does, and begin no other."""
        self._is_over = True
        self._let_go()

    def _let_go(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(OSError, ValueError):
                process.communicate()
