"""What of a campaign is done, as the sessions themselves say; and what becomes of those that are
not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from app.campaigns.plan import Campaign, PlannedRun
from app.records.record_types import End, Outcome
from app.records.summary import Summary
from app.session.files import files_of, remove_recorded
from app.session.journal import journal_of
from app.settings.config import measured_differently, settings_of
from app.system.disk import AppendedFile, is_locked, sync_folder
from app.system.errors import UserError
from app.system.outputs import check_folder_of, new_file

KEPT = "kept"  # folder of sessions whose runs are repeated
COPY, LOCK = "campaign.toml", ".campaign.lock"
HEAD = "# The campaign of this folder, as `slipscope campaign` has read it.\n"


class RunState(StrEnum):
    """What has become of a run."""

    WAITING = "waiting"
    RUNNING = "under way"
    DONE = "done"
    STOPPED = "stopped"  # by the operator, before its end
    FAILED = "failed"
    CUT = "cut short"  # by a kill or a power cut


@dataclass(frozen=True, slots=True)
class FoundSession:
    """A run as its session says."""

    state: RunState
    reason: str = ""
    summary: Summary | None = None

    @property
    def is_there(self) -> bool:
        """Whether there are files of it."""
        return self.state not in (RunState.WAITING, RunState.RUNNING)


def find_session(run: PlannedRun) -> FoundSession:
    """What has become of a run.

    Raises
    ------
    UserError
        Its session is of another experiment, or no session.
    """
    from app.session.reader import SessionReader  # HDF5 would hold up the window's start
    from app.session.repair import whole

    session = run.session
    if is_locked(journal_of(session)):
        return FoundSession(RunState.RUNNING, "a program is recording it")
    if _recorded(session):
        if session.exists() and whole(session):
            remove_recorded(session)  # the close was cut short just before it did that
        else:
            return FoundSession(RunState.CUT, "it was cut short")
    if not session.exists():
        return FoundSession(RunState.WAITING)
    with SessionReader(session) as reader:
        outcome, config = reader.outcome, settings_of(reader)
    found = _as_ended(outcome)
    differing = measured_differently(config, run.config, run.varied)
    recorded = ", ".join(f"{name} = {old}" for name, (old, _) in list(differing.items())[:3])
    if differing and found.state is RunState.DONE:
        raise UserError(
            f"{session}: recorded with {recorded}, which is not what run {run.number} of the"
            " campaign says now; give another folder with -o, or undo the change"
        )
    return found


def find_sessions(plan: Campaign) -> dict[int, FoundSession]:
    """What has become of each run, by its number; raises as `find_session`."""
    return {run.number: find_session(run) for run in plan.runs}


def _as_ended(outcome: Outcome) -> FoundSession:
    states = {
        End.COMPLETE: RunState.DONE,
        End.FAILED: RunState.FAILED,
        End.UNFINISHED: RunState.CUT,
    }
    state = states.get(outcome.end, RunState.STOPPED)
    return FoundSession(state, outcome.reason, outcome.summary)


def _recorded(session: Path) -> list[Path]:
    """The files that a session is made of, as far as there are any, the journal last."""
    ours = {session, session.with_suffix(".png")}
    return [
        path for path in reversed(files_of(session).values()) if path not in ours and path.exists()
    ]


def keep(session: Path) -> Path | None:
    """Move a session, and all that lies beside it of that name, to the folder of those that are
    kept; where it is then, None where there is nothing. A move that was cut short is finished.

    Nothing is replaced. What tells that there is something to move goes last: the journal, or else
    the session.
    """
    anchor = journal_of(session) if journal_of(session).exists() else session
    log = session.with_name(f"{session.name}.log")
    others = [path for path in (*files_of(session).values(), log) if path != anchor]
    left = [path for path in (*others, anchor) if path.exists()]
    if not left:
        return None
    folder, number = session.parent / KEPT, 1
    folder.mkdir(exist_ok=True)
    while any(_moved(path, session, number).exists() for path in left):
        number += 1
    for path in left:
        path.rename(_moved(path, session, number))
    sync_folder(folder)
    return _moved(session, session, number)


def _moved(path: Path, session: Path, number: int) -> Path:
    """Where a file of a session goes."""
    stem = session.stem if number == 1 else f"{session.stem}-{number}"
    return session.parent / KEPT / f"{stem}{path.name.removeprefix(session.stem)}"


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make the folder of a campaign if there is none, and let no other program work in it
    meanwhile; an empty one is removed.

    Raises
    ------
    UserError
        Another program works there, or it cannot be written to.
    """
    check_folder_of(folder)
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{folder}: a folder is needed, this is a file; give another one with -o")
    try:
        folder.mkdir(exist_ok=True)
        lock = AppendedFile(folder / LOCK, overwrite=True, locked=True)
    except BlockingIOError:
        raise UserError(
            f"{folder}: another slipscope campaign works in this folder; wait for its end"
        ) from None
    except OSError as error:
        raise UserError(
            f"{folder}: it cannot be written to: {error.strerror}; give another one with -o"
        ) from None
    try:
        yield
    finally:
        lock.remove()
        with suppress(OSError):
            folder.rmdir()


def keep_copy(campaign: Campaign) -> bool:
    """Keep a copy of the campaign beside its sessions; whether there was another one.

    Raises
    ------
    UserError
        The file there is somebody else's.
    """
    copy, text = campaign.folder / COPY, HEAD + campaign.text
    before = copy.read_text(encoding="utf-8", errors="replace") if copy.exists() else ""
    if before == text or (before and copy.samefile(campaign.file)):
        return False
    if before and not before.startswith(HEAD):
        raise UserError(
            f"{copy}: not written by `slipscope campaign`; give another folder with -o, or run that"
            " file itself"
        )
    with new_file(copy, overwrite=True) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    return bool(before)
