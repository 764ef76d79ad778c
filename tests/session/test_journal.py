"""The journal holds what the writer was told, to the bit, and ends where it is torn."""

from __future__ import annotations

import errno
from io import FileIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import COUNTS, NAN, OUTCOME, SHAPE, make_writer, record

from app.errors import UserError
from app.results import Outcome
from app.session import journal as journal_module
from app.session.journal import Journal, journal_of, records
from app.session.reader import SessionReader
from app.session.receipt import verify

WORDS: tuple[tuple[Any, ...], ...] = (
    ("event", 5, "phase", "µ\0\n力"),
    ("position", 3, 1.1e-3),
    ("frame", 0, 0, 1 << 40, 9, 0xFFFFFFFF),
)
SAMPLES = np.array([[0.1, NAN], [-0.0, 1e300]])


def make_journal(path: Path) -> list[int]:
    """A journal of some words and samples; where each record ends."""
    journal = Journal(path, overwrite=False)
    ends = []
    for words in WORDS:
        journal.note(*words)
        ends.append(path.stat().st_size)
    for first in (0, 2):
        journal.samples(first, SAMPLES, -SAMPLES)
        ends.append(path.stat().st_size)
    journal.samples(4, SAMPLES[:0], SAMPLES[:0])
    ends.append(path.stat().st_size)
    journal.sync()
    journal.close()
    return ends


def test_every_record_comes_back_to_the_bit(tmp_path: Path) -> None:
    make_journal(tmp_path / "j")
    *found, end = records(tmp_path / "j")
    assert tuple(found[:3]) == WORDS
    assert [record[:2] for record in found[3:]] == [("samples", 0), ("samples", 2), ("samples", 4)]
    assert (found[3][2].tobytes(), found[3][3].tobytes()) == (
        SAMPLES.tobytes(),
        (-SAMPLES).tobytes(),
    )
    assert found[5][2].shape == (0, 2)
    assert end == ("end", 0)


def test_places_are_those_that_hdf5_tells(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "a.h5")
    for n in range(30):
        writer.append_frame(100 + n, 12505 + 125 * n, np.full(SHAPE, n, np.uint8))
        if n % 7 == 0:
            writer.flush()
    told = [record[3] for record in records(journal_of(written.path)) if record[0] == "frame"]
    chunks = [writer._images.id.get_chunk_info_by_coord((row, 0, 0)) for row in range(len(told))]
    assert told == [chunk.byte_offset for chunk in chunks]
    # also where it does not lie at the end
    assert writer._place_of(3, np.ones(chunks[3].size, np.uint8), 0) == told[3]
    writer.discard()


def test_torn_tail_is_found_and_cut_at_every_byte(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for length in range(len(content) + 1):
        (tmp_path / "torn").write_bytes(content[:length])
        *found, (_, cut) = records(tmp_path / "torn")
        assert len(found) == sum(end <= length for end in ends)
        assert cut == length - max((end for end in (20, *ends) if end <= length), default=0)


def test_altered_byte_ends_the_journal_there(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for place in range(20, len(content)):
        altered = bytearray(content)
        altered[place] ^= 0x10
        (tmp_path / "altered").write_bytes(altered)
        assert len(list(records(tmp_path / "altered"))) == 1 + sum(end <= place for end in ends), (
            place
        )


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
        writer.append_frame(8, 1005, np.ones(SHAPE, np.uint8))
    with pytest.raises(OSError, match="No space left"):
        writer.append_samples(1003, np.zeros((9, 2)), np.zeros((9, 2)))
    assert journal_of(written.path).stat().st_size == size
    writer.finish(Outcome("failed", "the disk is full", COUNTS, None))
    writer.close()
    with SessionReader(written.path) as read:
        assert (read.state, read.counts(), len(read.triggers())) == ("failed", COUNTS, 8)


def test_clean_close_gives_a_receipt_and_removes_the_journal(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "clean.h5")
    assert journal_of(written.path).exists()
    writer.finish(OUTCOME)
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
    writer.append_samples(0, np.ones((5, 2)), np.ones((5, 2)))
    writer.append_gap(7, 3, "the board's memory ran over")
    writer.append_samples(10, np.ones((5, 2)), np.ones((5, 2)))
    writer.close()
    assert (writer.receipt.samples, writer.receipt.gaps) == (15, 2)
    with SessionReader(tmp_path / "gap.h5") as read:
        assert_array_equal(np.isnan(read.forces()[1][:, 0]), [False] * 5 + [True] * 5 + [False] * 5)


@pytest.mark.parametrize(
    ("tell", "words"),
    [
        (lambda journal: journal.note("frame", 8, 1005, 0, 192, 1), "frame 8 is not as recorded"),
        (lambda journal: journal.note("frame", 2, 255, 0, 192, 1), "frame 2 is not as recorded"),
        (
            lambda journal: journal.samples(1003, SAMPLES, SAMPLES),
            "1005 samples were recorded, 1003 are in the file",
        ),
        (
            lambda journal: journal.note("event", 1, "stop", "x"),
            "8 events were recorded, 7 are in the file",
        ),
    ],
)
def test_file_that_is_not_what_was_told_keeps_its_journal(
    tmp_path: Path, tell: Any, words: str
) -> None:
    writer, written = record(tmp_path / "other.h5")
    tell(writer._journal)
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


NONE = [
    b"",
    b"7",
    b"[]",
    b"{}",
    b'{"a": 12}',
    b"[1]",
    b"[[], 2]",
    b"[" * 10**5,
    b'"\xff"',
    b"[" + b"9" * 5000 + b"]",
]


@pytest.mark.parametrize("payload", NONE, ids=range(len(NONE)))
@pytest.mark.parametrize("kind", [b"W", b"S", b"?"])
def test_record_with_the_right_checksum_that_is_none_ends_the_journal(
    tmp_path: Path, kind: bytes, payload: bytes
) -> None:
    make_journal(tmp_path / "j")
    record_ = journal_module._HEAD.pack(kind, len(payload), crc32(payload)) + payload
    with (tmp_path / "j").open("ab") as file:
        file.write(record_)
    *found, end = records(tmp_path / "j")
    assert (len(found), end) == (6, ("end", len(record_)))
