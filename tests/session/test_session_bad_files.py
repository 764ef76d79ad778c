"""Whatever is not a whole session is refused with one sentence, or read as far as it goes; nothing
is overwritten.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from changed_files import attribute, changing, linked, put, removed, replaced
from hypothesis import HealthCheck, given, settings, strategies as st
from session_material import Session, copy_recording, make_writer, record
from spoiled import ask

from app.evaluation.setup import header_of
from app.records.record_types import Event, Phase, Position, Samples
from app.replay.archive import sessions_in
from app.replay.browser import conditions_at
from app.replay.replay import check_agree
from app.session.journal import journal_of
from app.session.layout import FORMAT_ATTRIBUTE, FORMAT_VERSION
from app.session.reader import SessionReader
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from app.settings.config import load
from app.system.errors import UserError
from drivers.protocols import Frame, LostFrame


def test_existing_session_is_not_overwritten_unasked(session: Session) -> None:
    before = session.path.read_bytes()
    with pytest.raises(UserError, match=r"session\.h5: a session of that name exists"):
        make_writer(session.path)
    assert session.path.read_bytes() == before
    make_writer(session.path, overwrite=True).close()
    with SessionReader(session.path) as read:
        assert len(read.triggers()) == 0


def test_what_is_gone_from_a_folder_is_not_listed(session: Session, tmp_path: Path) -> None:
    """As a link to a disk that is not there; all others are."""
    listed = tmp_path / "listed"
    listed.mkdir()
    (listed / "gone.h5").symlink_to(tmp_path / "nowhere.h5")
    (listed / "cut.h5.journal").touch()
    shutil.copy(session.path, listed / "there.h5")
    assert sorted(sessions_in(listed)) == [listed / "cut.h5", listed / "there.h5"]


def test_a_run_that_ended_before_its_first_phase_is_not_called_altered(tmp_path: Path) -> None:
    """Without images nothing can be analysed, which other sentences say; with them it is."""
    path, config = tmp_path / "a.h5", load(None)
    writer = SessionRecorder.create(path, header_of(config, {}))
    writer.append(LostFrame(0, 5, "no image came"))
    writer.close()
    with SessionReader(path) as read:
        check_agree(read, config)
    writer = SessionRecorder.create(path, header_of(config, {}), overwrite=True)
    writer.append(Frame(0, 5, np.zeros(config.camera.shape, np.uint8)))
    writer.close()
    with SessionReader(path) as read, pytest.raises(UserError, match="name no phases"):
        check_agree(read, config)


@pytest.mark.parametrize("blocks", [0, 1])
def test_frames_whose_forces_were_lost_have_their_phase(tmp_path: Path, blocks: int) -> None:
    """A run that was killed has images of which it had not yet read the forces."""
    path, config = tmp_path / "a.h5", load(None)
    writer = SessionRecorder.create(path, header_of(config, {}))
    for record_ in [Samples(0, np.zeros((100, 2)), np.zeros((100, 2))), Position(100, 0.5)][
        : 2 * blocks
    ]:
        writer.append(record_)
    writer.append(Event(0, "phase", str(Phase.BACKGROUND)))
    writer.append(Event(150, "phase", str(Phase.REFERENCE)))
    writer.close()
    with SessionReader(path) as read:
        before, after = (conditions_at(read, config, sample) for sample in (120, 160))
    assert (before.phase, after.phase) == (Phase.BACKGROUND, Phase.REFERENCE)
    for now in (before, after):
        assert np.isnan([now.normal_force_n, now.shear_force_n, now.time_s]).all()
        assert now.travel_m == 0.0 if blocks else np.isnan(now.travel_m)


def test_session_that_is_being_recorded_is_not_overwritten(tmp_path: Path) -> None:
    writer, written = record(tmp_path / "busy.h5")
    with pytest.raises(UserError, match="a program is recording this session"):
        make_writer(written.path, overwrite=True)
    writer.close()
    ask(written.path)


@pytest.mark.parametrize("place", ["no/such/folder/s.h5", "a_file/s.h5", "."])
def test_place_that_can_not_be_written(tmp_path: Path, place: str) -> None:
    (tmp_path / "a_file").write_text("x")
    with pytest.raises(UserError, match="cannot be made there"):
        make_writer(tmp_path / place, overwrite=True)


def _nothing(path: Path) -> None:
    path.unlink()


def _text(path: Path) -> None:
    path.write_text("frame,x_px\n")


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def _foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["entry/data"] = np.arange(3)


def _link_to_another_file(path: Path) -> None:
    other = path.with_name("other.h5")
    shutil.copy(path, other)
    linked("/entry/settings", h5py.ExternalLink(other.name, "/entry/settings"))(path)


def _dataset_of_another_file(path: Path) -> None:
    other = path.with_name("secret.txt")
    other.write_bytes(bytes(16))
    place = [(str(other), 0, 16)]
    replaced("/entry/fields/y", shape=(2,), dtype="f8", external=place)(path)


@changing
def _virtual_dataset(file: h5py.File) -> None:
    del file["/entry/fields/y"]
    source = h5py.VirtualLayout((2,), "f8")
    source[:] = h5py.VirtualSource("other.h5", "/entry/fields/y", (2,))
    file.create_virtual_dataset("/entry/fields/y", source)


@changing
def _absurd_size(file: h5py.File) -> None:
    file["/entry/forces/normal_force"].resize(2**50, axis=0)


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (_nothing, "there is no such session"),
        (_folder, "this is a folder, not a session"),
        (_text, "not an HDF5 file"),
        (_cut, "cut short"),
        (_foreign, "not a SlipScope session"),
        (attribute(FORMAT_ATTRIBUTE, "one"), "not a SlipScope session"),
        (
            attribute(FORMAT_ATTRIBUTE, FORMAT_VERSION + 1),
            "newer SlipScope \\(format 10, this one reads 9\\)",
        ),
        (removed("/entry/clock/divisor"), "damaged at /entry/clock/divisor: it is missing"),
        (
            replaced("/entry/clock/divisor", data="125"),
            "damaged at /entry/clock/divisor: it is 0-dimensional text",
        ),
        (
            replaced("/entry/clock/divisor", data=[125]),
            "damaged at /entry/clock/divisor: it is 1-dimensional",
        ),
        (
            replaced("/entry/contact/centre", data=[1.0, 2.0, 3.0]),
            r"damaged at /entry/contact/centre: its shape is \(3,\)",
        ),
        (_link_to_another_file, "damaged at /entry/settings/toml: it is a link to elsewhere"),
        (_dataset_of_another_file, "damaged at /entry/fields/y: it is not a dataset of this file"),
        (_virtual_dataset, "damaged at /entry/fields/y: it is not a dataset of this file"),
        (_absurd_size, "damaged at /entry/forces/normal_force: it claims"),
        (put("/entry/results/phase", 77, 3), "damaged at /entry/results/phase: 77"),
        (put("/entry/results/field", 4000, 3), "damaged at /entry/fields/ux: row 4000"),
        (put("/entry/results/ring_count", -2, 3), "damaged at /entry/results/ring_count: -2"),
        (put("/entry/triggers/image", 99, 2), "damaged at /entry/instrument/camera/data: row 99"),
    ],
)
def test_bad_file_is_refused_with_a_sentence(
    session: Session, spoil: Callable[[Path], None], sentence: str
) -> None:
    spoil(session.path)
    with pytest.raises(UserError, match=f"session\\.h5: .*{sentence}"):
        ask(session.path)


def test_what_was_not_closed_leads_to_its_journal(tmp_path: Path) -> None:
    """Only to one that a repair can begin with, else it would lead back here."""
    writer, written = record(tmp_path / "open.h5")
    path = tmp_path / "cut.h5"
    copy_recording(written.path, path)
    writer.discard()
    sentence = f"`slipscope repair {path} -o REPAIRED.h5` brings back what its journal holds"
    with pytest.raises(UserError, match=re.escape(sentence) + "$"):
        ask(path)
    assert repair(path, tmp_path / "repaired.h5").receipt.frames == 7
    journal_of(path).write_bytes(b"SlipScope journal 3\nnone")
    with pytest.raises(UserError, match=r"there is no such session to read; check the name$"):
        ask(path)


def test_broken_resources_are_told(session: Session) -> None:
    put("/entry/run/resources", "{")(session.path)
    with (
        SessionReader(session.path) as read,
        pytest.raises(UserError, match="damaged at /entry/run/resources"),
    ):
        _ = read.outcome


def test_frames_and_results_that_are_not_there(session: Session) -> None:
    with SessionReader(session.path) as read:
        for index in (3, 8, -1):
            with pytest.raises(UserError, match=f"no image of trigger {index}"):
                read.frame(index)
        for i in (-1, 6):
            with pytest.raises(
                UserError, match=f"there is no result {i} in this session; it has 6"
            ):
                read.snapshot(i)


@pytest.mark.slow
@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_damaged_file_is_read_or_refused(
    data: st.DataObject, recorded_once: Session, tmp_path: Path
) -> None:
    """Cut anywhere, or with any bytes changed: never another exception than UserError."""
    whole = recorded_once.path.read_bytes()
    spoiled = bytearray(whole)
    # most of a small file is empty chunks
    used = np.flatnonzero(np.frombuffer(whole, np.uint8)).tolist()
    if data.draw(st.booleans(), label="cut"):
        del spoiled[data.draw(st.integers(0, len(whole) - 1)) :]
    else:
        for at in data.draw(
            st.lists(st.sampled_from(used), min_size=1, max_size=8), label="places"
        ):
            spoiled[at] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "spoiled.h5"
    path.write_bytes(spoiled)
    try:
        ask(path)
    except UserError as error:
        assert str(error).startswith(str(path))  # noqa: PT017  (either outcome is right)
