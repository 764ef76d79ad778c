"""The way to the disk: everything that was measured, in the order it came, through one bounded
queue that never drops anything.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Protocol

import psutil

from app.engine.channels import ChannelClosed, ChannelFull, LosslessChannel
from app.priority import give_way
from app.records import Event, Gap, LostTrigger, ReceivedFrame, Record, Samples, Snapshot

LOG = logging.getLogger(__name__)

POLL_S = 0.1


class SessionSink(Protocol):
    """Where a run is recorded; called from one thread at a time."""

    @property
    def receipt(self) -> object: ...  # after `close`: what is there, as a sentence by str()

    def append(self, record: Record, /) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


def held_bytes(record: Record) -> int:
    """Memory that a record takes while it waits for the disk, or as it is written."""
    match record:
        case ReceivedFrame():
            return record.image.nbytes
        case Samples():
            further = 0 if record.auxiliary is None else record.auxiliary.nbytes
            return record.volts.nbytes + record.forces.nbytes + further
        case Gap():
            return 32 * record.count
        case Snapshot():
            field = record.field
            return 2000 + (0 if field is None else 5 * field.ux_px.nbytes + field.status.nbytes)
    return 100


class Recorder:
    """Hands records from any thread to the sink, which only `work` touches.

    Parameters
    ----------
    queue_s, bytes_per_s : float
        Seconds of data that may wait, and how much a second of it is.
    sender_waits : bool
        True where the sources wait for the disk (free-running simulation).
    on_failure : callable
        Called with one sentence when the sink can not be written any more, or when the queue is
        full. It must stop what moves: after a full queue all senders wait for the disk, so that
        whatever was measured until everything stood is recorded.
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
        self._queue: LosslessChannel[Record] = LosslessChannel(
            int(queue_s * bytes_per_s), sender_waits=sender_waits
        )

    @property
    def fill(self) -> float:
        """Share of the queue in use, 0 to 1."""
        return self._queue.fill

    def append(self, record: Record) -> None:
        """Queue a record; where there is no room for it, report the failure and wait for the
        disk.
        """
        if isinstance(record, Event | Gap | LostTrigger):
            LOG.info("%s", record)
        try:
            try:
                self._queue.put(record, held_bytes(record))
            except ChannelFull:
                self._on_failure(
                    f"recorder: the disk is slower than the data, {self.queue_s:g} s of it wait and"
                    " the queue holds no more; record to a faster disk, or fewer frames by a larger"
                    " camera.divisor; a larger recording.queue bridges longer pauses"
                )
                self._queue.sender_waits = True
                self._queue.put(record, held_bytes(record))
        except ChannelClosed:
            pass  # the failure has been reported already; the run is ending

    def end(self) -> None:
        """Nothing more will come; `work` returns when everything is written."""
        self._queue.end()

    def work(self) -> None:
        """Write until the end, flushing at the interval. A failure closes the queue and is
        reported; what was flushed before is safe.

        The interval runs from the beginning of a flush to the next, so that a slow flush costs no
        safety; half of it is left to write in.
        """
        give_way(3)  # its queue can wait, a stop can not
        process = psutil.Process()
        due = time.monotonic() + self._flush_interval_s
        try:
            while not self._queue.is_drained:
                record = self._queue.get(POLL_S)
                if record is not None:
                    self._sink.append(record)
                    self.frames_recorded += isinstance(record, ReceivedFrame)
                began = time.monotonic()
                if began >= due:
                    self._sink.flush()
                    if (took := time.monotonic() - began) > self._flush_interval_s:
                        LOG.warning("a flush to the disk took %.2f s", took)
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
