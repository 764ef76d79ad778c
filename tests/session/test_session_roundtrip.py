"""What comes back from a session is what went in, to the bit."""

from __future__ import annotations

import dataclasses
import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from session_material import (
    CONTACT,
    COUNTS,
    NAN,
    OUTCOME,
    SHAPE,
    Session,
    assert_identical,
    make_header,
    make_snapshot,
    make_writer,
    record,
    stamp_of,
)

from app.records.record_types import End, Event, Outcome, Samples
from app.session import layout
from app.session.layout import FORMAT_ATTRIBUTE
from app.session.reader import SessionReader
from drivers.protocols import Frame, LostFrame
from tests.same_results import difference


def test_the_header(session: Session) -> None:
    with SessionReader(session.path) as read:
        assert_identical(read.header, make_header(started=read.header.started))
        began, ended = map(datetime.datetime.fromisoformat, (read.header.started, read.ended))
        assert began <= ended


def test_forces_with_a_gap_keep_their_samples(session: Session) -> None:
    with SessionReader(session.path) as read:
        assert read.forces().first == 0
        assert_array_equal(read.forces().volts, session.volts)
        assert_array_equal(read.forces().forces, session.forces)
        assert read.gaps() == [(500, 3)]
        blocks = [record for record in read.records() if isinstance(record, Samples)]
        assert [(block.first, len(block.volts)) for block in blocks] == [(0, 500), (503, 500)]


def test_positions_and_events(session: Session) -> None:
    with SessionReader(session.path) as read:
        samples, metres = read.positions()
        assert list(zip(samples.tolist(), metres.tolist(), strict=True)) == session.positions
        assert read.events() == session.events


def test_every_trigger_has_its_fate(session: Session) -> None:
    with SessionReader(session.path) as read:
        triggers = read.triggers()
        assert triggers["index"].tolist() == list(range(8))
        assert triggers["sample"].tolist() == [5 + 125 * n for n in range(8)]
        assert triggers["received"].tolist() == [n != 3 for n in range(8)]
        assert triggers["analysed"].tolist() == [n not in {3, 5} for n in range(8)]
        assert_array_equal(triggers["stamp"], [np.nan if n == 3 else stamp_of(n) for n in range(8)])
        assert read.lost_frames() == [(3, 380, "no image within 0.5 s")]
        assert read.analysed_frames() == [0, 1, 2, 4, 6, 7]


def test_images(session: Session) -> None:
    with SessionReader(session.path) as read:
        found = list(read.frames())
        assert [(index, sample) for index, sample, _ in found] == [
            (n, 5 + 125 * n) for n in session.images
        ]
        for index, _, image in found:
            assert image.dtype == np.uint8
            assert_array_equal(image, session.images[index])
        assert_array_equal(read.frame(6)[2], session.images[6])


def test_images_of_sixteen_bits(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 65536, SHAPE, np.uint16)
    writer = make_writer(tmp_path / "deep.h5", frame_dtype="uint16")
    writer.append(Frame(0, 5, image))
    writer.close()
    with SessionReader(tmp_path / "deep.h5") as read:
        assert read.frame(0)[2].dtype == np.uint16
        assert_array_equal(read.frame(0)[2], image)


def test_snapshots(session: Session) -> None:
    with SessionReader(session.path) as read:
        found = list(read.snapshots())
        assert len(found) == len(session.snapshots)
        for a, b in zip(found, session.snapshots, strict=True):
            assert_identical(a, b)
        assert_identical(read.snapshot(3), session.snapshots[3])


@pytest.mark.parametrize(("version", "lacks_errors"), [(1, True), (2, False)])
def test_a_session_of_an_earlier_format_has_what_it_had(
    session: Session, version: int, lacks_errors: bool
) -> None:
    with h5py.File(session.path, "r+") as file:
        file.attrs[FORMAT_ATTRIBUTE] = version
        for item in layout.COLUMNS:
            if item.since > version and item.path in file:
                del file[item.path]
    with SessionReader(session.path) as read:
        assert read.format == version
        for a, b in zip(read.snapshots(), session.snapshots, strict=True):
            if b.field is None or b.stick is None:
                assert_identical(a, b)
                continue
            nothing = np.full_like(b.field.ux_px, np.nan)
            lacks = {"ux_std_px": nothing, "uy_std_px": nothing} if lacks_errors else {}
            expected = dataclasses.replace(
                b,
                field=dataclasses.replace(b.field, **lacks),
                motion=dataclasses.replace(b.motion, centre_ux_sd_m=NAN, drive_angle_rad=NAN),
                stick=dataclasses.replace(b.stick, full_slip_pa=NAN, reduced_chi2=NAN),
                traction=None,
                stress=None,
            )
            assert_identical(a, expected)
            assert difference(b, a, version) == ""
            assert difference(b, a) == "results/centre_ux_errors"  # the first that is new
        assert np.isnan(read.results()["block_m"]).all()
        assert np.isnan(read.outcome.summary.law_mu)


