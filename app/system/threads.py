"""Threads of the program."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


def start_thread(
    name: str, work: Callable[..., object], *arguments: Any, daemon: bool = True
) -> threading.Thread:
    """Begin some work in a thread of its own, which is named in the log.

    Parameters
    ----------
    daemon : bool
        Whether the program may end before the work does.
    """
    thread = threading.Thread(target=work, args=arguments, name=f"slipscope-{name}", daemon=daemon)
    thread.start()
    return thread
