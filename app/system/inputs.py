"""Files that are read: whether one has an end."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

HOLES = 64  # times the bytes that a file takes of the disk: beyond that it is nothing but holes
_SLACK = 1 << 24


class Endless(OSError):
    """A file cannot be read to its end; as a sentence."""

    def __str__(self) -> str:
        return str(self.strerror)


def check_ends(path: Path) -> None:
    """Refuse what cannot be read to its end: a pipe, a device, a file that is nothing but holes.

    Raises
    ------
    Endless
    """
    held = path.stat()
    if not (stat.S_ISREG(held.st_mode) or stat.S_ISDIR(held.st_mode)):
        raise Endless(errno.EINVAL, "it is a pipe or a device; save what comes from it as a file")
    if holes := holes_of(path):
        raise Endless(errno.EINVAL, holes)


def holes_of(path: Path) -> str:
    """What a file claims if it is nothing but holes; else nothing."""
    held = path.stat()
    real = getattr(held, "st_blocks", 0) * 512 or held.st_size
    if real == held.st_size > _SLACK and hasattr(os, "SEEK_DATA"):
        with path.open("rb") as file:
            try:
                os.lseek(file.fileno(), 0, os.SEEK_DATA)
            except OSError as error:  # there are no data, or the file system does not tell
                real = 0 if error.errno == errno.ENXIO else real
    if held.st_size <= HOLES * real + _SLACK:
        return ""
    return f"the file claims {held.st_size} bytes but takes {real} of the disk, the rest is holes"
