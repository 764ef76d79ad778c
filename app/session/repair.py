"""Makes a whole session of one that was cut short or damaged, from its journal where there is one,
else from what can be read of it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import numpy as np

from app.errors import UserError
from app.results import Event, Outcome, Source
from app.session.checked import CheckedFile
from app.session.files import check_new_session, new_session
from app.session.journal import has_journal, journal_of, records
from app.session.layout import FORCES_CHUNK, UNFINISHED
from app.session.reader import SessionReader
from app.session.receipt import Receipt, checksums, forces_of, image_of, samples_in, verify
from app.session.writer import SessionWriter

FLUSH_FRAMES = 256  # of small tables that wait in memory
_UNREADABLE = "its image can not be read, the bytes are not those that were recorded"
_UNREADABLE_SAMPLES = "they can not be read, the bytes are not those that were recorded"
# samples of a journal's gaps: a line of a stranger's could ask for terabytes of them
_MOST_MISSING = 1 << 22
# of a stranger's journal
_NONSENSE = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError)


@dataclass(frozen=True, slots=True)
class Repaired:
    """What came of a repair. `output` is None where the session is whole and nothing had to be
    written.

    `source` is "journal" or "file"; `torn` and `unread` count the frames and samples that were
    recorded and could not be brought back, `cut_bytes` what was left out at the torn end of the
    journal, `results` the analysed frames; `receipt` is that of the repaired session, or of the
    whole.
    """

    session: Path
    output: Path | None
    source: str
    torn: int
    unread: int
    cut_bytes: int
    results: int
    receipt: Receipt

    def __str__(self) -> str:
        """One sentence."""
        if self.output is None:
            return (
                f"{self.session}: the session is whole, nothing is to be repaired: {self.receipt}"
            )
        torn = f"{self.torn} images and {self.unread} samples could not be read"
        cut = "; what came after the torn end of the journal is lost" if self.cut_bytes else ""
        results = (
            f"results of {self.results} frames"
            if self.results
            else "no results, the images must be analysed again"
        )
        return (
            f"{self.output}: brought back from the {self.source}: {self.receipt}; {torn}{cut};"
            f" {results}"
        )


def repair(
    session: Path,
    output: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Repaired:
    """A whole session at `output` of everything durable in `session`, which is only read;
    `progress` is told the share done.

    Raises
    ------
    UserError
        There is nothing to repair from, or the output can not be made there.
    OSError
        The output can not be written.
    """
    if not session.is_file():
        raise UserError(f"{session}: there is no such session; check the name")
    check_new_session(output, overwrite, read=[session], has_picture=False)
    journal = journal_of(session)
    source = "journal" if has_journal(session) else "file"
    with suppress(UserError), SessionReader(session) as reader:
        if reader.state != UNFINISHED or source == "file":
            receipt = verify(session, journal if source == "journal" else None)
            return Repaired(session, None, source, 0, 0, 0, len(reader.analysed_frames()), receipt)
    try:
        told = (
            _told_by_journal(session, journal, progress)
            if source == "journal"
            else _told_by_file(session, progress)
        )
        with new_session(output, overwrite) as unfinished:
            repaired = _write(session, unfinished, source, told)
        return replace(repaired, output=output)
    except _NONSENSE as error:
        raise UserError(
            f"{session}: what its {source} holds makes no session: {error}; use a copy of it if"
            " there is one"
        ) from error


def _write(session: Path, output: Path, source: str, told: Iterator[tuple[Any, ...]]) -> Repaired:
    """Tell a new writer everything that the old one was told."""
    _, header = next(told)
    header |= {
        "frame_dtype": np.dtype(header["frame_dtype"]),
        "frame_shape": tuple(header["frame_shape"]),
    }
    header |= {name: np.asarray(header[name], np.float64) for name in ("grid_x_px", "grid_y_px")}
    header |= {name: int(header[name]) for name in ("exposure_samples", "divisor", "first_trigger")}
    header |= {name: float(header[name]) for name in ("sample_rate_hz", "pixel_m")}
    header |= {"source": Source(**header["source"]) if header["source"] else None}
    writer = SessionWriter.create(output, **header)
    frames: set[int] = set()
    torn = unread = count = cut = 0
    try:
        for what, *values in told:
            if what in ("frame", "source_frame"):
                frames.add(values[0])
            torn += what == "lost_frame" and values[2] == _UNREADABLE
            unread += values[1] if what == "gap" and values[2] == _UNREADABLE_SAMPLES else 0
            if what == "end":
                cut = values[0]
                break
            method, kinds = _TOLD[what]
            if not all(_is_of(value, kind) for value, kind in zip(values, kinds, strict=True)):
                raise ValueError(f"a {what} is not one")
            getattr(writer, method)(*([Event(*values)] if what == "event" else values))
            count += 1
            if count % FLUSH_FRAMES == 0:
                writer.flush()
        results = _copy_results(session, writer, frames, torn)
        writer.close()
    except BaseException:
        writer.discard()
        raise
    assert writer.receipt is not None
    return Repaired(session, output, source, torn, unread, cut, results, writer.receipt)


# record -> method of the writer and what it takes
_TOLD: dict[str, tuple[str, tuple[type, ...]]] = {
    "samples": ("append_samples", (int, np.ndarray, np.ndarray)),
    "gap": ("append_gap", (int, int, str)),
    "frame": ("append_frame", (int, int, np.ndarray, int)),
    "source_frame": ("append_source_frame", (int, int, int, int)),
    "lost_frame": ("append_lost_frame", (int, int, str)),
    "position": ("append_position", (int, float)),
    "event": ("append_event", (int, str, str)),
}


def _is_of(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not (isinstance(value, int) and abs(value) >= 1 << 62)


def _told_by_journal(
    session: Path, journal: Path, progress: Callable[[float], None]
) -> Iterator[tuple[Any, ...]]:
    """What the writer was told, with the images by their place in the session, whether HDF5 can
    open that or not.
    """
    size = room = session.stat().st_size
    end = missing = 0
    with session.open("rb") as file:
        for what, *values in records(journal):
            if what == "session":
                header: dict[str, Any] = values[0]
                shape, dtype = header["frame_shape"], np.dtype(header["frame_dtype"])
                longest = (
                    math.prod(shape) * dtype.itemsize if header["compression"] == "gzip" else None
                )
                yield what, dict(header)
            elif what == "frame":
                index, sample, place, nbytes, checksum = values
                image = _image_at(file, place, nbytes, size, checksum, longest)
                progress(min(1.0, place / max(1, size)))
                room -= nbytes if image else 0
                if room < 0:
                    raise ValueError("it names more images than the session has room for")
                if image is None:
                    yield "lost_frame", index, sample, _UNREADABLE
                else:
                    yield what, index, sample, np.frombuffer(image, dtype).reshape(shape), checksum
            else:
                if what in ("samples", "gap"):
                    first, count = values[0], len(values[1]) if what == "samples" else values[1]
                    missing += first - end + (count if what == "gap" else 0)
                    end = first + count
                if missing > _MOST_MISSING:
                    raise ValueError(f"{missing} samples are missing")
                yield what, *values


def _image_at(
    file: BinaryIO, place: int, nbytes: int, size: int, checksum: int, longest: int | None
) -> bytes | None:
    """The image at a place of a file; None where it is not there or not the one that was recorded.

    `longest` is the size of one that was compressed, None of one that was not.
    """
    if not 0 <= place <= place + nbytes <= size:
        return None
    file.seek(place)
    image = file.read(nbytes)
    if longest is not None:
        with suppress(zlib.error):
            image = zlib.decompressobj().decompress(image, longest)
    return image if crc32(image) == checksum else None


def _told_by_file(session: Path, progress: Callable[[float], None]) -> Iterator[tuple[Any, ...]]:
    """What a session without a journal can tell of itself."""
    with SessionReader(session) as reader, closing(CheckedFile(session, "session")) as file:
        names = (
            "config_toml",
            "sample_rate_hz",
            "frame_shape",
            "frame_dtype",
            "exposure_samples",
            "divisor",
            "first_trigger",
            "pixel_m",
        )
        header = {
            name: getattr(reader, name)
            for name in (*names, "grid_x_px", "grid_y_px", "versions", "started", "compression")
        }
        yield "session", header | {"source": asdict(reader.source) if reader.source else None}
        yield from _forces_told(reader, file)
        held = checksums(reader, file)
        # of an analysis they are in another file
        triggers, _ = reader.triggers(), reader.images_path
        for n, (index, sample, received, _, reason) in enumerate(triggers.tolist()):
            image = image_of(reader, index) if received else None
            found = None if image is None else crc32(image.data)
            if found is not None and held.get(index) in (None, found):
                own = ("frame", index, sample, image, found)
                yield (
                    ("source_frame", index, sample, reader.image_row(index), found)
                    if reader.source
                    else own
                )
            else:
                yield "lost_frame", index, sample, _UNREADABLE if received else reason
            progress((n + 1) / len(triggers))
        for sample, position in zip(
            *(column.tolist() for column in reader.positions()), strict=True
        ):
            yield "position", sample, position
        for event in reader.events():
            yield "event", event.sample, event.kind, event.text


def _forces_told(reader: SessionReader, file: CheckedFile) -> Iterator[tuple[Any, ...]]:
    """The samples between the gaps; those in a chunk that can not be read are a gap, too."""
    missing = np.zeros(samples_in(file), bool)
    for first, count in reader.gaps():
        missing[max(0, first) : first + count] = True
    parts = {
        *range(0, len(missing), FORCES_CHUNK),
        *(np.flatnonzero(np.diff(missing)) + 1).tolist(),
        len(missing),
    }
    for first, end in pairwise(sorted(parts)):
        if missing[first]:
            continue
        try:
            block = forces_of(file, first, end)
        except UserError:
            yield "gap", first, end - first, _UNREADABLE_SAMPLES
        else:
            yield "samples", first, block[:2].T, block[2:].T
    if missing.size and missing[-1]:
        yield "samples", len(missing), np.empty((0, 2)), np.empty((0, 2))


def _copy_results(session: Path, writer: SessionWriter, frames: set[int], torn: int) -> int:
    """How many analysed frames had their results copied; none where HDF5 can not read them any
    more. Tells how the run ended, too.
    """
    copied, state, outcome = 0, UNFINISHED, None
    # ValueError: results that do not fit the images
    with suppress(UserError, ValueError), SessionReader(session) as reader:
        for snapshot in reader.snapshots():
            if snapshot.frame in frames:
                writer.append_snapshot(snapshot)
                copied += 1
        contact = reader.contact()
        if contact is not None:
            writer.write_contact(contact)
        state, reason = reader.state, reader.reason
        if state != UNFINISHED:
            outcome = Outcome(
                state,
                f"{reason}; repaired, {torn} images were lost",
                reader.counts(),
                reader.summary(),
                reader.resources,
            )
    if outcome is not None:
        writer.finish(outcome)
    else:
        writer.explain(
            f"the run was cut short; repaired from {session.name}, {len(frames)} frames kept,"
            f" {torn} images lost"
        )
    return copied
