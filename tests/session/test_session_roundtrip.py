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
    GRID_X,
    GRID_Y,
    NAN,
    OUTCOME,
    SHAPE,
    SUMMARY,
    TOML,
    VERSIONS,
    Session,
    make_snapshot,
    make_writer,
    record,
)

from app.results import Event, Outcome
from app.session import layout
from app.session.layout import FORMAT_ATTRIBUTE, FORMAT_VERSION
from app.session.reader import SessionReader


def assert_same(a: object, b: object) -> None:
    """Two results are equal field by field: type, dtype, shape and every bit, NaN included."""
    assert type(a) is type(b)
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert type(x) is type(y), field.name
        if isinstance(x, np.ndarray):
            assert (x.dtype, x.shape, x.tobytes()) == (y.dtype, y.shape, y.tobytes()), field.name
        elif isinstance(x, float) or (isinstance(x, tuple) and isinstance(x[0], float)):
            assert_array_equal(x, y, err_msg=field.name)
        else:
            assert x == y, field.name


def test_what_was_known_at_the_start(session: Session) -> None:
    with SessionReader(session.path) as read:
        assert read.config_toml == TOML
        assert (read.sample_rate_hz, read.exposure_samples, read.divisor, read.first_trigger) == (
            1000.0,
            10,
            125,
            5,
        )
        assert read.pixel_m == 7.04e-6
        assert read.versions == VERSIONS
        assert read.frame_shape == SHAPE
        assert_array_equal(read.grid_x_px, GRID_X)
        assert_array_equal(read.grid_y_px, GRID_Y)
        assert datetime.datetime.fromisoformat(read.started) <= datetime.datetime.fromisoformat(
            read.ended
        )


def test_forces_with_a_gap_keep_their_samples(session: Session) -> None:
    with SessionReader(session.path) as read:
        first, volts, newtons = read.forces()
        assert first == 0
        assert_array_equal(volts, session.volts)
        assert_array_equal(newtons, session.forces)
        assert read.gaps() == [(500, 3)]


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
    writer = make_writer(tmp_path / "deep.h5", frame_dtype=np.dtype(np.uint16))
    writer.append_frame(0, 5, image)
    writer.close()
    with SessionReader(tmp_path / "deep.h5") as read:
        assert read.frame(0)[2].dtype == np.uint16
        assert_array_equal(read.frame(0)[2], image)


def test_snapshots(session: Session) -> None:
    with SessionReader(session.path) as read:
        found = list(read.snapshots())
        assert len(found) == len(session.snapshots)
        for a, b in zip(found, session.snapshots, strict=True):
            assert_same(a, b)
        assert_same(read.snapshot(3), session.snapshots[3])


@pytest.mark.parametrize(("version", "lacks_errors"), [(1, True), (2, False)])
def test_a_session_of_an_earlier_format_has_what_it_had(
    session: Session, version: int, lacks_errors: bool
) -> None:
    with h5py.File(session.path, "r+") as file:
        file.attrs[FORMAT_ATTRIBUTE] = version
        for item in layout.ITEMS:
            if item.since > version and item.path in file:
                del file[item.path]
    stress = {
        "stress_radius_m",
        "stress_pa",
        "stress_sd_pa",
        "stress_force_n",
        "stress_force_sd_n",
        "block_m",
        "block_sd_m",
    }
    later = stress | {"full_slip_pa", "peak_radius_m", "peak_radius_sd_m"}
    with SessionReader(session.path) as read:
        assert read.lacking == later | ({"ux_std_px", "uy_std_px"} if lacks_errors else set())
        for a, b in zip(read.snapshots(), session.snapshots, strict=True):
            nothing = np.full(b.ux_px.shape, np.nan, np.float32)
            had = {
                name: np.empty(0) if isinstance(getattr(b, name), np.ndarray) else np.nan
                for name in later
            }
            assert_same(
                a,
                dataclasses.replace(
                    b,
                    **had,
                    **({"ux_std_px": nothing, "uy_std_px": nothing} if lacks_errors else {}),
                ),
            )
        assert np.isnan(read.summary().law_mu)


def test_a_session_of_today_lacks_nothing(session: Session) -> None:
    with SessionReader(session.path) as read:
        assert (read.format, read.lacking) == (FORMAT_VERSION, frozenset())


