"""The thread that analyses the frames of a live run."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import suppress
from typing import NamedTuple

from app.acquisition.channels import LatestChannel
from app.acquisition.recorder_thread import Recorder
from app.evaluation.frame_analysis import Analysis, Following
from app.evaluation.quality import Quality
from app.records.effort import Effort
from app.records.record_types import RESTART, Event
from app.system.priority import give_way
from drivers.protocols import Frame

LOG = logging.getLogger(__name__)
POLL_S = 0.1
TRIES = 2  # attempts at one frame
# frames that could not be analysed, until the analysis is given up
MOST_FAILURES = 20
MOST_BEFORE_REFERENCE = 3


class _Dequeued(NamedTuple):
    """A frame that has left the queue, when it came there, and what is to be computed of it."""

    frame: Frame
    came_s: float
    effort: Effort


class AnalysisThread:
    """Analyses the frames of a live run, in a thread of its own.

    Attributes
    ----------
    reference_taken : threading.Event
        Set once the reference image is in place.
    """

    def __init__(
        self,
        analysis: Analysis,
        recorder: Recorder,
        frames: LatestChannel[Frame],
        quality: Quality,
    ) -> None:
        self.reference_taken = threading.Event()
        self._quality, self._skipped = quality, 0
        self._ready_s = 0.0  # when the reference was in place
        self._analysis = analysis
        self._recorder = recorder
        self._frames = frames
        self._next: _Dequeued | None = None  # begun while the one before it is analysed
        self._failures = 0

    def is_behind(self, received: int) -> bool:
        """Whether one of so many frames is neither analysed nor skipped."""
        return received > len(self._analysis.series) + self._frames.skipped

    def work(self) -> None:
        """Analyse until the frames end; everything else that needs the processor goes first.

        A frame whose analysis fails is tried once more after a restart, then left out: what is
        measured goes on all the same. Before there is a reference, three such frames end the run.
        """
        try:
            give_way(10)
            while self._next or not self._frames.is_drained:
                taken = self._next or self._take(POLL_S)
                self._next = None
                if taken is not None:
                    self._analyse(*taken)
        except BaseException:
            self._frames.skipped += 1  # the current frame
            raise
        finally:
            self._abandon()  # whatever happened, nobody waits for this thread

    def _take(self, timeout_s: float) -> _Dequeued | None:
        frame = self._frames.get(timeout_s)
        if frame is None:
            return None
        return _Dequeued(frame, time.monotonic() - self._frames.waited_s, self._quality.effort())

    def _look_ahead(self) -> Following | None:
        """The next frame, if it waits already and is sure to be analysed."""
        self._next, history = self._take(0.0), self._analysis.history
        if self._next is None:
            return None
        frame, _, effort = self._next
        is_known = history.wait_for(frame.sample + history.exposure_samples, 0.0)
        return (frame.index, frame.sample, frame.image, effort) if is_known else None

    def _analyse(self, frame: Frame, came_s: float, effort: Effort) -> None:
        history = self._analysis.history
        if not history.wait_for(frame.sample + history.exposure_samples):
            self._frames.skipped += 1  # the forces ended before its exposure did
            return
        waited_s = time.monotonic() - came_s
        following = self._look_ahead() if self.reference_taken.is_set() else None
        for _ in range(TRIES):
            try:
                effort = self._analysis.step(
                    frame.index,
                    frame.sample,
                    frame.image,
                    self._recorder.append,
                    effort,
                    is_certain=frame.is_certain,
                    waited_s=waited_s,
                    following=following,
                )
                break
            except Exception as error:
                LOG.warning("frame %d could not be analysed", frame.index, exc_info=error)
                what = f"frame {frame.index} could not be analysed ({error})"
                self._recorder.append(Event(frame.sample, RESTART, what))
                with suppress(Exception):  # the pipeline tries again at its next step
                    self._analysis.pipeline.restart()
        else:
            self._failures += 1
            self._check_failures(frame, what)
            self._frames.skipped += 1
            return
        if (
            self._analysis.pipeline.reference_frame is not None
            and not self.reference_taken.is_set()
        ):
            if self._analysis.pipeline.contact is not None:  # at once: a run may be cut short
                self._recorder.append(self._analysis.pipeline.contact)
            self.reference_taken.set()
            self._ready_s = time.monotonic()
        else:
            self._keep_up(frame, effort)

    def _keep_up(self, frame: Frame, effort: Effort) -> None:
        """Let more or less be computed of the next frames; every change is an event."""
        skipped, self._skipped = self._frames.skipped - self._skipped, self._frames.skipped
        now_s, spent = time.monotonic(), (effort.waited_s, effort.took_s)
        if now_s - sum(spent) < self._ready_s:  # it has waited for the reference, which takes long
            return
        change = self._quality.took(*spent, skipped, now_s)
        if change:
            LOG.info("frame %d: %s", frame.index, change)
            self._recorder.append(Event(frame.sample, "quality", change))

    def _check_failures(self, frame: Frame, what: str) -> None:
        if not self.reference_taken.is_set() and self._failures >= MOST_BEFORE_REFERENCE:
            raise RuntimeError(what)
        if self._failures == MOST_FAILURES:
            given_up = f"the analysis is given up after {MOST_FAILURES} failures: {what}; slipscope"
            given_up += " replay -o analyses every recorded frame"
            LOG.error("%s", given_up)
            self._recorder.append(Event(frame.sample, "error", given_up))
            self._abandon()

    def _abandon(self) -> None:
        """Take no more frames: what waits, and what comes, is counted as skipped."""
        self._frames.skipped += self._next is not None
        self._next = None
        self._frames.abandon()
