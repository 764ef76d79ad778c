"""The journal holds what the writer was given, to the bit, and ends where it is torn."""

from __future__ import annotations

import dataclasses
import errno
from io import FileIO
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import COUNTS, NAN, OUTCOME, SHAPE, make_header, make_writer, record

from app.errors import UserError
from app.records import (
    Event,
    Gap,
    LostTrigger,
    Outcome,
    Position,
    ReceivedFrame,
    Samples,
    Source,
    SourceFrame,
)
from app.session import journal as journal_module
from app.session.journal import Journal, StoredFrame, Torn, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.receipt import verify

SAMPLES = np.array([[0.1, NAN], [-0.0, 1e300]])
RECORDS = (
    Event(5, "phase", "µ\0\n力"),
    Position(3, 1.1e-3),
    Position(4, NAN),
    StoredFrame(0, 0, 1 << 40, 9, 0xFFFFFFFF),
    SourceFrame(1, 125, 7, 1),
    LostTrigger(2, 250, "late"),
    Gap(2, 3, "overflow"),
    Samples(0, SAMPLES, -SAMPLES),
    Samples(5, SAMPLES[:0], SAMPLES[:0]),
    make_header(source=Source("a.h5", "2026"), compression="gzip"),
)


def make_journal(path: Path) -> list[int]:
    """A journal of some records; where each of them ends."""
    journal = Journal(path, overwrite=False)
    ends = []
    for one in RECORDS:
        journal.append(one)
        ends.append(path.stat().st_size)
    journal.sync()
    journal.close()
    return ends


def test_every_record_comes_back_to_the_bit(tmp_path: Path) -> None:
    make_journal(tmp_path / "j")
    for found, given in zip(read_journal(tmp_path / "j"), RECORDS, strict=True):
        assert type(found) is type(given)
        for field in dataclasses.fields(given):
            a, b = getattr(found, field.name), getattr(given, field.name)
            np.testing.assert_equal(a, b)
            if isinstance(a, np.ndarray):
                assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


def test_texts_that_utf8_can_not_hold_are_spelled_out(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j", overwrite=False)
    journal.append(make_header(config_toml="\ud800", versions={"a": "\udc00"}))
    journal.append(Event(0, "error", "reply '\ud800'"))
    journal.close()
    header, event = read_journal(tmp_path / "j")
    assert (header.config_toml, header.versions) == ("\\ud800", {"a": "\\udc00"})
    assert event.text == "reply '\\ud800'"


def test_places_are_those_that_hdf5_tells(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "a.h5")
    for n in range(30):
        writer.append(ReceivedFrame(100 + n, 12505 + 125 * n, np.full(SHAPE, n, np.uint8)))
        if n % 7 == 0:
            writer.flush()
    journal = read_journal(journal_of(written.path))
    places = [one.place for one in journal if isinstance(one, StoredFrame)]
    chunks = [writer._images.id.get_chunk_info_by_coord((row, 0, 0)) for row in range(len(places))]
    assert places == [chunk.byte_offset for chunk in chunks]
    # also where it does not lie at the end
    assert writer._place_of(3, np.ones(chunks[3].size, np.uint8), 0) == places[3]
    writer.discard()


def test_torn_tail_is_found_and_cut_at_every_byte(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for length in range(len(content) + 1):
        (tmp_path / "torn").write_bytes(content[:length])
        found = list(read_journal(tmp_path / "torn"))
        torn = length - max((end for end in (20, *ends) if end <= length), default=0)
        assert found[sum(end <= length for end in ends) :] == ([Torn(torn)] if torn else [])


def test_altered_byte_ends_the_journal_there(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for place in range(20, len(content)):
        altered = bytearray(content)
        altered[place] ^= 0x10
        (tmp_path / "altered").write_bytes(altered)
        *found, torn = read_journal(tmp_path / "altered")
        assert isinstance(torn, Torn)
        assert len(found) == sum(end <= place for end in ends), place


class _SmallDisk(FileIO):
    """A file on a disk on which `room` bytes are left."""

    room = 1 << 20

    def write(self, data: Any) -> int:
        if len(data) > _SmallDisk.room:
            super().write(data[: _SmallDisk.room])
            raise OSError(errno.ENOSPC, "No space left on device")
        _SmallDisk.room -= len(data)
        return super().write(data)


def test_full_disk_leaves_no_half_record_and_no_phantom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "FileIO", _SmallDisk)
    writer, written = record(tmp_path / "full.h5")
    monkeypatch.setattr(_SmallDisk, "room", 10)
    size = journal_of(written.path).stat().st_size
    with pytest.raises(OSError, match="No space left"):
        writer.append(ReceivedFrame(8, 1005, np.ones(SHAPE, np.uint8)))
    with pytest.raises(OSError, match="No space left"):
        writer.append(Samples(1003, np.zeros((9, 2)), np.zeros((9, 2))))
    assert journal_of(written.path).stat().st_size == size
    writer.append(Outcome("failed", "the disk is full", COUNTS, None))
    writer.close()
    with SessionReader(written.path) as read:
        assert (read.outcome.state, read.outcome.counts, len(read.triggers())) == (
            "failed",
            COUNTS,
            8,
        )


def test_clean_close_gives_a_receipt_and_removes_the_journal(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "clean.h5")
    assert journal_of(written.path).exists()
    writer.append(OUTCOME)
    writer.close()
    assert not journal_of(written.path).exists()
    receipt = writer.receipt
    assert receipt is not None
    assert (receipt.frames, receipt.frames_lost, receipt.samples, receipt.gaps) == (7, 1, 1003, 1)
    assert receipt.bytes == written.path.stat().st_size
    assert str(receipt).startswith("7 frames, 1 lost, 1003 samples, 1 gaps, ")
    assert verify(written.path).checksum == receipt.checksum
    content = bytearray(written.path.read_bytes())
    content[content.index(written.images[6].tobytes()) + 100] ^= 1
    written.path.write_bytes(content)
    with pytest.raises(
        UserError, match=r"clean\.h5: image 6 is not as recorded; `slipscope repair` makes"
    ):
        verify(written.path)


def test_gap_that_was_told_is_verified_too(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "gap.h5")
    writer.append(Samples(0, np.ones((5, 2)), np.ones((5, 2))))
    writer.append(Gap(7, 3, "the board's memory ran over"))
    writer.append(Samples(10, np.ones((5, 2)), np.ones((5, 2))))
    writer.close()
    assert (writer.receipt.samples, writer.receipt.gaps) == (15, 2)
    with SessionReader(tmp_path / "gap.h5") as read:
        assert_array_equal(
            np.isnan(read.forces().volts[:, 0]), [False] * 5 + [True] * 5 + [False] * 5
        )


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (StoredFrame(8, 1005, 0, 192, 1), "frame 8 is not as recorded"),
        (StoredFrame(2, 255, 0, 192, 1), "frame 2 is not as recorded"),
        (Samples(1003, SAMPLES, SAMPLES), "1005 samples were recorded, 1003 are in the file"),
        (Event(1, "stop", "x"), "8 events were recorded, 7 are in the file"),
    ],
)
def test_file_that_is_not_what_was_recorded_keeps_its_journal(
    tmp_path: Path, more: Any, words: str
) -> None:
    writer, written = record(tmp_path / "other.h5")
    writer._journal.append(more)
    with pytest.raises(UserError, match=words):
        writer.close()
    assert journal_of(written.path).exists()
    assert writer.receipt is None
    writer.close()


