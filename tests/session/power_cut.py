"""What a power cut leaves of the files that a program was writing.

Every write of a recording is kept in order, with the moments at which the program had
a file brought to the disk. A cut leaves all that was brought there, and of the rest each page of 4
KiB as it was at any moment since then; a file may be shorter than it was.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from app.system import disk as disk_module

PAGE = 4096


class Disk:
    """The history of all writes; `record` fills it, `left_by_cut` looks back at it."""

    def __init__(self) -> None:
        # name of the file; "write", "size" or "sync"; place; what
        self.events: list[tuple[str, str, int, bytes]] = []
        self._places: dict[str, Path] = {}

    @contextmanager
    def record(self) -> Iterator[None]:
        """Keep what sessions write while the ``with`` statement lasts."""
        disk = self

        class Traced(FileIO):
            def __init__(self, path: Path, mode: str) -> None:
                super().__init__(path, mode)
                self.called = path.name
                disk._places[path.name] = path

            def write(self, data: Any) -> int:
                place = os.fstat(self.fileno()).st_size
                disk.events.append((self.called, "write", place, bytes(data)))
                return super().write(data)

            def truncate(self, size: int | None = None) -> int:
                size = super().truncate(size)
                disk.events.append((self.called, "size", size, b""))
                return size

        def sync(number: int) -> None:
            (name,) = [
                name
                for name, path in self._places.items()
                if os.path.samestat(os.fstat(number), path.stat())
            ]
            self.events.append((name, "sync", 0, b""))

        with patch.object(disk_module, "FileIO", Traced), patch.object(os, "fsync", sync):
            yield

    def left_by_cut(self, instant: int, rng: np.random.Generator, folder: Path) -> None:
        """Write to `folder` what is left of each file by a cut before event number `instant`."""
        for name in sorted({event[0] for event in self.events}):
            history = [event[1:] for event in self.events[:instant] if event[0] == name]
            synced = (
                max((n for n, (kind, _, _) in enumerate(history) if kind == "sync"), default=-1) + 1
            )
            content = bytearray()
            for event in history[:synced]:
                _apply(content, *event)
            least, rest = len(content), history[synced:]
            pages: dict[int, list[tuple[int, bytes]]] = {}
            size = least
            for kind, place, data in rest:
                size = place if kind == "size" else max(size, place + len(data))
                at = place
                while at < place + len(data):
                    end = min(place + len(data), (at // PAGE + 1) * PAGE)
                    pages.setdefault(at // PAGE, []).append((at, data[at - place : end - place]))
                    at = end
            for writes in pages.values():
                for at, part in writes[: rng.integers(0, len(writes) + 1)]:
                    _apply(content, "write", at, part)
            shortest = min(least, size)
            length = int(rng.choice([shortest, size, rng.integers(shortest, size + 1)]))
            (folder / name).write_bytes(bytes(content[:length]).ljust(length, b"\0"))


def _apply(content: bytearray, kind: str, place: int, data: bytes) -> None:
    if kind == "size":
        del content[place:]
    if kind != "sync" and len(content) < place + len(data):
        content.extend(bytes(place + len(data) - len(content)))
    if kind == "write":
        content[place : place + len(data)] = data
