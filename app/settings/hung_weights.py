"""What a protocol asks the operator to do, as a simulated one does it: weights to hang on a force
sensor, one axis at a time, and loads to press to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from analysis.options import number_in
from app.settings.protocol_steps import Approach, Ask, Motion, Step, durations
from app.system.errors import UserError

AXES = ("normal", "shear")
PRESSING_S = 1.0  # that the simulated operator takes
LATE_S = 1.0  # by which the next load comes after the steps before it, which may take longer


def asking_for(newtons: float, axis: str) -> Ask:
    """The step that asks for a weight; 0 N: for none."""
    nothing = ", that is, take all weights off" if not newtons else ""
    question = f"hang {newtons:.4f} N on the {axis} sensor{nothing}, and answer once it hangs still"
    return Ask(question=question, weight=newtons, axis=axis)


def growing_newtons(
    name: str, text: str, what: str, *, fewest: int = 0, most: float
) -> list[float]:
    """Weights or loads, as `what` says, as people write them, without a 0 at the beginning; at
    least so many, up to `most` newtons.

    Raises
    ------
    UserError
        They are others; the message begins with `name`.
    """
    try:
        found = [number_in(one) for one in text.replace(",", " ").split()]
    except ValueError:
        found = [0.0]
    is_growing = found == sorted(set(found)) and all(0 < one <= most for one in found)
    if len(found) < fewest or not is_growing:
        raise UserError(
            f"{name}: '{text[:80]}' found; write growing {what} in N, such as '0.1 0.2 0.5'"
        )
    return found


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


def pressed_loads(
    steps: Sequence[Step], rate_hz: float, settle_s: float
) -> list[tuple[float, float]]:
    """The loads (N) that the operator of a simulated bench presses to, each with the samples after
    the first one on which it begins; only the last, where the stage moves or how long a step takes
    is not known.
    """
    loads: list[tuple[float, float]] = []
    start = 0.0
    for step, lasts in zip(steps, durations(steps), strict=True):
        if isinstance(step, Approach):
            if not loads or step.normal_force != loads[-1][1]:
                loads.append((start, step.normal_force))
            start += (PRESSING_S + settle_s + LATE_S) * rate_hz
        elif loads:
            start += lasts * rate_hz
    is_known = math.isfinite(start) and not any(isinstance(step, Motion) for step in steps)
    return loads if is_known else [(0.0, load) for _, load in loads[-1:]]
