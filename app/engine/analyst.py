"""From frames to results: the analysis of an experiment, and the thread that does it in a
live run.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.effort import Effort
from app.engine.channels import LatestChannel
from app.engine.damage import Damage
from app.engine.history import History
from app.engine.quality import Quality
from app.engine.recorder import Recorder
from app.engine.series import Series
from app.priority import give_way
from app.records import RESTART, Conditions, ContactResult, Event, Snapshot
from app.settings import Config
from app.summary import Summary
from drivers.protocols import Frame

LOG = logging.getLogger(__name__)
POLL_S = 0.1
TRIES = 2  # of a frame
# frames that could not be analysed, until the analysis is given up
MOST_FAILURES = 20
MOST_BEFORE_REFERENCE = 3


class FrameAnalysis(Protocol):
    """What analyses frame by frame, here (`app.engine.pipeline`) or in a process of its own."""

    contact: ContactResult | None
    reference_frame: int | None

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        now: Conditions,
        effort: Effort,
    ) -> Snapshot: ...
    def restart(self) -> None: ...
    def summary(self, snapshots: list[Snapshot]) -> Summary: ...
    def close(self) -> None: ...


class Analysis:
    """An experiment on its way from frames to results, live or recorded.

    Only here the pipeline is stepped. One thread steps; the rest may be read from any.

    Attributes
    ----------
    history : History
        What the bench has measured so far.
    pipeline : FrameAnalysis
    reference_image : ndarray or None
        From which displacements are measured.
    series : Series
        One snapshot per analysed frame.
    uncertain : set of int
        Those of them that another trigger may have taken.
    damage : Damage
        Of their pictures.
    """

    def __init__(self, config: Config, pipeline: FrameAnalysis) -> None:
        self.config = config
        self.history = History(
            float(config.forces.sample_rate), config.exposure_samples, config.run.direction
        )
        self.pipeline = pipeline
        self.reference_image: NDArray[np.generic] | None = None
        self.series = Series()
        self.uncertain: set[int] = set()
        self._revoked_from: int | None = None
        self.damage = Damage()

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        append: Callable[[Event | Snapshot], None],
        effort: Effort,
        *,
        is_certain: bool = True,
        waited_s: float | None = None,
    ) -> Effort:
        """Analyse the next frame and append the result to the record; what it took, too, where it
        is said for how long the frame has waited.

        Everything up to the end of its exposure must be in the history.
        """
        began = time.perf_counter()
        now = self.history.conditions(sample)
        snapshot = self.pipeline.step(index, sample, image, now, effort)
        if waited_s is not None:
            effort = replace(effort, took_s=time.perf_counter() - began, waited_s=waited_s)
            snapshot = replace(snapshot, effort=effort)
        if self.pipeline.reference_frame == index:
            self.reference_image = image
            append(Event(sample, "reference", f"frame {index}"))
        has_fields = self.config.recording.results == "fields"
        append(snapshot if has_fields else replace(snapshot, field=None))
        if not is_certain:
            self.uncertain.add(index)
        self.series.append(snapshot)
        self.damage = self.damage.after(snapshot)
        return effort

    def revoke(self, first: int | None) -> None:
        """No frame from `first` on is of a certain trigger: the account of the run does not hold;
        None if it does. To be called when all frames are analysed.
        """
        if first is None:
            return
        self._revoked_from = first
        self.uncertain |= {one.frame for one in self.series.since(0) if one.frame >= first}

    def close(self) -> None:
        """Let the threads of the correlation go. May be called twice."""
        self.pipeline.close()

    def summary(self) -> Summary | None:
        """What the experiment comes down to, once it is closed; None if no frame was analysed.

        Frames whose trigger is uncertain are left out, unless they are more than half of all.
        """
        snapshots, doubtful = self.series.since(0), len(self.uncertain)
        if not snapshots:
            return None
        used, notes = snapshots, []
        if doubtful:
            why = ""
            if self._revoked_from is not None:
                why = f", from frame {self._revoked_from} on because the account does not hold"
            many = 2 * doubtful > len(snapshots)
            used = snapshots if many else [s for s in snapshots if s.frame not in self.uncertain]
            notes.append(
                f"camera: the trigger of {doubtful} of {len(snapshots)} frames is uncertain{why}; "
                + ("the results rest on them too" if many else "the results do without them")
            )
        summary = self.pipeline.summary(used)
        if self.damage.pictures:
            notes.append(f"camera: {self.damage}")
        return replace(summary, notes=(*summary.notes, *notes))


class Analyst:
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
            while not self._frames.is_drained:
                frame = self._frames.get(POLL_S)
                if frame is not None:
                    self._analyse(frame)
        except BaseException:
            self._frames.skipped += 1  # the current frame
            raise
        finally:
            self._frames.abandon()  # whatever happened, nobody waits for this thread

    def _analyse(self, frame: Frame) -> None:
        history = self._analysis.history
        if not history.wait_for(frame.sample + history.exposure_samples):
            self._frames.skipped += 1  # the forces ended before its exposure did
            return
        effort, waited_s = self._quality.effort(), self._frames.waited_s
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
            self._frames.abandon()
