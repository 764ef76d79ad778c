"""Runs that are ready to begin, and runs of others that can be shown."""

from __future__ import annotations

from pathlib import Path

from app.acquisition.stage import unsupervised
from app.processes.launch import attached, launched_or_made
from app.runs.live import check_run
from app.runs.run_source import PreparedSource, RunSource
from app.session.files import check_new_session
from app.settings.certificates import due_calibrations
from app.settings.sections import Config


def prepared_run(
    config: Config, path: Path, pace: float | None, overwrite: bool = False
) -> PreparedSource:
    """A run of these settings, which records `path`.

    Raises
    ------
    UserError, DeviceError
        It cannot be made.
    """
    check_new_session(path, overwrite)
    check_run(config, path, pace, overwrite)
    source, before = launched_or_made(config, path, pace, overwrite), _mark_of(path)

    def written() -> Path | None:
        moved = _moved(source)
        return Path(moved or path) if moved or _mark_of(path) != before else None

    warnings = filter(None, (unsupervised(config), due_calibrations(config)))
    return PreparedSource(source, written, "; ".join(warnings))


def attached_run(bench: str | None) -> PreparedSource:
    """A run that is under way in another process; UserError where there is none."""
    source = attached(bench)

    def written() -> Path | None:
        session = Path(_moved(source) or source.session)
        return session if session.exists() else None

    return PreparedSource(source, written)


def _moved(source: RunSource) -> str:
    """Where a run that has ended has put its session, if not where it was to be."""
    outcome = source.look().outcome
    moved: str = outcome.resources.get("session", "") if outcome else ""
    return moved


def _mark_of(path: Path) -> tuple[int, int, int] | None:
    """What distinguishes a file from one that is written under its name later; None: no file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns
