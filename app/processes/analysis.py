"""The analysis as a process: it steps a pipeline, frame by frame, for the bench that started it."""

from __future__ import annotations

import os
import secrets
from dataclasses import dataclass
from multiprocessing.connection import Listener
from pathlib import Path
from typing import Any

import numpy as np

from app.evaluation.history import DriveForces
from app.processes.calls import Methods, answer_calls
from app.processes.folder import shared_image
from app.processes.starting import end_with_parent, payload, report_ready
from app.records.effort import Effort
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import Conditions, ContactResult, Phase, Snapshot
from app.settings.sections import Config


@dataclass(frozen=True, slots=True)
class StepAnswer:
    """What a frame has given, and the state of the pipeline after it."""

    snapshot: Snapshot | None
    contact: ContactResult | None
    reference_frame: int | None


def methods_of(config: Config, image_path: Path, pattern: PixelPattern | None) -> Methods:
    """What the bench may call."""
    from app.evaluation.pipeline import Pipeline

    pipeline = Pipeline(config, pattern)
    images = shared_image(image_path, (2, *config.camera.shape), np.dtype(config.camera.dtype))
    images.setflags(write=False)
    is_updated = config.dic.update != "never"

    def image_at(place: int, *, is_kept: bool) -> Any:
        if not is_kept:
            return images[place]
        image = np.array(images[place])  # another one will come there
        image.setflags(write=False)
        return image

    def step(
        index: int,
        sample: int,
        place: int,
        now: Conditions,
        effort: Effort,
        following: tuple[int, int, int, Effort] | None,
    ) -> StepAnswer:
        is_kept = is_updated or now.phase in (Phase.BACKGROUND, Phase.REFERENCE)
        image, after = image_at(place, is_kept=is_kept), None
        if following is not None:
            frame, when, there, asked = following
            after = frame, when, image_at(there, is_kept=is_updated), asked
        snapshot = pipeline.step(index, sample, image, now, effort, after)
        return StepAnswer(snapshot, pipeline.contact, pipeline.reference_frame)

    def restart() -> StepAnswer:
        pipeline.restart()
        return StepAnswer(None, pipeline.contact, pipeline.reference_frame)

    def summary(snapshots: list[Snapshot], forces: DriveForces | None) -> Any:
        pipeline.close()
        return pipeline.summary(snapshots, forces)

    return {"step": step, "restart": restart, "summary": summary}


def main() -> None:
    """Compile, then serve the bench until it lets go."""
    config, image_path, pattern = payload()
    end_with_parent()
    from analysis.kernels import cache_warnings
    from app.evaluation.compiling import compile_analysis
    from app.system.priority import give_way

    give_way(10, to=os.getppid())  # whoever starts this again gives way already
    compile_analysis(config)
    methods = methods_of(config, image_path, pattern)
    key = secrets.token_bytes(32)
    with Listener(authkey=key) as listener:
        report_ready((listener.address, key, cache_warnings))
        with listener.accept() as line:
            answer_calls(line, methods)
