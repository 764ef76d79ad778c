"""The bench as a process: devices, control and recorder of one run."""

from __future__ import annotations

import gc
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from app.acquisition.run import Run
from app.evaluation.setup import pattern_of
from app.processes.calls import Methods
from app.processes.folder import image_publisher
from app.processes.making import make_session_in_a_process
from app.processes.pipeline_process import PipelineProcess
from app.processes.serving import LINGERS_AFTER_S, ServedBench, known_bench, serve
from app.processes.starting import Launch, RunOrder
from app.processes.supervision import Motion
from app.records.run_view import RunView
from app.runs import live
from app.system.errors import UserError

LOG = logging.getLogger(__name__)

LINGERS_BEFORE_S = 10.0  # while nobody calls


class ServedRun(ServedBench):
    """A run."""

    def __init__(self, launch: Launch) -> None:
        super().__init__(launch)
        order: RunOrder = launch.order
        config = order.config
        self.pipeline = PipelineProcess(
            config, self.folder, lambda pid: self.publish(analysis_pid=pid), pattern_of(config)
        )
        self.pipeline.begin()  # it takes a while, and so do the devices
        self.run: Run = live.make_run(
            config,
            order.output,
            pace=order.pace,
            overwrite=order.overwrite,
            pipeline=self.pipeline,
            wrap=lambda bench: self.supervised(bench, config.limits, self._motion),
            prepare_analysis=self._prepare_analysis,
            make=make_session_in_a_process,
        )
        self.bench = replace(self.bench, title=self.run.title, session=str(order.output.resolve()))
        self._numbers: Iterator[int] = count()

    def _motion(self) -> Motion:
        return self.run.motion()

    def _prepare_analysis(self) -> None:
        self.pipeline.wait()
        # a look at all that was loaded takes 0.1 s with every thread at a stand, also the one
        # that stops the motion
        gc.collect()
        gc.freeze()

    def methods(self) -> Methods:
        """What one connection may call."""
        return {
            "start": lambda: self.run.start() if self.run.health().state == "idle" else None,
            **methods_of(self.run, self.folder, next(self._numbers)),
        }

    @property
    def lingers_s(self) -> float:
        """How long a run that has ended, or never begins, goes on while nobody calls."""
        if self.run.health().state == "idle":
            return LINGERS_BEFORE_S
        return LINGERS_AFTER_S if self.run.wait(0.0) else math.inf

    def stop(self, reason: str) -> None:
        """End the run."""
        self.run.request_stop(reason)

    def close(self) -> None:
        """Let go of the analysis; the run has ended."""
        self.pipeline.end()
        self.has_ended.set()


def methods_of(run: Run, folder: Path, number: int) -> Methods:
    """What a connection may call of a run, whose images it shares under that number in a folder."""
    share = {
        "contact": lambda contact: contact,
        "image": image_publisher(folder, f"image-{number}"),
        "reference": image_publisher(folder, f"reference-{number}"),
    }
    sent: dict[str, Any] = {}  # and held, so that nothing newer can be taken for it

    def look(seen: int, is_shown: bool) -> tuple[RunView, dict[str, Any]]:
        view, new = run.look(seen, is_shown=is_shown), {}
        for name, shared in [*share.items()]:
            newest = getattr(view, name)
            if newest is None or newest is sent.get(name):
                continue
            try:
                sent[name], new[name] = newest, shared(newest)
            except UserError as error:  # the run goes on, unseen by this caller
                LOG.warning("%s", error)
                del share[name]
        return replace(view, contact=None, image=None, reference=None), new

    return {
        "about": lambda: (run.config, run.title, run.health()),
        "stop_motion": run.stop_motion,
        "stop_answer": run.stop_answer,
        "request_stop": run.request_stop,
        "answer": run.answer,
        "note": run.note,
        "pause": run.pause,
        "cancel_pause": run.cancel_pause,
        "look": look,
    }


@contextmanager
def known(run: Run) -> Iterator[None]:
    """Let windows, terminals and `slipscope stop` find and call a run of this process meanwhile.

    Raises
    ------
    UserError
        The folder of the benches cannot be written, or is not this user's alone.
    """
    numbers = count()
    with known_bench(
        run.title,
        lambda folder: methods_of(run, folder, next(numbers)),
        session=str(run.output.resolve()),
    ):
        yield


def main() -> None:
    """Serve a run."""
    serve(ServedRun)
