"""The account of frames: against a simulated camera whose every image carries the number of its
trigger.
"""

import time
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.frame_matching.delivered import Delivered
from drivers.frame_matching.frame_numbers import FrameNumbers
from drivers.frame_matching.witnesses import CountedExposures
from drivers.protocols import Frame, LostFrame, TriggerTrain

RATE, OPEN = 1000.0, 5
FATES = ("good", "good", "good", "late", "missed", "lost", "failed", "failed without id")


@dataclass
class Run:
    """One run of a camera and a board, played event by event on one time axis of samples (1 ms)."""

    fates: list
    divisor: int = 42
    first_id: int = 0
    counts: bool = True
    stamps: bool = False
    block: int = 50
    lag: int = 3
    late: int = 7
    readout: int = 8
    knows_first_id: bool = True
    answers: list = field(default_factory=list)

    def play(self):
        self.train = TriggerTrain(20, self.divisor)
        self.clock = SampleClock(RATE, 1.0)
        self.numbers = FrameNumbers(
            "camera",
            self.train,
            self.clock,
            OPEN,
            min(self.first_id, 1) if self.knows_first_id else None,
        )
        self.numbers._last_id = (self.first_id - 1 or 65535) if self.first_id > 1 else None
        self.clock.start(counts_exposures=self.counts)
        self.clock.began_s = 0.0
        self.began = []
        self.end = self.train.sample(len(self.fates)) // self.block * self.block  # the board stops
        images, frame_id = [], self.first_id
        for n, fate in enumerate(self.fates):
            at = self.train.sample(n) + (self.late if fate == "late" else 0)
            if fate == "missed" or at >= self.end:
                continue
            self.began.append(at)
            stamp = at / RATE + 1e-5 if self.stamps else None
            image = np.full((1, 1), n, np.uint16)
            if fate in ("good", "late"):
                images.append((at + OPEN + self.readout, Delivered(frame_id, stamp, image)))
            elif fate == "failed":
                images.append(
                    (at + OPEN + self.readout, Delivered(frame_id, stamp, None, "packets missing"))
                )
            elif fate == "failed without id":
                images.append(
                    (at + OPEN + self.readout, Delivered(None, None, None, "packets missing"))
                )
            frame_id = frame_id + 1 if frame_id < 65535 or self.first_id <= 1 else 1
        reads = [(end + self.lag, end) for end in range(self.block, self.end + 1, self.block)]
        polls = [(t, None) for t in range(0, self.end + 4000, 20)]
        for when, what in sorted(images + reads + polls, key=lambda event: event[0]):
            if isinstance(what, Delivered):
                self.numbers.arrived(what, when / RATE)
            elif what is None:
                self.numbers.nothing_came(when / RATE)
            else:
                samples = np.arange(what - self.block, what)
                self.clock.advance(
                    what,
                    np.searchsorted(self.began, samples, side="right") if self.counts else None,
                )
                if what == self.end:
                    self.clock.stop()
            while (answer := self.numbers.next(when / RATE)) is not None:
                self.answers.append(answer)
        return self

    def check(self, *, complete=True):
        """What is certain is true, what is not lies in its range, and nothing is asked twice."""
        assert [a.index for a in self.answers] == list(range(len(self.answers)))
        for answer in self.answers:
            if not isinstance(answer, Frame):
                assert answer.sample == self.train.sample(answer.index)
                continue
            truth = int(answer.image[0, 0])
            assert answer.first <= truth <= answer.last, answer
            began = self.train.sample(truth) + self.late * (self.fates[truth] == "late")
            stamp_s = began / RATE + 1e-5 if self.stamps else np.nan
            assert answer.stamp_s == pytest.approx(stamp_s, nan_ok=True)
            if answer.is_certain:
                assert answer.sample == self.sample(answer.index)
        if complete:
            exposed = [n for n, fate in enumerate(self.fates) if fate in ("good", "late")]
            assert [a.index for a in self.answers if isinstance(a, Frame)] == [
                n for n in exposed if self.sample(n) + OPEN < self.end
            ]
            assert all(a.is_certain for a in self.answers)

    def sample(self, n):
        is_late = self.counts and self.fates[n] == "late" and self.late > 1
        return self.train.sample(n) + (self.late if is_late else 0)


def reasons(run):
    return {a.index: a.reason for a in run.answers if isinstance(a, LostFrame)}


