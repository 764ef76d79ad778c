"""The stops of a run: sent to its stage before anything else, and what became of them."""

from __future__ import annotations

import math
import threading
import time

from app.acquisition.stage import AGREE_M, Stage
from app.acquisition.watchdog import Watchdog
from app.system.stopping import (
    Stop,
    StopAnswer,
    at_rest,
    failed,
    never_moved,
    not_connected,
    sent_to,
    unread,
)

STANDS_WITHIN_S = 1.5  # the fastest moves need a second to decelerate
APART_S = 0.1  # two readings of the position
STEADY_M = 0.1e-6  # of a stage that stands, a few counts of its encoder
_NOT_BEFORE = {
    "idle": "the run has not begun, and no bench is connected",
    "armed": "the bench is not connected yet; the run ends before it begins",
}


class Stops:
    """Sends every stop of a run, and reads afterwards whether the stage stands.

    Attributes
    ----------
    is_connected : bool
        Whether the actuator is open, so that it can be told to stop.
    answer : StopAnswer or None
        What became of the newest stop; None where none was sent.
    """

    def __init__(self, stage: Stage, watchdog: Watchdog) -> None:
        self.is_connected = False
        self.answer: StopAnswer | None = None
        self._stage, self._watchdog = stage, watchdog
        self._lock = threading.Lock()
        self._refusal = ""

    def send(self) -> None:
        """Stop the stage in the calling thread, if it is connected; in another one if it has not
        returned from a call before, as it may not return from this one either.
        """
        if not self.is_connected:
            return
        name = self._stage.name
        if name in self._watchdog.given_up:
            self._refused(f"{name}: it does not return from its calls")
            threading.Thread(target=self.send_now, name="slipscope-stop", daemon=True).start()
        else:
            self.send_now()

    def send_now(self) -> None:
        """Stop the stage in the calling thread.

        Raises
        ------
        DeviceError
            The stage has refused, or can not be reached.
        """
        try:
            self._stage.stop()
        except Exception as error:
            self._refusal = str(error)
            self._refused(error)
            raise
        self._refusal = ""
        self._note(sent_to(self._stage.name))

    def confirm(self) -> None:
        """Read whether the stage stands, for as long as it may decelerate; nothing is done where
        that is known or no stop was sent.
        """
        answer = self.answer
        if answer is None or answer.is_final:
            return
        try:
            found = self._read()
        except Exception as error:  # whatever it is, the end of the run goes on
            found = unread(self._stage.name, error)
            if self._refusal:
                found = failed(f"{self._refusal}; nor could its position be read")
        with self._lock:
            self.answer = found

    def told(self, state: str) -> StopAnswer:
        """What the operator is told who has just stopped a run in this state."""
        answer = self.answer
        if answer is not None and (self.is_connected or answer.kind is Stop.FAILED):
            return answer
        ended = "the run has ended and its bench is closed"
        return not_connected(_NOT_BEFORE.get(state, ended))

    def _refused(self, problem: object) -> None:
        if self._stage.may_move:
            self._note(failed(problem, is_final=False))
        else:
            self._note(never_moved(self._stage.name, problem))

    def _note(self, answer: StopAnswer) -> None:
        """A stage that was read at rest stays so: nothing moves it after the end was called for."""
        with self._lock:
            before = self.answer
            is_known = before is not None and before.is_final and before.kind is not Stop.FAILED
            if not (is_known and answer.kind is Stop.SENT):
                self.answer = answer

    def _read(self) -> StopAnswer:
        name, stage = self._stage.name, self._stage
        give_up = time.monotonic() + STANDS_WITHIN_S
        before, _ = self._watchdog.ask(name, stage.reading)
        while True:
            read_at = time.monotonic()
            if not self._watchdog.is_direct:
                time.sleep(APART_S)
            place, moves = self._watchdog.ask(name, stage.reading)
            step = stage.velocity_m_s * (time.monotonic() - read_at)
            steady = max(STEADY_M, step / 2) if math.isfinite(step) else AGREE_M
            if not moves and abs(place - before) <= steady:
                return at_rest(name, place, self._refusal)
            if time.monotonic() > give_up:
                says = "says that it moves" if moves else "says that it stands"
                return failed(
                    f"{name}: {STANDS_WITHIN_S:g} s after the stop it {says}, and was read at"
                    f" {before * 1e3:.4f} and {place * 1e3:.4f} mm"
                )
            before = place
