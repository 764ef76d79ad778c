"""What a contract of a driver is, and how it is broken."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Any

from drivers.errors import DeviceError
from drivers.protocols import TriggerTrain

TRAIN = TriggerTrain(first=0, divisor=100)
NEW, OPEN, STARTED = range(3)  # how a contract is given its device
PATIENCE_S = 5.0


class BrokenContract(Exception):
    """A driver does not do what it must; the message says what was found instead."""


class WrongScale(BrokenContract):
    """Positions or velocities are not in metres; what else moves would only say so again."""


class NotTried(Exception):
    """It cannot be tried on this device; the message says why, and what that means."""


@dataclass(frozen=True, slots=True)
class Contract:
    """One thing that every driver of a kind must do.

    Attributes
    ----------
    kind : str
        "forces", "camera" or "actuator".
    name : str
        What it must do, with underscores.
    moves : bool
        Whether a stage moves, by up to 1 mm, for which there must be room both ways.
    given : int
        Whether it tries a device that is `NEW`, `OPEN`, or `STARTED` with `TRAIN`.
    """

    kind: str
    name: str
    moves: bool
    given: int
    function: Callable[..., None]

    def __str__(self) -> str:
        return self.name.replace("_", " ")

    def check(self, device: Any, **means: Any) -> None:
        """Try a device that is neither open nor started; it is closed again only where the contract
        is kept.

        Parameters
        ----------
        means : callables
            For a camera ``run_until(sample)``, which starts the clock and lets it pass up to there,
            and ``end_clock()``. For an actuator ``pass_time(seconds)``; ``may_move()``, whether
            the stage may move; ``cut()``, which cuts the line to it; ``dying_move(target_m,
            velocity_m_s)``, which sends it off from a process that is killed meanwhile.

        Raises
        ------
        BrokenContract
            It does something else; any other error is the driver's own.
        NotTried
        """
        if self.given != NEW:
            device.open()
        if self.given == STARTED:
            device.start(TRAIN)
        self.function(device, **{name: means[name] for name in self.needs})
        if self.given != NEW:
            device.close()

    @property
    def needs(self) -> list[str]:
        """Names of the means that it needs."""
        return list(inspect.signature(self.function).parameters)[1:]


CONTRACTS: dict[str, list[Contract]] = {"forces": [], "camera": [], "actuator": []}


def contract(
    *kinds: str, moves: bool = False, given: int = OPEN
) -> Callable[[Callable[..., None]], None]:
    """Add a function to the contracts of these kinds of devices."""

    def add(function: Callable[..., None]) -> None:
        for kind in kinds:
            CONTRACTS[kind].append(Contract(kind, function.__name__[1:], moves, given, function))

    return add


def that(is_so: Any, found: str) -> None:
    """Raise `BrokenContract`, with what was found, if it is not so."""
    if not is_so:
        raise BrokenContract(found)


def is_text(what: str, found: Any) -> None:
    """Raise `BrokenContract` where what a device says of itself is no text, or an empty one."""
    that(found or not isinstance(found, str), f"{what} is empty")
    that(isinstance(found, str), f"{what} is {found!r}, not a text")


@contextmanager
def refused(kind: type[DeviceError], what: str) -> Iterator[None]:
    """What must raise an error of this kind; `BrokenContract` if it does not."""
    try:
        yield
    except kind:
        return
    raise BrokenContract(f"{what} was not refused with {kind.__name__}")


def named(error: Exception) -> str:
    """An error as a sentence, with its kind if it is none of a driver."""
    return str(error) if isinstance(error, DeviceError) else f"{type(error).__name__}: {error}"


def has_all_of(device: Any, protocol: type) -> None:
    """Raise `BrokenContract` where a device lacks something of a protocol."""
    annotated = (getattr(base, "__annotations__", ()) for base in protocol.__mro__)
    wanted = {*dir(protocol), *chain.from_iterable(annotated)}
    lacks = sorted(n for n in wanted if not (n.startswith("_") or hasattr(device, n)))
    that(not lacks, f"it has no {', '.join(lacks)}")
    is_text("its name", device.name)
