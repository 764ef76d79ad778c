"""`slipscope dic`, `export`, `import` and `repair`: files in, files out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.settings import Correlation
from app.commands.terminal import DONE, FAILED, Bar, output, print_json, print_rows

if TYPE_CHECKING:
    from app.exchange.correlating import CorrelationSummary
    from app.exchange.frames import Sources


def dic(
    reference: Path,
    images: Sequence[Path],
    fields: Path,
    correlation: Correlation,
    *,
    mask: Path | None,
    roi: tuple[int, int, int, int] | None,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Correlate image files and write the fields; the exit code."""
    from app.exchange.correlating import correlate_files

    with Bar("correlating", quiet=as_json) as bar:
        summary = correlate_files(
            reference,
            images,
            fields,
            correlation,
            mask=mask,
            roi=roi,
            overwrite=overwrite,
            on_progress=bar.show,
        )
    if as_json:
        from app.report.summary import plain

        print_json(plain(summary))
    else:
        _report(summary)
    return DONE


def _report(summary: CorrelationSummary) -> None:
    fates = ", ".join(f"{count} {status}" for status, count in summary.statuses.items() if count)
    output().print(
        f"{summary.output}: frames 1 to {summary.frames}, {summary.points} points each: {fates}"
    )
    quality = (
        f"; median standard uncertainty {summary.ux_std_px:.4f} px of u_x, {summary.uy_std_px:.4f}"
        f" px of u_y; median correlation {summary.zncc:.4f}"
    )
    output().print(
        f"{summary.points_per_s:,.0f} points/s" + (quality if summary.statuses["ok"] else "")
    )
    if summary.aligned:
        output().print(
            f"{summary.aligned} images were turned back first, as features that they share with the"
            " reference say: most points were lost without that"
        )
    if summary.updates:
        output().print(
            f"reference replaced {summary.updates} times, which adds {summary.drift_px:.4f} px to"
            " the uncertainty of u_x"
        )


def export(
    held: Path, destination: Path, what: str, frames: str, *, overwrite: bool, as_json: bool
) -> int:
    """Write what a session or a file of results holds; the exit code."""
    from app.exchange import exporting
    from app.session.fields import is_results

    with Bar("exporting", quiet=as_json) as bar:
        written = exporting.export(
            held, destination, what, frames=frames, overwrite=overwrite, on_progress=bar.show
        )
    if as_json:
        kind = "results" if is_results(held) else "session"
        print_json({kind: str(held), "output": str(destination), "written": written})
    else:
        output().print(written)
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
    notes = [f"note: {note}" for note in (outcome.summary.notes if outcome.summary else ())]
    for sentence in (*imported.remarks, *notes):
        output().print(sentence)
    output().print(f"session: {session}; `slipscope replay {session}` analyses it again")
    return DONE


def repair(session: Path, destination: Path, overwrite: bool, as_json: bool) -> int:
    """Bring back what a session that was cut short holds; the exit code, 1 if some of it is
    missing.
    """
    from app.report.summary import plain
    from app.session import repair as sessions

    with Bar("reading what is left", quiet=as_json) as bar:
        repaired = sessions.repair(
            session,
            destination,
            overwrite=overwrite,
            progress=lambda share: bar.show("bringing back the frames", share),
        )
    if as_json:
        print_json(plain(repaired))
    else:
        output().print(str(repaired))
    return DONE if repaired.found.is_whole else FAILED
