"""`slipscope info`: what a session holds, without its images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.commands.terminal import DONE, FAILED, output, print_json, print_rows, say
from app.config import from_record, values_of
from app.settings import Config

if TYPE_CHECKING:
    from app.session.receipt import Receipt


def info(session: Path, as_json: bool, verify: bool = False) -> int:
    """Print what a session holds, and with `verify` the receipt of reading it back; the exit code,
    1 if it is not as it was recorded.
    """
    from app.report.summary import Row, counts_rows, plain, resources_rows, summary_rows
    from app.session.analyses import analyses_of
    from app.session.journal import has_journal
    from app.session.reader import SessionReader

    receipt, fault = _read_back(session) if verify else (None, "")
    with SessionReader(session) as reader:
        config = from_record(reader.config_toml, f"{session}: settings")
        summary, counts, shape = reader.summary(), reader.counts(), reader.frame_shape
        phases = [
            {"phase": e.text, "sample": e.sample, "time_s": e.sample / reader.sample_rate_hz}
            for e in reader.events()
            if e.kind == "phase"
        ]
        data = {
            "session": str(session),
            "format": reader.format,
            "state": reader.state,
            "reason": reader.reason,
            "started": reader.started,
            "ended": reader.ended,
            "frame_shape": shape,
            "counts": counts,
            "phases": phases,
            "changed_settings": changed_settings(config),
            "summary": summary,
            "resources": reader.resources,
            "versions": reader.versions,
            "has_journal": has_journal(session),
            "source": reader.source,
            "analyses": [path.name for path in analyses_of(session)],
        }
    if as_json:
        print_json(plain(data | ({"receipt": receipt, "fault": fault} if verify else {})))
        return FAILED if fault else DONE
    images = f"{shape[1]} x {shape[0]} px"
    images += f", in {reader.source.session}" if reader.source else ""
    rows = [
        Row("format", "", f"SlipScope session, version {data['format']}"),
        Row("state", "", f"{data['state']}" + (f": {data['reason']}" if data["reason"] else "")),
        Row("started", "", str(data["started"])),
        Row("ended", "", str(data["ended"]) or "not closed in good order"),
        Row("images", "", images),
        *([Row("further analyses", "", ", ".join(data["analyses"]))] if data["analyses"] else []),  # type: ignore[arg-type]
        *counts_rows(counts),
        Row(
            "phases",
            "",
            ", ".join(f"{p['phase']} at {p['time_s']:.2f} s" for p in phases) or "none",
        ),
        *(
            summary_rows(summary)
            if summary
            else [Row("summary", "", "none: the run did not come to its end")]
        ),
        *resources_rows(data["resources"]),  # type: ignore[arg-type]
    ]
    print_rows(str(session), rows)
    for note in summary.notes if summary else ():
        output().print(f"note: {note}")
    changed = changed_settings(config)
    print_rows(
        "settings other than the defaults",
        [Row(key, "", str(value)) for key, value in changed.items()] or [Row("none", "", "")],
    )
    if data["has_journal"]:
        output().print(
            f"`slipscope repair {session} -o REPAIRED.h5` brings back what its journal holds"
        )
    if receipt:
        output().print(str(receipt))
    if fault:
        say(fault)
    return FAILED if fault else DONE


def _read_back(session: Path) -> tuple[Receipt | None, str]:
    """The receipt of a session, or why it is not as it was recorded."""
    from app.session.journal import has_journal, journal_of
    from app.session.receipt import NotAsRecordedError, verify

    try:
        return verify(session, journal_of(session) if has_journal(session) else None), ""
    except NotAsRecordedError as error:
        return None, str(error)


def changed_settings(config: Config) -> dict[str, Any]:
    """``table.key`` -> value of every setting that is not the default."""
    default = values_of(Config())
    return {
        f"{table}.{key}": value
        for table, values in values_of(config).items()
        for key, value in values.items()
        if value != default[table][key]
    }
