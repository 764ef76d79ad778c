"""From frames to results: the analysis of an experiment, and the thread that does it in a
live run.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.engine.channels import LatestChannel
from app.engine.history import History
from app.engine.pipeline import Pipeline, summarise
from app.engine.priority import give_way
from app.engine.recorder import Recorder
from app.engine.series import Series
from app.records import Event, Snapshot, Summary
from app.settings import Config
from drivers.protocols import Frame

POLL_S = 0.1


class Analysis:
    """An experiment on its way from frames to results, live or recorded.

    Only here the pipeline is stepped. One thread steps; the rest may be read from any.

    Attributes
    ----------
    history : History
        What the bench has measured so far.
    pipeline : Pipeline
    series : Series
        One snapshot per analysed frame.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self.history = History(float(config.forces.sample_rate), config.exposure_samples)
        self.pipeline = Pipeline(config)
        self.series = Series()

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        append: Callable[[Event | Snapshot], None],
    ) -> None:
        """Analyse the next frame and append the result to the record.

        Everything up to the end of its exposure must be in the history.
        """
        snapshot = self.pipeline.step(index, sample, image, self.history.conditions(sample))
        if self.pipeline.reference_frame == index:
            append(Event(sample, "reference", f"frame {index}"))
        append(snapshot)
        self.series.append(snapshot)

    def close(self) -> None:
        """Let the threads of the correlation go. May be called twice."""
        self.pipeline.close()

    def summary(self) -> Summary | None:
        """What the experiment comes down to, once it is closed; None if no frame was analysed."""
        snapshots = self.series.since(0)
        if not snapshots:
            return None
        return summarise(self.config, snapshots, self.pipeline.contact, self.pipeline.notes)


class Analyst:
    """Analyses the frames of a live run, in a thread of its own.

    Attributes
    ----------
    reference_taken : threading.Event
        Set once the reference image is in place.
    """

    def __init__(
        self, analysis: Analysis, recorder: Recorder, frames: LatestChannel[Frame]
    ) -> None:
        self.reference_taken = threading.Event()
        self._analysis = analysis
        self._recorder = recorder
        self._frames = frames

    def work(self) -> None:
        """Analyse until the frames end; everything else that needs the processor goes first."""
        give_way()
        try:
            while not self._frames.is_drained:
                frame = self._frames.get(POLL_S)
                if frame is not None:
                    self._analyse(frame)
        except Exception:
            self._frames.skipped += 1  # the current frame
            raise
        finally:
            self._frames.abandon()  # whatever happened, nobody waits for this thread

    def _analyse(self, frame: Frame) -> None:
        history = self._analysis.history
        if not history.wait_for(frame.sample + history.exposure_samples):
            self._frames.skipped += 1  # the forces ended before its exposure did
            return
        self._analysis.step(frame.index, frame.sample, frame.image, self._recorder.append)
        if self._analysis.pipeline.reference_frame is not None:
            self.reference_taken.set()
