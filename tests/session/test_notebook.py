"""`Session` gives in a notebook what was recorded, in SI units, as arrays, and reads no more than
is asked for.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from python_program import python
from session_material import (
    GRID_X,
    GRID_Y,
    SHAPE,
    SUMMARY,
    Session as Written,
    make_writer,
    session_of_format,
)

from app.records.record_types import (
    Event,
)
from app.records.snapshot_numbers import NUMBERS, numbers_of
from app.session import layout
from app.session.reader import SessionReader
from app.system.errors import UserError
from docs import reference
from slipscope import Session

ROOT = Path(__file__).parents[2]
PIXEL = 7.04e-6


def test_images_keep_the_numbers_of_their_triggers(session: Written) -> None:
    with Session(str(session.path)) as s:
        assert len(s.frames) == 8
        assert_array_equal(s.frames.received, list(session.images))
        for n, image in session.images.items():
            assert_array_equal(s.frames[n], image)
        assert_array_equal(s.frames[-1], session.images[7])
        assert_array_equal(s.frames[4:8:3], [session.images[4], session.images[7]])
        assert (s.frames[8:].shape, s.frames[8:].dtype) == ((0, *SHAPE), np.uint8)
        assert s.lost_frames == [(3, 380, "no image within 0.5 s")]


def test_a_closed_session_says_that_it_was_closed(session: Written) -> None:
    with Session(session.path) as s:
        pass
    with pytest.raises(UserError, match="the session was closed; open it again"):
        s.frames[0]


def test_an_image_that_was_lost_says_why(session: Written) -> None:
    with Session(session.path) as s:
        for asked in (3, -5, slice(2, 5)):
            with pytest.raises(
                UserError,
                match=r"session\.h5: frame 3 was lost: no image within 0\.5 s;"
                r" `frames\.received` lists",
            ):
                _ = s.frames[asked]
        for asked in (8, -9):
            with pytest.raises(IndexError, match=f"there is no frame {asked}; there are 8"):
                _ = s.frames[asked]


def test_images_are_read_when_they_are_asked_for(
    session: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    whole = SessionReader.frame
    monkeypatch.setattr(SessionReader, "frame", lambda self, n: asked.append(n) or whole(self, n))
    with Session(session.path) as s:
        _ = s.frames, s.results, s.forces, repr(s)
        assert asked == []
        _ = s.frames[6]
        assert asked == [6]


def test_forces_have_the_time_of_their_samples(session: Written) -> None:
    with Session(session.path) as s:
        time_s, normal_n, shear_n = s.forces
        assert_allclose(time_s, np.arange(1003) / 1000.0)
        assert_array_equal(np.column_stack([normal_n, shear_n]), session.forces)
        assert s.gaps == [(500, 3)]
        assert (s.sample_rate_hz, s.pixel_m) == (1000.0, PIXEL)


def test_results_are_one_table(session: Written) -> None:
    with Session(session.path) as s:
        assert s.results.dtype.names == tuple(NUMBERS)
        for row, snapshot in zip(s.results, session.snapshots, strict=True):
            for name, number in numbers_of(snapshot).items():
                assert_array_equal(row[name], number, err_msg=name)
        assert s.results["phase"].tolist()[:3] == ["background", "background", "drive"]


def test_fields_are_in_metres(session: Written) -> None:
    with Session(session.path) as s:
        assert s.fields[np.int64(3)].frame == s.fields[3].frame  # as np.flatnonzero gives it
        field, snapshot = s.fields[3], session.snapshots[3]
        assert (len(s.fields), field.frame, field.lens_m) == (6, 4, snapshot.motion.lens_m)
        assert_allclose(field.x_m, GRID_X * PIXEL)
        assert_allclose(field.y_m, GRID_Y * PIXEL)
        for found, pixels in zip(
            field[3:7],
            dataclasses.astuple(snapshot.field)[:4],
            strict=True,
        ):
            assert found.dtype == np.float64
            assert_allclose(found, pixels * PIXEL, rtol=1e-6)
        assert_array_equal(field.zncc, snapshot.field.zncc)
        assert s.fields[-1].frame == 7
        with pytest.raises(
            UserError, match="result 0 has no field: frame 0 came before the reference"
        ):
            _ = s.fields[0]
        with pytest.raises(IndexError, match="there is no field 6; there are 6"):
            _ = s.fields[6]


def test_the_rest_of_the_run(session: Written) -> None:
    with Session(session.path) as s:
        assert s.summary is not None
        assert (s.summary.mu_s, s.summary.notes) == (SUMMARY.mu_s, SUMMARY.notes)
        assert s.contact is not None
        assert s.contact.apparent_radius_m == 2.2e-3
        assert s.settings == {"run": {"normal_force": 0.5}}
        assert s.events == session.events
        assert (s.state, s.reason) == ("done", "the travel is done")
        assert math.isnan(s.drive_start_s)
        assert repr(s) == "<Session session.h5: done, 8 triggers, 6 results>"


def test_the_time_of_the_drive_is_that_of_the_forces(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "drive.h5")
    writer.append(Event(1500, "phase", "drive"))
    writer.close()
    with Session(tmp_path / "drive.h5") as s:
        assert s.drive_start_s == 1.5


def test_settings_that_are_none_are_told(tmp_path: Path) -> None:
    make_writer(tmp_path / "odd.h5", config_toml="[run").close()
    with (
        Session(tmp_path / "odd.h5") as s,
        pytest.raises(UserError, match=r"odd\.h5: the session's settings cannot be read"),
    ):
        _ = s.settings


CHECKED = ("frame", "time_s", "normal_force_n", "travel_m", "stick_radius_m", "centre_ux_m")


@pytest.mark.parametrize(
    ("version", "checksum"), [(1, 2469933011), (2, 2999432660), (3, 2999432660), (4, 3360144010)]
)
def test_sessions_of_earlier_versions_are_read(
    recorded_once: Written, tmp_path: Path, version: int, checksum: int
) -> None:
    """Files that the programs of those versions wrote; the checksums of their results are by the
    readers of those versions.
    """
    path, today = session_of_format(version, tmp_path), recorded_once
    with Session(path) as s, SessionReader(path) as reader:
        assert reader.format == version
        assert_array_equal(np.column_stack(s.forces[1:]), today.forces)
        assert_array_equal(s.frames[4:], [today.images[n] for n in range(4, 8)])
        assert (s.events, s.lost_frames, s.gaps) == (
            today.events,
            [(3, 380, "no image within 0.5 s")],
            [(500, 3)],
        )
        found = 0
        for r in reader.snapshots():
            field, rings = r.field, r.rings
            parts = [field.ux_px, field.uy_px, field.zncc, field.status] if field else []
            for part in parts + ([rings.ux_m, rings.sd_m] if rings else []):
                found = crc32(part.tobytes(), found)
            numbers = [numbers_of(r)[name] for name in CHECKED]
            found = crc32(np.array(numbers).tobytes(), found)
        assert found == checksum
        assert np.isnan(s.results["block_m"]).all() == (version < 3)
        assert s.summary is not None
        assert (s.summary.mu_s, s.summary.notes) == (SUMMARY.mu_s, SUMMARY.notes)


def test_the_example_of_the_documentation_runs(session: Written) -> None:
    done = python(ROOT / "docs/read_session.py", session.path)
    assert done.returncode == 0, done.stderr
    assert "1003 samples, 8 triggers, lost: [(3, 380, 'no image within 0.5 s')]" in done.stdout
    assert f"mean grey level of frame 7: {session.images[7].mean():.1f}" in done.stdout


def test_the_documentation_holds_the_layout() -> None:
    text = (ROOT / "docs/format.md").read_text(encoding="utf-8")
    table = reference.session_datasets()
    assert table in text, "docs/format.md is behind app/session/layout.py: python docs/reference.py"
    assert f"version {layout.FORMAT_VERSION}" in text
