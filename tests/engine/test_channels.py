"""The two channels: what the disk gets is everything, what the analysis gets is the newest, and
both say what they did.
"""

import itertools
import math
import threading

import pytest
from hypothesis import given, strategies as st

from app.acquisition.channels import ChannelClosed, ChannelFull, LatestChannel, LosslessChannel


@given(st.lists(st.integers(), max_size=50))
def test_lossless_gives_everything_in_order(items):
    channel = LosslessChannel(10_000, sender_waits=False)
    for item in items:
        channel.put(item, 10)
    channel.end()
    assert [channel.get(0) for _ in items] == items
    assert channel.is_drained


def test_lossless_refuses_when_full_and_keeps_what_it_has():
    channel = LosslessChannel(100, sender_waits=False)
    channel.put("a", 60)
    with pytest.raises(ChannelFull, match="limit"):
        channel.put("b", 60)
    assert channel.fill == pytest.approx(0.6)
    assert channel.get(0) == "a"


def test_lossless_takes_an_item_larger_than_itself_when_empty():
    channel = LosslessChannel(100, sender_waits=False)
    channel.put("huge", 1000)
    assert channel.fill == 1.0
    assert channel.get(0) == "huge"


def test_waiting_sender_continues_when_there_is_room():
    channel = LosslessChannel(100, sender_waits=True)
    channel.put(0, 100)
    sender = threading.Thread(target=lambda: [channel.put(n, 100) for n in range(1, 20)])
    sender.start()
    assert [channel.get(10) for _ in range(20)] == list(range(20))
    sender.join(60)
    assert not sender.is_alive()


def test_broken_channel_releases_a_waiting_sender():
    channel = LosslessChannel(100, sender_waits=True)
    channel.put(0, 100)
    caught = []

    def send():
        try:
            channel.put(1, 100)
        except ChannelClosed:
            caught.append(True)

    sender = threading.Thread(target=send)
    sender.start()
    channel.break_off()
    sender.join(60)
    assert caught == [True]


@given(st.integers(1, 5), st.lists(st.integers(), max_size=30))
def test_latest_keeps_the_newest_and_counts_the_rest(depth, items):
    channel = LatestChannel(depth, sender_waits=False)
    for item in items:
        channel.put(item)
    kept = [channel.get(0) for _ in range(min(depth, len(items)))]
    assert kept == items[-depth:] if items else kept == []
    assert channel.skipped == max(0, len(items) - depth)


def test_latest_with_a_waiting_sender_skips_nothing():
    channel = LatestChannel(2, sender_waits=True)
    sender = threading.Thread(target=lambda: [channel.put(n) for n in range(50)])
    sender.start()
    assert [channel.get(10) for _ in range(50)] == list(range(50))
    sender.join(60)
    assert channel.skipped == 0


def test_after_the_end_offers_are_counted_as_skipped():
    channel = LatestChannel(2, sender_waits=True)
    channel.end()
    channel.put(1)
    assert channel.get(0) is None
    assert channel.skipped == 1
    assert channel.is_drained


def test_what_waited_before_it_narrows_is_delivered():
    """As what came while the reference was taken, for a part of which there was no room."""
    channel = LatestChannel(5, sender_waits=False)
    for item in range(8):
        channel.put(item)
    channel.narrow(6, 2, math.inf)
    channel.put(8)
    assert channel.skipped == 3
    assert [channel.get(0) for _ in range(6)] == [3, 4, 5, 6, 7, 8]


def narrowed(depth, keeps, put=0):
    """A channel of so many, of which it keeps a few, and what was put into it."""
    channel = LatestChannel(depth, sender_waits=False)
    channel.narrow(depth, keeps, math.inf)
    for item in range(put):
        channel.put(item)
    return channel


def test_a_receiver_that_catches_up_after_each_pause_gets_everything():
    channel = narrowed(9, 2)
    put, taken = itertools.count(), []
    for _ in range(3):
        for _ in range(8):
            channel.put(next(put))
        for _ in range(16):  # two are taken while one comes
            channel.put(next(put))
            taken += [channel.get(0), channel.get(0)]
    assert channel.skipped == 0
    got = [item for item in taken if item is not None]
    assert got == list(range(len(got)))
    assert len(got) == next(put)