def test_an_exposure_is_on_time_within_a_sample_and_waited_for_until_the_next_trigger():
    clock, train = SampleClock(RATE), TriggerTrain(20, 100)
    counts = CountedExposures(train, clock)
    clock.start(counts_exposures=True)

    def read_to(sample):
        began = (19, 120, 221, 322)  # of triggers on 20, 120, 220, 320; none of that on 420
        at = np.arange(clock.now, sample)
        clock.advance(sample, np.searchsorted(began, at, side="right"))
        counts.update()

    read_to(518)
    assert [counts.on_time(n) for n in range(5)] == [True, True, True, False, False]
    assert [counts.has(n) for n in range(5)] == [True, True, True, True, False]
    assert not counts.is_known(4)
    read_to(519)
    assert counts.is_known(4)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_whatever_happens_what_is_certain_is_true(data):
    divisor = data.draw(st.integers(20, 300))
    run = Run(
        data.draw(st.lists(st.sampled_from(FATES), min_size=1, max_size=40)),
        divisor,
        first_id=data.draw(st.sampled_from([0, 1, 65500, 65535])),
        counts=data.draw(st.booleans()),
        stamps=data.draw(st.booleans()),
        block=data.draw(st.integers(7, 150)),
        lag=data.draw(st.integers(0, 80)),
        late=data.draw(st.integers(0, divisor - OPEN - 2)),
        readout=data.draw(st.integers(1, 60)),
    ).play()
    run.check(complete=False)
    assert len(run.answers) >= run.train.count_before(run.end - run.late - OPEN)


@pytest.mark.parametrize(("counts", "stamps"), [(True, True), (True, False), (False, True)])
def test_images_that_come_in_time_are_certain_after_any_loss(counts, stamps):
    fates = 30 * ["good"]
    for place, fate in ((4, "missed"), (8, "lost"), (12, "failed"), (15, "failed without id")):
        fates[place] = fate
    run = Run([*fates, *40 * ["good"]], 125, counts=counts, stamps=stamps, first_id=1).play()
    run.check()


def test_without_counter_and_timestamps_a_missed_trigger_leaves_uncertain_rows():
    fates = [*4 * ["good"], "missed", *60 * ["good"]]
    run = Run(fates, 125, counts=False, first_id=1).play()
    run.check(complete=False)
    frames = [a for a in run.answers if isinstance(a, Frame)]
    # an exposure by noise on the trigger line would look like that of a trigger
    assert not any(a.is_certain for a in frames)
    assert "neither a count nor a timestamp" in frames[-1].doubt


def test_a_late_exposure_does_not_pass_for_that_of_the_next_trigger():
    # 24 of 31 samples late, then one missed: the timestamps are 1.2 periods apart
    run = Run(["late", "missed", "good"], 31, counts=False, stamps=True, block=7, lag=0, late=24)
    run.readout = 1
    run.play().check(complete=False)


def test_a_missed_first_trigger_is_not_hidden_by_timestamps():
    run = Run(["missed", *60 * ["good"]], 125, counts=False, stamps=True, first_id=1).play()
    run.check(complete=False)
    assert not any(a.is_certain for a in run.answers if isinstance(a, Frame))


def test_images_slower_than_the_patience_prove_missed_triggers():
    fates = ["good", "missed", "good", "lost", "good", "failed", "missed", "good"]
    run = Run(fates, 4500, counts=False, stamps=True, first_id=1).play()
    run.check()
    run = Run(fates, 4500, counts=False, first_id=1).play()
    run.check(complete=False)
    assert [a.index for a in run.answers if isinstance(a, Frame)] == [0, 2, 4, 7]


class Uncounted(Run):
    """A run of which the board's counter misses the exposure of trigger 10."""

    def play(self):
        real = np.searchsorted
        return super().play() if real is None else self._without(real)

    def _without(self, real):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                np,
                "searchsorted",
                lambda began, *rest, **more: real(
                    [at for at in began if at != self.train.sample(10)], *rest, **more
                ),
            )
            return super().play()


@pytest.mark.parametrize("readout", [8, 70])
def test_an_exposure_that_was_not_counted_shifts_nothing(readout):
    run = Uncounted(60 * ["good"], 125, first_id=1, readout=readout).play()
    run.check()


