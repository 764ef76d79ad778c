"""The account of frames: against a simulated camera whose every image carries the number of its
trigger.
"""

import time
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.frame_numbers import Delivered, FrameNumbers
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
        assert [a.index for a in self.answers] == list(range(len(self.answers)))
        if complete:
            exposed = [n for n, fate in enumerate(self.fates) if fate in ("good", "late")]
            assert [
                a.index for a in self.answers if isinstance(a, Frame) and a.sample < self.end
            ] == [n for n in exposed if self.sample(n) < self.end]
        for answer in self.answers:
            if isinstance(answer, Frame):
                assert answer.image[0, 0] == answer.index
                assert answer.sample == self.sample(answer.index)
            else:
                assert answer.sample == self.train.sample(answer.index)

    def sample(self, n):
        is_late = self.counts and self.fates[n] == "late" and self.late > 1
        return self.train.sample(n) + (self.late if is_late else 0)


def ends_in_fault(run):
    """Plays; whether frames could not be numbered any more, which tells to wire a counter."""
    try:
        run.play()
    except DeviceFault as fault:
        return "counter" in str(fault) or pytest.fail(str(fault))
    return False


def reasons(run):
    return {a.index: a.reason for a in run.answers if isinstance(a, LostFrame)}


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_counted_exposures_find_every_trigger_at_its_true_index(data):
    divisor = data.draw(st.integers(20, 300))
    run = Run(
        data.draw(st.lists(st.sampled_from(FATES), min_size=1, max_size=40)),
        divisor,
        first_id=data.draw(st.sampled_from([0, 1, 65500, 65535])),
        block=data.draw(st.integers(7, 150)),
        lag=data.draw(st.integers(0, 80)),
        late=data.draw(st.integers(0, divisor - OPEN - 2)),
        readout=data.draw(st.integers(1, 60)),
    ).play()
    run.check()
    assert len(run.answers) >= run.train.count_before(run.end - run.late - OPEN)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_timestamps_find_missed_triggers(data):
    divisor = data.draw(st.integers(20, 300))
    fates = ["good", *data.draw(st.lists(st.sampled_from(FATES), max_size=40)), "good"]
    run = Run(
        fates,
        divisor,
        first_id=data.draw(st.sampled_from([0, 1, 65500])),
        counts=False,
        stamps=True,
        late=data.draw(st.integers(0, divisor // 2 - 1)),
        readout=data.draw(st.integers(1, divisor)),
        lag=data.draw(st.integers(0, 80)),
    )
    fault = ends_in_fault(run)  # more than 2 s without an image, and the first image not certain
    run.check(complete=not fault)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_inferred_from_frame_ids_alone_a_loss_is_never_a_shift(data):
    run = Run(
        [
            *data.draw(
                st.lists(
                    st.sampled_from(["good", "lost", "failed", "failed without id"]), max_size=40
                )
            ),
            "good",
        ],
        data.draw(st.integers(20, 300)),
        first_id=data.draw(st.sampled_from([0, 1, 65500])),
        counts=False,
        lag=data.draw(st.integers(0, 80)),
    )
    fault = ends_in_fault(run)  # more than 1 s without an image
    run.check(complete=not fault)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sampled_from(["good", "missed", "lost", "failed"]), min_size=1, max_size=12),
    st.integers(1200, 5000),
    st.booleans(),
)
def test_inferred_from_slow_images_finds_missed_triggers(fates, divisor, stamps):
    run = Run(fates, divisor, counts=False, stamps=stamps, first_id=1).play()
    run.check()
    assert len(run.answers) == len(fates)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from(["good", "missed"]), min_size=2, max_size=60), st.integers(20, 900))
def test_inferred_from_fast_images_a_missed_trigger_is_a_fault_and_never_silent(fates, divisor):
    run = Run(fates, divisor, counts=False, first_id=1)
    if not ends_in_fault(run):
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
    run.check()
    told = reasons(run)
    assert set(told) == {1, 3, 5, 7}
    assert "counted no exposure" in told[1]
    assert "frame ids jump to 3" in told[3]
    assert told[5] == "packets missing"
    assert "packets missing" in told[7]
    assert run.numbers.way == "proved"


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
    assert run.numbers.way == "timed"


