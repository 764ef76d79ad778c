"""What an analysis of a session keeps of its frames."""

from __future__ import annotations

import math

from app.records.record_types import REFERENCE, Conditions, Event, Phase, Snapshot
from app.study import one


def test_what_fields_rest_on_is_the_reference_that_was_taken() -> None:
    """Not an image before it at rest, whose forces lie in a gap."""
    taken = one._Taken()
    for frame, P in ((5, math.nan), (6, 0.5), (7, 0.5)):
        if frame == 6:
            taken.append(Event(600, REFERENCE, "frame 6", 6))
        taken.append(Snapshot(frame, 100 * frame, Conditions(Phase.REFERENCE, math.nan, P, P, 0.0)))
    assert [s.frame for s in taken.before] == [6]
    assert taken.at_rest == [6, 7]