def test_a_receiver_that_is_too_slow_gets_what_is_young():
    """Three come while two are taken: once they were too many, none is old, and nothing else is
    lost.
    """
    channel = narrowed(30, 4)
    ages = []
    for n in range(300):
        channel.put(n)
        if n % 3:
            ages.append(n - channel.get(0))
    assert max(ages[:50]) > 12
    assert max(ages[70:]) <= 4
    assert channel.skipped == 300 - len(ages) - sum(1 for _ in iter(lambda: channel.get(0), None))


class Clocked:
    """A channel of 20 that gets an item each 10 ms by a clock that stands still meanwhile."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 100.0
        monkeypatch.setattr("app.acquisition.channels.time.monotonic", lambda: self.now_s)
        self.channel: LatestChannel[int] = LatestChannel(20, sender_waits=False)
        self.channel.narrow(20, 3, 0.01)
        self.put, self.taken = 0, list[int]()

    def pass_(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            self.now_s += 0.01
            self.channel.put(self.put)
            self.put += 1

    def take(self, n: int, each_s: float) -> None:
        for _ in range(n):
            item = self.channel.get(0)
            assert item is not None
            self.taken.append(item)
            self.pass_(each_s)


def test_a_receiver_slower_than_what_comes_is_known_after_nine_items(monkeypatch):
    one = Clocked(monkeypatch)
    one.pass_(0.1)
    one.take(9, 0.02)
    assert one.channel.skipped == 0
    one.take(1, 0.02)
    assert one.channel.skipped == 17, "20 waited, the newest 3 stay"
    one.take(20, 0.02)
    ages = [n - item for n, item in zip(range(30, 70, 2), one.taken[10:], strict=True)]
    assert 0 < max(ages) <= 3


def test_of_a_receiver_slower_than_what_comes_a_quarter_of_a_queue_may_wait(monkeypatch):
    one = Clocked(monkeypatch)
    one.pass_(0.15)
    for _ in range(11):
        one.take(1, 0.0)
        one.now_s += 0.02
    one.pass_(0.01)
    assert one.channel.skipped == 0, "five of twenty wait"
    one.pass_(0.01)
    assert one.channel.skipped == 3


@pytest.mark.parametrize("pause_s", [0.05, 0.1, 0.19])
def test_a_pause_makes_no_receiver_slow(pause_s, monkeypatch):
    """One that keeps up, is held up for a while and catches up slowly."""
    one = Clocked(monkeypatch)
    for _ in range(3):
        one.pass_(0.01)
        one.take(15, 0.01)
        one.pass_(pause_s)
        while (item := one.channel.get(0)) is not None:
            one.taken.append(item)
            one.pass_(0.01 if len(one.taken) % 2 else 0)
    assert one.channel.skipped == 0
    assert one.taken == list(range(one.put))


def test_who_waits_for_items_is_not_slow(monkeypatch):
    one = Clocked(monkeypatch)
    for _ in range(20):
        one.pass_(0.01)
        one.take(1, 0.0)
        one.now_s += 0.05  # the sender pauses
    one.pass_(0.18)
    assert one.channel.skipped == 0


def test_a_queue_that_was_cut_may_be_long_again_once_it_has_run_empty():
    channel = narrowed(5, 2, put=6)
    assert channel.skipped == 4
    assert channel.get(0) == 4
    channel.put(6)
    channel.put(7)
    assert channel.skipped == 5
    assert [channel.get(0), channel.get(0)] == [6, 7]
    for item in range(5):
        channel.put(item)
    assert channel.skipped == 5


def test_a_queue_that_was_cut_may_be_long_again_in_the_next_drive():
    channel = narrowed(5, 2, put=6)
    channel.narrow(5, 2, math.inf)
    channel.put(6)
    assert [channel.get(0) for _ in range(3)] == [4, 5, 6]


def test_nothing_of_a_sender_who_waits_is_pushed_out():
    channel = LatestChannel(3, sender_waits=True)
    channel.narrow(4, 1, math.inf)
    for item in range(4):
        channel.put(item)
    assert [channel.get(0) for _ in range(4)] == [0, 1, 2, 3]
    assert channel.skipped == 0


def test_what_waits_when_its_receiver_gives_up_is_skipped():
    channel = LatestChannel(4, sender_waits=False)
    channel.put(0)
    channel.put(1)
    channel.abandon()
    assert (channel.skipped, channel.is_drained, channel.get(0.0)) == (2, True, None)
    channel.put(2)
    assert channel.skipped == 3


def test_lossless_takes_what_just_fits():
    channel = LosslessChannel(10, sender_waits=False)
    channel.put(0, 5)
    channel.put(1, 5)
    assert channel.fill == 1.0
