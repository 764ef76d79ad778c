"""Sessions analysed on a Dask cluster: each is a task, its results come back as a part. Sessions
stay where they are: every worker reads them by the same paths.
"""

from __future__ import annotations

import logging
import platform
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from app.study.analysis_plan import Task, programs
from app.study.jobs import TaskReport
from app.study.parts import Parts
from app.study.worker import Failed, analysed
from app.system.errors import UserError

PATIENCE_S = 5.0  # time that the scheduler has to answer
_ONE = threading.Lock()  # at a time in a process: memory, and the threads of the correlation


def part_of(task: Task, expected: dict[str, str]) -> bytes | Failed:
    """The results of a session as a file's bytes, computed on a worker.

    `expected` are the versions that the others compute with.
    """
    where = f"worker {platform.node()}"
    if (mine := programs()) != expected:
        other = [name for name in expected if mine.get(name) != expected[name]]
        return Failed(
            f"{where}: it has another {other[0]}: {mine.get(other[0])}, asked for with"
            f" {expected[other[0]]}; install the same on every worker"
        )
    if not task.world and not Path(task.session).is_file():
        return Failed(f"{where}: it sees no {task.session}; share that folder with the workers")
    with _ONE, tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "part.h5"
        failed = analysed(task, place, lambda share: None, threads=1)
        return Failed(f"{where}: {failed.sentence}") if failed else place.read_bytes()


def results_on_cluster(tasks: Sequence[Task], parts: Parts, address: str) -> Iterator[TaskReport]:
    """Analyse sessions into their parts on the workers of the scheduler at `address`.

    Raises
    ------
    UserError
        Dask is not installed, or no scheduler answers there.
    """
    client = _client(address)
    from distributed import as_completed

    with closing(client):
        versions = programs()
        futures = {
            client.submit(part_of, task, versions, key=f"slipscope-{task.key}", pure=False): task
            for task in tasks
        }
        try:
            for future in as_completed(list(futures), loop=client.loop):
                task, found = futures[future], _result(future, futures[future])
                if not isinstance(found, Failed):
                    parts.take(task, found)
                yield TaskReport(task, found if isinstance(found, Failed) else None)
                future.release()
        finally:
            client.cancel(list(futures))


def _result(future: Any, task: Task) -> bytes | Failed:
    try:
        found: bytes | Failed = future.result()
    except Exception as error:  # a worker that died again and again, or a scheduler that is gone
        return Failed(f"{task.session}: {type(error).__name__}: {error}")
    return found


def _client(address: str) -> Any:
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError:
        raise UserError(
            "--dask: the package distributed is not installed; install slipscope[cluster]"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is said here
    try:
        get_address_host_port(address)  # a client of what is no address ends in a traceback
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(
            f"--dask {address}: no scheduler answers there within {PATIENCE_S:.0f} s"
            f" ({type(error).__name__}); start one with `dask scheduler`, or check the address"
        ) from None
    return client
