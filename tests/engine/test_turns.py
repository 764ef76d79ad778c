"""A program that was suspended, or had no turn, does not hold that against its devices."""

import threading
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from app.acquisition.watchdog import PATIENCE_S, Patience, Watchdog
from drivers import turns
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


def test_a_device_that_returns_late_is_not_given_up_any_more():
    asks, released, is_back = Patience(), threading.Event(), threading.Event()
    asks.given_up = Mock(wraps=set())
    asks.given_up.discard.side_effect = lambda who: is_back.set()
    with pytest.raises(DeviceTimeout, match=r"board: it did not return from a call within 0\.05 s"):
        asks.aside("board", lambda: released.wait(60), 0.05)
    asks.given_up.add.assert_called_once_with("board")
    assert not is_back.is_set()
    released.set()
    assert is_back.wait(60)
    asks.given_up.discard.assert_called_once_with("board")


def test_the_wait_for_the_end_of_a_run_that_no_force_comes_for_counts_as_well(monkeypatch):
    clock = SimpleNamespace(now=0.0)

    def wait(seconds):
        clock.now += seconds
        return False

    def monotonic():
        clock.now += 0.1
        return clock.now

    monkeypatch.setattr(turns, "time", SimpleNamespace(monotonic=monotonic))
    called = SimpleNamespace(is_set=lambda: False, wait=wait)
    ending = SimpleNamespace(is_called=called, spawn=lambda *_: None)
    never, asks = threading.Event(), Watchdog(ending, 1.0, is_direct=False)
    asks.drives = True
    asks.heard(10.0)
    with pytest.raises(DeviceTimeout, match="board: it did not return from a call"):
        asks.ask("board", never.wait)
    assert PATIENCE_S < clock.now < PATIENCE_S + 1.0
    never.set()