def test_results_of_the_whole_run(session: Session) -> None:
    with SessionReader(session.path) as read:
        assert_identical(read.contact(), CONTACT)
        assert_identical(read.outcome, OUTCOME)


def test_batching_does_not_change_the_file(tmp_path: Path, session: Session) -> None:
    """Flushing after every step or once at the end gives the same content."""
    writer, _ = record(tmp_path / "once.h5", flush_each=False)
    writer.close()
    with SessionReader(tmp_path / "once.h5") as once, SessionReader(session.path) as often:
        for a, b in zip(once.snapshots(), often.snapshots(), strict=True):
            assert_identical(a, b)
        for name in once.triggers().dtype.names:
            assert_array_equal(once.triggers()[name], often.triggers()[name])
        assert_array_equal(once.forces().forces, often.forces().forces)


def test_session_that_was_not_finished_says_so(tmp_path: Path) -> None:
    writer, _ = record(tmp_path / "open.h5")
    writer.close()
    writer.close()
    with SessionReader(tmp_path / "open.h5") as read:
        assert read.outcome.state == "unfinished"
        assert read.outcome.reason
        assert (read.ended, read.outcome.resources) == ("", {})
        assert (read.contact(), read.outcome.summary) == (None, None)
        assert read.outcome.counts == COUNTS  # from the tables


def test_failed_run_without_summary(tmp_path: Path) -> None:
    writer, _ = record(tmp_path / "failed.h5")
    writer.append(Outcome(End.FAILED, "actuator 'sim': stalled", COUNTS, None))
    writer.close()
    with SessionReader(tmp_path / "failed.h5") as read:
        assert (read.outcome.state, read.outcome.reason) == ("failed", "actuator 'sim': stalled")
        assert read.outcome.summary is None


def test_session_in_which_nothing_happened(tmp_path: Path) -> None:
    make_writer(tmp_path / "empty.h5").close()
    with SessionReader(tmp_path / "empty.h5") as read:
        assert read.forces().volts.shape == (0, 2)
        assert (
            list(read.frames()),
            list(read.snapshots()),
            read.events(),
            len(read.triggers()),
        ) == ([], [], [], 0)


def test_texts_that_hdf5_can_not_hold_are_spelled_out(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "text.h5")
    writer.append(Event(0, "error", "reply '\0\ud800' of the stage"))
    writer.close()
    with SessionReader(tmp_path / "text.h5") as read:
        assert read.events() == [Event(0, "error", "reply '\\0\\ud800' of the stage")]


@pytest.mark.parametrize("first", [249, -1, 10**12])
def test_samples_that_can_not_be_placed_are_refused(tmp_path: Path, first: int) -> None:
    writer = make_writer(tmp_path / "samples.h5")
    writer.append(Samples(0, np.zeros((250, 2)), np.zeros((250, 2))))
    with pytest.raises(ValueError, match="cannot be placed"):
        writer.append(Samples(first, np.zeros((50, 2)), np.zeros((50, 2))))
    writer.close()
    with SessionReader(tmp_path / "samples.h5") as read:
        assert len(read.forces().volts) == 250


@pytest.mark.parametrize(
    "image",
    [np.zeros((12, 15), np.uint8), np.zeros(SHAPE, np.uint16), np.zeros((1, *SHAPE), np.uint8)],
)
def test_image_of_another_kind_is_refused(tmp_path: Path, image: np.ndarray) -> None:
    writer = make_writer(tmp_path / "image.h5")
    with pytest.raises(ValueError, match=r"\(12, 16\) uint8"):
        writer.append(Frame(0, 5, image))
    writer.close()
    with SessionReader(tmp_path / "image.h5") as read:
        assert len(read.triggers()) == 0


def test_results_of_a_frame_that_is_not_there_are_refused(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "orphan.h5")
    writer.append(LostFrame(4, 505, "lost"))
    with pytest.raises(ValueError, match="frame 4"):
        writer.append(make_snapshot(4))
    writer.close()
