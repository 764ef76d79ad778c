"""What is asked of an analysis of sessions, checked before anything is computed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.replay.browser import frames_of
from app.session.reader import SessionReader
from app.session.results_layout import RESULTS_VERSION
from app.session.versions import processor, versions
from app.settings.config import is_analysed, keyed, to_toml
from app.settings.sections import Config
from app.study.one import content_of, settings_of
from app.system.disk import free_bytes
from app.system.errors import UserError
from app.system.outputs import check_output

ENDINGS = (".h5", ".hdf5")
RECORDED = "session"  # the preset that is none: correlation as in the session
PART_BYTES = 12 << 20  # results of a session, of pictures of 2 Mpx and 400 frames
# settings that may differ from run to run of a bench; the uncertainties are those of its clocks,
# which an import finds
OWN = frozenset({"recording.results", "forces.zero", "dic.threads", "dic.quality"})
OWN |= {"uncertainty.start", "uncertainty.delay"}


@dataclass(frozen=True, slots=True)
class Task:
    """One session to analyse.

    Attributes
    ----------
    session : str
        Its path, absolute.
    overrides : tuple of str
        ``table.key=value`` of the settings to change.
    frames : int
        Images in it.
    key : str
        What its results depend on: what it recorded, settings, versions of the programs.
    world : str
        Settings of the simulated run that makes the session, which is not kept, as TOML; `session`
        is its name then. Empty: the session is there.
    note : str
        What is particular about that run.
    """

    session: str
    overrides: tuple[str, ...]
    frames: int
    key: str
    world: str = ""
    note: str = ""

    @property
    def name(self) -> str:
        """Name of the session's file."""
        return Path(self.session).name


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be done.

    Attributes
    ----------
    tasks : tuple of Task
        In the order given.
    is_sweep : bool
        Whether the runs differ by more than their load, and so have nothing in common.
    output : Path
    made_with : dict
        What the results will be made with.
    notes : tuple of str
        What somebody who reads the results should know of the sessions.
    """

    tasks: tuple[Task, ...]
    output: Path
    made_with: dict[str, str]
    notes: tuple[str, ...]
    is_sweep: bool = False


def plan_analysis(
    sessions: Sequence[Path],
    output: Path,
    *,
    preset: str,
    overrides: Sequence[str] = (),
    overwrite: bool = False,
) -> Plan:
    """The analysis of these sessions, each with its settings and `overrides`.

    Parameters
    ----------
    preset : str
        Of the image correlation; `RECORDED`: as in each session.

    Raises
    ------
    UserError, ConfigError
        A session cannot be analysed, two do not go together, or the results cannot be written.
    """
    check_output(
        output, overwrite, what="file of results", endings=ENDINGS, inputs={"session": sessions}
    )
    if not sessions:
        raise UserError(
            f"{output}: no session was given to analyse; check the folder and its files"
        )
    chosen = () if preset == RECORDED else (f"dic.preset={preset}",)
    changes = (*chosen, *overrides)
    tasks: list[Task] = []
    notes: list[str] = []
    first: tuple[str, dict[str, Any]] | None = None
    samples: dict[str, None] = {}
    seen: dict[str, Path] = {}
    for path in sessions:
        with SessionReader(path) as session:
            if session.header.source is not None:
                raise UserError(
                    f"{path}: it is a further analysis of {session.header.source.session}; give"
                    " that session"
                )
            config, frames = settings_of(session, changes), len(frames_of(session))
            content = content_of(session)
            if content in seen:
                raise UserError(f"{path}: it is the same session as {seen[content]}; give it once")
            seen[content] = path
            state, reason = session.outcome.ended_as, session.outcome.reason
            if state != "done":
                notes.append(
                    f"{path.name}: the run ended as {state} ({reason}); its images are analysed"
                )
            if name := session.header.sample:
                samples[name] = None
            same = _bench(config)
            first = first or (path.name, same)
            _check_same(path.name, same, *first)
        tasks.append(Task(str(path.absolute()), changes, frames, key_of(content, config)))
    if len(samples) > 1:
        notes.append(f"the sessions are of {len(samples)} samples: {', '.join(samples)}")
    check_room_for(output, len(tasks))
    made_with = versions() | {"preset": preset, "set": " ".join(overrides)}
    return Plan(tuple(tasks), output, made_with, tuple(notes))


def check_room_for(output: Path, runs: int) -> None:
    """Refuse a place for the results of so many runs that has no room for them; UserError."""
    needed, free = PART_BYTES * runs * 2, free_bytes(output)
    if free < needed:
        raise UserError(
            f"{output}: {free / 1e6:.0f} MB are left there, about {needed / 1e6:.0f} MB are needed;"
            " make room or choose another place"
        )


def _bench(config: Config) -> dict[str, Any]:
    """Settings that all runs have alike, by their names."""
    settings = keyed(config).items()
    return {key: value for key, value in settings if is_analysed(key) and key not in OWN}


def _check_same(name: str, its: dict[str, Any], first: str, others: dict[str, Any]) -> None:
    for key, value in its.items():
        if value != others[key]:
            raise UserError(
                f"{name}: {key} is {value}, in {first} it is {others[key]}; sessions of different"
                f" benches or samples are analysed apart, and if they are of one, --set {key}=..."
                " says what holds for all"
            )


def key_of(content: str, config: Config) -> str:
    """What the results of a session depend on."""
    parts = content, to_toml(config, comments=False), sorted(programs().items()), RESULTS_VERSION
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def programs() -> dict[str, str]:
    """Versions of the programs that compute, whatever the computer."""
    of_computer = {"computer", "platform", *processor()}
    return {name: held for name, held in versions().items() if name not in of_computer}


def left(tasks: Sequence[Task], done: set[str]) -> list[Task]:
    """Those that are not done yet, the longest first: the last ones decide when all are done."""
    return sorted((task for task in tasks if task.key not in done), key=lambda task: -task.frames)
