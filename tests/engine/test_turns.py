"""A program that was suspended, or had no turn, does not hold that against its devices."""

import threading
from types import SimpleNamespace

import pytest

from app.acquisition.watchdog import PATIENCE_S, Patience, Watchdog
from app.system import turns
from drivers.errors import DeviceTimeout


class SuspendedClock:
    """It stands, but for a pause before its second reading and any time that is told."""

    def __init__(self, pause_s):
        self.now, self.pause_s, self.readings = 0.0, pause_s, 0
        self.is_read_again = threading.Event()

    def monotonic(self):
        self.readings += 1
        assert self.readings < 1000, "nobody gives up"
        self.now += self.pause_s if self.readings == 2 else 0.1
        if self.readings > 2:
            self.is_read_again.set()
        return self.now


@pytest.fixture
def suspended(monkeypatch):
    monkeypatch.setattr(turns, "time", clock := SuspendedClock(100.0))
    return clock


def watchdog():
    return Watchdog(SimpleNamespace(is_called=threading.Event()), 1.0, is_direct=False)


@pytest.mark.parametrize("make", [Patience, watchdog])
def test_a_call_during_which_the_program_was_suspended_is_waited_for(suspended, make):
    def step():
        assert suspended.is_read_again.wait(60)
        return "an answer"

    assert make().ask("board", step) == "an answer"
    assert suspended.now > 100.0


@pytest.mark.parametrize("make", [Patience, watchdog])
def test_a_device_that_does_not_return_is_given_up_after_a_suspension_too(suspended, make):
    never, asks = threading.Event(), make()
    with pytest.raises(DeviceTimeout, match="board: it did not return from a call"):
        asks.ask("board", never.wait)
    assert asks.given_up == {"board"}
    assert PATIENCE_S - 0.5 < suspended.now - 100.0 < PATIENCE_S + 1.0
    never.set()
