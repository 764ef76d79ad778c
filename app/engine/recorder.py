"""The way to the disk: everything that was measured, in the order it came, through one bounded
queue that never drops.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import psutil
from numpy.typing import NDArray

from app.engine.channels import ChannelClosed, ChannelFull, LosslessChannel
from app.results import ContactResult, Event, Outcome, Snapshot
from drivers.protocols import Frame, LostFrame, LostSamples

POLL_S = 0.1


class SessionSink(Protocol):
    """Where a run is recorded; called from one thread at a time."""

    @property
    def receipt(self) -> object: ...  # after `close`: what is there, as a sentence by str()

    def append_samples(
        self, first: int, volts: NDArray[np.float64], forces: NDArray[np.float64]
    ) -> None: ...
    def append_gap(self, first: int, count: int, reason: str) -> None: ...
    def append_frame(self, index: int, sample: int, image: NDArray[Any]) -> None: ...
    def append_lost_frame(self, index: int, sample: int, reason: str) -> None: ...
    def append_position(self, sample: int, position_m: float) -> None: ...
    def append_event(self, event: Event) -> None: ...
    def append_snapshot(self, snapshot: Snapshot) -> None: ...
    def write_contact(self, contact: ContactResult) -> None: ...
    def finish(self, outcome: Outcome) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


class Recorder:
    """Hands measurements from any thread to the sink, which only `work` touches.

    Parameters
    ----------
    queue_s, bytes_per_s : float
        Seconds of data that may wait, and how much a second of it is.
    sender_waits : bool
        True where the sources wait for the disk (free-running simulation).
    on_failure : callable
        Told one sentence when the sink can not be written any more, or when the queue is full. It
        must stop what moves: after a full queue all senders wait for the disk, so that whatever was
        measured until everything stood is recorded.
    """

    def __init__(
        self,
        sink: SessionSink,
        queue_s: float,
        bytes_per_s: float,
        flush_interval_s: float,
        *,
        sender_waits: bool,
        on_failure: Callable[[str], None],
    ) -> None:
        self.queue_s = queue_s
        self.frames_recorded = 0
        self.peak_memory_bytes = 0
        self._sink = sink
        self._flush_interval_s = flush_interval_s
        self._on_failure = on_failure
        self._queue: LosslessChannel[Callable[[], None]] = LosslessChannel(
            int(queue_s * bytes_per_s), sender_waits=sender_waits
        )

    @property
    def fill(self) -> float:
        """Share of the queue in use, 0 to 1."""
        return self._queue.fill

    def samples(self, first: int, volts: NDArray[np.float64], forces: NDArray[np.float64]) -> None:
        """Record a block of readings and the forces they mean."""
        self._put(
            lambda: self._sink.append_samples(first, volts, forces), volts.nbytes + forces.nbytes
        )

    def gap(self, lost: LostSamples) -> None:
        """Record that samples are missing."""
        self._put(
            lambda: self._sink.append_gap(lost.first, lost.count, lost.reason), 32 * lost.count
        )

    def position(self, sample: int, position_m: float) -> None:
        """Record where the stage was at `sample`."""
        self._put(lambda: self._sink.append_position(sample, position_m), 100)

    def event(self, event: Event) -> None:
        """Record an event."""
        self._put(lambda: self._sink.append_event(event), 100)

    def frame(self, frame: Frame) -> None:
        """Record an image."""

        def write() -> None:
            self._sink.append_frame(frame.index, frame.sample, frame.image)
            self.frames_recorded += 1

        self._put(write, frame.image.nbytes)

    def lost_frame(self, lost: LostFrame) -> None:
        """Record that a trigger gave no image."""
        self._put(lambda: self._sink.append_lost_frame(lost.index, lost.sample, lost.reason), 100)

    def snapshot(self, snapshot: Snapshot) -> None:
        """Record the results of a frame."""
        self._put(
            lambda: self._sink.append_snapshot(snapshot),
            5 * snapshot.ux_px.nbytes + snapshot.status.nbytes + 2000,
        )

    def contact(self, contact: ContactResult) -> None:
        """Record the apparent contact."""
        self._put(lambda: self._sink.write_contact(contact), contact.profile_grey.nbytes * 2)

    def end(self) -> None:
        """Nothing more will come; `work` returns when everything is written."""
        self._queue.end()

    def work(self) -> None:
        """Write until the end, flushing at the interval. A failure closes the queue and is told;
        what was flushed is safe.

        The interval runs from the begin of a flush to the next, so that a slow one costs no safety;
        half of it is left to write in.
        """
        process = psutil.Process()
        due = time.monotonic() + self._flush_interval_s
        try:
            while not self._queue.is_drained:
                write = self._queue.get(POLL_S)
                if write is not None:
                    write()
                began = time.monotonic()
                if began >= due:
                    self._sink.flush()
                    due = max(
                        began + self._flush_interval_s,
                        time.monotonic() + self._flush_interval_s / 2,
                    )
                    self.peak_memory_bytes = max(self.peak_memory_bytes, process.memory_info().rss)
            self._sink.flush()
        except Exception as error:
            self._queue.break_off()
            self._on_failure(
                f"recorder: the session can not be written: {error}; everything flushed before is"
                " safe"
            )

    def _put(self, write: Callable[[], None], nbytes: int) -> None:
        """Queue one write; where there is no room for it, name the end and wait for the disk."""
        try:
            try:
                self._queue.put(write, nbytes)
            except ChannelFull:
                self._on_failure(
                    f"recorder: the disk is slower than the data, {self.queue_s:g} s of it wait and"
                    " the queue holds no more;"
                    " record to a faster disk, or fewer frames by a larger camera.divisor; a larger"
                    " recording.queue bridges longer pauses"
                )
                self._queue.sender_waits = True
                self._queue.put(write, nbytes)
        except ChannelClosed:
            pass  # the failure has been told already; the run is ending
