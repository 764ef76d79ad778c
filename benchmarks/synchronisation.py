"""Which trigger an image belongs to, in a world of faults: a board, a camera and the way between
them in virtual time, with missed triggers, uncounted exposures, glitches that are counted, failed
grabs, images lost, late or sent twice, jumps of the camera's clock, lost samples, the first and the
last of each, with clocks that drift by 100 ppm, ids that wrap at 16 bit or are missing, timestamps
with jitter, and delays up to what the camera's buffers hold. The world knows which trigger took
each image; the program under test sees only counts, ids, timestamps and times of arrival.

    python -m benchmarks synchronisation [RUNS]

Two faults that hide each other exactly can be seen by no witness and are not played: a glitch that
is counted within the sample of a missed trigger where there are no timestamps, and a transport that
becomes slower by a whole period, for good, at the very image of another fault.
"""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from benchmarks.report import Report
from drivers.clock import SampleClock
from drivers.delivered import Delivered
from drivers.errors import DeviceFault
from drivers.frame_numbers import FrameNumbers
from drivers.protocols import Frame, LostFrame, TriggerTrain

SUBJECT = "Synchronisation"
RATE = 1000.0
PPM = 1e-4
MODES = ("count and timestamps", "count", "timestamps", "neither")
FAULTS = (
    *("missed trigger", "uncounted exposure", "counted glitch", "late exposure", "failed grab"),
    *("failed without id", "lost image", "late images", "sent twice", "clock jump", "lost samples"),
)
OUTCOMES = ("certain and right", "uncertain", "lost", "CERTAIN AND WRONG", "outside its range")
BUFFER_S = 2.0


