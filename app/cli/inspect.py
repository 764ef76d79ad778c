"""`slipscope info`: what a session holds, without its images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option, Typer

from analysis.options import as_written
from app.cli.command_options import JsonFlag, SessionFile, command
from app.settings.sections import Config

if TYPE_CHECKING:
    from app.session.receipt import Receipt


app = Typer()


@command(app)
def info(
    session: SessionFile,
    verify: Annotated[
        bool,
        Option("--verify", help="Read everything and compare it with its checksums."),
    ] = False,
    as_json: JsonFlag = False,
) -> int:
    """Print the content of a session: how it ended, frames and samples, phases, results, changed
    settings, further analyses.

    With --verify, the exit code is 1 if data do not match their checksums.
    """
    from app.cli.end_of_run import tell_notes, text_rows
    from app.cli.terminal import DONE, FAILED, print_json, print_line, print_rows, say
    from app.report.summary_rows import counts_rows, plain, resources_rows, summary_rows
    from app.session.analyses import analyses_of
    from app.session.datasets import uncertain_triggers
    from app.session.journal import has_journal
    from app.session.reader import SessionReader
    from app.settings.config import settings_of
    from app.system.errors import UserError

    receipt, fault = _read_back(session) if verify else (None, "")
    try:
        with SessionReader(session) as reader:
            header, outcome, ended = reader.header, reader.outcome, reader.ended
            config = settings_of(reader)
            version = reader.format
            uncertain = uncertain_triggers(reader)
            phases = [
                {"phase": e.text, "sample": e.sample, "time_s": e.sample / header.sample_rate_hz}
                for e in reader.events()
                if e.kind == "phase"
            ]
    except UserError:
        if not fault:
            raise
        if as_json:
            print_json({"session": str(session), "receipt": None, "fault": fault})
        else:
            say(fault)
        return FAILED
    held = header.auxiliary
    channels = dict(zip(held.name, held.unit, strict=False)) if held else {}
    analyses = [path.name for path in analyses_of(session)]
    changed = changed_settings(config)
    if as_json:
        data = {
            "session": str(session),
            "format": version,
            "state": outcome.ended_as,
            "reason": outcome.reason,
            "started": header.started,
            "about": config.about,
            "ended": ended,
            "frame_shape": header.frame_shape,
            "auxiliary": channels,
            "counts": outcome.counts,
            "uncertain_triggers": uncertain,
            "phases": phases,
            "changed_settings": changed,
            "summary": outcome.summary,
            "resources": outcome.resources,
            "versions": header.versions,
            "has_journal": has_journal(session),
            "source": header.source,
            "analyses": analyses,
        }
        print_json(plain(data | ({"receipt": receipt, "fault": fault} if verify else {})))
        return FAILED if fault else DONE
    rows, columns = header.frame_shape
    kept_in = f", in {header.source.session}" if header.source else ""
    spans = ", ".join(f"{p['phase']} at {p['time_s']:.2f} s" for p in phases)
    doubt = ""
    if uncertain:
        doubt = f"{len(uncertain)}, the first is {uncertain[0]}: they may be of a trigger beside it"
    about = {
        "format": f"SlipScope session, version {version}",
        "state": outcome.ended_as + (f": {outcome.reason}" if outcome.reason else ""),
        **as_written(config.about),
        "started": header.started,
        "ended": ended or "not closed properly",
        "images": f"{columns} x {rows} px{kept_in}",
        "further channels": ", ".join(f"{name} ({unit})" for name, unit in channels.items()),
        "further analyses": ", ".join(analyses),
    }
    shown = [
        *text_rows(about),
        *counts_rows(outcome.counts),
        *text_rows({"uncertain triggers": doubt, "phases": spans or "none"}),
    ]
    if outcome.summary:
        shown += summary_rows(outcome.summary)
    else:
        shown += text_rows({"summary": "none: the run did not come to its end"})
    shown += resources_rows(outcome.resources)
    print_rows(str(session), shown)
    tell_notes(outcome.measured.notes)
    print_rows(
        "settings other than the defaults",
        [(key, "", str(value)) for key, value in changed.items()] or [("none", "", "")],
    )
    if has_journal(session):
        print_line(
            f"`slipscope repair {session} -o REPAIRED.h5` brings back what its journal holds"
        )
    if receipt:
        print_line(str(receipt))
    if fault:
        say(fault)
    return FAILED if fault else DONE


def _read_back(session: Path) -> tuple[Receipt | None, str]:
    """The receipt of a session, or why it is not as it was recorded."""
    from app.session.completing import account_of
    from app.session.receipt import NotAsRecordedError, verify

    try:
        return verify(session, account_of(session)), ""
    except NotAsRecordedError as error:
        return None, str(error)


def changed_settings(config: Config) -> dict[str, Any]:
    """``table.key`` -> value, as in the settings file, of every setting that is not the default."""
    from app.settings.config import keyed, with_own
    from app.settings.plain_values import STEPS

    default = keyed(Config())
    changed = {key: value for key, value in keyed(config).items() if value != default.get(key)}
    if changed.pop(f"run.{STEPS}", None):
        steps = enumerate(config.run.protocol, 1)
        changed |= {f"run.{STEPS}.{number}": str(step) for number, step in steps}
    return with_own(changed, config)
