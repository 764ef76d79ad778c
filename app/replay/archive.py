"""Recorded sessions for lists, comparisons and further analyses, in plain values."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

from app.records.record_types import Outcome
from app.report.card import card_of, card_quantities, verdict_of
from app.report.side_by_side import BEING_RECORDED, CUT_SHORT, Entry, Recorded, curves_of
from app.session.datasets import uncertain_triggers
from app.session.journal import journal_of, session_of
from app.settings.config import settings_of
from app.system.disk import is_locked
from app.system.errors import UserError

ENDINGS = (".h5", ".hdf5", ".nxs")


def sessions_in(folder: Path) -> list[Path]:
    """Files of a folder that may be sessions, the newest first."""
    there = list(folder.iterdir())
    # of a recording that was cut short, or is going on, there is a journal only
    files = {session: path for path in there if (session := session_of(path)) is not None}
    files |= {path: path for path in there if path.suffix.lower() in ENDINGS}
    changed: dict[Path, float] = {}
    for session, path in files.items():
        with suppress(OSError):  # it was removed just now, or is a link to nothing
            changed[session] = path.stat().st_mtime
    return sorted(changed, key=lambda path: (-changed[path], path.name))


def entry_of(path: Path) -> Entry:
    """What a list says of a file, also of one that is no session."""
    from app.session.reader import SessionReader

    try:
        with SessionReader(path) as session:
            header, outcome = session.header, session.outcome
    except (UserError, OSError) as error:
        journal = journal_of(path)
        if path.exists() or not journal.exists():
            return Entry(path, "", problem=str(error))
        if is_locked(journal):
            return Entry(path, BEING_RECORDED, problem=f"{path}: a program is recording it")
        output = path.with_stem(f"{path.stem}-repaired").name
        return Entry(
            path,
            CUT_SHORT,
            problem=f"{path}: its recording was cut short; slipscope repair {path.name} -o {output}"
            " brings back what there is of it",
        )
    state = str(verdict_of(outcome))
    if header.source is not None:
        state = f"analysis of {header.source.session}"
    return Entry(path, state, *_numbers(outcome), header.started)


def _numbers(outcome: Outcome) -> tuple[str, str]:
    """Load and mu_s as a list has them."""
    if outcome.summary is None:
        return "", ""
    by_symbol = {q.symbol: q for q in card_quantities(outcome.summary)}
    load, mu = by_symbol["P"], by_symbol["mu_s"]
    texts = f"{load.value:.3f}" if math.isfinite(load.value) else ""
    return texts, " ".join(mu.rounded).strip()


def recorded(path: Path) -> Recorded:
    """What a comparison needs of a session.

    Raises
    ------
    UserError
        It cannot be read.
    """
    from app.session.reader import SessionReader

    with SessionReader(path) as session:
        outcome, results = session.outcome, session.results()
        config = settings_of(session)
        uncertain, is_live = len(uncertain_triggers(session)), session.header.source is None
    card = card_of(path.name, outcome, uncertain, is_live=is_live)
    found, dic = outcome.measured, config.dic
    curves = curves_of(results, found)
    return Recorded(path, card, found.normal_force_n, *curves, f"box {dic.box}, step {dic.step}")
