"""What an experiment takes of the computer."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import psutil


class Usage:
    """Counts what this process, and those that it has started, take from now on."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._began = time.monotonic()
        self._cpu_s = self._cpu()
        self._peak_bytes = 0

    def look(self) -> None:
        """Take note of the memory in use."""
        self._peak_bytes = max(self._peak_bytes, memory_bytes(self._process))

    def resources(self, peak_bytes: int = 0) -> dict[str, Any]:
        """Largest memory (`peak_bytes` is what others have noted), processor time of all threads,
        and time elapsed.
        """
        self.look()
        self._peak_bytes = max(self._peak_bytes, peak_bytes)
        return {
            "peak_memory_mib": round(self._peak_bytes / 2**20, 1),
            "cpu_s": round(self._cpu() - self._cpu_s, 2),
            "wall_s": round(time.monotonic() - self._began, 2),
        }

    def _cpu(self) -> float:
        used = 0.0
        for process in family(self._process):
            with suppress(psutil.Error):
                times = process.cpu_times()
                used += times.user + times.system + times.children_user + times.children_system
        return used


def family(process: psutil.Process) -> list[psutil.Process]:
    """The process and those that it has started."""
    try:
        return [process, *process.children()]
    except psutil.Error:
        return [process]


def memory_bytes(process: psutil.Process) -> int:
    """Memory that the process and those that it has started have in use."""
    total = 0
    for one in family(process):
        with suppress(psutil.Error):
            total += one.memory_info().rss
    return total
