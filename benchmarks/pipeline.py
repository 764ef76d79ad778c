"""Milliseconds of each stage of the live analysis of one frame, everything on, at full resolution.

    python benchmarks/pipeline.py [--frames 60] [--set key=value]...

Pictures of the simulated world during a drive at 23.8 frames/s go through the pipeline of a run;
medians of the time on the clock and of the processor time of the process (the correlation uses two
threads). A frame must take less than 42 ms on average.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app import config as settings
from app import devices, live
from app.engine import pipeline, tractions
from app.engine.history import Conditions
from app.results import Phase
from drivers.sim.images import Renderer
from drivers.sim.world import World

DIVISOR = 42
spent: dict[str, list[tuple[float, float]]] = defaultdict(list)


def timed(name: str, work):
    """`work`, its times added to those of the frame."""

    def measured(*args, **options):
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            return work(*args, **options)
        finally:
            spent[name].append((time.perf_counter() - wall, time.process_time() - cpu))

    return measured


def main() -> None:
    """Run frames through the pipeline and print the budget."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("--frames", type=int, default=60)
    ask.add_argument("--set", action="append", default=[])
    asked = ask.parse_args()
    config = settings.load(
        None, [f"camera.divisor={DIVISOR}", "sim.law=elasto-plastic", *asked.set]
    )
    live.prepare(config, lambda what: None)
    world = World(devices.scenario(config), pace=None)
    world.start()
    world.advance(world.scenario.settled_sample + 100)
    renderer, at_rest = Renderer(world.scenario), world.now
    reference = renderer.image(world.state(at_rest), 0)
    free = renderer.image(world.state(0), 1)
    world.move(300e-6, 5e-6)
    line = pipeline.Pipeline(config, config.camera.shape)
    line.step(0, 0, free, conditions(world, 0, Phase.BACKGROUND, 0.0))
    began = time.perf_counter()
    line.step(1, at_rest, reference, conditions(world, at_rest, Phase.REFERENCE, 0.0))
    print(
        f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; reference frame"
        f" {1e3 * (time.perf_counter() - began):.0f} ms"
    )
    line._tracker.track = timed("displacement field", line._tracker.track)
    for name, label in (
        ("ring_means", "ring means"),
        ("fit_stick_radius", "c of the profile"),
        ("central_value", "u_x at the centre"),
    ):
        setattr(pipeline, name, timed(label, getattr(pipeline, name)))
    tractions.Tractions.of = timed("traction, profile", tractions.Tractions.of)
    if config.stress.field:
        tractions.Tractions.field = timed("traction, field", tractions.Tractions.field)
    step = timed("whole frame", line.step)
    for n in range(asked.frames):
        world.advance(DIVISOR * 10)  # ten frames on: a whole drive in some of its frames
        image = renderer.image(world.state(world.now), 2 + n)
        step(
            2 + n,
            world.now,
            image,
            conditions(world, world.now, Phase.DRIVE, (world.now - at_rest) / 1e3),
        )
    line.close()
    for name, times in sorted(spent.items(), key=lambda item: -np.median(item[1])):
        wall, cpu = 1e3 * np.median(times, axis=0)
        print(f"{name:22s} {wall:6.2f} ms on the clock, {cpu:6.2f} ms of processor")


def conditions(world: World, sample: int, phase: Phase, seconds: float) -> Conditions:
    """What the bench would have measured."""
    state = world.state(sample)
    return Conditions(
        phase=phase,
        time_s=seconds,
        normal_force_n=state.normal_force_n,
        shear_force_n=state.shear_force_n,
        travel_m=state.stage_m,
    )


if __name__ == "__main__":
    main()
