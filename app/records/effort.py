"""What is computed of a frame, for whom, and what it costs; and what a whole run took."""

from __future__ import annotations

import math
from enum import IntFlag
from typing import Annotated, TypedDict

from msgspec import Meta

from app.records.schema import column, record

Bits = Annotated[int, Meta(ge=0, lt=256)]
Taken = Annotated[float, Meta(ge=0, le=1e12)]


class Product(IntFlag):
    """What can be computed of a frame beyond its forces."""

    CONTACT = 1  # displacements about the contact, and all that follows from their means over rings
    PICTURE = 2  # displacements in the rest of the picture
    EVERY_POINT = 4  # the traction of every point
    SETTLED = 8  # as many passes as the correlation needs, instead of one


class Asker(IntFlag):
    """Who asks for something to be computed."""

    RECORD = 1  # recording.results
    WINDOW = 2


EVERYTHING = sum(Product)


@record("/entry/results", rows="results", since=6)
class Effort:
    """What was computed of a frame, for whom, and what it cost; a replay computes the same."""

    computed: Bits = column(
        "computed",
        "1",
        "sum of 1: displacements about the contact, 2: in the rest of the picture, 4: the traction"
        " of every point, 8: as many passes as needed instead of one",
        dtype="uint8",
        default=EVERYTHING,
    )
    asked_by: Bits = column(
        "asked_by", "1", "sum of 1: the record, 2: a window", dtype="uint8", default=1
    )
    shed: Bits = column(
        "shed",
        "1",
        "what was left out for lack of time, 0 to 4: nothing, every second redraw, also the"
        " traction of every point, also displacements far from the contact, also further passes",
        dtype="uint8",
        default=0,
    )
    took_s: float = column("took", "s", "duration of its analysis", default=math.nan)
    waited_s: float = column("waited", "s", "waiting time before its analysis", default=math.nan)

    @property
    def products(self) -> Product:
        """What was computed."""
        return Product(self.computed)


# what is left out for lack of time, in this order, each with all before it
STEPS = (
    "every second redraw",
    "the traction of every point",
    "displacements far from the contact",
    "further passes of the correlation",
)


def left_out(shed: int) -> str:
    """What is left out at a step, in words."""
    return " and ".join(STEPS[:shed]) or "nothing"


class Resources(TypedDict, total=False):
    """What a run took of the computer, and where its session went."""

    peak_memory_mib: Taken
    cpu_s: Taken
    wall_s: Taken
    receipt: str
    session: str
