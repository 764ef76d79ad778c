"""What sessions of format 7 and earlier, and journals of format 3, say in sentences that later ones
hold as numbers and names: how a run ended, and what of an event is computed with.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

from app.records.record_types import (
    ACCOUNT,
    COMPLETE,
    REFERENCE,
    REVOKED,
    STEP,
    End,
    Event,
)

TYPED_SINCE = 8  # format of the first sessions without sentences to be read
_ENDS = (
    (re.compile(r"^imported: "), End.IMPORTED),
    (re.compile(r" (complete|done)(;|$)"), End.COMPLETE),
    (re.compile(r"^all \d"), End.PLAYED),
)
_NUMBERED = re.compile(r"(?:frame )?([0-9]{1,18})\b")
_EARLIER_KINDS = {ACCOUNT: "camera", COMPLETE: "stop"}


def end_of(state: str, reason: str, version: int) -> End:
    """How a run ended, by what a session of that format says; ValueError for no state of a run."""
    if version >= TYPED_SINCE or state != "done":
        return End(state)
    return next((end for words, end in _ENDS if words.search(reason)), End.STOPPED)


def journalled(plain: Any) -> Any:
    """What a record of a journal of format 3 is now, both in plain values: an outcome by its end, a
    trigger by the first and the last that it can be.
    """
    match plain:
        case {"state": str(state), "reason": str(reason)}:
            return plain | {"end": str(end_of(state, reason, 7))}
        case {"index": index, "span": span}:
            first, last = span or (index, index)
            return plain | {"first": first, "last": last}
    return plain


def typed(record: Any, version: int = 7) -> Any:
    """A record of a session of that format with the facts that its sentence says; one that says
    none as it is.
    """
    match record:
        case _ if version >= TYPED_SINCE:
            return record
        case Event(kind="camera", text=text) if text.startswith("account: "):
            return replace(record, kind=ACCOUNT)
        case Event(kind="stop", text=text) if text.endswith(" complete"):
            return replace(record, kind=COMPLETE)
        case Event(kind=kind, text=text) if kind in (STEP, REFERENCE, REVOKED):
            found = _NUMBERED.match(text)
            return replace(record, number=int(found[1]) if found else -1)
        case Event(kind="zero", text=text):
            normal_v, shear_v = _volts(text)
            return replace(record, normal_v=normal_v, shear_v=shear_v)
        case _:
            return record


def happened(event: Event, version: int) -> str:
    """An event as the checksum of a session of that format has it."""
    if version >= TYPED_SINCE:
        facts = f"{event.number} {event.normal_v} {event.shear_v}"
        return f"{event.sample} {event.kind} {event.text}\n{facts}\n"
    return f"{event.sample} {_EARLIER_KINDS.get(event.kind, event.kind)} {event.text}\n"


def _volts(text: str) -> tuple[float, float]:
    """The two readings, NaN where there are others."""
    try:
        normal_v, shear_v = map(float, text.split())
    except ValueError:
        return math.nan, math.nan
    return normal_v, shear_v