@dataclass
class World:
    """One run: what the board, the camera and the way between them do, and when (seconds of the
    wall clock from the call that starts the board).
    """

    seed: int
    mode: str
    faults: list[tuple[str, int]] = field(default_factory=list)
    truth: list[tuple[float, Delivered]] = field(default_factory=list)
    reads: list[tuple[float, int, np.ndarray | None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        draw = random.Random(f"{self.seed} {self.mode}")
        self.divisor = draw.choice((42, 42, 80, 125, 125, 250, 600, 2600))
        seconds = draw.uniform(3.0, 9.0) if self.divisor < 2000 else 26.0
        self.open = draw.randint(2, min(20, self.divisor // 3))
        self.train = TriggerTrain(draw.choice((0, 20)), self.divisor)
        self.triggers = max(3, int(seconds * RATE / self.divisor))
        self.end = self.train.sample(self.triggers - 1) + draw.randint(self.open, self.divisor - 1)
        self.rate = RATE * (1 + draw.uniform(-PPM, PPM))
        self.start_s = draw.uniform(0.0, 0.02)
        for _ in range(draw.choice((0, 1, 1, 2, 2, 3, 4))):
            where = draw.choice((0, self.triggers - 1, *6 * (draw.randrange(self.triggers),)))
            self.faults.append((draw.choice(FAULTS), where))
        self._expose(draw)
        self._read(draw)

    def at(self, sample: float) -> float:
        """When a sample is taken, in seconds of the wall clock."""
        return self.start_s + sample / self.rate

    def has(self, fault: str, n: int) -> bool:
        """Whether that fault happens at trigger `n`."""
        return (fault, n) in self.faults

    def _expose(self, draw: random.Random) -> None:
        first = draw.choice((0, 1, 1, 1, 65520))
        self.knows_first = first < 2 and draw.random() < 0.9
        self.first_id = first if self.knows_first else None
        if first > 2:  # so that the ids wrap within the run
            self.first_id = first
        nameless = draw.random() < 0.1
        base_s = draw.choice((*4 * (draw.uniform(0.003, 0.03),), draw.uniform(0.02, 0.5), 1.8))
        jitter_s = draw.choice((0.001, 0.005, 0.02))
        stamp0, ticks = draw.uniform(1, 1e6), draw.choice((1e-9, 8e-9, 1e-3))
        camera_rate = 1 + draw.uniform(-PPM, PPM)
        delays = {}
        for fault, n in self.faults:
            if fault == "late images":
                for m in range(n, n + draw.randint(1, max(1, int(1500 / self.divisor)))):
                    delays[m] = draw.uniform(0.05, 1.5)
        self.counted: list[int] = []
        images, number = [], first
        for n in range(self.triggers):
            if self.has("clock jump", n):
                jump = draw.choice((draw.uniform(-5, 5), draw.randint(-9, 9) * self.divisor / RATE))
                stamp0 += jump
            if self.has("counted glitch", n):
                after = draw.randint(2, self.divisor - 3)
                self.counted.append(self.train.sample(n) + after)
            if self.has("missed trigger", n):
                continue
            late = draw.randint(2, max(2, self.divisor // 4)) if self.has("late exposure", n) else 0
            began = self.train.sample(n) + late
            if not self.has("uncounted exposure", n):
                self.counted.append(began + draw.randint(0, 1))
            ended_s = self.at(began + self.open + draw.uniform(-0.5, 0.5))
            delay_s = min(base_s + delays.get(n, 0.0), BUFFER_S - 0.1) + draw.uniform(0, jitter_s)
            stamp = stamp0 + self.at(began + draw.uniform(0, 0.3)) * camera_rate
            stamp = round(stamp / ticks) * ticks if "timestamps" in self.mode else None
            frame_id = None if nameless else number
            number = number + 1 if number < 65535 else 1
            if self.has("lost image", n):
                continue
            picture = np.full((1, 1), n, np.uint16)
            made = Delivered(frame_id, stamp, picture)
            if self.has("failed grab", n):
                made = Delivered(frame_id, stamp, None, "packets missing")
            if self.has("failed without id", n):
                made = Delivered(None, None, None, "packets missing")
            came_s = max(ended_s + delay_s, images[-1][0] if images else 0.0)
            images.append((came_s, made))
            if self.has("sent twice", n):
                images.append((came_s + draw.choice((0.0, 0.001)), made))
        self.truth = images

    def _read(self, draw: random.Random) -> None:
        counted = np.sort(self.counted)
        block, lag_s = draw.choice((10, 50, 100)), draw.choice((0.002, 0.03, 0.2))
        lost = {self.train.sample(n) // block for f, n in self.faults if f == "lost samples"}
        when = 0.0
        for full in range(block, self.end + block, block):
            end = min(full, self.end)
            when = max(when, self.at(end) + draw.uniform(0.0005, lag_s))
            if (end - 1) // block in lost and end < self.end and "count" in self.mode:
                continue
            first = max(0, (end - 1) // block * block)
            samples = np.arange(first, end)
            self.reads.append((when, end, np.searchsorted(counted, samples, side="right")))

    def play(self, kind: type[FrameNumbers] = FrameNumbers) -> list[Frame | LostFrame]:
        """What the program under test answers."""
        clock = SampleClock(RATE, 1.0)
        numbers = kind("camera", self.train, clock, self.open, self.first_id)
        clock.start(counts_exposures="count" in self.mode)
        clock.began_s = 0.0
        last_s = max([when for when, *_ in self.reads] + [when for when, _ in self.truth])
        polls = [(0.02 * n, None) for n in range(int((last_s + 3 * BUFFER_S) / 0.02))]
        reads = [(when, (end, counts)) for when, end, counts in self.reads]
        answers: list[Frame | LostFrame] = []
        for when, what in sorted([*self.truth, *reads, *polls], key=lambda event: event[0]):
            if isinstance(what, Delivered):
                numbers.arrived(what, when)
            elif what is None:
                numbers.nothing_came(when)
            else:
                end, counts = what
                clock.advance(end, counts if clock.counts_exposures else None)
                if end == self.end:
                    clock.stop()
            while len(answers) < self.triggers and (answer := numbers.next(when)) is not None:
                answers.append(answer)
        return answers


def outcomes(answers: list[Frame | LostFrame]) -> Counter[str]:
    """How many answers are what."""
    found: Counter[str] = Counter()
    for answer in answers:
        if isinstance(answer, LostFrame):
            found["lost"] += 1
            continue
        truth = int(answer.image[0, 0])
        if answer.is_certain:
            found["certain and right" if truth == answer.index else "CERTAIN AND WRONG"] += 1
        else:
            inside = answer.first <= truth <= answer.last
            found["uncertain" if inside else "outside its range"] += 1
    return found


def measure(report: Report, runs: int = 10_000) -> None:
    """Play the runs, in turn in each of the four modes, and account for every trigger."""
    total = {mode: Counter[str]() for mode in MODES}
    for seed in range(runs):
        mode = MODES[seed % len(MODES)]
        world = World(seed, mode)
        found = total[mode]
        found["runs"] += 1
        found["runs without a fault"] += not world.faults
        try:
            found += outcomes(world.play())
        except DeviceFault:
            found["runs ended as faulty"] += 1
    for mode in MODES:
        for name in ("runs", "runs without a fault", "runs ended as faulty", *OUTCOMES):
            is_bound = name in OUTCOMES[3:]
            report.add(name, total[mode][name], at_most=0 if is_bound else None, column=mode)
