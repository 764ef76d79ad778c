"""Makes what the window shows: runs on a bench, replays, further analyses, connected benches."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from app.records.bench_view import BenchPreview
from app.runs.run_source import PreparedSource, RunSource
from app.session.files import new_session_name, next_free
from app.settings.config import settings_of
from app.settings.sections import Config
from app.system.stopping import StopAnswer, of_all


@dataclass(slots=True)
class PendingRun:
    """A run or a replay that is being made."""

    is_live: bool  # it is a run, no replay
    is_stopped: bool = False  # STOP was pressed meanwhile: it does not begin


class RunFactory:
    """What one window makes; the window stays responsive, since it calls all of it in threads.

    What it needs is imported when it is needed, so that the window is soon in view. An exception
    is a sentence for the operator.

    Parameters
    ----------
    keep : callable
        Is told what was made, so that its end is reported and nothing is left running.
    pace : float or None
        Seconds of a bench per second.
    overwrite : bool
        Whether the first run may replace its file.
    """

    def __init__(
        self,
        keep: Callable[[PreparedSource], object],
        *,
        pace: float | None = 1.0,
        overwrite: bool = False,
    ) -> None:
        self._keep, self._pace, self._may_replace = keep, pace, overwrite
        self._connecting = threading.Lock()
        self._preview: BenchPreview | None = None  # the newest, which may be closed

    def run(self, config: Config, session: Path | None) -> RunSource:
        """A run with these settings, not yet begun; a free name is chosen where `session` is None
        or taken.
        """
        from app.processes.prepared import prepared_run

        with self._connecting:
            self._let_go()
        path, may_replace = session or new_session_name(datetime.now()), self._may_replace
        if session is None or not may_replace:
            path = next_free(path)
        self._may_replace = False  # further runs never replace a file
        return self._kept(prepared_run(config, path, self._pace, may_replace))

    def replay(self, session: Path) -> RunSource:
        """A recorded run, to be played."""
        from app.replay.replay import Replay

        return self._kept(PreparedSource(Replay(session, pace=1.0)))

    def reanalysis(self, session: Path, overrides: Sequence[str], output: Path) -> RunSource:
        """A further analysis with other settings, ``table.key=value``, not yet begun."""
        from app.replay.reanalysis import Reanalysis

        return self._kept(
            PreparedSource(Reanalysis(session, output, pace=None, overrides=overrides))
        )

    def runs_under_way(self) -> list[tuple[str, str]]:
        """Name and words of each run of this user that goes on, whoever has begun it."""
        from app.processes.launch import under_way

        return [
            (bench.name, f"{bench.title}, which records {bench.session}") for bench in under_way()
        ]

    def attach(self, name: str) -> RunSource:
        """A run that is under way, to be shown."""
        from app.processes.prepared import attached_run

        return self._kept(attached_run(name))

    def stop_others(self, own: RunSource | None) -> StopAnswer | None:
        """Stop the motion of every bench of this user but that of `own` and the connected one of
        this window; what became of that, None where there is no other.
        """
        from app.processes.launch import stopped_but

        mine = [getattr(one, "bench", None) for one in (own, self._preview)]  # if they are remote
        answers = stopped_but({bench.name for bench in mine if bench})
        return of_all(answers) if answers else None

    def settings_of(self, session: Path) -> Config:
        """The settings of a recorded run."""
        from app.session.reader import SessionReader

        with SessionReader(session) as reader:
            return settings_of(reader)

    def preview(self, config: Config) -> BenchPreview:
        """The bench of these settings, connecting, to be looked at without a run; `run` lets go of
        it before it opens the same devices.
        """
        from app.processes.client import LaunchedPreview

        with self._connecting:
            self._let_go()
            self._preview = preview = LaunchedPreview(config)
        return preview

    def _let_go(self) -> None:
        """Free the devices of the bench that was connected last."""
        preview, self._preview = self._preview, None
        if preview is not None:
            preview.close()

    def _kept(self, made: PreparedSource) -> RunSource:
        self._keep(made)
        return made.source
