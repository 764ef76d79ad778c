"""Who goes first when the processor is too small for all: the stop and the devices, then what can
wait in a queue, last the analysis.
"""

from __future__ import annotations

import os
import sys
import threading


def give_way(niceness: int) -> None:
    """Let this thread, and those that it starts, go after others of the program, the later the
    greater its niceness (1 to 19).

    Linux takes a niceness per thread and hands it on, Windows a priority. Elsewhere nothing is
    done: the order is a courtesy, no result depends on it.
    """
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), niceness)
    elif sys.platform == "win32":
        import ctypes

        ctypes.windll.kernel32.SetThreadPriority(ctypes.windll.kernel32.GetCurrentThread(), -1)
