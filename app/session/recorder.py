"""Records a session while it happens, in three files that only grow: images, journal, results.

Nothing that can break a program touches them: HDF5 comes at the close, when `completing` makes the
session of them, and in another process if there is one. A program that is killed loses nothing that
it was given; what a power cut takes is what was not synced yet. `slipscope repair` makes the same
session of the three files as the close does.
"""

from __future__ import annotations

import errno
import logging
import zlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Self
from zlib import crc32

import numpy as np

from analysis.arrays import Array
from app.records.record_types import (
    ContactResult,
    Event,
    Gap,
    Header,
    Outcome,
    Position,
    Record,
    Samples,
    Snapshot,
)
from app.session import trust
from app.session.checks import (
    check_channels,
    check_image,
    check_missing,
    check_place,
    check_snapshot,
)
from app.session.files import (
    RESERVE_BYTES,
    being_recorded,
    check_room,
    images_of,
    next_free,
    remove_recorded,
    results_of,
)
from app.session.journal import Journal, StoredFrame, journal_of
from app.system.disk import AppendedFile, DiskError, largest_file, sync_folder, take_place
from app.system.errors import UserError
from app.system.time_of_day import now
from drivers.protocols import Frame, LostFrame

if TYPE_CHECKING:
    from app.session.receipt import Receipt

# makes the session of the files that were recorded, for its path: where it is, what was read back
SessionMaker = Callable[[Path], "tuple[Path, Receipt]"]
LOG = logging.getLogger(__name__)
HEAD_BYTES = 1 << 14  # bytes before the images, where HDF5 begins
GZIP_LEVEL = 1


def make_session(session: Path) -> tuple[Path, Receipt]:
    """As `completing.make_session`, in this process."""
    from app.session.completing import make_session as made

    return made(session)


