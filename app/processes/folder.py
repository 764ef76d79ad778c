"""The benches that run on this computer: a folder for each, with its address and the images that it
shares.

The folder lies in memory where the computer has a place for that, and is its owner's alone.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from app.stopping import Stop, StopAnswer

MEMORY = Path("/dev/shm")  # of Linux
FILE = "bench.json"
ANSWER = "stop.json"  # of the supervisor
KEPT_S = 600.0  # after its last change: the folder of a dead bench, with what became of its stage


@dataclass(frozen=True, slots=True)
class RunningBench:
    """A bench that can be called.

    Attributes
    ----------
    name : str
        Of its folder.
    title : str
        For people.
    session : str
        The file that it records.
    pid, analysis_pid, supervisor_pid : int
        Its processes; 0 for one that it does not have.
    born : float
        When its process began, which tells it from a later one of the same number.
    """

    name: str
    title: str
    session: str
    address: str
    key: str
    pid: int
    born: float
    analysis_pid: int = 0
    supervisor_pid: int = 0

    @property
    def is_alive(self) -> bool:
        """Whether its process is still there."""
        try:
            process = psutil.Process(self.pid)
            return bool(process.create_time() == self.born and process.status() != "zombie")
        except psutil.Error:
            return False


def root() -> Path:
    """Where the folders of this user's benches are."""
    base = MEMORY if os.access(MEMORY, os.W_OK) else Path(tempfile.gettempdir())
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    folder = base / f"slipscope-{user}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def new_folder() -> Path:
    """An empty folder for a bench; those that dead benches have left are deleted, once nobody asks
    any more what became of the stage.
    """
    for folder in root().iterdir():
        if _is_left(folder):
            shutil.rmtree(folder, ignore_errors=True)
    name = f"{datetime.now():%H%M%S}-{secrets.token_hex(2)}"
    folder = root() / name
    folder.mkdir(mode=0o700)
    return folder


def publish(folder: Path, bench: RunningBench) -> None:
    """Make a bench known, or what has changed of it."""
    new = folder / f"{FILE}.new"
    new.write_text(json.dumps(asdict(bench)), encoding="utf-8")
    new.replace(folder / FILE)


def known(bench: RunningBench) -> RunningBench:
    """The same bench, as its folder says now, or did at its end."""
    return _read(root() / bench.name) or bench


def tell(path: Path, answer: StopAnswer) -> None:
    """Leave what became of a stop for those who ask for it when the bench is gone."""
    new = path.with_name(f"{path.name}.new")
    new.write_text(json.dumps(asdict(answer)), encoding="utf-8")
    new.replace(path)


def told(bench: str) -> StopAnswer | None:
    """What the supervisor of a bench of that name has left; None where there is nothing."""
    try:
        told = json.loads((root() / bench / ANSWER).read_text(encoding="utf-8"))
        return StopAnswer(Stop(told["kind"]), told["sentence"])
    except (OSError, ValueError):
        return None


def running() -> list[RunningBench]:
    """The benches that run now, the oldest first."""
    found = [_read(folder) for folder in sorted(root().iterdir())]
    return sorted((b for b in found if b is not None and b.is_alive), key=lambda b: b.born)


def _is_left(folder: Path) -> bool:
    """Whether a folder is of a bench that died a while ago, and whose supervisor has ended."""
    bench = _read(folder)
    if bench is None or bench.is_alive or psutil.pid_exists(bench.supervisor_pid or -1):
        return False
    try:
        return time.time() - folder.stat().st_mtime > KEPT_S
    except OSError:  # somebody else has deleted it
        return False


def _read(folder: Path) -> RunningBench | None:
    try:
        return RunningBench(**json.loads((folder / FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def shared_image(
    path: Path, shape: tuple[int, int], dtype: np.dtype[Any]
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """An image in a file that several processes can map; made where it is not there."""
    if not path.exists():
        with path.open("wb") as file:
            file.truncate(shape[0] * shape[1] * dtype.itemsize)
    return np.memmap(path, dtype, "r+", shape=shape).view(np.ndarray)


def shown_images(folder: Path, number: int) -> Callable[[NDArray[Any]], str]:
    """A function that shares images with one caller and answers the name of the file: of two in
    turn, so that one can be looked at while the next comes.
    """
    paths = [folder / f"image-{number}-{turn}" for turn in "ab"]
    shared: list[NDArray[Any]] = []

    def share(image: NDArray[Any]) -> str:
        if not shared:
            shape = image.shape[0], image.shape[1]
            shared.extend(shared_image(path, shape, image.dtype) for path in paths)
        paths.reverse()
        shared.reverse()
        np.copyto(shared[0], image)
        return paths[0].name

    return share
