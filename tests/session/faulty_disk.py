"""A disk that fails at a chosen operation, loses what was not synced, or takes long to sync: the
other side of ``faulty_disk.c``, for programs on Linux.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

COMPILER = shutil.which("cc") or shutil.which("gcc")
LIBRARY = "faulty_disk.so"
PAGE = 4096
_TEXT = 256
WRITE, SYNC, RENAME, SIZE, UNLINK, CREATE, FOLDER = (1 << n for n in range(7))
ANY = 127
FAIL, SHORT, KILL_BEFORE, KILL_AFTER, KILL_HALFWAY, LOSE = range(1, 7)
_UNSYNCED, _LOST = 1, 2


class _File(ctypes.Structure):
    _fields_ = (
        ("inode", ctypes.c_int64),
        ("end", ctypes.c_int64),
        ("bytes", ctypes.c_uint8 * (2 << 20)),
    )


class _Change(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int64),
        ("safe", ctypes.c_int64),
        *((name, ctypes.c_char * _TEXT) for name in ("from", "to", "saved")),
    )


_NUMBERS = (
    *("count", "at", "kinds", "action", "error", "lasting"),
    *("delay_us", "follow", "hit", "changes", "files"),
)


class _Control(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int64) for name in _NUMBERS),
        ("where", ctypes.c_char * _TEXT),
        ("last", ctypes.c_char * _TEXT),
        ("change", _Change * 64),
        ("file", _File * 24),
    )


@dataclass(frozen=True, slots=True)
class Fault:
    """What happens at one operation of some kinds; `lasting`: at all that follow, too.

    `cut`: the power fails then, and what was not synced is lost.
    """

    kinds: int = ANY
    action: int = FAIL
    errors: tuple[int, ...] = (errno.EIO,)
    lasting: bool = False
    cut: bool = False

    @property
    def kills(self) -> bool:
        """Whether the program does not live to see it."""
        return self.action in (KILL_BEFORE, KILL_AFTER, KILL_HALFWAY)

    @property
    def forgets(self) -> bool:
        """Whether something that was not synced is lost."""
        return self.cut or self.action == LOSE


FAULTS = {
    "error": Fault(),
    "dead disk": Fault(ANY & ~UNLINK, lasting=True),  # what cannot be removed is left
    "full disk": Fault(
        WRITE | CREATE | SIZE | FOLDER,
        SHORT,
        (errno.ENOSPC, errno.EDQUOT, errno.EFBIG),
        lasting=True,
    ),
    "lost by a failed sync": Fault(SYNC, LOSE),
    "killed in it": Fault(action=KILL_HALFWAY),
    "killed after it": Fault(action=KILL_AFTER),
    "power cut": Fault(action=KILL_AFTER, cut=True),
}


def build(folder: Path) -> Path:
    """The library, compiled in a folder."""
    assert COMPILER
    library = folder / LIBRARY
    source = Path(__file__).with_suffix(".c")
    command = [COMPILER, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"]
    subprocess.run(command, check=True, timeout=400)
    return library


def make_control(path: Path) -> None:
    """A file of control that does nothing yet; before the program begins."""
    path.write_bytes(b"")
    os.truncate(path, ctypes.sizeof(_Control))


def environment(library: Path, control: Path) -> dict[str, str]:
    """What a program needs in its environment to write to the disk that `control` rules."""
    # a folder may have a space in its name, which would end that of the library
    found = {"LD_PRELOAD": library.name, "LD_LIBRARY_PATH": str(library.parent)}
    return found | {"FAULTY_DISK": str(control)}


class FaultyDisk:
    """The rule over the disk of all programs that have the same file of control.

    Parameters
    ----------
    control : Path
        Its file, see `make_control`. Files that a power cut brings back are kept beside it.
    where : str
        Part of the paths that are concerned.
    """

    def __init__(self, control: Path, where: str) -> None:
        with control.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._control = _Control.from_buffer(self._map)
        self._path = control
        self._where = where.encode()

    def arm(self, fault: Fault, at: int, *, delay_s: float = 0.0) -> None:
        """From now on count the operations of the fault's kinds; it happens at number `at` (0:
        never). Each sync takes `delay_s` longer.
        """
        control = self._control
        for n in range(control.files):
            ctypes.memset(ctypes.byref(control.file[n]), 0, 16 + control.file[n].end)
        for saved in self._path.parent.glob(f"{self._path.name}.saved*"):
            saved.unlink()
        for name in _NUMBERS:
            setattr(control, name, 0)
        control.kinds, control.action, control.lasting = fault.kinds, fault.action, fault.lasting
        control.error = fault.errors[at % len(fault.errors)]
        control.at, control.delay_us = at, int(delay_s * 1e6)
        control.follow = fault.forgets
        control.last = b""
        control.where = self._where

    def disarm(self) -> None:
        """The disk is as good as any from now on."""
        self._control.where = b""

    @property
    def count(self) -> int:
        """Operations since `arm`."""
        return int(self._control.count)

    @property
    def hit(self) -> str:
        """The operation that failed, and its file; empty if none did."""
        return os.fsdecode(self._control.last) if self._control.hit else ""

    def lose(self, rng: np.random.Generator, folder: Path) -> None:
        """Take from the files of a folder what a power cut takes: of all that was not synced each
        page, each change of a name, or all of it.
        """
        control, everything = self._control, rng.random() < 0.3
        paths = {path.stat().st_ino: path for path in folder.rglob("*") if path.is_file()}
        for n in range(control.files):
            if path := paths.get(control.file[n].inode):
                state = np.frombuffer(control.file[n].bytes, np.uint8)[: path.stat().st_size]
                _lose_bytes(path, state.copy(), rng, everything)
        for n in reversed(range(control.changes)):
            change = control.change[n]
            if not change.safe and (everything or rng.random() < 0.5):
                _undo(change)

    def lose_failed(self, folder: Path) -> None:
        """Take from the files of a folder what a failed sync has lost."""
        control = self._control
        paths = {path.stat().st_ino: path for path in folder.rglob("*") if path.is_file()}
        for n in range(control.files):
            if path := paths.get(control.file[n].inode):
                state = np.frombuffer(control.file[n].bytes, np.uint8)[: path.stat().st_size]
                if (lost := state == _LOST).any():
                    content = np.fromfile(path, np.uint8)
                    content[: len(state)][lost] = 0
                    content.tofile(path)


def _lose_bytes(path: Path, state: np.ndarray, rng: np.random.Generator, everything: bool) -> None:
    """Zero pages of a file where nothing was synced; it may be shorter then."""
    unsafe = state != 0
    if not unsafe.any():
        return
    content = np.fromfile(path, np.uint8)
    pages = 1 + len(content) // PAGE
    lost = np.repeat(everything | (rng.random(pages) < 0.5), PAGE)[: len(content)]
    unsafe = np.pad(unsafe, (0, len(content) - len(unsafe))) & lost
    content[unsafe] = 0
    safe = np.flatnonzero(~unsafe)
    end = int(safe[-1]) + 1 if len(safe) else 0
    if everything or rng.random() < 0.5:
        content = content[:end]
    content.tofile(path)


def _undo(change: _Change) -> None:
    """As if a change of a folder had never been."""
    names = {name: os.fsdecode(getattr(change, name)) for name in ("from", "to", "saved")}
    with suppress(FileNotFoundError):
        if change.kind == CREATE:
            os.unlink(names["to"])
        elif change.kind == RENAME:
            os.rename(names["to"], names["from"])
    if names["saved"] and change.kind != CREATE:
        with suppress(FileNotFoundError):
            os.rename(names["saved"], names["to"])