class SessionRecorder:
    """One session being recorded; made by `create`. Images and results come from one thread, all
    else from another; each of `syncs` may have its own.

    Parameters
    ----------
    make : callable
        A `SessionMaker`.

    Attributes
    ----------
    path : Path
        Where the session will be. It is another than was asked where that was taken away, or taken
        by another file, during the run.
    receipt : Receipt or None
        After `close`: what was read back.
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        files: tuple[AppendedFile, AppendedFile, AppendedFile],
        *,
        overwrite: bool,
        make: SessionMaker,
    ) -> None:
        self.path = path
        self.receipt: Receipt | None = None
        self._header, self._overwrite, self._make = header, overwrite, make
        journal, self._images, results = files
        self._journal, self._results = Journal(journal), Journal(results)
        self._trigger: StoredFrame | LostFrame | None = None  # the last, not yet there twice
        self._received: set[int] = set()
        self._samples = self._missing = 0
        self._is_open = True
        self._former: list[AppendedFile] = []  # whose names were taken away
        self._is_lost = ""  # why what was recorded has no name any more
        self._switching = self._images.lock
        self._largest, self._limit = largest_file(path)
        self._images.append(bytes(HEAD_BYTES))
        for _ in range(2):
            self._journal.append(header)
        for sync in self.syncs:
            sync()

    @classmethod
    def create(
        cls,
        path: Path,
        header: Header,
        *,
        overwrite: bool = False,
        make: SessionMaker = make_session,
    ) -> Self:
        """A new session at `path`, ready to record. What is there now stays until it is complete.

        Raises
        ------
        UserError
            There is one and it may not be overwritten, another program is recording it, or the
            files cannot be made there.
        """
        header = dated(header)
        if path.is_dir():
            raise UserError(f"{path}: the session cannot be made there: it is a folder; add a name")
        if path.exists() and not overwrite:
            raise _exists(path)
        made: list[AppendedFile] = []
        try:
            for place in (journal_of(path), images_of(path), results_of(path)):
                if overwrite and made:  # a power cut may have left them a name of the session
                    place.unlink(missing_ok=True)
                made.append(AppendedFile(place, overwrite=overwrite, locked=not made))
            journal, images, results = made
            return cls(path, header, (journal, images, results), overwrite=overwrite, make=make)
        except BaseException as error:
            for file in made:
                file.remove()
            if isinstance(error, BlockingIOError):
                raise being_recorded(path) from None
            if isinstance(error, FileExistsError):
                raise _exists(Path(error.filename)) from None
            if isinstance(error, OSError):
                raise UserError(
                    f"{path}: the session cannot be made there: {error.strerror or error}; choose"
                    " another folder or name"
                ) from None
            raise

    # ------------------------------------------------------------------ records

    def append(self, record: Record) -> None:
        """Record something; it is with the operating system when this returns.

        Samples missing before a block of samples are a gap. A snapshot comes after the frame of
        which it is the result; an outcome ends the record.

        Raises
        ------
        ValueError
            The record cannot belong to this session: samples that were recorded already or lie
            absurdly far ahead, an image of another shape or type, results of a frame that is not
            here.
        OSError
            It could not be written, or the disk is all but full. What was recorded before is as it
            was.
        """
        match record:
            case Frame():
                with self._switching:
                    stored = self._stored(record)
                self._append_trigger(stored)
            case LostFrame():
                self._append_trigger(record)
            case Snapshot():
                if record.frame not in self._received:
                    raise ValueError(
                        f"session: frame {record.frame} has results, but it was not recorded"
                    )
                check_snapshot(record, self._header)
                with self._switching:
                    self._results.append(replace(record, stress_field_pa=None))
            case ContactResult():
                with self._switching:
                    self._results.append(record)
            case Samples(first, volts):
                check_channels(record, self._header)
                self._append_samples(record, first, first + len(volts))
            case Gap(first, count):
                check_place(first + count, self._samples, self._header)
                self._append_samples(record, first + count, first + count)
            case Position() | Event() | Outcome():
                self._journal.append(record)
            case _:
                raise ValueError(f"session: a {type(record).__name__} is not recorded live")

    def _append_samples(self, record: Samples | Gap, known_from: int, end: int) -> None:
        check_place(record.first, self._samples, self._header)
        missing = self._missing + known_from - self._samples
        check_missing(missing)
        self._journal.append(record)
        self._samples, self._missing = end, missing

    def _stored(self, frame: Frame) -> StoredFrame:
        """The frame, once its image is in the file of images."""
        image = np.ascontiguousarray(frame.image)
        check_image(image, self._header)
        self._check_room(image.nbytes)
        checksum = crc32(image.data)
        content = deflated(image) if self._header.compression == "gzip" else image.data
        place = self._images.append(content)
        nbytes, span = self._images.end - place, (frame.first, frame.last, frame.stamp_s)
        return StoredFrame(frame.index, frame.sample, place, nbytes, checksum, *span)

    def _append_trigger(self, record: StoredFrame | LostFrame) -> None:
        """Add the last trigger once more, and then this one: damage to one record loses none."""
        if self._trigger is not None:
            self._journal.append(self._trigger)
        self._journal.append(record)
        self._trigger = record
        if isinstance(record, StoredFrame):
            self._received.add(record.index)

    def _check_room(self, nbytes: int) -> None:
        """Refuse an image where too little would be left to make a session of the rest; OSError."""
        tables = self._journal.file.end + self._results.file.end
        copied = 0 if self._header.compression == "none" else self._images.end
        if self._images.end + nbytes + tables + RESERVE_BYTES > self._largest:
            limit = f"{self._limit} takes no file above {self._largest / 1e9:.2f} GB"
            raise DiskError(errno.EFBIG, f"{limit}; record to another disk", str(self.path))
        with suppress(FileNotFoundError):  # the folder was removed, which the next sync notices
            check_room(self.path, nbytes + tables + copied)

    # ------------------------------------------------------------------ the disk

    @property
    def syncs(self) -> Sequence[Callable[[], None]]:
        """Each brings some of what was recorded to the disk, for a thread of its own: forces never
        wait behind images.
        """
        return self._sync_journal, self._sync_images

    def flush(self) -> None:
        """Bring everything recorded so far to the disk; OSError where it may not be there."""
        for sync in self.syncs:
            sync()

    def _sync_journal(self) -> None:
        if not all(file.is_in_place for file in self._files):
            self._go_on_beside()
        self._journal.file.sync()

    def _sync_images(self) -> None:
        self._images.sync()
        self._results.file.sync()

    @property
    def _files(self) -> tuple[AppendedFile, AppendedFile, AppendedFile]:
        return self._journal.file, self._images, self._results.file

    def _go_on_beside(self) -> None:
        """Record on under another name: somebody has removed, renamed or replaced a file of this
        session. What is in it can still be read, as long as it is open.
        """
        former = self._files
        missing = ", ".join(file.path.name for file in former if not file.is_in_place)
        what = f"{missing} was removed, renamed or replaced"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            path = next_free(self.path)
            images = self._images.copy_to(images_of(path))
            self._former.append(images)
            with self._switching:
                images.catch_up(self._images)
                self._images = images
                self._results.move_to(results_of(path))
            self._journal.move_to(journal_of(path))
        except OSError as error:
            self._is_lost = f"{what}, and the recording cannot go on beside it: {error}"
            raise DiskError(error.errno, self._is_lost) from error
        self._former += former
        self._is_lost = ""
        for file in former:
            file.unlink()
        self.path, self._overwrite = path, False
        text = f"{what}; the recording goes on in {path}"
        LOG.warning("%s", text)
        self._journal.append(Event(self._samples, "recording", text))

    # ------------------------------------------------------------------ the end

    def close(self) -> None:
        """Make the session of what was recorded, let go of it and remove the rest. May be called
        twice.

        Raises
        ------
        OSError
            Not all that was recorded is sure to be on the disk.
        UserError
            What was read back is not what was recorded, or the session cannot be made. What was
            recorded stays as it is in both cases, and `slipscope repair` can be asked.
        """
        if not self._is_open:
            return
        self._is_open = False
        with ExitStack() as closing:
            closing.callback(self._let_go)
            try:
                if self._trigger is not None:
                    self._journal.append(self._trigger)
                self.flush()
                for file in self._files:
                    if file.failure or not file.is_all_there:
                        found = file.failure or f"{file.path} was cut short while it was written"
                        raise DiskError(errno.EIO, found)
                self._images.close()
                made, self.receipt = self._make(self.path)
                self._take_place(made, self.receipt)
            except OSError as error:
                if self._is_lost:
                    raise
                raise DiskError(
                    error.errno,
                    f"{error.strerror or error}; what was recorded lies beside {self.path},"
                    f" `slipscope repair {self.path} -o REPAIRED.h5` makes a session of it",
                ) from error
        LOG.info("%s: %s", self.path.name, self.receipt)

    def _let_go(self) -> None:
        for file in (*self._files, *self._former):
            file.close()

    def _take_place(self, made: Path, receipt: Receipt) -> None:
        """Give the session its name, and remove what it was made of."""
        recorded = self.path
        try:
            take_place(made, self.path, self._overwrite)
        except FileExistsError:
            self.path = next_free(self.path)
            take_place(made, self.path, overwrite=False)
            LOG.warning("%s is another file now; the session is %s", recorded, self.path)
        trust.remember(self.path, receipt.checksum)
        self._let_go()  # some systems remove no file that is open
        remove_recorded(recorded)
        sync_folder(self.path.absolute().parent)

    def discard(self) -> None:
        """Let go of the session and remove its files; what was there before stays."""
        self._is_open = False
        for file in (*self._files, *self._former):
            file.remove()


def deflated(image: Array) -> bytes:
    """An image as HDF5 can inflate it."""
    # most of an image is noise, in which little repeats: searching it for repetitions takes longer
    # than all the rest
    deflate = zlib.compressobj(GZIP_LEVEL, strategy=zlib.Z_HUFFMAN_ONLY)
    return deflate.compress(image.data) + deflate.flush()


def _exists(path: Path) -> UserError:
    return UserError(
        f"{path}: a session of that name exists; choose another name or ask to overwrite it"
    )


def dated(header: Header) -> Header:
    """The header of a session that begins now, unless it says when it began."""
    return header if header.started else replace(header, started=now())
