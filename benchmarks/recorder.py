"""How fast a session takes 1600 x 1200 images, and what that costs: ``python benchmarks/recorder.py [FOLDER] [FRAMES]``.

Records as a run at 24 frames/s does (frame, 42 samples, field of 120 x 160 boxes per frame; a flush every 10 frames), as fast as it goes.
The figures are those of the page cache unless FOLDER is on a disk that has none.
"""

from __future__ import annotations

import datetime
import platform
import statistics
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app.results import Phase, Snapshot
from app.session.reader import SessionReader
from app.session.writer import SessionWriter

SHAPE, GRID, RINGS = (1200, 1600), (119, 159), 40


def snapshot(frame: int) -> Snapshot:
    """Results of a frame, of the usual size."""
    field, ring = np.zeros(GRID, np.float32), np.zeros(RINGS)
    status = np.zeros(GRID, np.uint8)
    fields = (field, field, field, field, field, status)
    return Snapshot(frame, 42 * frame, Phase.DRIVE, 0.0, 0.5, 0.1, 1e-6, 1e-8, *fields, ring, ring, ring, 0.0, 1e-3, 1e-5)


def main(folder: Path, frames: int) -> None:
    """Record, read back, print."""
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, SHAPE, np.uint8) for _ in range(8)]
    path = folder / "recorder-benchmark.h5"
    writer = SessionWriter.create(
        path,
        config_toml="",
        sample_rate_hz=1000.0,
        frame_shape=SHAPE,
        frame_dtype=np.dtype(np.uint8),
        exposure_samples=10,
        divisor=42,
        first_trigger=0,
        pixel_m=7.04e-6,
        grid_x_px=np.arange(GRID[1], dtype=float),
        grid_y_px=np.arange(GRID[0], dtype=float),
        versions={},
        overwrite=True,
    )
    spent: dict[str, list[float]] = {"append_frame": [], "append_snapshot": [], "flush (of 10 frames)": []}
    block = np.zeros((42, 2))

    def timed(name: str, began: float) -> None:
        spent[name].append(1e3 * (time.process_time() - began))

    wall, cpu = time.perf_counter(), time.process_time()
    for n in range(frames):
        began = time.process_time()
        writer.append_frame(n, 42 * n, images[n % 8])
        timed("append_frame", began)
        writer.append_samples(42 * n, block, block)
        result = snapshot(n)
        began = time.process_time()
        writer.append_snapshot(result)
        timed("append_snapshot", began)
        if n % 10 == 9:
            began = time.process_time()
            writer.flush()
            timed("flush (of 10 frames)", began)
    writer.close()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    size = path.stat().st_size / 1e6

    print(f"{platform.platform()}, {platform.processor() or platform.machine()}, {datetime.date.today().isoformat()}")
    print(f"python {platform.python_version()}, h5py {h5py.__version__}, HDF5 {h5py.version.hdf5_version}")
    print(f"{frames} frames, {size:.0f} MB in {folder}")
    print(f"written: {size / wall:.0f} MB/s, {1e3 * cpu / frames:.2f} ms CPU per frame with its samples and results")
    for name, times in spent.items():
        print(f"  {name}: {statistics.median(times):.2f} ms CPU (median of {len(times)})")
    cpu = time.process_time()
    with SessionReader(path) as session:
        count = sum(1 for _ in session.frames())
    print(f"read: {1e3 * (time.process_time() - cpu) / count:.2f} ms CPU per frame")
    path.unlink()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(Path(sys.argv[1] if len(sys.argv) > 1 else temporary), int(sys.argv[2]) if len(sys.argv) > 2 else 300)
