"""What nothing refers to any more is found in the thread of the window only: Qt does not bear that
another thread deletes a widget, which Python's own collection does in whichever thread is at work.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from PySide6.QtCore import QTimer

LOOK_MS = 200


@contextmanager
def collected_here() -> Iterator[None]:
    """Python collects garbage while events are handled, and at no other time.

    What was there before is not looked at again: a look at it takes 0.1 s.
    """
    gc.disable()
    gc.freeze()
    timer = QTimer()
    timer.timeout.connect(_look)
    timer.start(LOOK_MS)
    try:
        yield
    finally:
        timer.stop()
        gc.unfreeze()
        gc.collect()
        gc.enable()


def _look() -> None:
    """Collect the oldest generation whose turn it is, as Python does."""
    for generation in (2, 1, 0):
        if gc.get_count()[generation] > gc.get_threshold()[generation]:
            gc.collect(generation)
            return