def test_the_last_image_lost_is_a_loss_after_a_wait():
    run = Run(["good", "good", "lost", "good"])
    run.fates[3] = "missed"
    run.play()
    assert "no image came in time" in reasons(run)[2]


def test_the_end_cuts_an_exposure_short():
    run = Run(["good", "good"], divisor=100, block=115).play()
    assert [a.index for a in run.answers] == [0]


def test_two_exposures_of_one_trigger_are_a_fault():
    clock = SampleClock(RATE)
    numbers = FrameNumbers("camera", TriggerTrain(0, 100), clock, OPEN, 0)
    clock.start(counts_exposures=True)
    clock.advance(60, np.searchsorted([0, 40], np.arange(60), side="right"))
    numbers.arrived(Delivered(0, None, np.zeros((1, 1), np.uint8)), 0.0)
    assert isinstance(numbers.next(0.0), Frame)
    with pytest.raises(
        DeviceFault,
        match=r"camera: frames can not be numbered: exposure 1 began on sample 40.*noise",
    ):
        numbers.next(0.0)


@pytest.mark.parametrize(("missed", "expected"), [((), "FFFFFF"), ((2,), "FLLLFF")])
def test_exposures_in_lost_samples(missed, expected):
    """Samples 90 to 350 are lost, with triggers 1 to 3: told where all of them were exposed, else
    three losses and no shift.
    """
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start(counts_exposures=True)
    exposed = [n for n in range(6) if n not in missed]
    began = [100 * n for n in exposed]
    for k, n in enumerate(exposed):
        numbers.arrived(Delivered(k, None, np.full((1, 1), n, np.uint8)), 0.0)
    clock.advance(90, np.searchsorted(began, np.arange(90), side="right"))
    clock.advance(350)
    clock.advance(600, np.searchsorted(began, np.arange(350, 600), side="right"))
    answers = [numbers.next(0.0) for _ in range(6)]
    assert "".join(type(a).__name__[0] for a in answers) == expected
    assert all(
        a.image[0, 0] == a.index and a.sample == 100 * a.index
        for a in answers
        if isinstance(a, Frame)
    )
    assert all("samples were lost" in a.reason for a in answers if isinstance(a, LostFrame))


def test_a_frame_id_that_goes_back_and_an_image_without_one_are_faults():
    image = np.zeros((1, 1), np.uint8)
    numbers = FrameNumbers("camera", TriggerTrain(0, 100), SampleClock(RATE), OPEN, 0)
    numbers.arrived(Delivered(7, None, image), 0.0)
    with pytest.raises(DeviceFault, match="went from 7 to 6"):
        numbers.arrived(Delivered(6, None, image), 0.0)
    with pytest.raises(DeviceFault, match="without a frame id"):
        numbers.arrived(Delivered(None, None, image), 0.0)


def test_a_first_image_lost_is_known_only_where_the_transport_numbers_from_a_fixed_id():
    fates = ["lost", "good", "good"]
    known = Run(fates, first_id=1).play()
    known.check()
    assert set(reasons(known)) == {0}
    assert ends_in_fault(Run(fates, first_id=1, knows_first_id=False))


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
    assert not numbers._waiting


def test_an_image_after_triggers_that_had_none_is_a_fault_where_it_may_be_anyones():
    clock, train = SampleClock(RATE), TriggerTrain(0, 100)
    numbers = FrameNumbers("camera", train, clock, OPEN, 0)
    clock.start()
    clock.advance(1000)
    numbers.nothing_came(0.0)
    numbers.nothing_came(5.0)
    assert [numbers.next(0.0).index for _ in range(10)] == list(range(10))
    with pytest.raises(
        DeviceFault,
        match=(
            r"an image came after trigger 9 had none, and it is unknown whether it"
            r" is that of trigger 10; wire .* counter"
        ),
    ):
        numbers.arrived(Delivered(0, None, np.zeros((1, 1), np.uint8)), 0.0)
