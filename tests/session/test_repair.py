"""A repair brings back everything durable, never touches the original, and says what is lost."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import h5py
import msgspec
import numpy as np
import pytest
from changed_files import removed
from killed_recorder import Recording
from numpy.testing import assert_array_equal
from session_material import (
    CONTACT,
    COUNTS,
    OUTCOME,
    SHAPE,
    Session,
    alter,
    assert_same,
    close_beside_journal,
    copy_recording,
    finish,
    make_header,
    make_snapshot,
    make_writer,
    record,
)

from app.cli.file_commands import repair as repair_command
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import DisplacementField, Gap, Samples
from app.session import journal
from app.session.files import images_of, results_of
from app.session.journal import Journal, StoredFrame, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.repair import repair
from app.system.disk import AppendedFile
from app.system.errors import UserError
from tests.same_results import difference


def cut_short(folder: Path) -> Session:
    """A session as a kill before its first flush leaves it."""
    writer, written = record(folder / "open.h5", flush_each=False)
    path = folder / "cut.h5"
    copy_recording(written.path, path)
    writer.discard()
    written.path = path
    return written


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1, 3, 40, 90])
def test_a_kill_at_any_instant_loses_nothing_that_the_system_had(
    tmp_path: Path, frames: int
) -> None:
    """`benchmarks crash` measures for how long something is with the program alone."""
    with Recording(tmp_path / "killed.h5", 100.0, (64, 96)) as recording:
        recording.wait_until_sent(frames)
        recording.wait_until_held(frames)
        kill = recording.kill()
    assert min(kill.lost + kill.forces_lost, default=frames) >= frames


def test_all_comes_back_from_the_journal(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert (repaired.source, repaired.found.is_whole, repaired.receipt.frames) == (
        "journal",
        True,
        7,
    )
    assert_same(tmp_path / "repaired.h5", written)
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.state, read.outcome.counts.frames_lost) == ("unfinished", 1)
        assert (
            read.outcome.reason
            == "the run was cut short; brought back from its journal, 7 frames kept, 0 images lost"
        )
    assert not journal_of(tmp_path / "repaired.h5").exists()


@pytest.mark.parametrize("as_json", [False, True])
def test_what_is_missing_is_said_first_and_with_what_to_do(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], as_json: bool
) -> None:
    written = cut_short(tmp_path)
    images_of(written.path).write_bytes(bytes(images_of(written.path).stat().st_size))
    assert repair_command(written.path, tmp_path / "b.h5", False, as_json) == 1
    said = " ".join(capfd.readouterr().err.split())
    assert f"{written.path.name}: not all of it is left: 7 of 7 recorded images and 0" in said
    assert "of images is cut.h5.images" in said
    assert "if there is a copy" in said


def test_torn_image_is_a_lost_frame_with_that_reason(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    content = bytearray(images_of(written.path).read_bytes())
    content[content.index(written.images[4].tobytes())] ^= 1
    end = content.index(written.images[7].tobytes())
    images_of(written.path).write_bytes(content[: end + 5])
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert (repaired.found.torn, repaired.found.is_whole) == (2, False)
    assert (
        "; 2 of 7 recorded images and 0 samples could not be brought back; results of 4 frames"
        in str(repaired)
    )
    assert_same(tmp_path / "repaired.h5", written, lost=(4, 7))
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.lost_frames()[1:] == [
            (
                index,
                5 + 125 * index,
                "its image cannot be read, the bytes are not those that were recorded",
            )
            for index in (4, 7)
        ]


def test_results_come_along_where_they_can_be_read(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "results.h5")
    writer.append(CONTACT)
    writer.flush()
    copied = tmp_path / "cut.h5"
    copy_recording(written.path, copied)
    writer.discard()
    assert repair(copied, tmp_path / "repaired.h5").found.results == 6
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
    """Of format 4 an image that was altered; before, there were no checksums, and only what cannot
    be read is found.
    """
    with h5py.File(session.path, "r+") as file:
        file.attrs["slipscope_format"] = format_version
        if format_version == 4:
            file["/entry/instrument/camera/data"][5, 3, 3] ^= 1  # trigger 6
        else:
            file["/entry/triggers/image"][6] = 99
    repaired = repair(session.path, tmp_path / "repaired.h5")
    assert (repaired.source, repaired.found.torn, repaired.found.results) == ("file", 1, 5)
    assert_same(tmp_path / "repaired.h5", session, lost=(6,))
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.state, read.outcome.reason) == (
            "done",
            "the travel is done; repaired, 1 images were lost",
        )
        assert read.outcome.summary is not None


@pytest.mark.parametrize("damage", ["altered", "missing"])
def test_a_map_of_the_pixels_that_can_not_be_read_is_left_out(
    tmp_path: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """All else comes back, and the sentence and the session say what that means."""
    gain = np.full(SHAPE, 1.25, np.float32)
    writer, written = record(tmp_path / "a.h5", pattern=PixelPattern(gain, np.zeros_like(gain)))
    finish(writer, CONTACT)
    with SessionReader(tmp_path / "a.h5") as read:
        assert_array_equal(read.pattern().gain, gain)
    if damage == "altered":
        alter(tmp_path / "a.h5", "/entry/pattern/gain", 0)
    else:
        removed("/entry/pattern/dark")(tmp_path / "a.h5")
    assert repair_command(tmp_path / "a.h5", tmp_path / "b.h5") == 1
    sentence = (
        "the map of the pixels cannot be read and is left out: the pictures are as they came from"
        " the camera, the results were computed with the map"
    )
    assert sentence in " ".join(capsys.readouterr().out.split())
    with SessionReader(tmp_path / "b.h5") as read:
        assert read.pattern() is None
        first, *events = read.events()
        assert (first.kind, first.text, events) == ("recording", sentence, written.events)
        assert len(read.analysed_frames()) == len(written.snapshots)
        assert read.outcome.reason == "the travel is done; repaired, 0 images were lost"
        for index, _, image in read.frames():
            assert_array_equal(image, written.images[index])


def test_forces_that_can_not_be_read_become_a_gap(tmp_path: Path) -> None:
    """One altered bit costs the 4096 samples that share its checksum, less those that were missing
    before; the others come back.
    """
    volts, forces = np.random.default_rng(3).normal(size=(2, 9000, 2))
    writer = make_writer(tmp_path / "altered.h5")
    writer.append(Samples(0, volts[:4090], forces[:4090]))
    writer.append(Samples(4110, volts[4110:8990], forces[4110:8990]))
    writer.append(Gap(8990, 10, "overflow"))
    finish(writer)
    alter(tmp_path / "altered.h5", "/entry/forces/shear_sensor", 5000)
    repaired = repair(tmp_path / "altered.h5", tmp_path / "repaired.h5")
    assert (repaired.source, repaired.found.unread) == ("file", 4082)
    assert repaired.receipt.samples == 9000
    assert "0 of 0 recorded images and 4082 samples could not be brought back" in str(repaired)
    volts[4090:8192] = forces[4090:8192] = volts[8990:] = forces[8990:] = np.nan
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.gaps() == [(4090, 20), (4110, 4082), (8990, 10)]
        assert_array_equal(read.forces().volts, volts)
        assert_array_equal(read.forces().forces, forces)
        assert [e.text for e in read.events() if e.sample == 4110] == [
            "4082 samples lost: they cannot be read, the bytes are not those that were recorded"
        ]


def test_what_can_not_be_repaired_says_why(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    with pytest.raises(UserError, match=r"cut\.h5\.journal: a journal of a session that was cut"):
        repair(written.path, written.path)
    with pytest.raises(UserError, match="there is no such session"):
        repair(tmp_path / "absent.h5", tmp_path / "repaired.h5")
    (tmp_path / "repaired.h5").write_bytes(b"mine")
    with pytest.raises(UserError, match="a session of that name exists"):
        repair(written.path, tmp_path / "repaired.h5")
    for file in tmp_path.glob("cut*"):
        file.unlink()
    written.path.write_bytes(bytes(5000))
    with pytest.raises(UserError, match="not an HDF5 file"):
        repair(written.path, tmp_path / "other.h5")
    assert (tmp_path / "repaired.h5").read_bytes() == b"mine"


IMPOSSIBLE = [
    Samples(10**15, np.empty((0, 2)), np.empty((0, 2))),
    Gap(0, 10**15, "x"),
    Gap(10**15, 1, "x"),
    make_header(divisor=126),
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


@pytest.mark.slow
@pytest.mark.parametrize("event", ODD, ids=range(len(ODD)))
def test_record_that_is_none_is_passed_over_and_all_others_are_brought_back(
    tmp_path: Path, event: object
) -> None:
    written = cut_short(tmp_path)
    content = msgspec.msgpack.encode(event)
    whole = journal_of(written.path).read_bytes()
    middle = whole.rindex(journal._MARK)
    odd = forged(6, content)
    journal_of(written.path).write_bytes(whole[:middle] + odd + whole[middle:])
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert repaired.found.damaged_bytes == len(odd)
    assert f"; {len(odd)} bytes of the journal are damaged" in str(repaired)
    assert_same(tmp_path / "repaired.h5", written)


def test_journal_of_an_earlier_version_names_the_program_that_reads_it(tmp_path: Path) -> None:
    path = cut_short(tmp_path).path
    journal_of(path).write_bytes(b"SlipScope journal 1\n" + journal_of(path).read_bytes()[20:])
    with pytest.raises(UserError, match=r"a journal of format 1, .* with the SlipScope that"):
        repair(path, tmp_path / "repaired.h5")
    assert not list(tmp_path.glob("repaired*"))


@pytest.mark.slow
def test_journal_can_not_ask_for_more_than_there_was(tmp_path: Path) -> None:
    """A few bytes of a journal from elsewhere could fill the disk."""
    path = cut_short(tmp_path).path
    content = journal_of(path).read_bytes()
    image = next(r for r in read_journal(journal_of(path)) if isinstance(r, StoredFrame))
    for hostile, found in (
        ([Gap(1003, 3_000_000, "x"), Gap(3_001_003, 3_000_000, "x")], "6000003 samples"),
        (
            [replace(image, index=n) for n in range(8, 5000)],
            "more images than there is room",
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
    writing = AppendedFile(path.with_name("added"), overwrite=True)
    Journal(writing).append(record_)
    writing.close()
    with path.open("ab") as file:
        file.write(writing.path.read_bytes()[len(journal.MAGIC) :])


def forged(kind: int, payload: bytes) -> bytes:
    """A record of a journal with its checksum, whatever it holds."""
    rest = journal._ABOUT.pack(kind, len(payload), 0) + payload
    return journal._HEAD.pack(journal._MARK, crc32(rest)) + rest


def test_results_that_do_not_fit_do_not_keep_the_images_from_coming_back(
    session: Session, tmp_path: Path
) -> None:
    with h5py.File(session.path, "r+") as file:
        file["/entry/instrument/camera/data"][5, 3, 3] ^= 1
        for name in ("ux", "uy", "ux_errors", "uy_errors", "zncc", "status"):
            kind = file[f"/entry/fields/{name}"].dtype
            del file[f"/entry/fields/{name}"]
            file.create_dataset(f"/entry/fields/{name}", (6, 3, 3), kind)
    repaired = repair(session.path, tmp_path / "repaired.h5")
    # those before the reference have no field
    assert (repaired.receipt.frames, repaired.found.results) == (6, 2)


def test_failed_repair_leaves_no_output_and_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = cut_short(tmp_path)
    (tmp_path / "repaired.h5").write_bytes(b"earlier")

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("app.system.disk.SparedFile.sync", full)
    with pytest.raises(UserError, match=r"repaired\.h5: it cannot be written: No space left"):
        repair(written.path, tmp_path / "repaired.h5", overwrite=True)
    assert [file.name for file in tmp_path.glob("*repaired*")] == ["repaired.h5"]
    assert (tmp_path / "repaired.h5").read_bytes() == b"earlier"


def test_the_command_ends_with_1_where_something_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = cut_short(tmp_path)
    command = (written.path, tmp_path / "repaired.h5")
    assert repair_command(*command, overwrite=False, as_json=False) == 0
    content = bytearray(images_of(written.path).read_bytes())
    content[content.index(written.images[4].tobytes())] ^= 1
    images_of(written.path).write_bytes(content)
    assert repair_command(*command, overwrite=True, as_json=False) == 1
    assert "1 of 7 recorded images" in " ".join(capsys.readouterr().out.split())
    assert repair_command(*command, overwrite=True, as_json=True) == 1


def test_a_record_that_somebody_changed_is_told(tmp_path: Path) -> None:
    """With its checksum made right; only the chain shows it."""
    written = cut_short(tmp_path)
    content = bytearray(journal_of(written.path).read_bytes())
    at = content.index(b"phase 2") - 64
    at = content.index(journal._MARK, at)
    while b"phase 2" not in content[at : content.index(journal._MARK, at + 1)]:
        at = content.index(journal._MARK, at + 1)
    end = content.index(journal._MARK, at + 1)
    content[content.index(b"phase 2") + 6] = ord("9")
    content[at + 4 : at + 8] = crc32(content[at + 8 : end]).to_bytes(4, "little")
    journal_of(written.path).write_bytes(content)
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert (repaired.found.altered, repaired.found.is_whole) == (1, False)
    assert "somebody has changed it" in str(repaired)


def test_a_session_that_was_given_its_name_but_kept_its_journal_is_whole(tmp_path: Path) -> None:
    """As a kill between the last two steps of a close leaves it."""
    writer, written = record(tmp_path / "a.h5")
    writer.append(OUTCOME)
    close_beside_journal(writer)
    assert repair(written.path, tmp_path / "repaired.h5").output is None


def test_results_that_are_of_another_grid_cost_nothing_else(tmp_path: Path) -> None:
    """In a file of results that somebody wrote: its checksums are right."""
    written = cut_short(tmp_path)
    misfit = make_snapshot(7)
    wide = np.zeros((2, 4), np.float32)
    misfit = replace(misfit, field=DisplacementField(*[wide] * 5, np.zeros((2, 4), np.uint8)))
    add(results_of(written.path), misfit)
    repaired = repair(written.path, tmp_path / "repaired.h5")
    assert (repaired.receipt.frames, repaired.found.results) == (7, 6)
    assert repaired.found.damaged_bytes > 0


def test_a_contact_that_is_told_twice_is_the_first(tmp_path: Path) -> None:
    written = cut_short(tmp_path)
    for radius in (1e-3, 2e-3):
        add(results_of(written.path), replace(CONTACT, apparent_radius_m=radius))
    repair(written.path, tmp_path / "repaired.h5")
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.contact().apparent_radius_m == 1e-3
