"""What becomes of a stop of the stage, in four true answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

CUT_POWER = "STOP MOTION FAILED, cut the actuator's power"


SETTLES_S = 8.0  # the position of a stage that does not answer is given up after it
POLL_S = 0.1


class Stop(StrEnum):
    """The answers to a stop."""

    SENT = "sent"
    AT_REST = "at rest"
    FAILED = "FAILED"
    NOT_CONNECTED = "not connected"


class MotionStopped(KeyboardInterrupt):
    """Somebody has stopped the stage for good: no fault of a device, and the end of the command."""


@dataclass(frozen=True, slots=True)
class StopAnswer:
    """What is known of a stop, and the sentence that says so.

    `is_final` is False while the position of the stage is still to be read.
    """

    kind: Stop
    sentence: str
    is_final: bool = True

    @property
    def has_failed(self) -> bool:
        """Whether the stage may be moving, and cannot be stopped from here."""
        return self.kind is Stop.FAILED


def settled(answer: StopAnswer, newest: Callable[[], StopAnswer | None]) -> StopAnswer:
    """The last answer to a stop, once the position was read; the newest, if that takes too long."""
    give_up = time.monotonic() + SETTLES_S
    while not answer.is_final and time.monotonic() < give_up:
        time.sleep(POLL_S)
        answer = newest() or answer
    return answer


def of_all(answers: Sequence[StopAnswer]) -> StopAnswer:
    """The answers of several benches as one, which is as bad as the worst of them."""
    kinds = (Stop.FAILED, Stop.SENT, Stop.AT_REST, Stop.NOT_CONNECTED)
    worst = min((answer.kind for answer in answers), key=kinds.index)
    sentences = sorted(answers, key=lambda answer: kinds.index(answer.kind))
    return StopAnswer(worst, "  ".join(answer.sentence for answer in sentences))


def sent_to(name: str) -> StopAnswer:
    """The actuator took the command; its position is not read yet."""
    return StopAnswer(
        Stop.SENT, f"STOP MOTION was sent to the {name}; its position is being read.", False
    )


def unread(name: str, problem: object) -> StopAnswer:
    """The actuator took the command, and nobody knows whether it stands."""
    return StopAnswer(
        Stop.SENT,
        f"STOP MOTION was sent to the {name}, and whether it stands could not be read: {problem};"
        " watch the stage, and cut the actuator's power if it moves",
    )


def sent_from_outside() -> StopAnswer:
    """The supervisor sent the command; it cannot read the position."""
    return StopAnswer(
        Stop.SENT,
        "STOP MOTION was sent by the supervisor, because the bench's process has ended; it cannot"
        " read whether the stage stands: watch it, and cut the actuator's power if it moves.",
    )


def at_rest(name: str, position_m: float, refusal: str = "") -> StopAnswer:
    """The position of the stage was read, twice, and is the same."""
    although = f", although the stop was refused ({refusal})" if refusal else ""
    return StopAnswer(
        Stop.AT_REST,
        f"STOP MOTION: the {name} is at rest at {position_m * 1e3:.4f} mm; its position was read"
        f" twice{although}.",
    )


def never_moved(name: str, problem: object) -> StopAnswer:
    """The stop could not be sent or confirmed, and nothing was moving that it could have ended."""
    return StopAnswer(
        Stop.NOT_CONNECTED,
        f"STOP MOTION: no motion was asked of the {name}, whose answer to the stop is: {problem}",
    )


def failed(problem: object, *, is_final: bool = True) -> StopAnswer:
    """The stage may be moving, and this program cannot stop it."""
    return StopAnswer(Stop.FAILED, f"{CUT_POWER}: {problem}", is_final)


def not_connected(why: str) -> StopAnswer:
    """Nothing was sent, because there is nothing that it could be sent to."""
    return StopAnswer(Stop.NOT_CONNECTED, f"STOP MOTION: nothing was sent, because {why}.")
