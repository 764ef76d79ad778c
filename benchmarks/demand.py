"""Processor time of a frame for what is asked of it, at full resolution, on one core: pictures of
the simulated world during a drive at 23.8 frames/s go through the pipeline of a run. Medians; and
what the simulated world itself takes per frame.

    python -m benchmarks demand [--frames 60] [--set key=value]...

forces only            nothing but the means of the forces (recording.results = "forces")
Q(delta) and c         u_x about the contact, its rings, sigma(r) and c ("profiles")
one pass               the same with a single pass of the correlation: the last step of quality auto
u_x live               the whole field, and all that follows from it ("fields")
everything             also the traction of every point (stress.field)
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import cv2
import numpy as np

from app.records.effort import Effort, Product
from app.records.record_types import Conditions, Phase
from benchmarks.pipeline import DIVISOR, Drive
from benchmarks.report import Report
from drivers.sim.images import Renderer
from drivers.sim.world import World

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
        state = world.state(world.now)
        now = Conditions(
            phase=Phase.DRIVE,
            time_s=(world.now - drive.at_rest) / world.scenario.forces.sample_rate,
            normal_force_n=state.normal_force_n,
            shear_force_n=state.shear_force_n,
            travel_m=state.stage_m,
        )
        frames.append((index, world.now, drive.renderer.image(state, index), now))
    return frames


def analysis(report: Report, frames: int, overrides: Sequence[str]) -> None:
    """One drive for each kind of demand."""
    report.table("Analysis of a frame, processor time on one core")
    for name, (products, bound) in ASKED.items():
        drive = Drive([*overrides, "dic.threads=1", "stress.field=true"])
        effort, spent, tractions = Effort(int(products)), [], []
        for frame in frames_of(drive, frames):
            began = time.process_time()
            found = drive.line.step(*frame, effort)
            if (frame[0] - 2) % SERIES > 1:  # the first two come from elsewhere in the drive
                spent.append(time.process_time() - began)
            if found.traction:
                tractions.append(found.traction)
        drive.line.close()
        D_sd = [1e9 * t.block_sd_m for t in tractions]
        c_sd = [1e6 * t.peak_radius_sd_m for t in tractions]
        report.row(
            name,
            median=(1e3 * np.median(spent), "ms", bound),
            of_95_percent=(1e3 * np.percentile(spent, 95), "ms"),
            **({"uncertainty of D": (np.median(D_sd), "nm")} if D_sd else {}),
            **({"uncertainty of c": (np.nanmedian(c_sd), "um")} if c_sd else {}),
        )


def world(report: Report, frames: int, overrides: Sequence[str]) -> None:
    """The world at rest, while it is sheared, and while it slides."""
    report.table("The simulated world, processor time of a frame's samples and of its picture")
    drive = Drive(overrides)
    scenario = drive.world.scenario
    for name, velocity, since_s in (("idle", 0.0, 0), ("loading", 5e-6, 2), ("sliding", 5e-6, 25)):
        made, renderer = World(scenario, pace=None), Renderer(scenario)
        made.start()
        made.advance(scenario.settled_sample + 100)
        if velocity:
            made.move(500e-6, velocity)
            made.advance(since_s * int(scenario.forces.sample_rate))
        samples, pictures = [], []
        for n in range(frames):
            began = time.process_time()
            made.advance(DIVISOR)
            state = made.state(made.now)
            middle = time.process_time()
            renderer.image(state, n)
            samples.append(middle - began)
            pictures.append(time.process_time() - middle)
        report.row(
            name,
            samples=(1e3 * np.median(samples), "ms"),
            picture=(1e3 * np.median(pictures), "ms"),
        )


def measure(report: Report, *, frames: int = 60, set_: Sequence[str] = ()) -> None:
    """Both tables."""
    cv2.setNumThreads(1)
    analysis(report, frames, set_)
    world(report, frames, set_)
