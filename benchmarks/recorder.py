"""Cost of recording at full rate: a recorder as in a run, in real time, with 1600 x 1200 images at
23.8 frames/s, forces at 1 kHz, a field of 159 x 119 boxes for every frame, and a sync to the disk
every 0.4 s. Then the close, which makes the session and reads everything back, and a repair of the
same session as a kill leaves it.

    python -m benchmarks recorder [--folder FOLDER] [--seconds 20] [--compression none|gzip]
"""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from io import FileIO
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from app.acquisition.recorder_thread import Recorder
from app.records.record_types import (
    Conditions,
    DisplacementField,
    FrameMotion,
    Header,
    Phase,
    RingProfile,
    Samples,
    Snapshot,
    Stick,
)
from app.session.files import images_of, results_of
from app.session.journal import journal_of
from app.session.receipt import verify
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from app.system.disk import forget_cached
from benchmarks.report import Report
from drivers.protocols import Frame

assert sys.platform != "win32", "it asks what a system of POSIX knows of a process"

SUBJECT = "Recording"
SHAPE, GRID, RINGS = (1200, 1600), (119, 159), 40
RATE_HZ, DIVISOR = 1000.0, 42
QUEUE_S, FLUSH_S = 4.0, 0.4


def snapshot(frame: int) -> Snapshot:
    """Results of a frame, of the usual size."""
    field, ring = np.zeros(GRID, np.float32), np.zeros(RINGS)
    return Snapshot(
        frame,
        DIVISOR * frame,
        Conditions(Phase.DRIVE, 0.0, 0.5, 0.1, 1e-6),
        FrameMotion(1e-8, 0.0),
        DisplacementField(field, field, field, field, field, np.zeros(GRID, np.uint8)),
        RingProfile(ring, ring, ring),
        Stick(1e-3, 1e-5, 2e4),
    )


def create(path: Path, compression: str) -> SessionRecorder:
    """An empty session."""
    header = Header(
        frame_shape=SHAPE,
        frame_dtype="uint8",
        versions={},
        config_toml="",
        sample_rate_hz=RATE_HZ,
        first_trigger=0,
        divisor=DIVISOR,
        exposure_samples=10,
        pixel_m=7.04e-6,
        grid_x_px=np.arange(GRID[1], dtype=float),
        grid_y_px=np.arange(GRID[0], dtype=float),
        compression="gzip" if compression == "gzip" else "none",
    )
    return SessionRecorder.create(path, header, overwrite=True)


class Measured:
    """The threads of a recorder, their processor time, and the times of the syncs."""

    def __init__(self, writer: SessionRecorder) -> None:
        self.cpu_s = 0.0
        self.syncs: list[list[tuple[float, float]]] = []
        self.failures: list[str] = []
        timed = tuple(map(self._timed, writer.syncs))
        sink = SimpleNamespace(append=writer.append, syncs=timed, path=writer.path)
        self.recorder = Recorder(
            sink,  # type: ignore[arg-type]
            QUEUE_S,
            RATE_HZ / DIVISOR * SHAPE[0] * SHAPE[1],
            FLUSH_S,
            sender_waits=False,
            on_failure=self.failures.append,
        )
        self.threads = [
            threading.Thread(target=self._work, args=[work]) for _, work in self.recorder.works()
        ]
        for thread in self.threads:
            thread.start()

    def _timed(self, sync: Callable[[], None]) -> Callable[[], None]:
        times: list[tuple[float, float]] = []
        self.syncs.append(times)

        def timed() -> None:
            began = time.monotonic()
            sync()
            times.append((began, time.monotonic()))

        return timed

    def _work(self, work: Callable[[], None]) -> None:
        before = resource.getrusage(resource.RUSAGE_THREAD)
        work()
        after = resource.getrusage(resource.RUSAGE_THREAD)
        self.cpu_s += after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def record(self, images: list[NDArray[np.uint8]], frames: int) -> float:
        """Send frames, samples and results in real time, and end; the largest share of the queue
        that was in use.
        """
        began, fullest, block = time.monotonic(), 0.0, np.ones((DIVISOR, 2))
        for n in range(frames):
            time.sleep(max(0.0, began + n * DIVISOR / RATE_HZ - time.monotonic()))
            self.recorder.append(Samples(DIVISOR * n, block, block))
            self.recorder.append(Frame(n, DIVISOR * n, images[n % len(images)]))
            self.recorder.append(snapshot(n))
            fullest = max(fullest, self.recorder.fill)
        self.recorder.end()
        for thread in self.threads:
            thread.join()
        return fullest


