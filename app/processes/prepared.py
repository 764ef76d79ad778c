"""Runs that are ready to begin, and runs of others that can be shown."""

from __future__ import annotations

from pathlib import Path

from app.acquisition.stage import unsupervised
from app.processes.launch import attached, launched_or_made
from app.runs.live import check_run
from app.runs.run_source import PreparedSource
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
        outcome = source.look().outcome
        moved = outcome.resources.get("session") if outcome else None
        return Path(moved or path) if moved or _mark_of(path) != before else None

    warnings = filter(None, (unsupervised(config), due_calibrations(config)))
    return PreparedSource(source, written, "; ".join(warnings))


def attached_run(bench: str | None) -> PreparedSource:
    """A run that is under way in another process; UserError where there is none."""
    source = attached(bench)

    def written() -> Path | None:
        outcome = source.look().outcome
        moved = outcome.resources.get("session") if outcome else None
        session = Path(moved or source.session)
        return session if session.exists() else None

    return PreparedSource(source, written)


def _mark_of(path: Path) -> tuple[int, int, int] | None:
    """What distinguishes a file from one that is written under its name later; None: no file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns
