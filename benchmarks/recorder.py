"""What recording costs at full rate: ``python benchmarks/recorder.py [--folder FOLDER] [--seconds
20] [--compression none|gzip]``.

A recorder as in a run, in real time: 1600 x 1200 images at 23.8 frames/s, forces at 1 kHz, a field
of 159 x 119 boxes for every frame, the journal, a flush to the disk each 0.4 s. Then the reading
back at the close, and a repair of the same session as a kill leaves it.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import resource
import shutil
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app.engine.recorder import Recorder
from app.records import (
    Conditions,
    DisplacementField,
    Header,
    Motion,
    Phase,
    ReceivedFrame,
    RingProfile,
    Samples,
    Snapshot,
    Stick,
)
from app.session.journal import journal_of
from app.session.repair import repair
from app.session.writer import SessionWriter

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
        motion=Motion(1e-8, 0.0),
        field=DisplacementField(*[field] * 5, status=np.zeros(GRID, np.uint8)),
        rings=RingProfile(ring, ring, ring),
        stick=Stick(1e-3, 1e-5, 3e4),
    )


class Measured:
    """A recorder's thread that keeps its processor time, and the times of its flushes."""

    def __init__(self, recorder: Recorder, writer: SessionWriter) -> None:
        self.cpu_s = 0.0
        self.flushes: list[tuple[float, float]] = []
        self._recorder = recorder
        self._flush = writer.flush
        writer.flush = self.flush  # type: ignore[method-assign]

    def flush(self) -> None:
        """A flush of the writer, timed."""
        began = time.monotonic()
        self._flush()
        self.flushes.append((began, time.monotonic()))

    def work(self) -> None:
        """The recorder's work, timed."""
        before = resource.getrusage(resource.RUSAGE_THREAD)
        self._recorder.work()
        after = resource.getrusage(resource.RUSAGE_THREAD)
        self.cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def speckle(seed: int) -> NDArray[np.uint8]:
    """An image as of the bench, as far as compression goes: blurred grains of a few pixels, and
    noise of one grey level.
    """
    rng = np.random.default_rng(seed)
    grains = cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 1.6)
    return np.clip(90 + 35 * grains / grains.std() + rng.normal(size=SHAPE), 0, 255).astype(
        np.uint8
    )


def main(folder: Path, seconds: float, compression: str) -> None:
    """Record, close, repair, print."""
    images = [speckle(seed) for seed in range(8)]
    path, cut = folder / "recorder-benchmark.h5", folder / "recorder-benchmark-cut.h5"
    header = Header(
        config_toml="",
        sample_rate_hz=RATE_HZ,
        frame_shape=SHAPE,
        frame_dtype="uint8",
        exposure_samples=10,
        divisor=DIVISOR,
        first_trigger=0,
        pixel_m=7.04e-6,
        grid_x_px=np.arange(GRID[1], dtype=float),
        grid_y_px=np.arange(GRID[0], dtype=float),
        versions={},
        compression=compression,
    )
    writer = SessionWriter.create(path, header, overwrite=True)
    rate = RATE_HZ / DIVISOR
    failures: list[str] = []
    recorder = Recorder(
        writer,
        QUEUE_S,
        rate * images[0].nbytes,
        FLUSH_S,
        sender_waits=False,
        on_failure=failures.append,
    )
    measured = Measured(recorder, writer)
    thread = threading.Thread(target=measured.work)
    thread.start()
    began, fullest, block = time.monotonic(), 0.0, np.ones((DIVISOR, 2))
    frames = int(seconds * rate)
    for n in range(frames):
        time.sleep(max(0.0, began + n / rate - time.monotonic()))
        recorder.append(Samples(DIVISOR * n, block, block))
        recorder.append(ReceivedFrame(n, DIVISOR * n, images[n % 8]))
        recorder.append(snapshot(n))
        fullest = max(fullest, recorder.fill)
    recorder.end()
    thread.join()
    flushes = measured.flushes.copy()
    copying = time.monotonic()
    shutil.copyfile(path, cut)
    with cut.open("r+b") as file:
        os.fsync(file.fileno())
    copying = time.monotonic() - copying
    shutil.copy(journal_of(path), journal_of(cut))
    closing = time.monotonic()
    writer.close()
    closing = time.monotonic() - closing

    print(
        f"{platform.platform()}, {platform.processor() or platform.machine()},"
        f" {datetime.date.today().isoformat()}"
    )
    print(
        f"python {platform.python_version()}, h5py {h5py.__version__}, HDF5"
        f" {h5py.version.hdf5_version}"
    )
    print(
        f"{frames} frames in {seconds:.0f} s, {rate:.1f}/s, compression {compression}, in {folder};"
        f" failures: {failures or 'none'}"
    )
    share = measured.cpu_s / seconds
    print(
        f"recorder: {share:.1%} of a core, {1e3 * measured.cpu_s / frames:.2f} ms CPU per frame"
        " with its samples and results"
    )
    times = [end - start for start, end in flushes]
    between = max(b[1] - a[0] for a, b in pairwise(flushes))
    print(
        f"flush to the disk: {1e3 * np.median(times):.0f} ms (median), {1e3 * max(times):.0f} ms"
        f" (longest of {len(times)})"
    )
    print(
        f"begin of a flush to the end of the next, lost by a power cut: {between:.2f} s at most;"
        f" queue filled to {fullest:.0%}"
    )
    size = path.stat().st_size
    with h5py.File(path, "r") as file:
        share = file["entry/instrument/camera/data"].id.get_storage_size() / (
            frames * images[0].nbytes
        )
    print(f"images in the file: {share:.1%} of their size in memory")
    print(
        f"close with reading back: {closing:.2f} s, {size / closing / 1e6:.0f} MB/s:"
        f" {writer.receipt}"
    )
    path.unlink()
    began = time.monotonic()
    repaired = repair(cut, path)
    took = time.monotonic() - began
    print(f"a plain copy to the disk: {size / copying / 1e6:.0f} MB/s")
    print(f"repair with reading back: {took:.2f} s, {size / took / 1e6:.0f} MB/s: {repaired}")
    for done in (path, cut, journal_of(cut)):
        done.unlink()


if __name__ == "__main__":
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--folder", type=Path)
    options.add_argument("--seconds", type=float, default=20.0)
    options.add_argument("--compression", choices=("none", "gzip"), default="none")
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        main(asked.folder or Path(temporary), asked.seconds, asked.compression)
