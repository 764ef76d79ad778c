"""`slipscope repair`: a whole session of one that was cut short."""

from __future__ import annotations

from pathlib import Path

from app.commands.terminal import DONE, Bar, output, print_json


def repair(session: Path, destination: Path, overwrite: bool, as_json: bool) -> int:
    """Bring back what a session that was cut short holds; the exit code."""
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
    return DONE
