"""Makes a whole session of one that was cut short or damaged: from what was recorded for it where
its journal is there, else from what can be read of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from app.records.quantities import counted
from app.records.record_types import End, Event, Gap, Record, TriggerRow
from app.session.checks import check_snapshot
from app.session.completing import JOURNAL, WITHOUT_MAP, FoundRecording, account_of, rebuild, write
from app.session.files import (
    check_new_session,
    check_not_recorded,
    has_images,
    images_of,
    new_session,
)
from app.session.journal import has_journal
from app.session.reader import SessionReader
from app.session.receipt import Receipt, verify
from app.session.writer import SessionWriter
from app.system.errors import UserError
from app.system.progress import ShareDone, unheard
from drivers.protocols import Frame, LostFrame

# what a journal from elsewhere may lead to
_NONSENSE = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError)


@dataclass(frozen=True, slots=True)
class Repaired:
    """What came of a repair.

    Attributes
    ----------
    output : Path or None
        None where the session is whole and nothing had to be written.
    source : str
        "journal" or "file".
    found : FoundRecording
        What was brought back, and what was not.
    receipt : Receipt
        Of the repaired session, or of the one that is whole.
    """

    session: Path
    output: Path | None
    source: str
    found: FoundRecording
    receipt: Receipt

    def __str__(self) -> str:
        """One sentence."""
        if self.output is None:
            return (
                f"{self.session}: the session is whole, nothing is to be repaired: {self.receipt}"
            )
        results = (
            f"results of {counted(self.found.results, 'frame')}"
            if self.found.results
            else "no results, the images must be analysed again"
        )
        return (
            f"{self.output}: brought back from the {self.source}: {self.receipt}; {self.found};"
            f" {results}"
        )


def repair(
    session: Path,
    output: Path,
    *,
    overwrite: bool = False,
    progress: ShareDone = unheard,
) -> Repaired:
    """A whole session at `output` of everything that `session`, which is only read, still holds.

    `progress` is called with the share that is done.

    Raises
    ------
    UserError
        There is nothing to repair from, or the output cannot be written.
    """
    is_recorded = has_journal(session)
    if not (session.is_file() or is_recorded):
        kind = "this is a folder, not a" if session.is_dir() else "there is no such"
        raise UserError(f"{session}: {kind} session; check the name")
    check_not_recorded(session)
    check_new_session(output, overwrite, read=[session], has_picture=False)
    if repaired := whole(session):
        return repaired
    origin, source = (JOURNAL, "journal") if is_recorded else (session.name, "file")
    found = FoundRecording(origin=origin)
    try:
        with new_session(output, overwrite) as unfinished:
            if is_recorded:
                # the images may have become the session, or part of it
                images = images_of(session) if has_images(session) else session
                receipt = write(session, images, unfinished, found, progress)
            else:
                receipt = _from_file(session, unfinished, found, progress)
        return Repaired(session, output, source, found, receipt)
    except _NONSENSE as error:
        raise UserError(
            f"{session}: what its {source} holds makes no session: {error}; use a copy of it if"
            " there is one"
        ) from error


def whole(session: Path) -> Repaired | None:
    """What a session holds that is read back whole, whatever lies beside it; None where there is
    something to repair.
    """
    is_recorded = has_journal(session)
    if not (is_recorded and has_images(session)):
        with suppress(UserError), SessionReader(session) as reader:
            if reader.outcome.end is not End.UNFINISHED or not is_recorded:
                receipt = verify(session, account_of(session))
                found = FoundRecording(frames=receipt.frames, results=len(reader.analysed_frames()))
                return Repaired(session, None, "", found, receipt)
    return None


def _from_file(session: Path, output: Path, found: FoundRecording, progress: ShareDone) -> Receipt:
    """Make a session of what can be read of another."""
    with SessionReader(session, is_whole=False) as reader:
        header = reader.header
        try:
            header = replace(header, pattern=reader.pattern())
        except UserError:
            found.lacks_map = True
        writer = SessionWriter.create(output, header)
        return rebuild(writer, writer.append, _readable(reader, found, progress), found)


def _readable(
    reader: SessionReader, found: FoundRecording, progress: ShareDone
) -> Iterator[Record]:
    """The records of a session, those that are damaged as lost; the results of the frames that are
    there, and how the run ended, as far as they can be read.
    """
    frames: set[int] = set()
    triggers = max(1, len(reader.dataset("/entry/triggers/index")))
    if found.lacks_map:
        yield Event(0, "recording", WITHOUT_MAP)
    for name, part in reader.parts().items():
        try:
            for record in part():
                if isinstance(record, Frame | TriggerRow):
                    frames.add(record.index)
                    progress(min(1.0, record.index / triggers))
                yield record
        except UserError:
            found.lacking.append(name)
    found.frames = len(frames)
    found.torn = sum(isinstance(lost, LostFrame) for lost in reader.altered)
    found.unread = sum(lost.count for lost in reader.altered if isinstance(lost, Gap))
    try:
        for i, frame in enumerate(reader.analysed_frames()):
            if frame in frames:
                try:
                    check_snapshot(snapshot := reader.snapshot(i), reader.header)
                except (UserError, ValueError):  # damaged, or it does not fit the images
                    found.lost_results += 1
                else:
                    found.results += 1
                    yield snapshot
    except UserError:
        found.lacking.append("results")
    try:
        if (contact := reader.contact()) is not None:
            yield contact
    except UserError:
        found.lacking.append("contact")
    try:
        if reader.outcome.end is not End.UNFINISHED:
            yield reader.outcome
    except UserError:
        found.lacking.append("end of the run")
