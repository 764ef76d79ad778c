"""`slipscope dic`, `export`, `import` and `repair`: files in, files out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.settings import Correlation
from app.cli.terminal import DONE, FAILED, Bar, output, print_json, print_rows, say

if TYPE_CHECKING:
    from app.files.correlating import CorrelationSummary
    from app.files.frames import Sources


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
    from app.files.correlating import correlate_files

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
        from app.report.summary_rows import plain

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
    if summary.full_scale:
        output().print(
            f"{summary.saturated:.2%} of the pixels of the reference share the grey level"
            f" {summary.full_scale}, at which the grey scale seems to end: they count as saturated;"
            " --full-scale says where it ends"
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
    from app.files import exporting
    from app.session.field_series import is_results

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
    from app.files.importing import import_files
    from app.report.summary_rows import outcome_data, outcome_rows

    with Bar("importing", quiet=as_json) as bar:
        imported = import_files(sources, session, overwrite=overwrite, on_progress=bar.show)
    outcome = imported.outcome
    failed = imported.shortcoming
    if as_json:
        told = {"remarks": imported.remarks, "samples_outside": imported.samples_outside}
        data = {"session": str(session), **told, "failure": failed, **outcome_data(outcome)}
        print_json(data)
        return FAILED if failed else DONE
    counts, outside = outcome.counts, imported.samples_outside
    rows = [
        row
        if row.label != "force samples"
        else row._replace(
            value=f"{counts.samples} recorded, {counts.samples_lost - outside} lost"
            + (f", {outside} before or after the table" if outside else "")
        )
        for row in outcome_rows(outcome)
    ]
    print_rows(outcome.reason, rows)
    notes = [f"note: {note}" for note in (outcome.summary.notes if outcome.summary else ())]
    for sentence in (*imported.remarks, *notes):
        output().print(sentence)
    output().print(f"session: {session}; `slipscope replay {session}` analyses it again")
    if failed:
        say(failed)
        return FAILED
    return DONE


def repair(session: Path, destination: Path, overwrite: bool, as_json: bool) -> int:
    """Bring back what a session that was cut short holds; the exit code, 1 if some of it is
    missing.
    """
    from app.report.summary_rows import plain
    from app.session import repair as sessions
    from app.session.files import images_of

    with Bar("reading what is left", quiet=as_json) as bar:
        repaired = sessions.repair(
            session,
            destination,
            overwrite=overwrite,
            progress=lambda share: bar.show("bringing back the frames", share),
        )
    found = repaired.found
    if not found.is_whole:
        where = f" (the file of images is {images_of(session).name})"
        say(
            f"{session}: not all of it is left: {found}"
            f"{where if found.torn and repaired.source == 'journal' else ''}; nothing of it was"
            " changed: if there is a copy of its files, repair that"
        )
    if as_json:
        print_json(plain(repaired))
    else:
        output().print(str(repaired))
    return DONE if found.is_whole else FAILED
