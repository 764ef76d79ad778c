"""The journal holds what the recorder was given, to the bit, whatever is damaged beside it."""

from __future__ import annotations

import dataclasses
import errno
import os
import struct
import time
from io import FileIO
from itertools import pairwise
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import (
    CONTACT,
    COUNTS,
    NAN,
    OUTCOME,
    SHAPE,
    assert_identical,
    finish,
    make_header,
    make_snapshot,
    make_writer,
    record,
)

from app.records.record_types import End, Event, Gap, Outcome, Position, Samples, SourceSession
from app.session import journal as journal_module
from app.session.columns import ColumnGroup
from app.session.journal import Journal, JournalDamage, StoredFrame, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.repair import repair
from app.system import disk
from app.system.disk import AppendedFile, SparedFile
from app.system.errors import UserError
from drivers.protocols import Frame, LostFrame

SAMPLES = np.array([[0.1, NAN], [-0.0, 1e300]])
RECORDS = (
    Event(5, "phase", "µ\0\n力"),
    Position(3, 1.1e-3),
    Position(4, NAN),
    StoredFrame(0, 0, 1 << 40, 9, 0xFFFFFFFF, 0, 2, 1e6 + 1 / 3),
    LostFrame(2, 250, "late"),
    Gap(2, 3, "overflow"),
    Samples(0, SAMPLES, -SAMPLES),
    Samples(5, SAMPLES[:0], SAMPLES[:0]),
    make_header(source=SourceSession("a.h5", "2026"), compression="gzip"),
    OUTCOME,
    CONTACT,
    make_snapshot(7),
    make_snapshot(8, field=False),
)


def make_journal(path: Path) -> list[int]:
    """A journal of some records; where each of them ends."""
    file = AppendedFile(path, overwrite=False)
    journal, ends = Journal(file), []
    for one in RECORDS:
        journal.append(one)
        ends.append(file.end)
    file.sync()
    file.close()
    return ends


def test_every_record_comes_back_to_the_bit(tmp_path: Path) -> None:
    make_journal(tmp_path / "j")
    for found, given in zip(read_journal(tmp_path / "j"), RECORDS, strict=True):
        assert_identical(found, given)


def test_a_journal_of_the_format_before_comes_back(tmp_path: Path) -> None:
    """It has a hash in the place of the second checksum, a SHA-256 of each image, and "done"."""
    content = journal_module._FORMAT_3
    for n, one in enumerate(RECORDS):
        held = msgspec.msgpack.decode(journal_module.encode(one))
        if isinstance(one, StoredFrame):
            held["digest"] = bytes(range(32))
        if isinstance(one, StoredFrame | LostFrame):
            span = held.pop("first"), held.pop("last")
            held["span"] = None if span == (one.index, one.index) else span
        if isinstance(one, Outcome):
            assert held.pop("end") == "complete"
            held["state"] = "done"
        payload = msgspec.msgpack.encode(held)
        kind = journal_module._TYPES.index(type(one))
        rest = struct.pack("<BI16s", kind, len(payload), bytes([7 * n + 1]) * 16) + payload
        content += journal_module._HEAD.pack(journal_module._MARK, crc32(rest)) + rest
    (tmp_path / "j").write_bytes(content)
    for found, given in zip(read_journal(tmp_path / "j"), RECORDS, strict=True):
        assert_identical(found, given)


@pytest.mark.parametrize(
    "lost",
    [LostFrame(-1, 5, "late"), LostFrame(1 << 62, 5, "late"), LostFrame(2, 5, "", 2, 1 << 63)],
)
def test_a_trigger_that_no_camera_has_is_damage(tmp_path: Path, lost: LostFrame) -> None:
    file = AppendedFile(tmp_path / "a.h5.journal", overwrite=False)
    Journal(file).append(lost)
    file.close()
    (found,) = read_journal(file.path)
    assert isinstance(found, JournalDamage)


def test_texts_that_utf8_can_not_hold_are_spelled_out(tmp_path: Path) -> None:
    file = AppendedFile(tmp_path / "j", overwrite=False)
    journal = Journal(file)
    journal.append(make_header(config_toml="\ud800", versions={"a": "\udc00"}))
    journal.append(Event(0, "error", "reply '\ud800'"))
    file.close()
    header, event = read_journal(tmp_path / "j")
    assert (header.config_toml, header.versions) == ("\\ud800", {"a": "\\udc00"})
    assert event.text == "reply '\\ud800'"


def test_torn_tail_is_found_at_every_byte(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for length in range(0, len(content) + 1, 3):
        (tmp_path / "torn").write_bytes(content[:length])
        found = list(read_journal(tmp_path / "torn"))
        torn = length - max((end for end in (20, *ends) if end <= length), default=0)
        assert found[sum(end <= length for end in ends) :] == (
            [JournalDamage(torn)] if torn else []
        )


def test_altered_byte_costs_the_record_that_it_is_in_and_no_other(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    for place in range(0, len(content), 3):
        altered = bytearray(content)
        altered[place] ^= 0x10
        (tmp_path / "altered").write_bytes(altered)
        found = list(read_journal(tmp_path / "altered"))
        lost = sum(end <= place for end in ends)
        if place < 20:
            assert found[0] == JournalDamage(20)
            lost = -1
        else:
            first = ([20, *ends])[lost]
            assert found.pop(lost) == JournalDamage(ends[lost] - first)
        assert [type(one) for one in found if type(one) is not JournalDamage] == [
            type(one) for n, one in enumerate(RECORDS) if n != lost
        ]


@pytest.mark.parametrize("change", ["left out", "repeated", "exchanged"])
def test_a_record_that_does_not_follow_from_the_one_before_is_told(
    tmp_path: Path, change: str
) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    parts = [content[a:b] for a, b in pairwise([0, 20, *ends])]
    if change == "left out":
        del parts[4]
    elif change == "repeated":
        parts.insert(4, parts[4])
    else:
        parts[4], parts[5] = parts[5], parts[4]
    (tmp_path / "changed").write_bytes(b"".join(parts))
    damage = [one for one in read_journal(tmp_path / "changed") if isinstance(one, JournalDamage)]
    assert len(damage) >= 1
    assert all(one.nbytes == 0 for one in damage)


def test_who_rewrites_a_journal_is_not_found_out_and_no_page_says_so(tmp_path: Path) -> None:
    """What finds accidents is no proof against a forger."""
    changed = Journal(AppendedFile(tmp_path / "j", overwrite=False))
    for one in RECORDS:
        changed.append(dataclasses.replace(one, text="forged") if isinstance(one, Event) else one)
    changed.file.close()
    assert not [one for one in read_journal(tmp_path / "j") if isinstance(one, JournalDamage)]
    pages = (journal_module.__doc__, *map(page_of, ("format.md", "promises.md")))
    for page in pages:
        said = " ".join(page.split())
        assert "find accidental damage" in said or "Both find accidental damage only" in said
        assert "unseen" not in said


def page_of(name: str) -> str:
    return (Path(__file__).parents[2] / "docs" / name).read_text(encoding="utf-8")


def test_a_journal_of_false_beginnings_takes_no_time(tmp_path: Path) -> None:
    """Each promises a record of all that is left; looking at all of them would take days."""
    about = journal_module._ABOUT.pack(1, 1 << 22, 0)
    (tmp_path / "false").write_bytes(journal_module._HEAD.pack(journal_module._MARK, 0) + about)
    (tmp_path / "false").write_bytes((tmp_path / "false").read_bytes() * 200_000)
    began = time.process_time()
    assert list(read_journal(tmp_path / "false")) == [
        JournalDamage((tmp_path / "false").stat().st_size)
    ]
    assert time.process_time() - began < 10


def test_a_journal_of_nothing_but_marks_takes_no_time(tmp_path: Path) -> None:
    (tmp_path / "marks").write_bytes(journal_module.MAGIC + journal_module._MARK * (2 << 20))
    began = time.process_time()
    (damage,) = read_journal(tmp_path / "marks")
    assert damage == JournalDamage((tmp_path / "marks").stat().st_size - len(journal_module.MAGIC))
    assert time.process_time() - began < 10


def test_what_follows_many_damaged_records_is_found(tmp_path: Path) -> None:
    ends = make_journal(tmp_path / "j")
    content = (tmp_path / "j").read_bytes()
    marks = journal_module._MARK * 20_000
    (tmp_path / "j").write_bytes(content[: ends[0]] + marks + content[ends[0] :])
    found = list(read_journal(tmp_path / "j"))
    assert len(found) == len(RECORDS) + 1
    assert found[1] == JournalDamage(len(marks))


def test_full_disk_leaves_no_half_record_and_is_not_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class SmallDisk(FileIO):
        room = 1 << 20

        def write(self, data: Any) -> int:
            if len(data) > SmallDisk.room:
                if SmallDisk.room == 0:
                    raise OSError(errno.ENOSPC, "No space left on device")
                data, SmallDisk.room = data[: SmallDisk.room], 0
                return super().write(data)
            SmallDisk.room -= len(data)
            return super().write(data)

    monkeypatch.setattr(disk, "FileIO", SmallDisk)
    writer, written = record(tmp_path / "full.h5")
    sizes = [file.path.stat().st_size for file in writer._files]
    monkeypatch.setattr(SmallDisk, "room", 100)
    with pytest.raises(OSError, match=r"full\.h5\.images cannot be written: No space left"):
        writer.append(Frame(8, 1005, np.ones(SHAPE, np.uint8)))
    monkeypatch.setattr(SmallDisk, "room", 1 << 20)
    with pytest.raises(OSError, match=r"full\.h5\.images cannot be written: No space left"):
        writer.append(Frame(8, 1005, np.ones(SHAPE, np.uint8)))
    assert [file.path.stat().st_size for file in writer._files] == sizes
    writer.append(Outcome(End.FAILED, "the disk is full", COUNTS, None))
    with pytest.raises(OSError, match=r"No space left on device; what was recorded lies beside"):
        writer.close()
    assert not written.path.exists()
    assert repair(written.path, tmp_path / "repaired.h5").found.is_whole
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.state, read.outcome.counts, len(read.triggers())) == (
            "failed",
            COUNTS,
            8,
        )


def test_clean_close_gives_a_receipt_and_removes_the_journal(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "clean.h5")
    assert journal_of(written.path).exists()
    finish(writer)
    assert not journal_of(written.path).exists()
    receipt = writer.receipt
    assert receipt is not None
    assert (receipt.frames, receipt.frames_lost, receipt.samples, receipt.gaps) == (7, 1, 1003, 1)
    assert receipt.bytes == written.path.stat().st_size
    assert str(receipt).startswith("7 frames, 1 lost, 1003 samples, 1 gap, ")
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


def test_session_that_is_not_what_was_recorded_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever HDF5 makes of the numbers."""
    extend = ColumnGroup.extend

    def changed(self: ColumnGroup, block: Any) -> None:
        if "/entry/forces/shear_force" in block:
            block = block | {"/entry/forces/shear_force": block["/entry/forces/shear_force"] + 1e-9}
        extend(self, block)

    writer, written = record(tmp_path / "other.h5")
    monkeypatch.setattr(ColumnGroup, "extend", changed)
    with pytest.raises(UserError, match="the forces are not as recorded"):
        writer.close()
    assert writer.receipt is None
    assert not written.path.exists()
    monkeypatch.undo()
    assert repair(written.path, tmp_path / "repaired.h5").found.is_whole


@pytest.mark.parametrize("which", [0, 1])
def test_a_failed_sync_is_final(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, which: int
) -> None:
    """The next one may well say nothing, though the data are lost."""
    writer, written = record(tmp_path / "sync.h5")
    with monkeypatch.context() as patch:

        def fail(_: int) -> None:
            raise OSError(errno.EIO, "Input/output error")

        patch.setattr(os, "fsync", fail)
        with pytest.raises(OSError, match="cannot be brought to the disk"):
            writer.syncs[which]()
    for sync in writer.syncs:
        sync()
    writer.append(OUTCOME)
    with pytest.raises(OSError, match=r"Input/output error; what was recorded lies beside"):
        writer.close()
    assert (writer.receipt, written.path.exists()) == (None, False)
    assert repair(written.path, tmp_path / "repaired.h5").receipt.frames == 7


def test_hdf5_writes_nothing_after_a_write_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "a.h5"
    path.touch()
    with SparedFile(path) as file:
        with monkeypatch.context() as patch:
            patch.setattr(disk, "_write_all", fail)
            assert file.write(b"lost") == 4
        assert file.write(b"late") == 4
        assert path.read_bytes() == b""
        with pytest.raises(disk.DiskError, match="cannot be written: No space left on device"):
            file.check()


def test_hdf5_reads_zeros_where_a_write_failed(tmp_path: Path) -> None:
    (path := tmp_path / "a.h5").write_bytes(b"there")
    with SparedFile(path) as file:
        file.seek(3)
        assert file.readinto(into := bytearray(b"\xff" * 4)) == 4  # not what the memory held
        assert into == b"re\0\0"


def test_a_file_in_the_place_of_ones_own_is_not_removed(tmp_path: Path) -> None:
    own, other = AppendedFile(tmp_path / "a", overwrite=False), tmp_path / "b"
    other.write_text("of another program")
    os.replace(other, own.path)
    own.remove()
    assert own.path.read_text() == "of another program"


def test_journal_of_a_lost_session_is_not_overwritten_unasked(tmp_path: Path) -> None:
    journal_of(tmp_path / "new.h5").write_bytes(b"all that is left")
    with pytest.raises(UserError, match=r"new\.h5\.journal: a session of that name exists"):
        make_writer(tmp_path / "new.h5")
    assert [file.name for file in tmp_path.iterdir()] == ["new.h5.journal"]
    make_writer(tmp_path / "new.h5", overwrite=True).close()


NONE = [b"", b"\x07", b"\x90", b"\x80", b"\xa1a", b"\x91" * 10**5, b"\xc1", b"\xdf\xff\xff\xff\xff"]
NONE += [
    msgspec.msgpack.encode(odd)
    for odd in (
        {"sample": 1},
        {"sample": "1", "kind": "", "text": ""},
        {"first": 0, "volts": ["<f8", [1, 2], b""], "forces": ["<f8", [1, 2], b""]},
        {"first": 0, "volts": ["<f8", [2**62, 2], bytes(32)], "forces": ["<f8", [2, 2], bytes(32)]},
        {"first": 0, "volts": ["<f8", [2], bytes(16)], "forces": ["<f8", [2], bytes(16)]},
        {"first": 0, "volts": ["O", [2, 2], bytes(32)], "forces": ["<f8", [2, 2], bytes(32)]},
        {"first": 0, "volts": 7, "forces": None},
    )
]


@pytest.mark.parametrize("payload", NONE, ids=range(len(NONE)))
@pytest.mark.parametrize("kind", [1, 6, 8, 255])
def test_record_with_the_right_checksum_that_is_none_is_passed_over(
    tmp_path: Path, kind: int, payload: bytes
) -> None:
    make_journal(tmp_path / "j")
    rest = journal_module._ABOUT.pack(kind, len(payload), 0) + payload
    false = journal_module._HEAD.pack(journal_module._MARK, crc32(rest)) + rest
    whole = (tmp_path / "j").read_bytes()
    (tmp_path / "j").write_bytes(whole[:20] + false + whole[20:])
    damage, *found = read_journal(tmp_path / "j")
    assert (len(found), damage) == (len(RECORDS), JournalDamage(len(false)))
