"""The report at the end of a run or a replay: numbers on the terminal, a picture beside the
session.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.commands.terminal import output, print_rows, say
from app.errors import UserError
from app.outputs import new_file
from app.results import Outcome
from app.session.files import picture_of


def report_run(outcome: Outcome, session: Path | None, as_json: bool) -> dict[str, Any]:
    """Tell how a run ended and draw its picture; the same as data.

    `session` is None where nothing was recorded.
    """
    picture = _draw(session, as_json) if session else None
    return _report(outcome, "run", session, picture, as_json, {})


def report_replay(source: Any, outcome: Outcome, session: Path, as_json: bool) -> dict[str, Any]:
    """As of a run; an existing picture is left as it is, for it shows the same results."""
    comparison = source.comparison()
    picture: Path | None = picture_of(session)
    if not picture_of(session).exists():
        picture = _draw(session, as_json)
    same = (
        f"{comparison.identical} of {comparison.frames} frames gave the recorded results to the bit"
    )
    if comparison.first_difference:
        same += f"; first difference: {comparison.first_difference}"
    if not as_json:
        output().print(same)
    extra = {
        "frames": comparison.frames,
        "identical": comparison.identical,
        "first_difference": comparison.first_difference,
    }
    return _report(outcome, "replay", session, picture, as_json, {"comparison": extra})


def report_analysis(source: Any, outcome: Outcome, as_json: bool) -> dict[str, Any]:
    """As of a run, with what the session held beside what was found now."""
    from app.report.summary import compared_rows, plain

    made = source.output if outcome.state == "done" else None
    picture = _draw(made, as_json) if made else None
    if not as_json and outcome.summary and source.recorded_summary:
        print_rows(
            f"{source.path.name} and {source.output.name}",
            compared_rows(source.recorded_summary, outcome.summary),
        )
    return _report(
        outcome,
        "analysis",
        made,
        picture,
        as_json,
        {"source": str(source.path), "recorded": plain(source.recorded_summary)},
    )


def _report(
    outcome: Outcome,
    what: str,
    session: Path | None,
    picture: Path | None,
    as_json: bool,
    extra: dict[str, Any],
) -> dict[str, Any]:
    from app.report.summary import outcome_data, outcome_rows

    if not as_json:
        print_rows(f"{what} {outcome.state}: {outcome.reason}", outcome_rows(outcome))
        for note in outcome.summary.notes if outcome.summary else ():
            output().print(f"note: {note}")
        if session:
            output().print(f"session: {session}")
        if picture is not None:
            output().print(f"picture: {picture}")
        if outcome.state == "failed":
            say(outcome.reason)
    paths = {
        "session": str(session) if session else None,
        "picture": str(picture) if picture else None,
    }
    return {**paths, **outcome_data(outcome), **extra}


def _draw(session: Path, as_json: bool) -> Path | None:
    """The picture of a session, made from what is on disk; None, with the reason on the terminal,
    where there is nothing to draw.
    """
    from app.report.figures import experiment_picture, numbered_instants
    from app.results import without_fields
    from app.session.reader import SessionReader

    path = picture_of(session)
    try:
        with SessionReader(session) as reader:
            snapshots = [without_fields(snapshot) for snapshot in reader.snapshots()]
            summary = reader.summary()
            instants = numbered_instants(snapshots, summary)
            if not instants:
                if not as_json:
                    say("no picture: no frame was analysed during the drive")
                return None
            for i in instants:
                snapshots[i] = reader.snapshot(i)
            with new_file(path, overwrite=True) as unfinished:
                experiment_picture(
                    snapshots,
                    reader.contact(),
                    summary,
                    reader.grid_x_px,
                    reader.grid_y_px,
                    reader.pixel_m,
                    unfinished,
                    title=session.name,
                )
    except (UserError, OSError) as error:
        if not as_json:
            say(f"no picture: {error}")
        return None
    return path
