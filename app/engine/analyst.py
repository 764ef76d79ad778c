"""The analysis side of a run: one pipeline step per frame that gets here."""

from __future__ import annotations

import threading

from app.engine.channels import LatestChannel
from app.engine.history import History
from app.engine.pipeline import Pipeline
from app.engine.priority import give_way
from app.engine.recorder import Recorder
from app.engine.series import Series
from app.records import Event
from drivers.protocols import Frame

POLL_S = 0.1


class Analyst:
    """Steps the pipeline frame by frame and keeps the series.

    Attributes
    ----------
    series : Series
        One snapshot per analysed frame.
    reference_taken : threading.Event
        Set once the reference image is in place.
    """

    def __init__(
        self, pipeline: Pipeline, history: History, recorder: Recorder, frames: LatestChannel[Frame]
    ) -> None:
        self.series = Series()
        self.reference_taken = threading.Event()
        self._pipeline = pipeline
        self._history = history
        self._recorder = recorder
        self._frames = frames

    def work(self) -> None:
        """Analyse until the frames end, after all else that wants the processor."""
        give_way()
        try:
            while not self._frames.is_drained:
                frame = self._frames.get(POLL_S)
                if frame is not None:
                    self._analyse(frame)
        except Exception:
            self._frames.skipped += 1  # the frame in hand
            raise
        finally:
            self._frames.abandon()  # whatever happened, nobody waits for us

    def _analyse(self, frame: Frame) -> None:
        if not self._history.wait_for(frame.sample + self._history.exposure_samples):
            self._frames.skipped += 1  # the forces ended before its exposure did
            return
        snapshot = self._pipeline.step(
            frame.index, frame.sample, frame.image, self._history.conditions(frame.sample)
        )
        if self._pipeline.reference_frame == frame.index:
            self._recorder.append(Event(frame.sample, "reference", f"frame {frame.index}"))
            self.reference_taken.set()
        self.series.append(snapshot)
        self._recorder.append(snapshot)
