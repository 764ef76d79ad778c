"""Recorded sessions for the window: lists, comparisons, further analyses, exports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from app.cli.end_of_run import report_analysis
from app.cli.run_and_replay import Made
from app.files.kinds import KINDS
from app.gui.desk import ExportKind
from app.replay import archive
from app.report.side_by_side import Entry, Recorded
from app.session.files import next_free
from app.session.tables import SESSION

MEANINGS = {
    "images": "images (TIFF), forces, settings",
    "tables": "all tables",
    "fields": "displacement fields of every frame",
    "arrays": "everything but the images",
    "paraview": "displacement fields for ParaView",
}


class RecordedSessions:
    """See `app.gui.desk.Archive`.

    Parameters
    ----------
    keep : callable
        Is told what was made, so that its end is reported and nothing is left running.
    as_json : bool
        Whether reports are for programs.
    """

    def __init__(self, keep: Callable[[Made], None], *, as_json: bool = False) -> None:
        self._keep, self._as_json = keep, as_json
        self.exports = tuple(
            ExportKind(what, ending, MEANINGS.get(what) or SESSION[what].meaning)
            for ending, kinds in KINDS.items()
            for what in kinds
        )

    def sessions_in(self, folder: Path) -> list[Path]:
        """See `app.gui.desk.Archive`."""
        return archive.sessions_in(folder)

    def entry(self, path: Path) -> Entry:
        """See `app.gui.desk.Archive`."""
        return archive.entry_of(path)

    def recorded(self, path: Path) -> Recorded:
        """See `app.gui.desk.Archive`."""
        return archive.recorded(path)

    def analysis_of(self, session: Path) -> Path:
        """See `app.gui.desk.Archive`."""
        return next_free(session.with_stem(f"{session.stem}-analysis"))

    def repair(self, session: Path, on_progress: Callable[[float], None]) -> tuple[Path, str]:
        """See `app.gui.desk.Archive`."""
        from app.session.repair import repair

        output = next_free(session.with_stem(f"{session.stem}-repaired"))
        return output, str(repair(session, output, progress=on_progress))

    def reanalysis(self, session: Path, overrides: Sequence[str], output: Path) -> Any:
        """See `app.gui.desk.Archive`."""
        from app.replay.reanalysis import Reanalysis

        analysis = Reanalysis(session, output, pace=None, overrides=overrides)
        self._keep(Made(analysis, lambda: report_analysis(analysis, self._as_json)))
        return analysis

    def export(
        self,
        session: Path,
        destination: Path,
        what: str,
        frames: str,
        on_progress: Callable[[str, float], None],
    ) -> str:
        """See `app.gui.desk.Archive`."""
        from app.files import exporting  # what it needs would hold up the window at its start

        return exporting.export(session, destination, what, frames=frames, on_progress=on_progress)
