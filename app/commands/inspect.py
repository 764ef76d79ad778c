"""`slipscope info`: what a session holds, without its images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.commands.terminal import DONE, output, print_json, print_rows
from app.config import from_record
from app.sections import Config


def info(session: Path, as_json: bool) -> int:
    """Print what a session holds; the exit code."""
    from app.report.summary import Row, counts_rows, plain, resources_rows, summary_rows
    from app.session.reader import SessionReader

    with SessionReader(session) as reader:
        config = from_record(reader.config_toml, f"{session}: settings")
        summary, counts = reader.summary(), reader.counts()
        phases = [
            {"phase": e.text, "sample": e.sample, "time_s": e.sample / reader.sample_rate_hz} for e in reader.events() if e.kind == "phase"
        ]
        data = {
            "session": str(session),
            "format": reader.format,
            "state": reader.state,
            "reason": reader.reason,
            "started": reader.started,
            "ended": reader.ended,
            "frame_shape": reader.frame_shape,
            "counts": counts,
            "phases": phases,
            "changed_settings": changed_settings(config),
            "summary": summary,
            "resources": reader.resources,
            "versions": reader.versions,
        }
    if as_json:
        print_json(plain(data))
        return DONE
    rows = [
        Row("format", "", f"SlipScope session, version {data['format']}"),
        Row("state", "", f"{data['state']}" + (f": {data['reason']}" if data["reason"] else "")),
        Row("started", "", str(data["started"])),
        Row("ended", "", str(data["ended"]) or "not closed in good order"),
        Row("images", "", "{1} x {0} px".format(*data["frame_shape"])),  # type: ignore[misc]
        *counts_rows(counts),
        Row("phases", "", ", ".join(f"{p['phase']} at {p['time_s']:.2f} s" for p in phases) or "none"),
        *(summary_rows(summary) if summary else [Row("summary", "", "none: the run did not come to its end")]),
        *resources_rows(data["resources"]),  # type: ignore[arg-type]
    ]
    print_rows(str(session), rows)
    for note in summary.notes if summary else ():
        output().print(f"note: {note}")
    changed = changed_settings(config)
    print_rows("settings other than the defaults", [Row(key, "", str(value)) for key, value in changed.items()] or [Row("none", "", "")])
    return DONE


def changed_settings(config: Config) -> dict[str, Any]:
    """``table.key`` -> value of every setting that is not the default."""
    default = Config()
    return {
        f"{table}.{key}": getattr(getattr(config, table), key)
        for table in config.__struct_fields__
        for key in getattr(config, table).__struct_fields__
        if getattr(getattr(config, table), key) != getattr(getattr(default, table), key)
    }
