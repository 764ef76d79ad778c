"""Weights that a protocol asks the operator to hang on a force sensor, one axis at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from app.settings.protocol_steps import Ask, Step, durations

AXES = ("normal", "shear")


def asking_for(newtons: float, axis: str) -> Ask:
    """The step that asks for a weight; 0 N: for none."""
    nothing = ", that is, take all weights off" if not newtons else ""
    question = f"hang {newtons:.4f} N on the {axis} sensor{nothing}, and answer once it hangs still"
    return Ask(question=question, weight=newtons, axis=axis)


def asked_weight(step: Step) -> tuple[str, float] | None:
    """Axis and newtons that a step asks for; None if it asks for no weight."""
    return (step.axis, step.weight) if isinstance(step, Ask) and step.weight >= 0 else None


def hung_weights(
    steps: Sequence[Step], rate_hz: float, block: int
) -> tuple[tuple[int, float, float], ...]:
    """What the operator of a simulated bench hangs, and when, if no question is answered before its
    time is over: the sample, and the newtons on the normal and the shear sensor from then on.
    """
    weights, hung, start = [], dict.fromkeys(AXES, 0.0), 0.0
    for step, planned in zip(steps, durations(steps), strict=True):
        asked = asked_weight(step)
        lasts = step.timeout if isinstance(step, Ask) else planned
        if asked:
            hung |= dict([asked])
            weights.append((round(start + lasts * rate_hz / 2), hung["normal"], hung["shear"]))
        # a step ends with a block; how long an approach takes is not known
        if math.isnan(lasts):
            break
        start += block * math.ceil(lasts * rate_hz / block)
    return tuple(weights)
