"""One owner for each network port of a device, among the programs of one computer: a device server
lets several callers in, and one of them could stop the experiment of another.
"""

from __future__ import annotations

import hashlib
import os
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

from drivers.errors import DeviceFault

if sys.platform == "win32":
    import msvcrt

    def _take(lock: int) -> None:
        os.lseek(lock, 1 << 20, os.SEEK_SET)  # beyond the text, which others may read
        msvcrt.locking(lock, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(lock: int) -> None:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)


def lock_file(port: str) -> Path:
    """The file whose lock stands for a port such as ``socket://host:port``, by whatever name the
    host is called.
    """
    parts = urlsplit(port)
    host = parts.hostname or ""
    with suppress(OSError):  # whoever opens the port will say so
        host = socket.gethostbyname(host)
    key = hashlib.sha256(f"{host}:{parts.netloc.rpartition(':')[2]}".encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"slipscope-port-{key}.lock"


@contextmanager
def locked(who: str, port: str) -> Iterator[None]:
    """Own a port for as long as the block lasts; the operating system ends that with the program.

    Raises
    ------
    DeviceFault
        Another program of this computer owns it, or the lock cannot be made.
    """
    path = lock_file(port)
    try:
        lock = _opened(path)
    except OSError as error:
        raise DeviceFault(
            f"{who}: {port} cannot be locked against other programs, {path} cannot be written"
            f" ({error.strerror}); let everybody who uses the bench write to it"
        ) from error
    try:
        try:
            _take(lock)
        except OSError as error:
            os.lseek(lock, 0, os.SEEK_SET)
            owner = os.read(lock, 20).decode("ascii", "replace").strip() or "unknown"
            raise DeviceFault(
                f"{who}: another program has {port} open (process {owner}); close that program"
            ) from error
        os.lseek(lock, 0, os.SEEK_SET)
        os.write(lock, f"{os.getpid():<20}".encode("ascii"))
        yield
    finally:
        os.close(lock)


def _opened(path: Path) -> int:
    """The file, for any user: only who makes it may ask to make it, in a folder of all users."""
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR)
        with suppress(FileExistsError):
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
            path.chmod(0o666)
            return lock
