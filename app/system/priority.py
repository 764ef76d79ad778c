"""Who goes first when the processor is too small for all: the stop and the devices, then what can
wait in a queue, last the analysis.
"""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress


def give_way(niceness: int, to: int | None = None) -> None:
    """Let this thread, and those that it starts, go after others of the program, the later the
    greater its niceness (1 to 19).

    Linux takes a niceness per thread and hands it on, Windows a priority. Elsewhere nothing is
    done, nor where the system does not allow it: the order is a courtesy, no result depends on it.

    Parameters
    ----------
    niceness : int
        Beyond that of the main thread of the program, which may have been started with one.
    to : int, optional
        Number of the process whose main thread is meant; without it, this one.
    """
    with suppress(OSError):
        if sys.platform == "linux":
            first = os.getpriority(os.PRIO_PROCESS, to or os.getpid())
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), first + niceness)
        elif sys.platform == "win32":
            import ctypes

            ctypes.windll.kernel32.SetThreadPriority(ctypes.windll.kernel32.GetCurrentThread(), -1)
