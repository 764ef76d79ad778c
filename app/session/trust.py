"""Sessions that this computer has closed itself and read back whole: they need no second look.

Each has a small file in the user's state folder, named by what tells the session from every other:
its place on the disk, its size and the times of its last changes. A copy, or a file that was
touched since, is a stranger's.
"""

from __future__ import annotations

import hashlib
import secrets
from contextlib import suppress
from pathlib import Path

from app.settings.trusted_settings import state_folder

MOST_KNOWN = 5000  # sessions; the oldest are forgotten


def identity_of(path: Path) -> str:
    """What tells a file from every other and from an earlier state of itself; OSError."""
    held = path.stat()
    parts = (held.st_dev, held.st_ino, held.st_size, held.st_mtime_ns, held.st_ctime_ns)
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def remember(path: Path, checksum: str) -> None:
    """Keep that the session at `path` is whole and this computer's own, with the checksum of its
    receipt. Where that cannot be kept, it will be read as a stranger's.
    """
    with suppress(OSError):
        folder = _folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        unfinished = folder / f".{secrets.token_hex(8)}"
        try:
            unfinished.write_text(checksum, encoding="utf-8")
            unfinished.replace(folder / identity_of(path))
        finally:
            unfinished.unlink(missing_ok=True)
        _forget_the_oldest(folder)


def checksum_of(path: Path) -> str | None:
    """The checksum of the receipt of a session that this computer closed; None of any other."""
    with suppress(OSError, UnicodeDecodeError):
        return (_folder() / identity_of(path)).read_text(encoding="utf-8")
    return None


def is_known(path: Path) -> bool:
    """Whether this computer closed this very file, and nobody has written to it since."""
    return checksum_of(path) is not None


def _folder() -> Path:
    return state_folder() / "sessions"


def _forget_the_oldest(folder: Path) -> None:
    known = list(folder.iterdir())
    if len(known) <= MOST_KNOWN:
        return
    ages = []
    for path in known:
        with suppress(OSError):  # another process has forgotten it already
            ages.append((path.stat().st_mtime_ns, path))
    for _, path in sorted(ages)[: len(known) - MOST_KNOWN]:
        path.unlink(missing_ok=True)
