"""The way to the disk: everything that was measured, in the order it came, through bounded queues
that never drop anything.

Forces and images have a queue and a thread each, so that neither waits for the other, and what
brings them to the disk has threads of its own, so that a slow disk holds nobody up.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol

import psutil

from app.acquisition.channels import ChannelClosed, ChannelFull, LosslessChannel
from app.records.record_types import ContactResult, Event, Gap, Record, Samples, Snapshot
from app.system.disk import free_bytes
from app.system.priority import give_way
from drivers.protocols import Frame, LostFrame

LOG = logging.getLogger(__name__)

POLL_S = 0.1
SMALL_QUEUE_BYTES = 1 << 24  # minutes of forces
# these go with the images, in their order
WITH_IMAGES = (Frame, LostFrame, Snapshot, ContactResult)


class RecordSink(Protocol):
    """Where records go."""

    def append(self, record: Record, /) -> None: ...
    def flush(self) -> None: ...


class SessionSink(RecordSink, Protocol):
    """Where a run is recorded. Images and results come from one thread, all else from another, and
    each of `syncs` is called from its own.
    """

    @property
    def path(self) -> Path: ...  # where it is
    @property
    def receipt(self) -> object: ...  # after `close`: what is there, as a sentence by str()
    @property
    def syncs(self) -> Sequence[Callable[[], None]]: ...  # each brings some of it to the disk

    def close(self) -> None: ...


def held_bytes(record: Record) -> int:
    """Memory that a record takes while it waits for the disk, or as it is written."""
    match record:
        case Frame():
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


def in_words(record: Event | Gap | LostFrame) -> str:
    """A record as the log has it."""
    match record:
        case Event():
            return f"{record.kind}: {record.text} (sample {record.sample})"
        case Gap():
            return f"{record.count} samples from {record.first} on are lost: {record.reason}"
    return f"trigger {record.index} has no image: {record.reason} (sample {record.sample})"


def _refused(frame: Frame) -> LostFrame:
    return LostFrame(frame.index, frame.sample, "it could not be recorded", frame.first, frame.last)


class Recorder:
    """Hands records from any thread to the sink.

    Parameters
    ----------
    queue_s, bytes_per_s : float
        Seconds of data that may wait, and how much a second of it is.
    sender_waits : bool
        True where the sources wait for the disk (free-running simulation).
    on_failure : callable
        Called with one sentence when the sink cannot be written any more, or when a queue is full.
        It must stop what moves: after a full queue all senders wait for the disk, so that whatever
        was measured until everything stood is recorded.

    Attributes
    ----------
    frames_recorded, frames_refused : int
        Frames that the sink has, and those that it did not take: these are recorded as lost, as
        long as anything can be.
    disk_free_bytes : int
        Room for the session when an image was last written, negative before the first: who asks
        need not wait for the disk.
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
        self.frames_recorded = self.frames_refused = 0
        self.peak_memory_bytes = 0
        self._sink = sink
        self.disk_free_bytes = -1
        self._flush_interval_s = flush_interval_s
        self._on_failure = on_failure
        self._images: LosslessChannel[Record] = LosslessChannel(
            int(queue_s * bytes_per_s), sender_waits=sender_waits
        )
        self._small: LosslessChannel[Record] = LosslessChannel(
            SMALL_QUEUE_BYTES, sender_waits=sender_waits
        )
        self._is_over = threading.Event()

    @property
    def fill(self) -> float:
        """Share of the fuller queue in use, 0 to 1."""
        return max(self._images.fill, self._small.fill)

    def append(self, record: Record) -> None:
        """Queue a record; where there is no room for it, report the failure and wait for the
        disk.
        """
        if isinstance(record, Event | Gap | LostFrame):
            LOG.info("%s", in_words(record))
        queue = self._images if isinstance(record, WITH_IMAGES) else self._small
        try:
            try:
                queue.put(record, held_bytes(record))
            except ChannelFull:
                self._on_failure(
                    f"recorder: the disk is slower than the data, {self.queue_s:g} s of it wait and"
                    " the queue holds no more; record to a faster disk, or fewer frames by a larger"
                    " camera.divisor; a larger recording.queue bridges longer pauses"
                )
                queue.sender_waits = True
                queue.put(record, held_bytes(record))
        except ChannelClosed:  # its failure was reported; the run is ending
            self.frames_refused += isinstance(record, Frame)

    def works(self) -> Iterator[tuple[str, Callable[[], None]]]:
        """What the recorder does, by name, each for a thread of its own; all of it returns when
        everything is written after `end`.
        """
        yield "recorder", self._write_images
        yield "journal", self._write_small
        for n, sync in enumerate(self._sink.syncs):
            yield f"sync-{n}", partial(self._sync, sync)

    def end(self) -> None:
        """Nothing more will come."""
        self._images.end()
        self._small.end()
        self._is_over.set()

    def _write_images(self) -> None:
        try:
            give_way(3)  # its queue can wait, a stop cannot
            self._take_images()
        finally:  # whatever happened, nobody waits for this thread
            left = self._images.break_off()
            self.frames_refused += sum(isinstance(record, Frame) for record in left)

    def _take_images(self) -> None:
        has_failed, is_refused, due = False, False, 0.0
        while not self._images.is_drained:
            record = self._images.get(POLL_S)
            if record is None:
                continue
            is_frame, is_taken = isinstance(record, Frame), False
            try:
                if isinstance(record, Frame) and is_refused:
                    record = _refused(record)
                self._sink.append(record)
                is_taken = isinstance(record, Frame)
            except Exception as error:
                if not has_failed:
                    self._fail(error)
                has_failed = True
                if isinstance(record, Frame):
                    is_refused = True  # so are all after it; results that fail cost no image
                    with contextlib.suppress(Exception):
                        self._sink.append(_refused(record))
            finally:
                self.frames_recorded += is_taken
                self.frames_refused += is_frame and not is_taken
            if time.monotonic() >= due:
                with contextlib.suppress(psutil.Error):
                    used = psutil.Process().memory_info().rss
                    self.peak_memory_bytes = max(self.peak_memory_bytes, used)
                with contextlib.suppress(OSError):
                    self.disk_free_bytes = free_bytes(self._sink.path)
                due = time.monotonic() + self._flush_interval_s

    def _write_small(self) -> None:
        try:
            while not self._small.is_drained:
                record = self._small.get(POLL_S)
                if record is not None:
                    self._sink.append(record)
        except Exception as error:
            self._fail(error)
        finally:
            self._small.break_off()

    def _sync(self, sync: Callable[[], None]) -> None:
        """Sync at the interval, from the beginning of one to that of the next, so that a slow disk
        costs no safety; a failure is reported once.
        """
        try:
            give_way(3)
            while not self._is_over.is_set():
                began = time.monotonic()
                sync()
                if (took := time.monotonic() - began) > self._flush_interval_s:
                    LOG.warning("a flush to the disk took %.2f s", took)
                self._is_over.wait(max(self._flush_interval_s - took, POLL_S))
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        LOG.debug("the session cannot be written", exc_info=error)
        self._on_failure(f"recorder: the session cannot be written: {error}")
