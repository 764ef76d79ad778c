"""The faults of a simulated or emulated bench, each written ``KIND AT [AMOUNT]``: "lost-trigger
40", "daq-overflow 5000 300".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.options import number_in

FAULTS = {
    "lost-trigger": "the camera does not see trigger AT (and the AMOUNT - 1 after it)",
    "late-trigger": "trigger AT reaches the camera AMOUNT samples late (5)",
    "lost-frame": "image AT (and the AMOUNT - 1 after it) is exposed, but lost on its way",
    "corrupt-frame": "the lower half of image AT is garbage",
    "camera-gone": "the camera is unplugged at trigger AT",
    "uncounted-exposure": "the counter misses exposure AT (and the AMOUNT - 1 after it)",
    "exposure-wire": "the wire of the exposure output is broken from trigger AT on",
    "exposure-inverted": "the exposure output is inverted (AT is 0): its rising edge is the end",
    "daq-overflow": "the board loses AMOUNT samples (300) from sample AT on",
    "daq-gone": "the board, or its server, is gone from sample AT on",
    "saturated": "the shear sensor is at the end of its range from sample AT on",
    "stall": "the stage stands still after AT um of travel while its controller says that it moves",
    "end-of-run": "the stage meets its end switch after AT um of travel",
    "unplugged": "the line to the actuator is cut at sample AT",
    "noisy-line": "from sample AT on, AMOUNT answers of the actuator (5), every third, are garbled",
    "mute-controller": "from sample AT on, the controller of the actuator answers nothing",
    "slow-controller": "from sample AT on, its answers come AMOUNT ms (100) late",
    "deaf-controller": "from sample AT on, it hears nothing for AMOUNT ms (60) after a command",
    "silent-server": "from sample AT on, the board's server takes calls and does not answer",
    "slow-server": "from sample AT on, the board's server takes AMOUNT ms (200) for each call",
}
"""Kind -> what happens; AT is a number of triggers, samples or micrometres."""

_AMOUNTS = {
    "late-trigger": 5.0,
    "daq-overflow": 300.0,
    "noisy-line": 5.0,
    "slow-controller": 100.0,
    "deaf-controller": 60.0,
    "slow-server": 200.0,
}
EMULATED = {
    "actuator": ("noisy-line", "mute-controller", "slow-controller", "deaf-controller"),
    "forces": ("silent-server", "slow-server"),
}
"""Kind of device -> faults that only an emulated one can have: a simulated one has no line."""


_OF_TRIGGERS = frozenset({
    "lost-trigger", "late-trigger", "lost-frame", "corrupt-frame", "camera-gone",
    "uncounted-exposure", "exposure-wire", "exposure-inverted",
})  # fmt: skip
_OF_TRAVEL = frozenset({"stall", "end-of-run"})


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: its kind, where it happens, and how much of it."""

    kind: str
    at: float
    amount: float = 1.0

    @property
    def place_m(self) -> float:
        """Where the stage meets it, for the kinds whose AT is a travel."""
        return self.at * 1e-6


def parse(text: str) -> Fault:
    """The fault that a text describes.

    Raises
    ------
    ValueError
        It describes none; the message says how faults are written.
    """
    kind, *numbers = text.split()[:4] or [""]
    if kind not in FAULTS:
        raise ValueError(f"no fault is called '{kind}'; known: {', '.join(FAULTS)}")
    try:
        values = [number_in(number) for number in numbers]
    except ValueError:
        values = []
    if not 1 <= len(values) <= 2 or not all(math.isfinite(v) and v >= 0 for v in values):
        raise ValueError(
            f"'{text}' is not a fault; write 'KIND AT' or 'KIND AT AMOUNT' with numbers from 0 on"
            f" ({kind}: {FAULTS[kind]})"
        )
    return Fault(kind, values[0], values[1] if len(values) == 2 else _AMOUNTS.get(kind, 1.0))


def timed(text: str, sample_rate_hz: float, divisor: int) -> str:
    """The text of a fault whose AT may be a time, ``"lost-trigger 4.2s"``: the sample, or the first
    trigger, at that many seconds from the start of the sampling.

    Raises
    ------
    ValueError
        The fault happens at a travel.
    """
    kind, *numbers = text.split()
    try:
        is_time = numbers[0].endswith("s")
        seconds = number_in(numbers[0].removesuffix("s")) if is_time else None
    except (IndexError, ValueError):
        seconds = None
    if seconds is None or not math.isfinite(seconds):
        return text  # `parse` says what is wrong with it
    if kind in _OF_TRAVEL:
        raise ValueError(f"'{text}': the stage meets it at a travel; give AT in um")
    period = divisor if kind in _OF_TRIGGERS else 1
    at = math.ceil(round(seconds * sample_rate_hz / period, 6))
    return " ".join([kind, str(at), *numbers[1:]])


@dataclass(frozen=True, slots=True)
class Faults:
    """All faults of a bench."""

    all: tuple[Fault, ...] = ()

    def needs_emulated(self, device: str) -> str:
        """The first fault that only an emulated device of this kind can have; empty if none."""
        return next((fault.kind for fault in self.all if fault.kind in EMULATED[device]), "")

    def hits(self, kind: str, n: float) -> Fault | None:
        """The fault of this kind that covers trigger or sample `n`; None if there is none.

        It covers `amount` numbers from `at` on, or only `at` if its amount is the size of the
        fault.
        """
        for fault in self.all:
            width = 1 if kind in _AMOUNTS else fault.amount
            if fault.kind == kind and fault.at <= n < fault.at + width:
                return fault
        return None

    def since(self, kind: str, n: float) -> Fault | None:
        """The fault of this kind, which lasts from its beginning on, that has begun by `n`; None if
        there is none.
        """
        return next((fault for fault in self.all if fault.kind == kind and n >= fault.at), None)
