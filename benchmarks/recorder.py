"""Cost of recording at full rate: a recorder as in a run, in real time, with 1600 x 1200 images at
23.8 frames/s, forces at 1 kHz, a field of 159 x 119 boxes for every frame, the journal, and a flush
to the disk every 0.4 s. Then the close, which reads everything back, and a repair of the same
session as a kill leaves it.

    python -m benchmarks recorder [--folder FOLDER] [--seconds 20] [--compression none|gzip]
"""

from __future__ import annotations

import os
import resource
import shutil
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

from app.engine.recorder import Recorder
from app.records import Phase, Snapshot
from app.session.journal import journal_of
from app.session.repair import repair
from app.session.writer import SessionWriter
from benchmarks.report import Report
from drivers.protocols import Frame

SUBJECT = "Recording"
SHAPE, GRID, RINGS = (1200, 1600), (119, 159), 40
RATE_HZ, DIVISOR = 1000.0, 42
QUEUE_S, FLUSH_S = 4.0, 0.4


def snapshot(frame: int) -> Snapshot:
    """Results of a frame, of the usual size."""
    field, ring = np.zeros(GRID, np.float32), np.zeros(RINGS)
    numbers = (0.0, 0.5, 0.1, 1e-6, 1e-8)  # time, P, Q, travel, lens
    fields = (field, field, field, field, field, np.zeros(GRID, np.uint8))
    stick = (0.0, 1e-3, 1e-5)  # u_x at the centre, c, its uncertainty
    return Snapshot(
        frame, DIVISOR * frame, Phase.DRIVE, *numbers, *fields, ring, ring, ring, *stick
    )


def create(path: Path, compression: str) -> SessionWriter:
    """An empty session."""
    return SessionWriter.create(
        path,
        config_toml="",
        sample_rate_hz=RATE_HZ,
        frame_shape=SHAPE,
        frame_dtype=np.dtype(np.uint8),
        exposure_samples=10,
        divisor=DIVISOR,
        first_trigger=0,
        pixel_m=7.04e-6,
        grid_x_px=np.arange(GRID[1], dtype=float),
        grid_y_px=np.arange(GRID[0], dtype=float),
        versions={},
        compression=compression,
        overwrite=True,
    )


class Measured:
    """The thread of a recorder, its processor time, and the times of the writer's flushes."""

    def __init__(self, writer: SessionWriter) -> None:
        self.cpu_s = 0.0
        self.flushes: list[tuple[float, float]] = []
        self.failures: list[str] = []
        self.recorder = Recorder(
            writer,
            QUEUE_S,
            RATE_HZ / DIVISOR * SHAPE[0] * SHAPE[1],
            FLUSH_S,
            sender_waits=False,
            on_failure=self.failures.append,
        )
        self._flush = writer.flush
        writer.flush = self._timed_flush  # type: ignore[method-assign]
        self.thread = threading.Thread(target=self._work)
        self.thread.start()

    def _timed_flush(self) -> None:
        began = time.monotonic()
        self._flush()
        self.flushes.append((began, time.monotonic()))

    def _work(self) -> None:
        before = resource.getrusage(resource.RUSAGE_THREAD)
        self.recorder.work()
        after = resource.getrusage(resource.RUSAGE_THREAD)
        self.cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def record(self, images: list[NDArray[np.uint8]], frames: int) -> float:
        """Send frames, samples and results in real time, and end; the largest share of the queue
        that was in use.
        """
        began, fullest, block = time.monotonic(), 0.0, np.ones((DIVISOR, 2))
        for n in range(frames):
            time.sleep(max(0.0, began + n * DIVISOR / RATE_HZ - time.monotonic()))
            self.recorder.samples(DIVISOR * n, block, block)
            self.recorder.frame(Frame(n, DIVISOR * n, images[n % len(images)]))
            self.recorder.snapshot(snapshot(n))
            fullest = max(fullest, self.recorder.fill)
        self.recorder.end()
        self.thread.join()
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
    """Copy a session that was not closed, with its journal; seconds of the copy to the disk."""
    began = time.monotonic()
    shutil.copyfile(path, cut)
    with cut.open("r+b") as file:
        os.fsync(file.fileno())
    seconds = time.monotonic() - began
    shutil.copy(journal_of(path), journal_of(cut))
    return seconds


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
        flushes = measured.flushes.copy()
        copying = copy_as_killed(path, cut)
        closing = time.monotonic()
        writer.close()
        closing = time.monotonic() - closing
        megabytes = path.stat().st_size / 1e6
        with h5py.File(path) as file:
            stored = file["entry/instrument/camera/data"].id.get_storage_size()
        path.unlink()
        repairing = time.monotonic()
        repair(cut, path)
        repairing = time.monotonic() - repairing
    report.add("frames", frames)
    report.add("failures", "; ".join(measured.failures) or "none")
    report.add("recorder", 100 * measured.cpu_s / seconds, "% of a core", at_most=20)
    report.add("recorder, each frame with samples and results", 1e3 * measured.cpu_s / frames, "ms")
    flush_ms = [1e3 * (end - start) for start, end in flushes]
    report.add("flush to the disk, median", np.median(flush_ms), "ms")
    report.add("flush to the disk, longest", max(flush_ms), "ms")
    between = max(after[1] - before[0] for before, after in pairwise(flushes))
    report.add("from the start of a flush to the end of the next", between, "s", at_most=0.5)
    report.add("fullest queue", 100 * fullest, "%")
    report.add("images in the file", 100 * stored / (frames * raw), "% of their size in memory")
    report.add("session", megabytes, "MB")
    report.add("close, with reading back", megabytes / closing, "MB/s")
    report.add("plain copy to the disk", megabytes / copying, "MB/s")
    report.add("repair, with reading back", megabytes / repairing, "MB/s")
    report.add("time of a repair over that of a plain copy", repairing / copying, at_most=1)
