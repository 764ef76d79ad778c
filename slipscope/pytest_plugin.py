"""A fixture for tests with a bench in the loop, for a project of yours: in its conftest.py write
``pytest_plugins = ["slipscope.pytest_plugin"]``. Only pytest imports this.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

from slipscope.commands import run
from slipscope.notebook import Session


@pytest.fixture
def run_bench(tmp_path: Path) -> Iterator[Callable[..., Session]]:
    """Runs the protocol of a simulated or emulated bench in the folder of the test, with faults at
    times of the bench; its session, which is closed after the test.

    ``run_bench("hil-emulated", ["run.travel=30"], faults=["noisy-line 0.5s"])``: as for
    `slipscope.run`, without a name for the file.
    """
    with ExitStack() as opened:
        runs = 0

        def run_one(
            bench: str | os.PathLike[str] | None = None,
            settings: Sequence[str] = (),
            *,
            faults: Sequence[str] = (),
            pace: float | None = None,
            timeout_s: float = 600.0,
        ) -> Session:
            nonlocal runs
            runs += 1
            path = tmp_path / f"run-{runs}.h5"
            session = run(path, bench, settings, faults=faults, pace=pace, timeout_s=timeout_s)
            return opened.enter_context(session)

        yield run_one
