"""`slipscope info --verify` prints the receipt of a session, or says what is not as it was
recorded.
"""

from __future__ import annotations

import json
from pathlib import Path
from zlib import crc32

import h5py
import pytest
from changed_files import attribute
from session_material import Session, alter, close_beside_journal, record

from app.cli.inspect import info
from app.session.reader import SessionReader
from app.system.errors import UserError

Capture = pytest.CaptureFixture[str]


def test_whole_session_gives_its_receipt(session: Session, capsys: Capture) -> None:
    assert info(session.path, as_json=False, verify=True) == 0
    assert (
        "7 frames, 1 lost, 1003 samples, 1 gap, 0.9 MB read back as they were written"
        in capsys.readouterr().out
    )
    assert info(session.path, as_json=True, verify=True) == 0
    data = json.loads(capsys.readouterr().out)
    assert (
        data["receipt"]["frames"],
        data["receipt"]["checked"],
        data["fault"],
        data["has_journal"],
    ) == (7, True, "", False)
    assert info(session.path, as_json=True) == 0
    assert "receipt" not in json.loads(capsys.readouterr().out)


def test_altered_image_is_named(session: Session, capsys: Capture) -> None:
    with h5py.File(session.path, "r+") as file:
        file["/entry/instrument/camera/data"][5, 3, 3] ^= 1  # trigger 6
    assert info(session.path, as_json=False) == 0
    assert info(session.path, as_json=False, verify=True) == 1
    said = capsys.readouterr().err
    assert said == (
        f"slipscope: {session.path}: image 6 is not as recorded; `slipscope repair` makes a"
        " session of the others\n"
    )
    assert info(session.path, as_json=True, verify=True) == 1
    data = json.loads(capsys.readouterr().out)
    assert (data["receipt"], "image 6 is not" in data["fault"]) == (None, True)


@pytest.mark.parametrize("table", ["triggers/index", "events/sample"])
def test_what_info_itself_needs_is_told_as_any_other_fault(
    session: Session, capsys: Capture, table: str
) -> None:
    alter(session.path, f"/entry/{table}", 0)
    assert info(session.path, as_json=False, verify=True) == 1
    assert f"/entry/{table} is not as recorded" in capsys.readouterr().err
    assert info(session.path, as_json=True, verify=True) == 1
    assert f"/entry/{table} is" in json.loads(capsys.readouterr().out)["fault"]
    with pytest.raises(UserError, match=f"damaged at /entry/{table}"):
        info(session.path, as_json=False)


COLUMNS = [
    "forces/shear_force",
    "triggers/checksum",
    "results/stick_radius",
    "rings/ux",
    "fields/ux",
    "gaps/first",
]


@pytest.mark.parametrize("altered", COLUMNS)
def test_altered_number_is_told_by_its_column(
    session: Session, capsys: Capture, altered: str
) -> None:
    alter(session.path, f"/entry/{altered}", 0)
    assert info(session.path, as_json=False, verify=True) == 1
    told = (
        f"{session.path}: /entry/{altered} is not as recorded; `slipscope repair` makes a session"
        " of what can be read"
    )
    assert capsys.readouterr().err == f"slipscope: {told}\n"


def test_altered_force_is_not_given_to_anybody(session: Session) -> None:
    alter(session.path, "/entry/forces/shear_force", 700)
    with (
        SessionReader(session.path) as read,
        pytest.raises(UserError, match="damaged at /entry/forces/shear_force: the bytes are not"),
    ):
        read.forces()


def test_older_session_has_nothing_to_be_held_against(session: Session, capsys: Capture) -> None:
    attribute("slipscope_format", 3)(session.path)
    assert info(session.path, as_json=False, verify=True) == 0
    assert "read back without checksums to hold them against" in capsys.readouterr().out


def test_a_session_is_held_against_the_journal_beside_it(tmp_path: Path, capsys: Capture) -> None:
    """As a kill between the last two steps of a close leaves it, with a force changed since."""
    writer, written = record(tmp_path / "a.h5")
    close_beside_journal(writer)
    assert info(written.path, as_json=False, verify=True) == 0
    said = capsys.readouterr().out
    assert f"`slipscope repair {written.path} -o REPAIRED.h5` brings back what its" in said
    with h5py.File(written.path, "r+") as file:
        file["/entry/forces/shear_force"][7] += 1e-9
    assert info(written.path, as_json=False, verify=True) == 1
    assert "the forces are not as recorded" in capsys.readouterr().err


def test_an_image_that_was_altered_with_its_checksum_is_told_by_the_journal(
    tmp_path: Path, capsys: Capture
) -> None:
    writer, written = record(tmp_path / "a.h5")
    close_beside_journal(writer)
    with h5py.File(written.path, "r+") as file:
        image = file["/entry/instrument/camera/data"][5]  # of trigger 6
        image[3, 3] ^= 1
        file["/entry/instrument/camera/data"][5] = image
        file["/entry/triggers/checksum"][6] = crc32(image.tobytes())
    assert info(written.path, as_json=False, verify=True) == 1
    assert "frame 6 is not as recorded" in capsys.readouterr().err


def test_what_can_not_be_read_is_not_as_recorded(session: Session, capsys: Capture) -> None:
    with h5py.File(session.path, "r+") as file:
        del file["/entry/forces/shear_force"]
        how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        how.set_chunk((4096,))
        how.set_deflate(1)
        space = h5py.h5s.create_simple((1003,), (h5py.h5s.UNLIMITED,))
        forces = h5py.Dataset(
            h5py.h5d.create(
                file["/entry/forces"].id, b"shear_force", h5py.h5t.IEEE_F64LE, space, how
            )
        )
        forces.id.write_direct_chunk((0,), b"no deflated bytes")
    assert info(session.path, as_json=False, verify=True) == 1
    assert "/entry/forces/shear_force is not as recorded" in capsys.readouterr().err