def test_a_failed_grab_keeps_its_timestamp_and_shifts_nothing():
    fates = [*10 * ["good"], "failed", *10 * ["good"], "missed", "failed", *40 * ["good"]]
    run = Run(fates, 125, counts=False, stamps=True, first_id=1).play()
    run.check()


def test_each_loss_says_what_happened():
    run = Run(
        [
            "good",
            "missed",
            "good",
            "lost",
            "good",
            "failed",
            "good",
            "failed without id",
            "good",
            "good",
        ]
    ).play()
    run.check(complete=False)
    told = reasons(run)
    assert set(told) == {1, 3, 5, 7}
    assert "counted no exposure" in told[1]
    assert "frame ids jump to 3" in told[3]
    assert told[5] == "packets missing"
    assert "packets missing" in told[7]
    assert "proved" in run.numbers.describe()
    account = run.numbers.account
    assert (account.images, account.lost, account.missed, account.surplus) == (6, 3, 1, 0)


def test_ids_of_16_bits_go_on_with_1():
    run = Run(60 * ["good"], 125, first_id=65530).play()
    run.check()
    assert not reasons(run)


@pytest.mark.parametrize(("first_id", "size"), [(None, 1 << 16), (0, 1 << 16), (None, 1 << 32)])
def test_ids_that_use_0_go_on_with_0(first_id, size):
    numbers = FrameNumbers("camera", TriggerTrain(0, 100), SampleClock(RATE), OPEN, first_id)
    for turn in range(2):
        numbers._last_id = size - 3
        for ids, number in ((size - 2, 0), (size - 1, 1), (turn, 2 + turn), (3, 5)):
            numbers.arrived(Delivered(ids, None, np.zeros((1, 1), np.uint8)), 0.0)
            assert numbers._items[-1].number == number + 6 * turn
        numbers._seen.clear()  # as they would be by then


@pytest.mark.parametrize(("stamp_s", "steps"), [(1.1, 1), (1.2, None), (None, None)])
def test_only_timestamps_tell_whether_ids_that_began_with_0_go_on_with_1(stamp_s, steps):
    """Or whether an image with id 0 was lost."""
    numbers = FrameNumbers("camera", TriggerTrain(0, 100), SampleClock(RATE), OPEN, 0)
    numbers._last_id = 65534
    for frame_id, stamp in ((65535, stamp_s and 1.0), (1, stamp_s)):
        numbers.arrived(Delivered(frame_id, stamp, np.zeros((1, 1), np.uint8)), 0.0)
    assert numbers._items[-1].steps == steps


def test_timestamps_tell_missed_from_lost():
    run = Run(
        ["good", "missed", "good", "lost", "good", "missed", "lost", "good", "good"],
        counts=False,
        stamps=True,
    ).play()
    told = reasons(run)
    assert "1 of 1 were missed" in told[1]
    assert "frame ids jump" in told[3]
    assert "1 of 2 were missed" in told[5] == told[6]
    assert "timestamps" in run.numbers.describe()
    run.check(complete=False)


def test_the_last_image_lost_is_a_loss_after_a_wait():
    run = Run(["good", "good", "lost", "good"])
    run.fates[3] = "missed"
    run.play()
    assert "no image came in time" in reasons(run)[2]


def test_the_end_cuts_an_exposure_short():
    run = Run(["good", "good"], divisor=100, block=115).play()
    assert [a.index for a in run.answers] == [0]


@pytest.mark.parametrize(("missed", "expected"), [((), True), ((2,), False)])
def test_exposures_in_lost_samples(missed, expected):
    """Samples 90 to 350 are lost, with triggers 1 to 3: told where all of them were exposed, else
    uncertain and no shift.
    """
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start(counts_exposures=True)
    exposed = [n for n in range(6) if n not in missed]
    began = [100 * n for n in exposed]
    for k, n in enumerate(exposed):
        numbers.arrived(Delivered(k, None, np.full((1, 1), n, np.uint8)), 0.0)
    clock.advance(90, np.searchsorted(began, np.arange(90), side="right"))
    clock.advance(600, np.searchsorted(began, np.arange(350, 600), side="right"))
    numbers.nothing_came(0.0)
    numbers.nothing_came(5.0)
    answers = [numbers.next(5.0) for _ in range(6)]
    frames = [a for a in answers if isinstance(a, Frame)]
    assert all(a.first <= a.image[0, 0] <= a.last for a in frames)
    assert all(a.is_certain for a in frames) == expected
    assert len(frames) == (6 if expected else 5)


