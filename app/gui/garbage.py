"""What nothing refers to any more is found in the thread of the window only: Qt does not bear that
another thread deletes a widget, which Python's own collection does in whichever thread is at work.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from PySide6.QtCore import QTimer

LOOK_MS = 200
LATER = 60  # times as much garbage is left to the oldest generation while something is urgent


@contextmanager
def collected_here(is_urgent: Callable[[], bool] = lambda: False) -> Iterator[None]:
    """Python collects garbage while events are handled, and at no other time.

    What was there before is not looked at again: a look at it takes 0.1 s. So does one at all that
    has been made since, which waits while something `is_urgent`: a stop would wait for it.
    """
    gc.disable()
    gc.freeze()
    timer = QTimer()
    timer.timeout.connect(partial(_look, is_urgent))
    timer.start(LOOK_MS)
    try:
        yield
    finally:
        timer.stop()
        gc.unfreeze()
        gc.collect()
        gc.enable()


def _look(is_urgent: Callable[[], bool]) -> None:
    """Collect the oldest generation whose turn it is."""
    for generation in (2, 1, 0):
        turns = LATER if generation == 2 and is_urgent() else 1
        if gc.get_count()[generation] > turns * gc.get_threshold()[generation]:
            gc.collect(generation)
            return