def speckle(seed: int) -> NDArray[np.uint8]:
    """An image that compresses like those of the bench: blurred grains of a few pixels, and noise
    of one grey level.
    """
    rng = np.random.default_rng(seed)
    grains = cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 1.6)
    grey = 90 + 35 * grains / grains.std() + rng.normal(size=SHAPE)
    return np.clip(grey, 0, 255).astype(np.uint8)


def copy_as_killed(path: Path, cut: Path) -> float:
    """Copy the files of a session that was not closed; seconds of the copy to the disk."""
    began = time.monotonic()
    for file in (images_of, journal_of, results_of):
        shutil.copyfile(file(path), file(cut))
        with file(cut).open("r+b") as copy:
            os.fsync(copy.fileno())
    return time.monotonic() - began


def measure(
    report: Report,
    *,
    folder: Path | None = None,
    seconds: float = 20.0,
    compression: Annotated[str, ("none", "gzip")] = "none",
) -> None:
    """Record, close and repair in a new folder there."""
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        images = [speckle(seed) for seed in range(8)]
        path, cut = Path(temporary) / "session.h5", Path(temporary) / "cut.h5"
        frames, raw = int(seconds * RATE_HZ / DIVISOR), SHAPE[0] * SHAPE[1]
        writer = create(path, compression)
        measured = Measured(writer)
        fullest = measured.record(images, frames)
        copying = copy_as_killed(path, cut)
        closing = time.monotonic()
        writer.close()
        closing = time.monotonic() - closing
        megabytes = path.stat().st_size / 1e6
        with h5py.File(path) as file:
            stored = file["entry/instrument/camera/data"].id.get_storage_size()
        verifying = time.monotonic()
        with FileIO(path) as held:
            forget_cached(held)
        verify(path)
        verifying = time.monotonic() - verifying
        path.unlink()
        repairing = time.monotonic()
        repair(cut, path)
        repairing = time.monotonic() - repairing
    report.add("frames", frames)
    report.add("failures", "; ".join(measured.failures) or "none")
    report.add("recorder", 100 * measured.cpu_s / seconds, "% of a core", at_most=15)
    report.add("recorder, each frame with samples and results", 1e3 * measured.cpu_s / frames, "ms")
    for what, times in zip(("forces", "images"), measured.syncs, strict=True):
        report.add(
            f"sync of the {what}, median", np.median([1e3 * (b - a) for a, b in times]), "ms"
        )
        between = max(after[1] - before[0] for before, after in pairwise(times))
        report.add(f"from the start of one to the end of the next, {what}", between, "s")
    report.add("fullest queue", 100 * fullest, "%")
    report.add("images in the file", 100 * stored / (frames * raw), "% of their size in memory")
    report.add("session", megabytes, "MB")
    report.add("close, with reading back", megabytes / closing, "MB/s")
    report.add("close, with reading back, time", closing, "s")
    report.add("`info --verify`", megabytes / verifying, "MB/s")
    report.add("plain copy to the disk", megabytes / copying, "MB/s")
    report.add("repair, with reading back", megabytes / repairing, "MB/s")
    report.add("time of a repair over that of a plain copy", repairing / copying, at_most=1)