def test_a_frame_id_that_goes_back_is_a_fault_and_an_image_sent_twice_is_none():
    image = np.zeros((1, 1), np.uint8)
    numbers = FrameNumbers("camera", TriggerTrain(0, 100), SampleClock(RATE), OPEN, 0)
    numbers.arrived(Delivered(7, None, image), 0.0)
    numbers.arrived(Delivered(7, None, image), 0.0)
    assert numbers.account.surplus == 1
    with pytest.raises(DeviceFault, match="went from 7 to 6"):
        numbers.arrived(Delivered(6, None, image), 0.0)
    numbers._last_id = 100_000  # which 16 bits do not hold
    with pytest.raises(DeviceFault, match="went from 100000 to 5"):
        numbers.arrived(Delivered(5, None, image), 0.0)


def test_a_first_image_lost_is_known_only_where_the_transport_numbers_from_a_fixed_id():
    fates = ["lost", *60 * ["good"]]
    known = Run(fates, first_id=1).play()
    known.check()
    assert set(reasons(known)) == {0}
    unknown = Run(["lost", "lost", *60 * ["good"]], first_id=1, counts=False, knows_first_id=False)
    unknown.play().check(complete=False)
    assert not any(a.is_certain for a in unknown.answers if isinstance(a, Frame))


def test_answer_waits_for_the_image_and_for_the_clock():
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start(counts_exposures=True)
    waits = []

    def fetch(wait_s):
        waits.append(wait_s)
        time.sleep(wait_s)

    with pytest.raises(
        DeviceTimeout,
        match=r"camera: trigger 0 had no answer within 0\.05 s \(it falls on sample 0",
    ):
        numbers.answer(fetch, 0.05)
    assert 0 < waits[0] <= 0.02
    assert len(waits) <= 8  # no busy loop, whatever fetch does
    numbers.arrived(Delivered(0, None, np.zeros((1, 1), np.uint8)), 0.0)
    with pytest.raises(DeviceTimeout):
        numbers.answer(fetch, 0.03)
    clock.advance(50, np.ones(50, np.int64))
    assert numbers.answer(fetch, 5.0).index == 0


def test_an_image_that_comes_after_it_was_given_up_shifts_nothing():
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start(counts_exposures=True)
    clock.advance(250, np.searchsorted([0, 100, 200], np.arange(250), side="right"))
    numbers.nothing_came(0.0)
    numbers.nothing_came(5.0)
    assert [type(numbers.next(0.0)) for _ in range(3)] == 3 * [LostFrame]
    for n in range(4):
        numbers.arrived(Delivered(n, None, np.full((1, 1), n, np.uint8)), 0.0)
    clock.advance(350, np.searchsorted([0, 100, 200, 300], np.arange(250, 350), side="right"))
    assert numbers.next(0.0).image[0, 0] == 3
    assert numbers.next(0.0) is None
    assert not numbers._items


def test_an_image_after_triggers_that_had_none_is_uncertain_where_it_may_be_anyones():
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start()
    clock.advance(1000)
    numbers.nothing_came(0.0)
    numbers.nothing_came(5.0)
    assert [numbers.next(5.0).index for _ in range(10)] == list(range(10))
    clock.advance(1050)
    numbers.arrived(Delivered(0, None, np.zeros((1, 1), np.uint8)), 5.0)
    frame = numbers.next(5.0)
    assert (frame.index, frame.first) == (10, 0)
    assert frame.last >= 10


def test_a_broken_exposure_wire_is_told_by_name_and_holds_nothing_up():
    run = Run(60 * ["good"], 125)
    run.counts = True
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "searchsorted", lambda began, at, side: np.zeros(len(at), np.int64))
        run.play()
    run.check(complete=False)
    frames = [a for a in run.answers if isinstance(a, Frame)]
    assert [a.index for a in frames] == list(range(60))
    assert frames[0].is_certain
    assert not frames[-1].is_certain  # without a wire an exposure by noise would pass unseen
    told = [a.index for a in run.answers if "exposure wire" in a.doubt]
    assert told[0] <= 20
    assert told == list(range(told[0], 60))
    assert "inferred" in run.numbers.describe()
