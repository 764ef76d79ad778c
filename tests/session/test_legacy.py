"""What earlier formats said in sentences is read as the numbers and names that it means."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import pytest
from changed_files import put
from session_material import session_of_format

from app.records.record_types import End, Event
from app.session.datasets import uncertain_triggers
from app.session.journal import journal_of, read_journal
from app.session.legacy import end_of, typed
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.repair import repair
from app.system.errors import UserError

DATA = Path(__file__).parents[1] / "data"
WHY = "the drive of 60 um is complete"
# the last events of both recordings, with what the sentences mean
EVENTS = [
    Event(0, "step", "1 of 3: background", 1),
    Event(10, "zero", "0.1 -0.25", -1, 0.1, -0.25),
    Event(200, "reference", "frame 2", 2),
    Event(300, "step", "2 of 3: drive 60 um at 5 um/s", 2),
    Event(700, "step", "3 of 3: hold for 10 s", 3),
    Event(
        1003,
        "account",
        "account: 8 triggers = 8 exposures + 0 missed; 8 exposures = 7 images + 1 lost; 3 are"
        " uncertain",
    ),
    Event(
        1003,
        "revoked",
        "5: from this frame on nothing is certain, the account does not hold",
        5,
    ),
    Event(1003, "complete", WHY),
]


def check_facts(session: Path) -> None:
    with SessionReader(session) as read:
        assert read.events()[-len(EVENTS) :] == EVENTS
        assert (read.outcome.end, read.outcome.reason) == (End.COMPLETE, WHY)
        assert uncertain_triggers(read) == [5, 6, 7]


@pytest.mark.parametrize(
    ("version", "checksum"),
    [(7, "bf452580389c4d488e2e53646cc72581"), (8, "2e7428b8785b336f20ded00762c3284b")],
)
def test_a_session_of_an_earlier_format_says_the_same(
    tmp_path: Path, version: int, checksum: str
) -> None:
    """The checksum is that of the program that wrote it."""
    session = session_of_format(version, tmp_path)
    check_facts(session)
    with SessionReader(session) as read:
        assert (read.format, read.pattern()) == (version, None)
    receipt = verify(session)
    assert receipt.checksum == checksum
    assert (receipt.uncertain, receipt.account) == (3, EVENTS[5].text)


def test_a_recording_with_a_journal_of_format_3_becomes_a_session(tmp_path: Path) -> None:
    with ZipFile(DATA / "recording_of_journal_3.zip") as recording:
        recording.extractall(tmp_path)
    session, repaired = tmp_path / "cut.h5", tmp_path / "repaired.h5"
    assert journal_of(session).read_bytes().startswith(b"SlipScope journal 3\n")
    assert [r for r in read_journal(journal_of(session)) if isinstance(r, Event)][-8:] == EVENTS
    assert repair(session, repaired).found.is_whole
    check_facts(repaired)
    assert verify(repaired).account == EVENTS[5].text


@pytest.mark.parametrize(
    ("reason", "end"),
    [
        ("all 14 steps are complete", End.COMPLETE),
        ("the travel is done", End.COMPLETE),
        ("the drive of 60 um is complete; repaired, 1 images were lost", End.COMPLETE),
        ("all 93 analysed frames were replayed", End.PLAYED),
        ("all 93 frames were analysed", End.PLAYED),
        ("imported: 20 images, 0 lost, from what is done", End.IMPORTED),
        ("the operator ended the run; repaired, 1 images were lost", End.STOPPED),
    ],
)
def test_the_end_of_a_run_by_its_reason(reason: str, end: End) -> None:
    assert end_of("done", reason, 7) is end


@pytest.mark.parametrize("text", ["", "frame", "x of 3: hold", "9" * 30])
@pytest.mark.parametrize("kind", ["step", "reference", "revoked"])
def test_a_sentence_without_a_number_has_none(kind: str, text: str) -> None:
    assert typed(Event(0, kind, text)).number == -1


def test_a_state_that_is_none_is_damage(tmp_path: Path) -> None:
    session = session_of_format(7, tmp_path)
    put("/entry/run/state", "odd")(session)
    with (
        SessionReader(session) as read,
        pytest.raises(UserError, match="damaged at /entry/run/state"),
    ):
        _ = read.outcome
