"""Makes what the window shows: runs on a bench, and replays."""

from __future__ import annotations

import threading
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from app.cli.end_of_run import report_replay
from app.cli.recorded_sessions import RecordedSessions
from app.cli.run_and_replay import Made, made_attached, made_run
from app.records.bench_view import BenchPreview
from app.session.files import new_session_name, next_free
from app.settings.config import from_record
from app.settings.sections import Config
from app.system.stopping import StopAnswer, of_all


class WindowWorkshop:
    """The workshop of one window, see `app.gui.desk.Workshop`.

    Parameters
    ----------
    keep : callable
        Is told what was made, so that its end is reported and nothing is left running.
    pace : float or None
        Seconds of a bench per second.
    overwrite : bool
        Whether the first run may replace its file.
    as_json : bool
        Whether reports are for programs.
    """

    def __init__(
        self,
        keep: Callable[[Made], None],
        *,
        pace: float | None = 1.0,
        overwrite: bool = False,
        as_json: bool = False,
    ) -> None:
        self._keep, self._pace, self._as_json = keep, pace, as_json
        self._may_replace = overwrite
        self._connecting = threading.Lock()
        self._preview: BenchPreview | None = None  # the newest, which may be closed
        self.archive = RecordedSessions(keep, as_json=as_json)

    def run(self, config: Config, session: Path | None) -> Any:
        """See `app.gui.desk.Workshop`."""
        with self._connecting:
            self._let_go()
        path, may_replace = session or new_session_name(datetime.now()), self._may_replace
        if session is None or not may_replace:
            path = next_free(path)
        self._may_replace = False  # further runs never replace a file
        return self._kept(made_run(config, path, self._pace, may_replace, self._as_json))

    def replay(self, session: Path) -> Any:
        """See `app.gui.desk.Workshop`."""
        from app.replay.replay import Replay

        source = Replay(session, pace=1.0)
        return self._kept(Made(source, lambda: report_replay(source, self._as_json)))

    def runs_under_way(self) -> list[tuple[str, str]]:
        """See `app.gui.desk.Workshop`."""
        from app.processes.launch import under_way

        return [
            (bench.name, f"{bench.title}, which records {bench.session}") for bench in under_way()
        ]

    def attach(self, name: str) -> Any:
        """See `app.gui.desk.Workshop`."""
        return self._kept(made_attached(name, self._as_json))

    def stop_others(self, own: Any) -> StopAnswer | None:
        """See `app.gui.desk.Workshop`."""
        from app.processes.launch import stopped_but

        mine = getattr(own, "bench", None)  # of a run in another process
        answers = stopped_but(mine and mine.name)
        return of_all(answers) if answers else None

    def settings_of(self, session: Path) -> Config:
        """See `app.gui.desk.Workshop`."""
        from app.session.reader import SessionReader

        with SessionReader(session) as reader:
            text = reader.header.config_toml
        return from_record(text, f"{session}: settings")

    def campaigns(self) -> list[str]:
        """See `app.gui.desk.Workshop`."""
        from app.campaigns.plan import campaign_names

        return campaign_names()

    def campaign(self, file: Path) -> Any:
        """See `app.gui.desk.Workshop`."""
        from app.cli import campaign_runs as campaign_lines

        return campaign_lines.look(file)

    def campaign_taken(self, file: Path, number: int) -> Any:
        """See `app.gui.desk.Workshop`."""
        from app.cli import campaign_runs as campaign_lines

        return campaign_lines.taken(file, number)

    def campaign_renewed(self, file: Path) -> Any:
        """See `app.gui.desk.Workshop`."""
        from app.cli import campaign_runs as campaign_lines

        return campaign_lines.renewed(file)

    def preview(self, config: Config) -> BenchPreview:
        """See `app.gui.desk.Workshop`."""
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

    def _kept(self, made: Made) -> Any:
        self._keep(made)
        return made.source
