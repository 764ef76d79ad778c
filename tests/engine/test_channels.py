"""The two channels: what the disk gets is everything, what the analysis gets is the newest, and
both say what they did.
"""

import threading

import pytest
from hypothesis import given, strategies as st

from app.acquisition import channels
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
    channel = LatestChannel(depth, depth, sender_waits=False)
    for item in items:
        channel.put(item)
    kept = [channel.get(0) for _ in range(min(depth, len(items)))]
    assert kept == items[-depth:] if items else kept == []
    assert channel.skipped == max(0, len(items) - depth)


def test_latest_with_a_waiting_sender_skips_nothing():
    channel = LatestChannel(2, 1, sender_waits=True)
    sender = threading.Thread(target=lambda: [channel.put(n) for n in range(50)])
    sender.start()
    assert [channel.get(10) for _ in range(50)] == list(range(50))
    sender.join(60)
    assert channel.skipped == 0


def test_after_the_end_offers_are_counted_as_skipped():
    channel = LatestChannel(2, 1, sender_waits=True)
    channel.end()
    channel.put(1)
    assert channel.get(0) is None
    assert channel.skipped == 1
    assert channel.is_drained


class Clock:
    """Reads what a test sets."""

    def __init__(self):
        self.now_s = 100.0

    def monotonic(self):
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(channels, "time", made)
    return made


def test_a_channel_that_narrows_delivers_what_waited(clock):
    channel = LatestChannel(5, 2, sender_waits=False)
    for item in range(5):
        channel.put(item)
    clock.now_s += 0.9 * channels.PATIENCE_S
    channel.narrow(5)
    assert [channel.get(0) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert channel.skipped == 0


def test_a_channel_that_narrows_pushes_out_the_oldest():
    channel = LatestChannel(5, 1, sender_waits=False)
    for item in range(5):
        channel.put(item)
    channel.narrow(3)
    assert (channel.skipped, channel.get(0)) == (2, 2)


def test_a_queue_that_was_long_when_it_narrows_is_cut_at_once(clock):
    channel = LatestChannel(5, 1, sender_waits=False)
    for item in range(4):
        channel.put(item)
        clock.now_s += 0.9 * channels.PATIENCE_S
    assert channel.skipped == 0
    channel.narrow(5)
    assert (channel.skipped, channel.get(0)) == (3, 3)


def test_a_pause_of_the_receiver_costs_nothing(clock):
    """However long the queue was short before."""
    channel = LatestChannel(9, 2, sender_waits=False)
    channel.narrow(9)
    channel.put(0)
    assert channel.get(0) == 0
    clock.now_s += 60
    for item in range(9):
        channel.put(item)
    clock.now_s += 0.9 * channels.PATIENCE_S
    for item in range(9):
        assert channel.get(0) == item
    assert channel.skipped == 0


def test_a_receiver_that_is_too_slow_gets_what_is_young(clock):
    """Ten items come in a second and six are taken: a queue of twelve would stand."""
    channel = LatestChannel(12, 2, sender_waits=False)
    channel.narrow(12)
    waited, taken = [], []
    for n in range(300):
        channel.put(n)
        clock.now_s += 0.1
        if n % 5 < 3:
            taken.append(channel.get(0))
            waited.append(channel.waited_s)
    assert max(waited) < 0.1 * 2 + channels.PATIENCE_S + 0.2
    assert max(waited[10:]) < 0.35
    assert taken == sorted(taken)
    assert channel.skipped == 300 - len(taken) - 2


def test_a_queue_that_was_cut_may_be_long_again_once_it_has_run_empty(clock):
    channel = LatestChannel(9, 2, sender_waits=False)
    channel.narrow(9)
    for item in range(9):
        channel.put(item)
    clock.now_s += 2 * channels.PATIENCE_S
    channel.put(9)
    assert channel.skipped == 8
    assert channel.get(0) == 8
    channel.put(10)
    channel.put(11)
    assert channel.skipped == 9
    assert [channel.get(0), channel.get(0)] == [10, 11]
    for item in range(9):
        channel.put(item)
    assert channel.skipped == 9


def test_nothing_of_a_sender_who_waits_is_pushed_out(clock):
    channel = LatestChannel(3, 1, sender_waits=True)
    channel.narrow(3)
    for item in range(3):
        channel.put(item)
        clock.now_s += 2 * channels.PATIENCE_S
    assert [channel.get(0) for _ in range(3)] == [0, 1, 2]
    assert channel.skipped == 0


def test_what_waits_when_its_receiver_gives_up_is_skipped():
    channel = LatestChannel(4, 1, sender_waits=False)
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
