"""Processor time of a frame for what is asked of it, at full resolution, on one core: pictures of
the simulated world during a drive at 23.8 frames/s go through the pipeline of a run. Medians.

    python -m benchmarks demand [--frames 60]

forces only            nothing but the means of the forces (recording.results = "forces")
Q(delta) and c         u_x about the contact, its rings, sigma(r) and c ("profiles")
one pass               the same with a single pass of the correlation: the last step of quality auto
u_x live               the whole field, and all that follows from it ("fields")
everything             also the traction of every point (stress.field)
"""

from __future__ import annotations

import time

import cv2
import numpy as np

from app.records.effort import Effort, Product
from app.records.record_types import Conditions
from benchmarks.pipeline import DIVISOR, Drive
from benchmarks.report import Report

SUBJECT = "Cost of a frame, by the results that are asked for"
SERIES = 10
CONTACT = Product.CONTACT | Product.SETTLED
ASKED = {
    "forces only": (Product(0), 2.0),
    "Q(delta) and c": (CONTACT, 8.0),
    "Q(delta) and c, one pass": (Product.CONTACT, None),
    "u_x live": (CONTACT | Product.PICTURE, 16.0),
    "everything": (CONTACT | Product.PICTURE | Product.EVERY_POINT, None),
}


def frames_of(drive: Drive, n: int) -> list[tuple[int, int, np.ndarray, Conditions]]:
    """Series of `SERIES` pictures at the rate of the camera from the whole of a drive, and the
    conditions of their exposures.
    """
    frames, world = [], drive.world
    for index in range(2, n + 2):
        is_next = (index - 2) % SERIES
        world.advance(DIVISOR if is_next else max(1, DIVISOR * (600 * SERIES // n - SERIES)))
        frames.append(drive.frame(index, world.now))
    return frames


def measure(report: Report, *, frames: int = 60) -> None:
    """One drive for each kind of demand."""
    cv2.setNumThreads(1)
    report.table("Analysis of a frame, processor time on one core")
    for name, (products, bound) in ASKED.items():
        drive = Drive(["dic.threads=1", "stress.field=true"])
        effort, spent = Effort(int(products)), []
        for frame in frames_of(drive, frames):
            began = time.process_time()
            drive.line.step(*frame, effort)
            if (frame[0] - 2) % SERIES > 1:  # the first two come from elsewhere in the drive
                spent.append(time.process_time() - began)
        drive.line.close()
        report.row(
            name,
            median=(1e3 * np.median(spent), "ms", bound),
            of_95_percent=(1e3 * np.percentile(spent, 95), "ms"),
        )
