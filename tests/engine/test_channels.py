"""The two channels: what the disk gets is everything, what the analysis gets is the newest, and
both say what they did.
"""

import itertools
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


class Clock:
    """Reads what a test sets."""

    def __init__(self):
        self.now_s = 100.0

    def perf_counter(self):
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(channels, "time", made)
    return made


def pass_on(channel, clock, seconds, put_s, *taken_s):
    """A sender and a receiver with so much time between two items, the receiver in turn; how long
    each item waited.

    The receiver asks again as soon as it has worked on an item.
    """
    end_s, put_at, taken_at, waited = clock.now_s + seconds, clock.now_s, clock.now_s, []
    works_s = itertools.cycle(taken_s)
    while clock.now_s < end_s:
        clock.now_s = min(put_at, taken_at)
        if clock.now_s == put_at:
            channel.put(clock.now_s)
            put_at += put_s
        if clock.now_s == taken_at:
            is_taken = channel.get(0) is not None
            waited += [channel.waited_s] * is_taken
            taken_at += next(works_s) if is_taken else 0.001
    return waited


@pytest.mark.parametrize("pause_s", [0.5, 1.0, 1.4])
def test_a_pause_of_a_receiver_that_is_fast_enough_costs_nothing(clock, pause_s):
    """However long the queue was short before, and whatever came during the pause."""
    channel = LatestChannel(36, sender_waits=False)
    channel.stay_short(2, 5.0)
    for _ in range(3):
        assert max(pass_on(channel, clock, 20, 0.042, 0.028)) < pause_s
        channel.put(clock.now_s)
        for _ in range(int(pause_s / 0.042)):
            clock.now_s += 0.042
            channel.put(clock.now_s)
    assert channel.skipped == 0


def test_what_came_before_is_worked_off(clock):
    """As what came while the reference was taken, for a part of which there was no room."""
    channel = LatestChannel(36, sender_waits=False)
    pass_on(channel, clock, 1, 0.042, 0.1)  # it was slow, too, as long as kernels were compiled
    for _ in range(60):
        clock.now_s += 0.042
        channel.put(clock.now_s)
    had_no_room = channel.skipped
    channel.stay_short(2, 5.0)
    waited = pass_on(channel, clock, 20, 0.042, 0.028)
    assert channel.skipped == had_no_room + 1
    assert max(waited) > 1.4
    assert max(waited[-100:]) < 0.042


@pytest.mark.parametrize(("put_s", "taken_s"), [(0.016, 0.028), (0.042, 0.044), (0.042, 0.0405)])
def test_a_receiver_that_is_too_slow_gets_what_is_young(clock, put_s, taken_s):
    """Also one that would need a minute for what waits: as soon as its pace is known."""
    channel = LatestChannel(90, sender_waits=False)
    for _ in range(60):
        clock.now_s += put_s
        channel.put(clock.now_s)
    channel.stay_short(4, 5.0)
    waited = pass_on(channel, clock, 30, put_s, taken_s)
    assert max(waited[channels.RECENT + 1 :]) < 4 * put_s + taken_s
    assert channel.skipped >= 60 - 4 - channels.RECENT
    if put_s < taken_s:
        due = 60 + 30 / put_s
        assert channel.skipped == pytest.approx(due - 30 / taken_s, abs=6)


def test_a_queue_that_does_not_become_short_in_time_is_cut(clock):
    """Whatever the median of the receiver's times promises: every third item takes long."""
    channel = LatestChannel(90, sender_waits=False)
    for _ in range(20):
        channel.put(clock.now_s)
    channel.stay_short(4, 5.0)
    waited = pass_on(channel, clock, 20, 0.042, 0.02, 0.02, 0.086)
    assert min(waited[50:100]) > 0.7
    assert max(waited[125:]) < 0.3
    assert 14 <= channel.skipped <= 20


def test_a_queue_is_cut_once_and_may_be_long_again_when_it_has_run_empty(clock):
    channel = LatestChannel(9, sender_waits=False)
    channel.stay_short(2, 5.0)
    for item in range(9):
        channel.put(item)
    clock.now_s += 5.1
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


def test_without_patience_only_the_newest_wait(clock):
    channel = LatestChannel(9, sender_waits=False)
    channel.stay_short(3, 0.0)
    for item in range(20):
        clock.now_s += 0.1
        channel.put(item)
    assert channel.skipped == 17
    assert [channel.get(0) for _ in range(3)] == [17, 18, 19]


def test_nothing_of_a_sender_who_waits_is_pushed_out(clock):
    channel = LatestChannel(3, sender_waits=True)
    channel.stay_short(1, 5.0)
    for item in range(3):
        channel.put(item)
        clock.now_s += 60
    assert [channel.get(0) for _ in range(3)] == [0, 1, 2]
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
