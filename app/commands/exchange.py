"""`slipscope export` and `slipscope import`: sessions to and from the files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.terminal import DONE, Bar, output, print_json, print_rows

if TYPE_CHECKING:
    from app.exchange.frames import Sources


def export(
    session: Path, destination: Path, what: str, frames: str, *, overwrite: bool, as_json: bool
) -> int:
    """Write what a session holds; the exit code."""
    from app.exchange.exporting import export as write

    with Bar("exporting", quiet=as_json) as bar:
        sentence = write(
            session, destination, what, frames=frames, overwrite=overwrite, on_progress=bar.show
        )
    if as_json:
        print_json({"session": str(session), "output": str(destination), "written": sentence})
    else:
        output().print(sentence)
    return DONE


def import_(sources: Sources, session: Path, *, overwrite: bool, as_json: bool) -> int:
    """Make a session of images and forces; the exit code."""
    from app.exchange.importing import import_files
    from app.report.summary import outcome_data, outcome_rows

    with Bar("importing", quiet=as_json) as bar:
        imported = import_files(sources, session, overwrite=overwrite, on_progress=bar.show)
    outcome = imported.outcome
    if as_json:
        print_json({"session": str(session), "remarks": imported.remarks, **outcome_data(outcome)})
        return DONE
    print_rows(outcome.reason, outcome_rows(outcome))
    for sentence in (
        *imported.remarks,
        *(f"note: {note}" for note in (outcome.summary.notes if outcome.summary else ())),
    ):
        output().print(sentence)
    output().print(f"session: {session}; `slipscope replay {session}` analyses it again")
    return DONE
