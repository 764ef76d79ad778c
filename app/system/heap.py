"""Memory that a process has let go of is kept for what needs as much again."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # of malloc.h
KEPT = 256 * 2**20  # bytes that stay at the end of the heap
MAPPED = 32 * 2**20  # bytes from which a piece is mapped by itself; more are not allowed


def keep_freed_memory() -> None:
    """Let the C library of GNU keep what is freed. By itself it gives the memory of each image back
    to the system, which clears every page of the next one, and keeps memory of each thread apart,
    which grows with the runs of an evening. Elsewhere nothing is done.
    """
    if sys.platform == "linux":
        with suppress(AttributeError):  # another C library
            set_option = ctypes.CDLL(None).mallopt
            set_option(M_TRIM_THRESHOLD, KEPT)
            set_option(M_MMAP_THRESHOLD, MAPPED)
            set_option(M_ARENA_MAX, 1)  # one heap for all threads
