"""A run of the simulated bench in a window, which closes by itself."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from app.gui.start import run_window
from app.processes.client import LaunchedRun
from app.records.record_types import Outcome


def in_window(run: LaunchedRun, ready: Callable[[Any], Callable[[], object]]) -> Outcome:
    """Run in a window; `ready` is given the window, and what it answers is done meanwhile in a
    thread, with whose end the window closes.
    """
    is_over = threading.Event()

    def opened(window: Any) -> None:
        work = ready(window)
        threading.Thread(target=lambda: (work(), is_over.set()), daemon=True).start()

    run_window(run, autostart=True, on_ready=opened, close_when=is_over.is_set)
    outcome = run.wait()
    assert outcome is not None
    return outcome
