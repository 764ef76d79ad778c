"""Experiments on the simulated and on the emulated bench: what the benchmarks need of the program
to run one, and its account.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.acquisition.run import Run
from app.evaluation.compiling import compile_analysis
from app.records.record_types import Outcome
from app.runs import live
from app.settings import config
from app.settings.sections import Config
from benchmarks.report import Report
from drivers.bench import Bench
from drivers.sim.truth import TrueState
from drivers.sim.world import World

NOTHING_LOST = dict.fromkeys(
    ("frames lost", "triggers without a frame or a named loss", "samples lost"), 0
)


@dataclass(frozen=True)
class Experiment:
    """A run that was not started yet, its settings and its bench."""

    settings: Config
    bench: Bench
    run: Run

    def outcome(self) -> Outcome:
        """Run to the end."""
        self.run.start()
        outcome = self.run.wait()
        assert outcome is not None
        return outcome


def experiment(
    path: Path, overrides: Sequence[str], *, bench: str | None = None, pace: float | None = 1.0
) -> Experiment:
    """An experiment that records to `path`, with everything compiled; pace None is as fast as the
    machine.
    """
    settings = config.load(Path(bench) if bench else None, overrides)
    live.prepare(settings, partial(compile_analysis, settings), lambda what: None)
    made = live.make_bench(settings, pace)
    return Experiment(
        settings, made, live.make_run(settings, path, pace=pace, overwrite=True, bench=made)
    )


def account(
    report: Report, outcome: Outcome, bounds: Mapping[str, float] = NOTHING_LOST, column: str = ""
) -> None:
    """Report what became of every frame and sample of a run, its cost, and how it ended."""
    counts, cost = outcome.counts, outcome.resources
    fates = counts.frames_recorded + counts.frames_lost
    for name, value, unit in (
        ("frames recorded", counts.frames_recorded, ""),
        ("frames lost", counts.frames_lost, ""),
        ("frames not analysed live", counts.frames_skipped, ""),
        ("triggers without a frame or a named loss", counts.triggers - fates, ""),
        ("samples recorded", counts.samples, ""),
        ("samples lost", counts.samples_lost, ""),
        ("processor", cost["cpu_s"] / cost["wall_s"], "cores"),
        ("duration", cost["wall_s"], "s"),
        ("largest memory", cost["peak_memory_mib"], "MiB"),
        ("end of the run", outcome.reason, ""),
    ):
        report.add(name, value, unit, bounds.get(name), column=column)


def middle_of_exposure(world: World, sample: Any) -> Any:
    """The sample whose state a frame shows that began its exposure at `sample`."""
    return sample + world.scenario.exposure_samples // 2


def lens_centre_px(world: World, state: TrueState) -> np.ndarray:
    """Centre (x, y) of the contact in the image."""
    return np.array(state.lens_centre_m) / world.scenario.camera.pixel
