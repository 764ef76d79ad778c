"""Speed and noise of the direct correlation at full size, on the paper's own test (Fig. 4d).

    python benchmarks/dic_direct.py [--threads 2] [--noise 2]

Exact blob images of 1600 x 1200 pixels are moved along x by 0.14 to 14 px. Printed: milliseconds of processor time per
frame, cold and warm, and the standard deviation of u_x - v t for boxes of 10 to 100 px.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "dic")]

from blobs import Speckle  # noqa: E402

from analysis.dic import DirectTracker, compile_kernels  # noqa: E402

SHIFTS = np.linspace(0.14, 14.0, 29)


def main() -> None:
    """Run the test and print its figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--threads", type=int, default=2)
    options.add_argument("--noise", type=float, default=2.0, help="camera noise, grey levels")
    options.add_argument("--boxes", type=int, nargs="+", default=[10, 14, 20, 32, 64, 100])
    asked = options.parse_args()
    compile_kernels()
    speckle = Speckle((1200, 1600))
    reference = speckle.image(noise=asked.noise)
    frames = [speckle.image(ux, noise=asked.noise, seed=1 + k) for k, ux in enumerate(SHIFTS)]
    print(f"noise {asked.noise:g} grey levels, {asked.threads} threads, {len(frames)} frames, u_x {SHIFTS[0]:g} ... {SHIFTS[-1]:g} px")
    print("box  points   cold ms (cpu)  warm ms (cpu)  warm ms (wall)  sigma px  worst bias px  not ok  errors > 0.5 px")
    for box in asked.boxes:
        tracker = DirectTracker(reference, box, 10, threads=asked.threads)
        start = time.process_time()
        tracker.track(frames[-1])  # a jump of 14 px
        cold = time.process_time() - start
        tracker.reset()
        tracker.track(reference)
        cpu, wall, errors, lost = [], [], [], 0
        for frame, truth in zip(frames, SHIFTS, strict=True):
            start, clock = time.process_time(), time.perf_counter()
            field = tracker.track(frame)
            cpu.append(time.process_time() - start)
            wall.append(time.perf_counter() - clock)
            errors.append(field.ux_px[field.status == 0] - truth)
            lost += np.count_nonzero(field.status)
        tracker.close()
        every = np.concatenate(errors)
        print(
            f"{box:3d}  {field.status.size:6d}  {cold * 1e3:13.0f}  {np.median(cpu) * 1e3:13.1f}  {np.median(wall) * 1e3:14.1f}"
            f"  {every.std():8.4f}  {max(abs(e.mean()) for e in errors):13.4f}  {lost / len(frames):6.1f}"
            f"  {np.count_nonzero(abs(every) > 0.5)}"
        )


if __name__ == "__main__":
    main()
