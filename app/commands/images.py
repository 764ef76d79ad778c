"""`slipscope dic`: displacement fields between plain image files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.commands.names import check_writable
from app.commands.terminal import DONE, Bar, output
from app.config import Dic as DicSettings
from app.config import options
from app.errors import UserError


def dic(reference: Path, images: Sequence[Path], fields: Path, *, box: int, step: int, search: int, threads: int, overwrite: bool) -> int:
    """Correlate image files and write the fields; the exit code."""
    _check_limits(box=box, step=step, search=search, threads=threads)
    check_writable(fields)
    if fields.exists() and not overwrite:
        raise UserError(f"{fields}: a file of that name exists; choose another name or give --overwrite")
    from app.dic_files import correlate_files

    with Bar("correlating", quiet=False) as bar:
        summary = correlate_files(
            reference,
            list(images),
            fields,
            box=box,
            step=step,
            search=search,
            threads=threads,
            overwrite=overwrite,
            on_progress=bar.show,
        )
    total = max(1, summary.frames * summary.points)
    fates = ", ".join(f"{status} {count / total:.1%}" for status, count in summary.statuses.items() if count)
    output().print(f"{fields}: frames 1 to {summary.frames}, {summary.points} points each ({fates})")
    return DONE


def _check_limits(**asked: int) -> None:
    """The limits of the settings file hold for the command line."""
    known = options(DicSettings)
    for name, value in asked.items():
        meta = known[name][1]
        if not (meta.ge or 0) <= value <= (meta.le or value):
            raise UserError(f"--{name}: {value} was asked, it must be at least {meta.ge:g} and at most {meta.le:g}")
