"""The analysis of a live run in a process of its own, with the methods of a pipeline.

The process may die at any time. It is started again at the next frame, and given the background and
the reference; what it had found in between only started its searches.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import Array
from app.evaluation.frame_analysis import Following, FrameAnalysis
from app.evaluation.history import DriveForces
from app.processes.analysis import StepAnswer
from app.processes.calls import Caller, Gone, Silent
from app.processes.folder import shared_image
from app.processes.starting import Process, end, start_process, wait_until_ready
from app.records.effort import Effort
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import Conditions, ContactResult, Phase, Snapshot
from app.records.summary import Summary
from app.settings.sections import Config

LOG = logging.getLogger(__name__)
STEP_S = 20.0  # longest time of one frame; beyond, it is not analysed
LONGEST_STEP_S = 160.0  # after several silences in a row, as of a computer that does much else
CONCLUDES_S = 120.0  # what a run comes down to, on a computer that does much else; nothing moves
CLOSE_S = 5.0
COMPILES_S = 1200.0  # longest time of compiling everything, on a busy computer

Frame = tuple[int, int, Array, Conditions, Effort]


class PipelineProcess(FrameAnalysis):
    """Steps a pipeline in another process.

    Parameters
    ----------
    config : Config
    folder : Path
        Of the bench, for the images that both see.
    on_start : callable
        Told the number of each process that is started.
    pattern : PixelPattern, optional
        What is undone in every picture.
    """

    def __init__(
        self,
        config: Config,
        folder: Path,
        on_start: Callable[[int], None],
        pattern: PixelPattern | None = None,
    ) -> None:
        self.contact: ContactResult | None = None
        self.reference_frame: int | None = None
        self._config, self._on_start, self.pattern = config, on_start, pattern
        self._image_path, self._log = folder / "image-analysis", folder / "analysis.log"
        # of a frame and of the one that follows
        self._images = shared_image(
            self._image_path, (2, *config.camera.shape), np.dtype(config.camera.dtype)
        )
        self._placed, self._place = -1, 0  # the frame that came last, and where it lies
        self._process: Process | None = None
        self._caller: Caller | None = None
        self._background: Frame | None = None
        self._reference: Frame | None = None
        self._closing = threading.Event()
        self._step_s = STEP_S

    def begin(self) -> None:
        """Start the process; returns at once."""
        self._process = start_process(
            "app.processes.analysis", (self._config, self._image_path, self.pattern), self._log
        )
        self._on_start(self._process.pid)

    def wait(self) -> None:
        """Return when the process has compiled what it needs.

        Raises
        ------
        ProcessFailed
        """
        if self._process is None:
            self.begin()
        assert self._process is not None
        try:
            address, key, warnings = wait_until_ready(self._process, self._log, COMPILES_S)
            self._caller = Caller(address, key)
        except BaseException:
            self._let_go()
            raise
        for sentence in warnings:
            LOG.warning("analysis: %s", sentence)

    def step(
        self,
        index: int,
        sample: int,
        image: Array,
        now: Conditions,
        effort: Effort,
        following: Following | None = None,
    ) -> Snapshot:
        """As of a pipeline.

        Raises
        ------
        RuntimeError, ConnectionError, TimeoutError
            The frame cannot be analysed, the process is gone, or says nothing.
        """
        frame = (index, sample, image, now, effort)
        had_reference = self.reference_frame is not None
        if self._caller is None:
            self._begin_again()
        snapshot = self._step(frame, following)
        if now.phase is Phase.BACKGROUND:
            self._background = frame
        if not had_reference and self.reference_frame is not None:
            self._reference = frame
        return snapshot

    def restart(self) -> None:
        """As of a pipeline; a process that is gone is replaced at the next frame."""
        if self._caller is not None:
            try:
                self._take(self._call("restart"))
            except Exception as error:
                LOG.warning("the analysis does not restart", exc_info=error)
                self._let_go()

    def summary(self, snapshots: list[Snapshot], forces: DriveForces | None = None) -> Summary:
        """As of a pipeline."""
        if self._caller is None:
            self._begin_again()
        try:
            summary = self._call("summary", snapshots, forces, answer_s=CONCLUDES_S)
        except (Gone, Silent):
            self._begin_again()
            summary = self._call("summary", snapshots, forces, answer_s=CONCLUDES_S)
        assert isinstance(summary, Summary)
        return summary

    def close(self) -> None:
        """As of a pipeline: nothing is analysed any more, the summary can still be had."""

    def end(self) -> None:
        """Let the process end. May be called from any thread, at any time."""
        self._closing.set()
        self._let_go()

    def _begin_again(self) -> None:
        if self._closing.is_set():
            raise Gone("analysis: it has been ended")
        LOG.warning("the analysis is started again")
        self._let_go()
        self.wait()
        for frame in (self._background, self._reference):
            if frame is not None:
                self._step(frame)

    def _share(self, index: int, image: Array) -> int:
        """Which of the two shared images is that of a frame: the one that the frame before has not,
        unless it came as the following one.
        """
        if index != self._placed:
            self._placed, self._place = index, 1 - self._place
            np.copyto(self._images[self._place], image)
        return self._place

    def _step(self, frame: Frame, following: Following | None = None) -> Snapshot:
        index, sample, image, now, effort = frame
        shared = index, sample, self._share(index, image), now, effort
        after = None
        if following is not None:
            number, when, picture, asked = following
            after = number, when, self._share(number, picture), asked
        try:
            answer = self._call("step", *shared, after, answer_s=self._step_s)
        except Silent:  # a process that is started anew would come no further in the same time
            self._step_s = min(2 * self._step_s, LONGEST_STEP_S)
            raise
        self._step_s = STEP_S
        self._take(answer)
        snapshot = answer.snapshot
        assert isinstance(snapshot, Snapshot)
        return snapshot

    def _take(self, answer: StepAnswer) -> None:
        if answer.reference_frame != self.reference_frame:  # else it is the same contact
            self.contact = answer.contact
        self.reference_frame = answer.reference_frame

    def _call(self, name: str, *arguments: Any, answer_s: float = STEP_S) -> Any:
        assert self._caller is not None
        try:
            return self._caller(name, *arguments, answer_s=answer_s)
        except (Gone, Silent):
            self._let_go()
            raise

    def _let_go(self) -> None:
        caller, process = self._caller, self._process
        self._caller = self._process = None
        if process is None:
            return
        if caller is None or not self._closing.is_set():
            process.kill()
        if caller is not None:
            caller.close()
        for pipe in filter(None, (process.stdin, process.stdout)):
            pipe.close()
        end(process, CLOSE_S)  # it ends as its standard input does
