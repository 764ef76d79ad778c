"""Files of results that a test makes."""

from __future__ import annotations

from pathlib import Path

from app.records.study_results import StudyResults
from app.session.results import write_runs


def write_results(path: Path, results: StudyResults, *, overwrite: bool = False) -> None:
    """Write results as a file."""
    write_runs(path, results.runs, results.joint, results.made_with, overwrite=overwrite)
