"""A repair brings back everything durable, never touches the original, and says what is lost."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import h5py
import msgspec
import numpy as np
import pytest
from killed_recorder import lost_by_kill
from numpy.testing import assert_array_equal
from session_material import (
    CONTACT,
    COUNTS,
    OUTCOME,
    Session,
    alter,
    make_header,
    make_writer,
    record,
)

from app.errors import UserError
from app.offline.replay import difference
from app.records import Gap, Samples
from app.session import journal
from app.session.journal import Journal, StoredFrame, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.repair import repair


def cut_short(folder: Path) -> Session:
    """A session as a kill before its first flush leaves it: the file is empty but for the images,
    the journal has everything.
    """
    writer, written = record(folder / "open.h5", flush_each=False)
    path = folder / "cut.h5"
    shutil.copy(written.path, path)
    shutil.copy(journal_of(written.path), journal_of(path))
    writer.discard()
    written.path = path
    return written


def assert_same(path: Path, written: Session, lost: tuple[int, ...] = ()) -> None:
    """Everything measured is in the session at `path`, but for some images."""
    with SessionReader(path) as read:
        images = {index: image for index, _, image in read.frames()}
        assert images.keys() == written.images.keys() - set(lost)
        for index, image in images.items():
            assert_array_equal(image, written.images[index])
        assert_array_equal(read.forces().volts, written.volts)
        assert_array_equal(read.forces().forces, written.forces)
        assert read.gaps() == [(500, 3)]
        assert read.events() == written.events
        assert (
            list(zip(*(column.tolist() for column in read.positions()), strict=True))
            == written.positions
        )
        assert (3, 380, "no image within 0.5 s") in read.lost_frames()
        assert read.header.config_toml.startswith("[run]")


@pytest.mark.parametrize("seed", range(10))
def test_kill_at_any_instant_loses_nothing_but_the_last_half_second(
    tmp_path: Path, seed: int
) -> None:
    kill = lost_by_kill(
        tmp_path / "killed.h5", 100.0, (64, 96), np.random.default_rng(seed).uniform(0.02, 1.0)
    )
    assert kill.sent > 0
    assert kill.lost_s <= 0.5


@pytest.mark.parametrize("damage", ["none", "not HDF5", "empty tables"])
def test_all_comes_back_from_the_journal(tmp_path: Path, damage: str) -> None:
    written = cut_short(tmp_path)
    if damage == "not HDF5":
        with written.path.open("r+b") as file:
            file.write(bytes(2048))
    before = written.path.read_bytes(), journal_of(written.path).read_bytes()
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert (written.path.read_bytes(), journal_of(written.path).read_bytes()) == before
    assert (repaired.source, repaired.torn, repaired.cut_bytes, repaired.receipt.frames) == (
        "journal",
        0,
        0,
        7,
    )
    assert_same(tmp_path / "repaired.h5", written)
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.state, read.outcome.counts.frames_lost) == ("unfinished", 1)
        assert (
            read.outcome.reason
            == "the run was cut short; repaired from cut.h5, 7 frames kept, 0 images lost"
        )
    assert not journal_of(tmp_path / "repaired.h5").exists()


def test_torn_image_is_a_lost_frame_with_that_reason(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    content = bytearray(written.path.read_bytes())
    content[content.index(written.images[4].tobytes())] ^= 1
    end = content.index(written.images[7].tobytes())
    written.path.write_bytes(content[: end + 5])
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert repaired.torn == 2
    assert "; 2 images and 0 samples could not be read; no results" in str(repaired)
    assert_same(tmp_path / "repaired.h5", written, lost=(4, 7))
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.lost_frames()[1:] == [
            (
                index,
                5 + 125 * index,
                "its image can not be read, the bytes are not those that were recorded",
            )
            for index in (4, 7)
        ]


def test_results_come_along_where_they_can_be_read(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "results.h5")
    writer.append(CONTACT)
    writer.flush()
    copied = tmp_path / "cut.h5"
    shutil.copy(written.path, copied)
    shutil.copy(journal_of(written.path), journal_of(copied))
    writer.discard()
    assert repair(copied, tmp_path / "repaired.h5").results == 6
    with SessionReader(tmp_path / "repaired.h5") as read:
        for found, snapshot in zip(read.snapshots(), written.snapshots, strict=True):
            assert difference(found, snapshot) == ""
        assert read.contact() is not None
        assert read.outcome.counts == COUNTS


def test_whole_session_says_so_and_nothing_is_written(session: Session) -> None:
    repaired = repair(session.path, session.path.with_name("repaired.h5"))
    assert (repaired.output, repaired.receipt.frames) == (None, 7)
    assert str(repaired).startswith(
        f"{session.path}: the session is whole, nothing is to be repaired: 7 frames, 1 lost"
    )
    assert not session.path.with_name("repaired.h5").exists()


@pytest.mark.parametrize("format_version", [4, 3])
def test_damaged_session_without_a_journal_gives_what_can_be_read(
    session: Session, tmp_path: Path, format_version: int
) -> None:
    """Of format 4 an image that was altered; before, there were no checksums, and only what can not
    be read is found.
    """
    with h5py.File(session.path, "r+") as file:
        file.attrs["slipscope_format"] = format_version
        if format_version == 4:
            file["/entry/instrument/camera/data"][5, 3, 3] ^= 1  # trigger 6
        else:
            file["/entry/triggers/image"][6] = 99
    repaired = repair(session.path, tmp_path / "repaired.h5")
    assert (repaired.source, repaired.torn, repaired.results) == ("file", 1, 5)
    assert_same(tmp_path / "repaired.h5", session, lost=(6,))
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.state, read.outcome.reason) == (
            "done",
            "the travel is done; repaired, 1 images were lost",
        )
        assert read.outcome.summary is not None


def test_forces_that_can_not_be_read_become_a_gap(tmp_path: Path) -> None:
    """One altered bit costs the 4096 samples that share its checksum, less those that were missing
    before; the others come back.
    """
    volts, forces = np.random.default_rng(3).normal(size=(2, 9000, 2))
    writer = make_writer(tmp_path / "altered.h5")
    writer.append(Samples(0, volts[:4090], forces[:4090]))
    writer.append(Samples(4110, volts[4110:8990], forces[4110:8990]))
    writer.append(Gap(8990, 10, "overflow"))
    writer.append(OUTCOME)
    writer.close()
    alter(tmp_path / "altered.h5", "/entry/forces/shear_sensor", 5000)
    repaired = repair(tmp_path / "altered.h5", tmp_path / "repaired.h5")
    assert (repaired.source, repaired.unread, repaired.receipt.samples) == ("file", 4082, 9000)
    assert "0 images and 4082 samples could not be read" in str(repaired)
    volts[4090:8192] = forces[4090:8192] = volts[8990:] = forces[8990:] = np.nan
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.gaps() == [(4090, 20), (4110, 4082), (8990, 10)]
        assert_array_equal(read.forces().volts, volts)
        assert_array_equal(read.forces().forces, forces)
        assert [e.text for e in read.events() if e.sample == 4110] == [
            "4082 samples lost: they can not be read, the bytes are not those that were recorded"
        ]


def test_what_can_not_be_repaired_says_why(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    with pytest.raises(
        UserError, match=r"cut\.h5: this is the session itself, which is never changed"
    ):
        repair(written.path, written.path)
    with pytest.raises(UserError, match="there is no such session"):
        repair(tmp_path / "absent.h5", tmp_path / "repaired.h5")
    (tmp_path / "repaired.h5").write_bytes(b"mine")
    with pytest.raises(UserError, match="a session of that name exists"):
        repair(written.path, tmp_path / "repaired.h5")
    journal_of(written.path).unlink()
    written.path.write_bytes(bytes(5000))
    with pytest.raises(UserError, match="not an HDF5 file"):
        repair(written.path, tmp_path / "other.h5")
    assert (tmp_path / "repaired.h5").read_bytes() == b"mine"


IMPOSSIBLE = [
    Samples(10**15, np.empty((0, 2)), np.empty((0, 2))),
    Gap(0, 10**15, "x"),
    Gap(10**15, 1, "x"),
    make_header(),
]


@pytest.mark.parametrize("record_", IMPOSSIBLE, ids=range(len(IMPOSSIBLE)))
def test_journal_with_an_impossible_record_gives_a_sentence_and_no_file(
    tmp_path: Path, record_: Any
) -> None:
    path = cut_short(tmp_path).path
    add(journal_of(path), record_)
    with pytest.raises(UserError, match="what its journal holds makes no session"):
        repair(path, tmp_path / "repaired.h5")
    assert not list(tmp_path.glob("repaired*"))


ODD = [
    {"index": 1},
    {"sample": [], "kind": {}, "text": 3},
    {"sample": -5, "kind": "stop", "text": "x"},
    {"sample": 2**63, "kind": "stop", "text": "x"},
    [5, "stop", "x"],
    "x",
]


@pytest.mark.parametrize("event", ODD, ids=range(len(ODD)))
def test_record_that_is_none_ends_the_journal_and_what_came_before_is_brought_back(
    tmp_path: Path, event: object
) -> None:
    written = cut_short(tmp_path)
    content = msgspec.msgpack.encode(event)
    with journal_of(written.path).open("ab") as file:
        file.write(journal._HEAD.pack(journal._MARK, 7, len(content), crc32(content)) + content)
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert repaired.cut_bytes == journal._HEAD.size + len(content)
    assert "; what came after the torn end of the journal is lost" in str(repaired)
    assert_same(tmp_path / "repaired.h5", written)


def test_journal_of_an_earlier_version_names_the_program_that_reads_it(tmp_path: Path) -> None:
    path = cut_short(tmp_path).path
    journal_of(path).write_bytes(b"SlipScope journal 1\n" + journal_of(path).read_bytes()[20:])
    with pytest.raises(UserError, match=r"a journal of format 1, .* with the SlipScope that"):
        repair(path, tmp_path / "repaired.h5")
    assert not list(tmp_path.glob("repaired*"))


def test_journal_can_not_ask_for_more_than_there_was(tmp_path: Path) -> None:
    """A few bytes of a journal from elsewhere could fill the disk."""
    path = cut_short(tmp_path).path
    content = journal_of(path).read_bytes()
    image = next(r for r in read_journal(journal_of(path)) if isinstance(r, StoredFrame))
    for hostile, found in (
        ([Gap(1003, 3_000_000, "x"), Gap(3_001_003, 3_000_000, "x")], "6000003 samples"),
        (
            [replace(image, index=n) for n in range(8, 5000)],
            "more images than the session has room",
        ),
    ):
        journal_of(path).write_bytes(content)
        for record_ in hostile:
            add(journal_of(path), record_)
        with pytest.raises(UserError, match=found):
            repair(path, tmp_path / "repaired.h5")
        assert not list(tmp_path.glob("repaired*"))


def add(path: Path, record_: Any) -> None:
    """Add a record to a journal."""
    writing = Journal(path.with_name("added"), overwrite=True)
    began = writing._end
    writing.append(record_)
    writing.close()
    with path.open("ab") as file:
        file.write(writing.path.read_bytes()[began:])


def test_results_that_do_not_fit_do_not_keep_the_images_from_coming_back(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "open.h5")
    writer.flush()
    path = tmp_path / "cut.h5"
    shutil.copy(written.path, path)
    shutil.copy(journal_of(written.path), journal_of(path))
    writer.discard()
    with h5py.File(path, "r+") as file:
        for name in ("ux", "uy", "ux_errors", "uy_errors", "zncc", "status"):
            kind = file[f"/entry/fields/{name}"].dtype
            del file[f"/entry/fields/{name}"]
            file.create_dataset(f"/entry/fields/{name}", (6, 3, 3), kind)
    repaired = repair(path, tmp_path / "repaired.h5")
    # those before the reference have no field
    assert (repaired.receipt.frames, repaired.results) == (7, 2)


def test_failed_repair_leaves_no_output(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = cut_short(tmp_path)
    monkeypatch.setattr(
        "app.session.files.shutil.disk_usage", lambda _: type("usage", (), {"free": 0})
    )
    with pytest.raises(UserError, match=r"repaired\.h5: it can not be written: the disk is full"):
        repair(written.path, tmp_path / "repaired.h5")
    assert not list(tmp_path.glob("repaired*"))
