"""How much of the computer the program takes: this process and those that it has started."""

from __future__ import annotations

import math
import time

import psutil

LOOK_S = 1.0  # between two looks at the processes that are known
CHILDREN_S = 5.0  # between two looks for others, which read of each process of the computer


class ProcessorLoad:
    """Looks at most once a second; to be called from one thread."""

    def __init__(self) -> None:
        self._me = psutil.Process()
        self._seen: dict[int, psutil.Process] = {}
        self._cores, self._looked, self._listed = 0.0, -math.inf, -math.inf

    def cores(self) -> float:
        """Processor cores in use by the program, over the last second or more."""
        now_s = time.monotonic()
        if now_s - self._looked < LOOK_S:
            return self._cores
        self._looked = now_s
        if now_s - self._listed >= CHILDREN_S:
            self._listed = now_s
            now = {p.pid: p for p in (self._me, *self._me.children(recursive=True))}
            # a process is known by what it has used since the look before
            self._seen = {pid: self._seen.get(pid, process) for pid, process in now.items()}
        self._cores = sum(map(_percent, self._seen.values())) / 100
        return self._cores


def _percent(process: psutil.Process) -> float:
    try:
        return float(process.cpu_percent(None))
    except psutil.Error:
        return 0.0  # it has ended
