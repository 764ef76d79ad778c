"""What a camera delivers, on its way to a trigger, and the account of it."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.frame_matching.verdict import Verdict
from drivers.protocols import Image


@dataclass(frozen=True, slots=True)
class Delivered:
    """The result of one exposure, from the camera's library.

    Attributes
    ----------
    frame_id : int or None
        The camera's own number; None if the library has lost it.
    timestamp_s : float or None
        Of the camera's clock; None if it has none.
    image : ndarray or None
        None if the grab failed, for the `reason`.
    """

    frame_id: int | None
    timestamp_s: float | None
    image: Image | None
    reason: str = ""


@dataclass(slots=True)
class Item:
    """A delivered image on its way to an answer.

    `number` counts exposures by the camera's ids: `steps` of them since the last image (None: it is
    not known how many), `named` since the last image with an id. `missed` is the number of triggers
    between by timestamps. `limit` is the last trigger that it can have by the time at which it
    came, less the number; `least` the first. `delay` is the time from trigger 0 to its coming, in
    samples.
    """

    delivered: Delivered
    number: int
    steps: int | None
    named: int
    missed: int | None
    came_s: float
    limit: int
    least: int
    complaint: str
    delay: float
    verdict: Verdict | None = None


@dataclass(slots=True)
class Doubt:
    """A doubt that is open: since when, how late images came `before` it and since, and the extra
    counts up to it. How late is in samples, as if no trigger had been missed since.

    `trigger` is the first that it can be about.

    `by_count` and `by_stamp` are whether either of them has told of a missed trigger that the other
    does not know, `by_delay` whether it is about two faults of which only the delay can tell,
    `times` how often something arose that no witness has settled yet, `regular` how many images
    were a whole number of periods apart, although not from those before.
    """

    since_s: float
    before: list[float]
    extras: int
    trigger: int = 0
    by_count: bool = False
    by_stamp: bool = False
    by_delay: bool = False
    times: int = 0
    regular: int = 0
    since: list[float] = field(default_factory=list)


@dataclass(slots=True)
class TriggerAccount:
    """What came of the triggers of a run so far.

    `surplus` are images that had no trigger, came twice, or came when theirs was given up.
    """

    images: int = 0
    lost: int = 0
    missed: int = 0
    uncertain: int = 0
    surplus: int = 0
    notes: set[str] = field(default_factory=set)
