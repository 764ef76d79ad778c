"""Devices that do not return from a call: they are asked in a thread of their own, which is given
up on, and the stage is stopped as soon as the newest force is too old.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from functools import partial
from typing import TypeAlias, TypeVar

from app.acquisition.ending import FOR_PEOPLE, Ending, sentence
from app.system.stopping import MotionStopped
from app.system.threads import start_thread
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.turns import POLL_S, TurnClock, done_beside, settle

T = TypeVar("T")
_Calls: TypeAlias = "queue.SimpleQueue[Callable[[], None] | None]"
PATIENCE_S = 3.0  # a device that does not return from a call is given up after it
START_S = 10.0  # time that a device has to start
STEP_PATIENCE_S = 60.0  # the same for a step of a check, which is many calls


def _result(call: Future[T], who: str) -> T:
    with blamed(who):
        return call.result()


@contextmanager
def blamed(who: str) -> Iterator[None]:
    """What a call of a device raises; what no driver may raise is a fault of that device."""
    try:
        yield
    except (*FOR_PEOPLE, MotionStopped):
        raise
    except BaseException as error:
        remedy = "check the device and its driver, which `slipscope check-driver` tests"
        raise DeviceFault(f"{sentence(who, error)}; {remedy}") from error


class Patience:
    """Asks each device in a thread of its own, as long as nothing is sampled for a run.

    Attributes
    ----------
    given_up : set of str
        Devices that have not returned from a call yet.
    is_direct : bool
        Whether a device is asked in the calling thread.
    """

    is_direct = False

    def __init__(self) -> None:
        self.given_up: set[str] = set()

    def ask(self, who: str, step: Callable[[], T]) -> T:
        """See `aside`."""
        return self.aside(who, step)

    def aside(self, who: str, step: Callable[[], T], patience_s: float | None = None) -> T:
        """What a step with a device returns or raises, beside all that it is asked otherwise;
        `DeviceTimeout` after `patience_s`, by default `PATIENCE_S`, and `DeviceFault` for what no
        driver may raise.
        """
        if self.is_direct:
            return step()
        patience_s = PATIENCE_S if patience_s is None else patience_s
        call = done_beside(step, patience_s)
        if not call.done():
            self.given_up.add(who)
            call.add_done_callback(lambda _: self.given_up.discard(who))  # or at once, if meanwhile
            raise DeviceTimeout(
                f"{who}: it did not return from a call within {patience_s:g} s; check the device,"
                " its connection and its driver"
            )
        self.given_up.discard(who)
        return _result(call, who)


class Watchdog(Patience):
    """Asks the devices for the thread that decides, and watches how long that takes.

    Parameters
    ----------
    ending : Ending
        Called when the stage moves and no force comes.
    age_s : float
        Greatest age of the newest force while the stage moves.
    is_direct : bool
        True where the devices wait for us (simulation at full speed): they are asked in the calling
        thread, and time does not count.

    Attributes
    ----------
    asked : str
        Device that is being asked; set by what asks several in one call.
    given_up : set of str
        Devices that did not return; they are not asked again.
    drives : bool
        Whether the stage moves, by the clock on the wall.
    is_direct : bool
        As it was given.
    """

    def __init__(self, ending: Ending, age_s: float, *, is_direct: bool) -> None:
        super().__init__()
        self.asked = ""
        self.drives = False
        self._ending, self._age_s, self.is_direct = ending, age_s, is_direct
        self._calls: _Calls | None = None
        self._heard_at = time.monotonic()

    def heard(self, age_s: float) -> float:
        """Note that forces came, of which the newest is `age_s` old; how old the newest known one
        had become by then, if that is more.
        """
        if self.is_direct:
            return 0.0
        before, self._heard_at = self._heard_at, time.monotonic() - age_s
        return max(age_s, time.monotonic() - before)

    def ask(self, who: str, step: Callable[[], T], patience_s: float = PATIENCE_S) -> T:
        """What a step with a device returns or raises.

        Raises
        ------
        DeviceTimeout
            The device did not return within `patience_s`, or `PATIENCE_S` after the end of the run
            was called for, or was given up before.
        DeviceFault
            It raised what no driver may raise.
        """
        if self.is_direct:
            return step()
        if who in self.given_up:
            raise self._is_given_up(who)
        if self._calls is None:
            self._calls = queue.SimpleQueue()
            start_thread("devices", _work, self._calls)
        self.asked, call = who, Future[T]()
        self._calls.put(partial(settle, call, step))
        turns, give_up_s = TurnClock(), patience_s
        while not wait([call], POLL_S).done:
            past_s = turns.read()
            if self._ending.is_called.is_set():
                give_up_s = min(give_up_s, past_s + PATIENCE_S)
            elif self.drives and time.monotonic() - self._heard_at > self._age_s:
                # another thread, because the stage may be what does not return
                self._ending.spawn("watchdog", self._bark)
                called_s = past_s
                while past_s - called_s < PATIENCE_S and not self._ending.is_called.wait(POLL_S):
                    past_s = turns.read()
            if past_s > give_up_s:
                self._calls.put(None)  # should it ever return
                self._calls = None
                self.given_up.add(self.asked)
                raise self._is_given_up(self.asked)
        return _result(call, self.asked)

    def close(self) -> None:
        """Let the thread end."""
        if self._calls is not None:
            self._calls.put(None)

    def _bark(self) -> None:
        self._ending.call(
            f"{self.asked}: it was asked and no force came for {self._age_s:g} s (limits.age) while"
            " the stage moves; check this device, its connection and what else the computer does",
            failed=True,
        )

    def _is_given_up(self, who: str) -> DeviceTimeout:
        return DeviceTimeout(
            f"{who}: it did not return from a call and was given up; check the device, its"
            " connection and its driver"
        )


def _work(calls: _Calls) -> None:
    while (call := calls.get()) is not None:
        call()
