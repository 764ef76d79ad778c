"""Time of each stage of the live analysis of one frame, at full resolution: pictures of the
simulated world during a drive at 23.8 frames/s go through the pipeline of a run. Medians on the
wall clock and of the processor time of the process; the correlation uses two threads.

    python -m benchmarks pipeline [--frames 60] [--set key=value]...

`--set stress.field=true` adds the traction of every point.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from app.evaluation import pipeline, tractions
from app.evaluation.compiling import compile_analysis
from app.records.record_types import Conditions, Phase
from app.runs import live
from app.settings import config
from benchmarks.report import Report
from drivers.sim.images import Renderer
from drivers.sim.world import World

SUBJECT = "Live analysis of a frame"
DIVISOR = 42
FRAME_MS = 42.0  # from one frame to the next at 1 kHz
Times = dict[str, list[tuple[float, float]]]


def stages(line: pipeline.Pipeline) -> list[tuple[str, Any, str]]:
    """Name of each stage, and the object and its attribute that do the work."""
    every_point = [("traction of every point", tractions.Tractions, "field")]
    return [
        ("displacement field", line._tracker, "track"),
        ("ring means", pipeline, "ring_means"),
        ("c from the profile of u_x", pipeline, "fit_stick_radius"),
        ("u_x at the centre", pipeline, "central_value"),
        ("traction sigma(r)", tractions.Tractions, "of"),
        *(every_point if line.config.stress.field else []),
    ]


def timed(name: str, work: Callable[..., Any], spent: Times) -> Callable[..., Any]:
    """The same work, which adds its wall and processor time to those spent."""

    def measured(*arguments: Any, **options: Any) -> Any:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            return work(*arguments, **options)
        finally:
            spent[name].append((time.perf_counter() - wall, time.process_time() - cpu))

    return measured


class Drive:
    """A pipeline that has its reference, and the pictures of a drive."""

    def __init__(self, overrides: Sequence[str]) -> None:
        settings = config.load(
            None, [f"camera.divisor={DIVISOR}", "sim.law=elasto-plastic", *overrides]
        )
        live.prepare(settings, partial(compile_analysis, settings), lambda what: None)
        self.world = world = World(live.make_bench(settings, None).world.scenario, pace=None)
        world.start()
        world.advance(world.scenario.settled_sample + 100)
        self.renderer, self.at_rest = Renderer(world.scenario), world.now
        world.move(300e-6, 5e-6)
        self.line = pipeline.Pipeline(settings)
        self.line.step(*self.frame(0, 0, Phase.BACKGROUND))
        first = self.frame(1, self.at_rest, Phase.REFERENCE)
        began = time.perf_counter()
        self.line.step(*first)
        self.reference_s = time.perf_counter() - began

    def frame(
        self, frame: int, sample: int, phase: Phase = Phase.DRIVE
    ) -> tuple[int, int, np.ndarray, Conditions]:
        """What the pipeline gets of the picture that shows the world at a sample."""
        state = self.world.state(sample)
        now = Conditions(
            phase=phase,
            time_s=(sample - self.at_rest) / self.world.scenario.forces.sample_rate,
            normal_force_n=state.normal_force_n,
            shear_force_n=state.shear_force_n,
            travel_m=state.stage_m,
        )
        return frame, sample, self.renderer.image(state, frame), now


def measure(report: Report, *, frames: int = 60, set_: Sequence[str] = ()) -> None:
    """Send frames through the pipeline and report the budget."""
    drive, spent = Drive(set_), defaultdict(list)
    report.row("reference frame", wall_clock=(1e3 * drive.reference_s, "ms"))
    for name, owner, attribute in stages(drive.line):
        setattr(owner, attribute, timed(name, getattr(owner, attribute), spent))
    drive.line.step = timed("whole frame", drive.line.step, spent)
    for n in range(frames):
        drive.world.advance(DIVISOR * 10)  # every tenth frame, so that they cover a whole drive
        drive.line.step(*drive.frame(2 + n, drive.world.now))
    drive.line.close()
    for name, times in sorted(spent.items(), key=lambda item: -np.median(item[1])):
        wall, cpu = 1e3 * np.median(times, axis=0)
        bound = FRAME_MS if name == "whole frame" else None
        report.row(name, wall_clock=(wall, "ms", bound), processor=(cpu, "ms"))