def test_altered_force_is_found(tmp_path: Path) -> None:
    writer, _ = record(tmp_path / "force.h5")
    writer.flush()
    writer._file["/entry/forces/shear_force"][17] += 1e-12
    with pytest.raises(UserError, match="the forces are not as recorded"):
        writer.close()


def test_journal_of_a_lost_session_is_not_overwritten_unasked(tmp_path: Path) -> None:
    journal_of(tmp_path / "new.h5").write_bytes(b"all that is left")
    with pytest.raises(UserError, match=r"new\.h5\.journal: a session of that name exists"):
        make_writer(tmp_path / "new.h5")
    assert not (tmp_path / "new.h5").exists()
    make_writer(tmp_path / "new.h5", overwrite=True).close()


NONE = [b"", b"\x07", b"\x90", b"\x80", b"\xa1a", b"\x91" * 10**5, b"\xc1", b"\xdf\xff\xff\xff\xff"]
NONE += [
    msgspec.msgpack.encode(odd)
    for odd in (
        {"sample": 1},
        {"sample": "1", "kind": "", "text": ""},
        {"first": 0, "volts": [[1, 2], b""], "forces": [[1, 2], b""]},
        {"first": 0, "volts": [[2**62, 2], bytes(32)], "forces": [[2, 2], bytes(32)]},
        {"first": 0, "volts": [[2], bytes(16)], "forces": [[2], bytes(16)]},
        {"first": 0, "volts": 7, "forces": None},
    )
]


@pytest.mark.parametrize("payload", NONE, ids=range(len(NONE)))
@pytest.mark.parametrize("kind", [1, 7, 8, 255])
def test_record_with_the_right_checksum_that_is_none_ends_the_journal(
    tmp_path: Path, kind: int, payload: bytes
) -> None:
    make_journal(tmp_path / "j")
    head = journal_module._HEAD.pack(journal_module._MARK, kind, len(payload), crc32(payload))
    with (tmp_path / "j").open("ab") as file:
        file.write(head + payload)
    *found, torn = read_journal(tmp_path / "j")
    assert (len(found), torn) == (len(RECORDS), Torn(len(head + payload)))
