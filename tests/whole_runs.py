"""Runs and replays from their beginning to their end, as fast as the machine allows."""

from pathlib import Path
from typing import Any

from app.records.record_types import Outcome
from app.replay.replay import Replay
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config

PATIENCE_S = 400.0


def done(source: Any) -> Outcome:
    """Begin a run, a replay or an analysis; its outcome, which must be no failure."""
    source.start()
    outcome: Outcome | None = source.wait(PATIENCE_S)
    assert outcome is not None, "it did not end"
    assert outcome.state == "done", outcome.reason
    return outcome


def recorded(path: Path, *settings: str, **how: Any) -> Outcome:
    """Record a run with these settings at `path`."""
    return done(live.make_run(config.load(None, settings), path, pace=None, **how))


def replayed(path: Path) -> Replay:
    """A replay that has ended."""
    replay = Replay(path, pace=None)
    done(replay)
    return replay


def frames_of(path: Path) -> list[tuple[Any, ...]]:
    """What a pipeline was given in a run: index, sample, image and conditions of each frame."""
    with SessionReader(path) as session:
        conditions = {s.frame: s.conditions for s in session.snapshots()}
        return [(i, n, image.copy(), conditions[i]) for i, n, image in session.frames()]
