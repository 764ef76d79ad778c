"""The report at the end of a run or a replay: numbers on the terminal, and a picture beside the
session.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.options import as_written
from app.cli.names import JsonData
from app.cli.terminal import print_line, print_rows, say
from app.records.quantities import doubts
from app.records.record_types import Outcome
from app.runs.run_source import Kind, PreparedSource, kind_of
from app.session.files import picture_of
from app.settings.sections import AboutSettings
from app.system.errors import UserError
from app.system.outputs import new_file


def report_end(made: PreparedSource, as_json: bool) -> JsonData:
    """Report how a run, a replay or an analysis ended, and draw its picture; the same as data."""
    source = made.source
    if kind_of(source) is not Kind.LIVE:
        report = report_replay if kind_of(source) is Kind.REPLAY else report_analysis
        return report(source, as_json)
    outcome, session = source.look().outcome, made.session()
    assert outcome is not None
    is_experiment = source.config.run.purpose == "experiment"
    picture = draw(session, as_json) if session and is_experiment else None
    about = source.config.about
    return _report("run", outcome, about, session, picture, as_json, {}, is_whole=is_experiment)


def tell_notes(notes: Sequence[str]) -> None:
    """Print the notes of a summary: first those that put its numbers in doubt, in bold."""
    warnings = doubts(notes)
    for note in warnings:
        print_line(f"WARNING: {note}", style="bold")
    for note in notes:
        if note not in warnings:
            print_line(f"note: {note}")


def text_rows(texts: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Rows of texts by what they are about, without the empty ones."""
    return [(name, "", text) for name, text in texts.items() if text]


def report_replay(replay: Any, as_json: bool) -> JsonData:
    """As of a run; a picture that exists is kept, since it shows the same results."""
    comparison, session = replay.comparison(), replay.path
    picture: Path | None = picture_of(session)
    if not picture_of(session).exists():
        picture = None if replay.is_refused else draw(session, as_json)
    share = comparison.share
    data = {
        "verdict": comparison.verdict if comparison.frames else None,
        "agrees": comparison.agrees,
        "frames": comparison.frames,
        "identical": comparison.identical,
        "first_difference": comparison.first_difference,
        "largest_difference": comparison.largest_difference,
        "uncertainty_share": share if math.isfinite(share) else None,
        "recorded_on": comparison.recorded_on,
        "replayed_on": comparison.replayed_on,
    }
    if not as_json:
        for sentence in comparison.sentences:
            print_line(sentence)
    more = {"comparison": data, "refused": replay.is_refused}
    return _report("replay", replay.outcome(), replay.config.about, session, picture, as_json, more)


def report_analysis(analysis: Any, as_json: bool) -> JsonData:
    """As of a run, with the results of the session beside the new ones."""
    from app.report.summary_rows import compared_rows, plain

    outcome, before = analysis.outcome(), analysis.recorded_summary
    made = analysis.output if outcome.state == "done" else None
    picture = draw(made, as_json) if made else None
    if not as_json and outcome.summary and before:
        title = f"{analysis.path.name} and {analysis.output.name}"
        print_rows(title, compared_rows(before, outcome.summary))
    more = {"source": str(analysis.path), "recorded": plain(before)}
    more["refused"] = analysis.is_refused
    return _report("analysis", outcome, analysis.config.about, made, picture, as_json, more)


def _report(
    what: str,
    outcome: Outcome,
    about: AboutSettings,
    session: Path | None,
    picture: Path | None,
    as_json: bool,
    more: JsonData,
    *,
    is_whole: bool = True,
) -> JsonData:
    from app.report.summary_rows import outcome_data, outcome_rows, plain

    files = {"session": session, "picture": picture}
    if not as_json:
        rows = [*text_rows(as_written(about)), *outcome_rows(outcome)] if is_whole else []
        print_rows(f"{what} {outcome.ended_as}: {outcome.reason}", rows)
        tell_notes(outcome.measured.notes)
        for name, path in files.items():
            if path:
                print_line(f"{name}: {path}")
        if outcome.state == "failed":
            say(outcome.reason)
    paths = {name: str(path) if path else None for name, path in files.items()}
    return {**paths, "about": plain(about), **outcome_data(outcome), **more}


def _printable(name: str) -> str:
    """The name of a file, which can be any bytes, as a text of a picture, in which $ begins a
    formula.
    """
    return name.encode("utf-8", "backslashreplace").decode().replace("$", r"\$")


def draw(session: Path, as_json: bool) -> Path | None:
    """Draw the picture of a session from what is on disk; None, with the reason on the terminal, if
    there is nothing to draw.
    """
    from app.records.legs import numbered_instants
    from app.report.figures import experiment_figure, write_picture
    from app.session.reader import SessionReader

    path = picture_of(session)
    try:
        with SessionReader(session) as reader:
            snapshots = [replace(snapshot, field=None) for snapshot in reader.snapshots()]
            summary, header = reader.outcome.summary, reader.header
            instants = numbered_instants(snapshots, summary)
            if not instants:
                if not as_json:
                    say("no picture: no frame was analysed during the drive")
                return None
            for i in instants:
                snapshots[i] = reader.snapshot(i)
            figure = experiment_figure(
                snapshots,
                reader.contact(),
                summary,
                header.grid_x_px,
                header.grid_y_px,
                header.pixel_m,
                title=_printable(session.name),
            )
        with new_file(path, overwrite=True) as unfinished:
            write_picture(figure, unfinished)
    except (UserError, OSError) as error:
        if not as_json:
            say(f"no picture: {error}")
        return None
    return path
