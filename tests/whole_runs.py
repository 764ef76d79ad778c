"""Runs and replays from their beginning to their end, as fast as the machine allows."""

from pathlib import Path
from typing import Any

import h5py

from app.records.record_types import Outcome
from app.replay.replay import Replay
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config

PATIENCE_S = 400.0


def ended(source: Any) -> Outcome:
    """Begin a run, a replay or an analysis; its outcome."""
    source.start()
    outcome: Outcome | None = source.wait(PATIENCE_S)
    assert outcome is not None, "it did not end"
    return outcome


def done(source: Any) -> Outcome:
    """The same, which must be no failure."""
    outcome = ended(source)
    assert outcome.state == "done", outcome.reason
    return outcome


def recorded(path: Path, *settings: str, **how: Any) -> Outcome:
    """Record a run with these settings at `path`."""
    return done(live.make_run(config.load(None, settings), path, pace=None, **how))


def ran(settings: config.Config, path: Path) -> Path:
    """Run these settings from beginning to end; `path`, at which it was recorded."""
    done(live.make_run(settings, path, pace=None))
    return path


def replayed(path: Path) -> Replay:
    """A replay that has ended."""
    replay = Replay(path, pace=None)
    done(replay)
    return replay


class RunFile:
    """A run in a simulated world, and what its file holds once it has ended."""

    run: Any

    def end(self) -> None:
        """Wait for the end."""
        outcome = self.run.wait(PATIENCE_S)
        assert outcome is not None, "the run did not end"
        self.outcome: Outcome = outcome

    def read(self, path: Path, travel_m: float) -> None:
        """Read forces, images and events; every trigger and every gap as they stand in the file.

        They must agree with the account, and the stage has gone no further than it was asked to.
        """
        self.world, self.counts = self.run._bench.world, self.outcome.counts
        assert 0 <= self.world.stage_m() <= travel_m + 1e-9
        with SessionReader(path) as s:
            self.volts, self.newtons = s.forces().volts, s.forces().forces
            self.frames = {index: (sample, image.copy()) for index, sample, image in s.frames()}
            self.events, recorded = s.events(), s.outcome
            self.state, self.reason = recorded.state, recorded.reason
        with h5py.File(path) as f:
            group = f["/entry/triggers"]
            index, sample, first, last = (
                group[name][:].tolist() for name in ("index", "sample", "first", "last")
            )
            reasons = zip(sample, group["reason"].asstr()[:], strict=True)
            self.triggers = dict(zip(index, reasons, strict=True))
            spans = zip(index, zip(first, last, strict=True), strict=True)
            self.uncertain = {n: span for n, span in spans if span != (n, n)}
            gaps = (f[f"/entry/gaps/{name}"][:].tolist() for name in ("first", "count"))
            self.gaps = list(zip(*gaps, strict=True))
        assert self.is_accounted_for()
        assert (self.state, self.reason) == (self.outcome.state, self.outcome.reason)

    @property
    def lost(self) -> dict[int, str]:
        """Index -> reason of every trigger without an image."""
        return {index: reason for index, (_, reason) in self.triggers.items() if reason}

    def is_accounted_for(self) -> bool:
        """Whether every trigger is there once and in order, and every sample or its gap."""
        return (
            list(self.triggers) == list(range(self.counts.triggers))
            and len(self.frames) == self.counts.frames_recorded == self.counts.frames_received
            and len(self.lost) == self.counts.frames_lost
            and len(self.volts) == self.counts.samples + self.counts.samples_lost
        )

    def stands(self) -> bool:
        """Whether nothing moves in the world any more, or will."""
        return self.world._moves[-1].speed == 0 or not self.world.is_moving()

    def check_failed(self, *reasons: str, stands: bool = True) -> None:
        """It failed for one of these reasons, with the stage at rest."""
        assert self.state == "failed"
        assert any(reason in self.reason for reason in reasons), self.reason
        assert self.stands() or not stands


def frames_of(path: Path) -> list[tuple[Any, ...]]:
    """What a pipeline was given in a run: index, sample, image and conditions of each frame."""
    with SessionReader(path) as session:
        conditions = {s.frame: s.conditions for s in session.snapshots()}
        return [(i, n, image.copy(), conditions[i]) for i, n, image in session.frames()]