def test_results_of_the_whole_run(session: Session) -> None:
    with SessionReader(session.path) as read:
        contact, summary = read.contact(), read.summary()
        assert contact is not None
        assert summary is not None
        assert_same(contact, CONTACT)
        assert_same(summary, SUMMARY)
        assert read.counts() == COUNTS
        assert (read.state, read.reason, read.resources) == (
            OUTCOME.state,
            OUTCOME.reason,
            OUTCOME.resources,
        )


def test_batching_does_not_change_the_file(tmp_path: Path, session: Session) -> None:
    """Flushing after every step or once at the end gives the same content."""
    writer, _ = record(tmp_path / "once.h5", flush_each=False)
    writer.close()
    with SessionReader(tmp_path / "once.h5") as once, SessionReader(session.path) as often:
        for a, b in zip(once.snapshots(), often.snapshots(), strict=True):
            assert_same(a, b)
        assert_array_equal(once.triggers(), often.triggers())
        assert_array_equal(once.forces()[2], often.forces()[2])


def test_session_that_was_not_finished_says_so(tmp_path: Path) -> None:
    writer, _ = record(tmp_path / "open.h5")
    writer.close()
    writer.close()
    with SessionReader(tmp_path / "open.h5") as read:
        assert read.state == "unfinished"
        assert read.reason
        assert (read.ended, read.resources) == ("", {})
        assert (read.contact(), read.summary()) == (None, None)
        assert read.counts() == COUNTS  # from the tables


def test_failed_run_without_summary(tmp_path: Path) -> None:
    writer, _ = record(tmp_path / "failed.h5")
    writer.finish(Outcome("failed", "actuator 'sim': stalled", COUNTS, None))
    writer.close()
    with SessionReader(tmp_path / "failed.h5") as read:
        assert (read.state, read.reason) == ("failed", "actuator 'sim': stalled")
        assert read.summary() is None


def test_session_in_which_nothing_happened(tmp_path: Path) -> None:
    make_writer(tmp_path / "empty.h5").close()
    with SessionReader(tmp_path / "empty.h5") as read:
        assert read.forces()[1].shape == (0, 2)
        assert (
            list(read.frames()),
            list(read.snapshots()),
            read.events(),
            len(read.triggers()),
        ) == ([], [], [], 0)


def test_texts_that_hdf5_can_not_hold_are_spelled_out(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "text.h5")
    writer.append_event(Event(0, "error", "reply '\0\ud800' of the stage"))
    writer.close()
    with SessionReader(tmp_path / "text.h5") as read:
        assert read.events() == [Event(0, "error", "reply '\\0\\ud800' of the stage")]


@pytest.mark.parametrize("first", [249, -1, 10**12])
def test_samples_that_can_not_be_placed_are_refused(tmp_path: Path, first: int) -> None:
    writer = make_writer(tmp_path / "samples.h5")
    writer.append_samples(0, np.zeros((250, 2)), np.zeros((250, 2)))
    with pytest.raises(ValueError, match="can not be placed"):
        writer.append_samples(first, np.zeros((50, 2)), np.zeros((50, 2)))
    writer.close()
    with SessionReader(tmp_path / "samples.h5") as read:
        assert len(read.forces()[1]) == 250


@pytest.mark.parametrize(
    "image",
    [np.zeros((12, 15), np.uint8), np.zeros(SHAPE, np.uint16), np.zeros((1, *SHAPE), np.uint8)],
)
def test_image_of_another_kind_is_refused(tmp_path: Path, image: np.ndarray) -> None:
    writer = make_writer(tmp_path / "image.h5")
    with pytest.raises(ValueError, match=r"\(12, 16\) uint8"):
        writer.append_frame(0, 5, image)
    writer.close()
    with SessionReader(tmp_path / "image.h5") as read:
        assert len(read.triggers()) == 0


def test_results_of_a_frame_that_is_not_there_are_refused(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "orphan.h5")
    writer.append_lost_frame(4, 505, "lost")
    with pytest.raises(ValueError, match="frame 4"):
        writer.append_snapshot(make_snapshot(4))
    writer.close()


def test_nan_of_the_summary_is_kept_apart_from_zero(session: Session) -> None:
    with SessionReader(session.path) as read:
        summary = read.summary()
        assert summary is not None
        assert_array_equal([summary.mu_d, summary.mu_d_range[1], summary.mu_s], [NAN, NAN, 0.94])
