"""A computer that does not fall asleep while an experiment is under way: nothing would watch the
stage, and samples would be lost.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from app.system.threads import start_thread

LOG = logging.getLogger(__name__)
ANSWERS_S = 2.0  # a desktop that takes longer to answer is not waited for


@contextmanager
def kept_awake() -> Iterator[None]:
    """Within it the computer does not fall asleep by itself, if its desktop can be asked not to;
    the log says whether it can.
    """
    has_answered, is_over = threading.Event(), threading.Event()

    def ask() -> None:
        from wakepy import keep

        with keep.running(on_fail="pass") as mode:
            if mode.active:
                LOG.info("the computer is kept awake by %s", mode.method)
            else:
                LOG.info(
                    "the computer is not kept awake, because no desktop here can be asked; if it"
                    " falls asleep by itself after a time without input, switch that off"
                )
            has_answered.set()
            is_over.wait()

    asking = start_thread("awake", ask)
    has_answered.wait(ANSWERS_S)
    try:
        yield
    finally:
        is_over.set()
        asking.join(ANSWERS_S)
