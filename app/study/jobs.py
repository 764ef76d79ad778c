"""Sessions analysed on this computer, several at a time, each in a process of its own."""

from __future__ import annotations

import pickle
import queue
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, BinaryIO, NamedTuple, cast

from app.processes.starting import start_process, wait_until_ready
from app.study.analysis_plan import Task
from app.study.parts import Parts
from app.study.worker import DONE, Failed, analysed

POLL_S = 0.5
TRIES = 2  # of a session whose process died


class Told(NamedTuple):
    """What is heard of a session: the share that is done, `DONE`, or `Failed`."""

    task: Task
    what: float | str | Failed


def results_of(tasks: Sequence[Task], parts: Parts, jobs: int) -> Iterator[Told]:
    """Analyse sessions into their parts, `jobs` at a time."""
    if min(jobs, len(tasks)) > 1:
        return _beside(tasks, parts, min(jobs, len(tasks)))
    return _here(tasks, parts)


def _here(tasks: Sequence[Task], parts: Parts) -> Iterator[Told]:
    """One after the other, in a thread of this process, so that progress can be told."""
    told: queue.SimpleQueue[Told | BaseException] = queue.SimpleQueue()
    is_over = threading.Event()

    def work() -> None:
        for task in tasks:

            def tell(share: float, task: Task = task) -> None:
                if is_over.is_set():
                    raise KeyboardInterrupt
                told.put(Told(task, share))

            try:
                failed = analysed(task, parts.place(task), tell, threads=None)
            except BaseException as error:
                told.put(error)
                return
            told.put(Told(task, failed or DONE))

    thread = threading.Thread(target=work, name="slipscope-analyze", daemon=True)
    thread.start()
    try:
        yield from _until_all_are_done(len(tasks), told)
    finally:
        is_over.set()
        thread.join()


def _beside(tasks: Sequence[Task], parts: Parts, jobs: int) -> Iterator[Told]:
    waiting: queue.SimpleQueue[Task] = queue.SimpleQueue()
    for task in tasks:
        waiting.put(task)
    told: queue.SimpleQueue[Told | BaseException] = queue.SimpleQueue()
    workers = [_Worker(waiting, told, parts) for _ in range(jobs)]
    try:
        yield from _until_all_are_done(len(tasks), told)
    finally:
        for worker in workers:
            worker.end()


def _until_all_are_done(
    count: int, told: queue.SimpleQueue[Told | BaseException]
) -> Iterator[Told]:
    while count:
        try:
            one = told.get(timeout=POLL_S)  # Ctrl-C is seen in between, on every system
        except queue.Empty:
            continue
        if isinstance(one, BaseException):
            raise one
        count -= not isinstance(one.what, float)
        yield one


class _Worker:
    """A process that analyses, and the thread that gives it what to do."""

    def __init__(
        self,
        waiting: queue.SimpleQueue[Task],
        told: queue.SimpleQueue[Told | BaseException],
        parts: Parts,
    ) -> None:
        self._waiting, self._told, self._parts = waiting, told, parts
        self._is_over = False
        self._process = start_process("app.study.worker", None)
        self._thread = threading.Thread(target=self._work, name="slipscope-worker", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the process, whatever it does."""
        self._is_over = True
        _end(self._process)
        self._thread.join()
        _end(self._process)  # of a new one that was begun meanwhile

    def _work(self) -> None:
        try:
            wait_until_ready(self._process)
            while not self._is_over:
                self._told.put(self._done(self._waiting.get_nowait()))
        except queue.Empty:
            pass
        except BaseException as error:
            self._told.put(error)

    def _done(self, task: Task) -> Told:
        for _ in range(TRIES):
            try:
                return Told(task, self._asked(task))
            except (EOFError, OSError, pickle.UnpicklingError):
                code = self._process.wait()
            if self._is_over:
                break
            _end(self._process)
            self._process = start_process("app.study.worker", None)
            wait_until_ready(self._process)
        return Told(
            task,
            Failed(
                f"{task.session}: its process ended with code {code}, as for want of memory; give"
                " fewer --jobs"
            ),
        )

    def _asked(self, task: Task) -> str | Failed:
        process = self._process
        pickle.dump((task, self._parts.place(task)), cast(BinaryIO, process.stdin))
        cast(BinaryIO, process.stdin).flush()
        while isinstance(what := pickle.load(cast(BinaryIO, process.stdout)), float):
            self._told.put(Told(task, what))
        return cast(Any, what)  # type: ignore[no-any-return]


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    with suppress(OSError, ValueError):
        process.communicate()
