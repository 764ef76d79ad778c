"""Which trigger a camera image belongs to, in a world of faults, in virtual time: a board, a camera
and the way between them.

The world knows which trigger took each image; the program under test sees only counts, ids,
timestamps and times of arrival. What the world has and the program is not told: three clocks that
are up to 100 ppm apart and wander (that of the computer is slewed by 500 ppm at times), a board
that answers late, blocks of samples that are read late, and images that come 0 to 3 trigger periods
after their exposure, with a delay that steps at any image, drifts, and scatters by up to a period
and a half; through a transport that hands out one image at a time, whose queue grows or drains for
good by what happens. Faults: missed triggers, exposures that are not counted, counted glitches,
exposures by noise on the trigger line (which may take the place of the next trigger), late
exposures, failed grabs, images lost, late or sent twice, jumps of the camera's clock, lost samples.
At times two faults meet at one image on purpose: see `PAIRS`.

    python -m benchmarks synchronisation [RUNS]

One run in twenty lasts an hour. Pairs that give each witness exactly what a single fault gives are
seen by nobody, and are not arranged on purpose: a trigger missed as the camera's clock jumps back
by a period, which is an exposure that was not counted; with the count alone, noise that takes the
place of an exposure not counted, which is a late exposure; and, with one witness alone, an exposure
not counted (or a clock that jumps ahead by a period) as the transport becomes slower by a period
for good, which is a missed trigger. By chance they may happen.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from drivers.clock import SampleClock
from drivers.errors import DeviceFault
from drivers.frame_matching.delivered import Delivered
from drivers.frame_matching.frame_numbers import FrameNumbers
from drivers.protocols import Frame, LostFrame, TriggerTrain

SUBJECT = "Synchronisation"
MEASURES = ("drivers.clock", "drivers.frame_matching", "app.acquisition")
RATE = 1000.0
PPM = 1e-4
MODES = ("count and timestamps", "count", "timestamps", "neither")
FAULTS = (
    *("missed trigger", "uncounted exposure", "counted glitch", "extra exposure", "late exposure"),
    *("failed grab", "failed without id", "lost image", "late images", "sent twice"),
    *("clock jump", "lost samples"),
)
PAIRS: dict[str, tuple[tuple[str, ...], ...]] = {
    "count and timestamps": (
        ("uncounted exposure", "slower by a period"),
        ("missed trigger", "faster by a period"),
        ("missed trigger", "counted glitch"),
        ("extra exposure", "slower by a period"),
        ("uncounted exposure", "lost image"),
    ),
    "count": (
        ("missed trigger", "faster by a period"),
        ("missed trigger", "lost image"),
        ("uncounted exposure", "lost image"),
    ),
    "timestamps": (
        ("missed trigger", "faster by a period"),
        ("missed trigger", "lost image"),
        ("clock jump", "lost image"),
    ),
    "neither": (("missed trigger", "faster by a period"), ("extra exposure", "lost image")),
}
RUNS = (
    *("runs", "runs of an hour", "runs without a fault", "runs ended as faulty"),
    "uncertain in runs without a fault",
)
OUTCOMES = ("certain and right", "uncertain", "lost", "CERTAIN AND WRONG", "outside its range")
BUFFER_S = 2.0  # images, and samples, wait no longer than that
HOUR_S = 3600.0
EVERY = 20  # runs, one of which lasts an hour
AT_ONCE, WORKERS = 80, 4  # runs of a portion, and processes
NO_TRIGGER = -1


@dataclass
class Plan:
    """What a run is made of; a test may give its own instead of one that is drawn.

    `faults` are pairs of a kind and a trigger, `delay_s` the delay of a sound transport, `jitter_s`
    its scatter, `steps` (trigger, seconds) changes of the delay for good, `drift_s` its change over
    the whole run, `service_s` the least time between two images.
    """

    divisor: int
    seconds: float
    faults: list[tuple[str, int]] = field(default_factory=list)
    delay_s: float = 0.01
    jitter_s: float = 0.001
    steps: list[tuple[int, float]] = field(default_factory=list)
    drift_s: float = 0.0
    service_s: float = 0.0
    has_ids: bool = True
    knows_first: bool = True
    is_slewed: bool = False

    @property
    def is_sound(self) -> bool:
        """Whether nothing goes wrong: the delay may do what it likes."""
        return not self.faults and self.has_ids and self.knows_first


def drawn(draw: random.Random, mode: str, *, hour: bool) -> Plan:
    """A plan by chance."""
    divisor = draw.choice((42, 42, 50, 80, 125, 125, 250, 600, 2600))
    seconds = draw.uniform(3.0, 9.0) if divisor < 2000 else 26.0
    if hour:
        divisor, seconds = draw.choice((400, 600, 600, 1000, 1500, 2600)), HOUR_S
        if draw.random() < 0.1:
            divisor = draw.choice((42, 125, 125, 200, 200, 250))
    triggers, period_s = int(seconds * RATE / divisor), divisor / RATE
    longest_s = min(3 * period_s, 1.6)
    plan = Plan(divisor, seconds)
    plan.delay_s = draw.choice((draw.uniform(0.003, 0.03), draw.uniform(0.003, longest_s)))
    plan.jitter_s = draw.choice((5e-4, 2e-3, 5e-3, 0.02, 0.3 * period_s, 1.5 * period_s))
    plan.jitter_s = min(plan.jitter_s, 0.5)
    for _ in range(draw.choice((0, 0, 1, 2, 4)) * (1 + 3 * hour)):
        by_s = draw.choice((draw.uniform(-3, 3), draw.choice((-2, -1, 1, 2)))) * period_s
        plan.steps.append((draw.randrange(triggers), by_s))
    plan.drift_s = draw.choice((0.0, 0.0, draw.uniform(-longest_s, longest_s)))
    plan.service_s = draw.choice((0.0, 0.0, draw.uniform(0.3, 1.0) * period_s))
    plan.has_ids = draw.random() < 0.93
    plan.knows_first = draw.random() < 0.93
    plan.is_slewed = draw.random() < 0.2
    kinds = draw.choice((0, 1, 1, 2, 2, 3, 4)) * (1 if not hour else draw.randint(1, 8))
    for _ in range(kinds):
        where = draw.choice((0, triggers - 1, *14 * (draw.randrange(triggers),)))
        plan.faults.append((draw.choice(FAULTS), where))
    if draw.random() < 0.15:
        where = draw.randrange(1, max(2, triggers))
        for kind in draw.choice(PAIRS[mode]):
            if kind.endswith("a period"):
                plan.steps.append((where, period_s * (1 if kind.startswith("slower") else -1)))
            else:
                plan.faults.append((kind, where))
    return plan


class World:
    """One run: what the board, the camera and the way between them do, and when (seconds of the
    computer's clock from the call that starts the board).
    """

    def __init__(
        self, seed: int, mode: str, plan: Plan | None = None, *, hour: bool = False
    ) -> None:
        draw = random.Random(f"{seed} {mode}")
        self.mode = mode
        self.plan = plan or drawn(draw, mode, hour=hour)
        self.faults = self.plan.faults
        self._kinds: dict[int, set[str]] = {}
        for kind, n in self.faults:
            self._kinds.setdefault(n, set()).add(kind)
        self.divisor = self.plan.divisor
        self.open = draw.randint(2, min(20, self.divisor // 3))
        self.train = TriggerTrain(draw.choice((0, 20)), self.divisor)
        self.triggers = max(3, int(self.plan.seconds * RATE / self.divisor))
        self.end = self.train.sample(self.triggers - 1) + draw.randint(self.open, self.divisor - 1)
        self._begins_again_at = random.Random(seed).randint(0, 1)  # where ids began with 0
        self._start_clocks(draw)
        self.truth: list[tuple[float, Delivered]] = []
        self.counted: list[int] = []
        self._expose(draw)
        self._read(draw)
        self._ask(draw)

    # ------------------------------------------------------------------ clocks

    def _start_clocks(self, draw: random.Random) -> None:
        self.start_s = draw.uniform(0.0, 0.02)
        self._rate = 1 + draw.uniform(-PPM, PPM)
        self._wander = draw.uniform(0, 2e-5), draw.uniform(300.0, 3000.0), draw.uniform(0, 6.3)
        slews = draw.choice((-5e-4, 5e-4)) if self.plan.is_slewed else 0.0
        began = draw.uniform(0, self.plan.seconds)
        self._slew = slews, began, began + draw.uniform(1.0, 300.0)
        self._camera_rate = 1 + draw.uniform(-PPM, PPM)

    def at(self, sample: float) -> float:
        """When a sample is taken, in seconds of the computer's clock."""
        t = sample / RATE
        by, period_s, phase = self._wander
        swing_s = by * period_s / 2 / math.pi
        wandered = swing_s * (math.sin(2 * math.pi * t / period_s + phase) - math.sin(phase))
        slew, first, last = self._slew
        slewed = slew * (min(max(t, first), last) - first)
        return self.start_s + t / self._rate + wandered + slewed

    def has(self, kind: str, n: int) -> bool:
        """Whether that fault happens at trigger `n`."""
        return kind in self._kinds.get(n, ())

    # ------------------------------------------------------------------ camera and transport

    def _exposures(self, draw: random.Random) -> list[tuple[int, int]]:
        """Trigger and first sample of each exposure of the camera, in order."""
        busy = self.open + draw.randint(1, max(1, self.divisor // 3))  # exposure and readout
        made: list[tuple[int, int]] = []
        free = 0
        for n in range(self.triggers):
            at = self.train.sample(n)
            if self.has("late exposure", n):
                at += draw.randint(2, max(2, self.divisor // 4))
            if not self.has("missed trigger", n) and at >= free:
                made.append((n, at))
                free = at + busy
            if self.has("extra exposure", n):
                noise = self.train.sample(n) + draw.randint(
                    1, self.divisor - 5
                )  # nearer, it is the next
                if noise >= free:
                    # in the period of a missed trigger it is no other than a late exposure
                    made.append((n if self.has("missed trigger", n) else NO_TRIGGER, noise))
                    free = noise + busy
        return made

    def _expose(self, draw: random.Random) -> None:
        plan, period_s = self.plan, self.divisor / RATE
        first = draw.choice((0, 1, 1, 1, 65520))
        self.knows_first = plan.knows_first
        self.first_id = first if plan.knows_first or first > 2 else None  # ids that wrap soon
        has_stamps = "timestamps" in self.mode
        jitter, ticks = draw.choice((0.0, 0.3)), draw.choice((1e-9, 8e-9, 1e-3))
        stamp0, number = draw.uniform(1, 1e6), first
        steps = sorted(plan.steps)
        delay_s, step, hiccups, last_s = plan.delay_s, 0, 0, 0.0
        for n, began in self._exposures(draw):
            trigger = max(n, (began - self.train.first) // self.divisor)
            while step < len(steps) and steps[step][0] <= trigger:
                delay_s += steps[step][1]
                step += 1
            if n >= 0 and self.has("clock jump", n):
                by_s = draw.choice((-9, -2, -1, 1, 2, 9)) * period_s
                stamp0 += draw.choice((draw.uniform(-5, 5), by_s, -stamp0 + 1))
            if n >= 0 and self.has("late images", n):
                hiccups = draw.randint(1, max(1, int(1500 / self.divisor)))
            extra_s = draw.uniform(0.05, 1.5) if hiccups > 0 else 0.0
            hiccups -= 1
            if not (n >= 0 and self.has("uncounted exposure", n)):
                self.counted.append(began + draw.randint(0, 1))
            ended_s = self.at(began + self.open + draw.uniform(-0.5, 0.5))
            now_s = max(0.002, delay_s + plan.drift_s * began / self.end)
            came_s = ended_s + now_s + draw.uniform(0, plan.jitter_s) + extra_s
            came_s = max(came_s, last_s + plan.service_s)
            came_s = max(min(came_s, ended_s + BUFFER_S - 0.1), last_s)
            stamp = None
            if has_stamps:
                exposed = began + draw.uniform(0, jitter)
                stamp = stamp0 + exposed / RATE * self._camera_rate
                stamp = round(stamp / ticks) * ticks
            frame_id = number if plan.has_ids else None
            number = number + 1 if number < 65535 else min(first, 1) or self._begins_again_at
            kinds = self._kinds.get(n, ()) if n >= 0 else ()
            if "lost image" in kinds:
                continue
            picture: Any = n  # an image is handed on, and never looked into
            made = Delivered(frame_id, stamp, picture)
            if "failed grab" in kinds:
                made = Delivered(frame_id, stamp, None, "packets missing")
            if "failed without id" in kinds:
                made = Delivered(None, None, None, "packets missing")
            last_s = came_s
            self.truth.append((came_s, made))
            if "sent twice" in kinds:
                self.truth.append((came_s + draw.choice((0.0, 0.001)), made))
        for kind, n in self.faults:
            if kind == "counted glitch":
                self.counted.append(self.train.sample(n) + draw.randint(2, self.divisor - 3))
        self.counted.sort()

    # ------------------------------------------------------------------ board

    def _read(self, draw: random.Random) -> None:
        self.reads: list[tuple[float, tuple[int, NDArray[np.int64]]]] = []
        counted = np.array(self.counted, np.int64)
        block = draw.choice((10, 50, 100) if self.plan.seconds < 100 else (200, 500))
        lag_s = draw.choice((0.002, 0.03, 0.2))
        lost = {self.train.sample(n) // block for f, n in self.faults if f == "lost samples"}
        when, counts = 0.0, np.searchsorted(counted, np.arange(self.end), side="right")
        for first in range(0, self.end, block):
            end = min(first + block, self.end)
            when = max(when, self.at(end) + draw.uniform(0.0005, lag_s))
            if first // block in lost and end < self.end and "count" in self.mode:
                continue
            self.reads.append((when, (end, counts[first:end])))

    def _ask(self, draw: random.Random) -> None:
        """The answers of the board to how far it is: late, and at times from a board that has
        handed over nothing for a while.
        """
        self.anchors: list[tuple[float, tuple[float, int]]] = []  # answered, asked, newest sample
        every_s, lag = draw.choice((0.1, 0.3, 1.0)), draw.choice((0.0, 5.0, 20.0))
        every_s = max(every_s, self.plan.seconds / 1e4)
        asked_s, last, stands_to = 0.05, self.at(self.end), 0.0
        while asked_s < last:
            answered_s = asked_s + draw.choice((0.001, 0.001, draw.uniform(0.001, 0.1)))
            taken_s = draw.uniform(asked_s, answered_s)
            if draw.random() < 0.01:
                stands_to = asked_s + draw.uniform(0.0, 0.5)
            behind = lag * draw.random() + 300.0 * (asked_s < stands_to)
            newest = (taken_s - self.start_s) * RATE
            newest += RATE * (taken_s - self.at(newest)) - behind  # one step of Newton's method
            self.anchors.append((answered_s, (asked_s, max(0, int(newest)))))
            asked_s = answered_s + every_s

    # ------------------------------------------------------------------ the run

    def play(self, kind: type[FrameNumbers] = FrameNumbers) -> list[Frame | LostFrame]:
        """What the program under test answers."""
        clock = SampleClock(RATE, 1.0)
        self.numbers = numbers = kind("camera", self.train, clock, self.open, self.first_id)
        clock.start(counts_exposures="count" in self.mode)
        clock.began_s = 0.0
        last_s = max(self.reads[-1][0], self.truth[-1][0] if self.truth else 0.0) + 3 * BUFFER_S
        every_s = 0.02 if self.plan.seconds < 100 else 0.5
        polls = ((every_s * n, None) for n in range(int(last_s / every_s)))
        events: list[tuple[float, Any]] = [*self.truth, *self.reads, *self.anchors, *polls]
        events.sort(key=lambda event: event[0])
        answers: list[Frame | LostFrame] = []
        for when, what in events:
            if isinstance(what, Delivered):
                numbers.arrived(what, when)
            elif what is None:
                numbers.nothing_came(when)
            elif isinstance(what[0], float):
                clock.anchor(what[1], what[0], when)
                continue
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
        truth = int(answer.image)  # type: ignore[call-overload]
        if answer.is_certain:
            found["certain and right" if truth == answer.index else "CERTAIN AND WRONG"] += 1
        else:
            inside = truth == NO_TRIGGER or answer.first <= truth <= answer.last
            found["uncertain" if inside else "outside its range"] += 1
    return found


def portion(first: int, end: int) -> dict[str, Counter[str]]:
    """What came of the runs from one seed to another, by mode."""
    total = {mode: Counter[str]() for mode in MODES}
    for seed in range(first, end):
        mode = MODES[seed % len(MODES)]
        is_long = seed // len(MODES) % EVERY == 0
        world = World(seed, mode, hour=is_long)
        found = total[mode]
        found["runs"] += 1
        found["runs of an hour"] += is_long
        found["runs without a fault"] += world.plan.is_sound
        try:
            told = outcomes(world.play())
        except DeviceFault:
            found["runs ended as faulty"] += 1
            continue
        found += told
        if world.plan.is_sound:
            found["uncertain in runs without a fault"] += told["uncertain"]
        if told[OUTCOMES[3]] or told[OUTCOMES[4]]:
            print(f"run {seed}, {mode}: {dict(told)}, {world.faults}", flush=True)
    return total


def measure(report: Report, runs: int = 10_000) -> None:
    """Play the runs, in turn in each of the four modes, and account for every trigger."""
    total = {mode: Counter[str]() for mode in MODES}
    firsts = range(0, runs, AT_ONCE)
    with ProcessPoolExecutor(WORKERS) as pool:
        portions = pool.map(portion, firsts, [min(first + AT_ONCE, runs) for first in firsts])
        for number, found in enumerate(portions, 1):
            for mode in MODES:
                total[mode] += found[mode]
            if number % 10 == 0:
                wrong = sum(total[mode][OUTCOMES[3]] for mode in MODES)
                print(f"{number * AT_ONCE} runs, {wrong} frames certain and wrong", flush=True)
    for mode in MODES:
        for name in (*RUNS, *OUTCOMES):
            is_bound = name in OUTCOMES[3:] or (name == RUNS[-1] and mode == MODES[0])
            report.add(name, total[mode][name], at_most=0 if is_bound else None, column=mode)
