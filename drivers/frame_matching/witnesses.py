"""The three witnesses of an image: the board's count of exposures, the camera's timestamps, and
the time at which the image came: no image comes before its exposure has ended.

Each of them can fail: a count is missed or made by a glitch, the camera's clock jumps, an image is
late. None of them decides alone (`drivers.frame_matching.verdict`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from statistics import median

from drivers.clock import SampleClock
from drivers.protocols import TriggerTrain

PATIENCE_S = 2.0
"""Images, and the samples taken with them, reach the program within this time after the exposure,
or within half a trigger period if that is longer: the camera's buffers hold no more.
"""

_KNOWN = 8  # images just before a doubt
_NEEDED = 3
_RECENT_S = 10.0
JITTER = 2.0  # samples, of the start of an exposure that is not late
CLOCKS_APART = 2e-4  # by so much the camera's clock may be faster or slower than the board's


class CountedExposures:
    """Which triggers the board has counted an exposure for; on time is at most one sample off."""

    def __init__(self, train: TriggerTrain, clock: SampleClock) -> None:
        self._train, self._clock = train, clock
        self.total = self._gaps_taken = 0
        self._counted: dict[int, list[int]] = {}  # trigger -> samples of the exposures after it
        self._inferred: set[int] = set()  # in lost samples, where as many were counted as triggers
        self._unclear: set[int] = set()  # triggers in lost samples that were not all exposed
        self.last = 0  # sample of the newest count
        self._summed = 0, 0  # triggers that were summed, and those of them with a count

    def update(self) -> None:
        """Take what the clock has learned."""
        new = self._clock.exposures_from(self.total)
        self.total += len(new)
        gaps = self._clock.gaps[self._gaps_taken :]
        self._gaps_taken += len(gaps)
        for began in new:
            gap = next((gap for gap in gaps if gap[1] == began), None)
            if gap is None:
                self._counted.setdefault(self._slot(began), []).append(began)
            self.last = began
        for first, end in gaps:
            late = [began for began in new if began == end]
            slots = [
                n
                for n in range(max(0, self._slot(first - 1)), self._slot(end) + 1)
                if first - 1 <= self._train.sample(n) <= end and n not in self._counted
            ]
            if len(late) == len(slots):
                self._counted.update((n, [self._train.sample(n)]) for n in slots)
                self._inferred.update(slots)
            else:
                self._unclear.update(slots)

    def _slot(self, sample: int) -> int:
        return (sample + 1 - self._train.first) // self._train.divisor

    def before(self, n: int) -> int:
        """Exposures counted for the triggers before `n`."""
        return sum(len(counted) for slot, counted in self._counted.items() if slot < n)

    def triggers_before(self, n: int) -> int:
        """Triggers before `n` for which an exposure was counted; the next call asks for no less."""
        first, found = self._summed
        self._summed = n, found + sum(map(self.has, range(first, n)))
        return self._summed[1]

    def on_time(self, n: int) -> bool:
        """Whether the exposure of trigger `n` was counted on its sample, or the one beside it."""
        at = self._train.sample(n)
        return any(abs(began - at) <= 1 for began in self._counted.get(n, ()))

    def began(self, n: int) -> int:
        """Sample on which the exposure of trigger `n` began: that of the trigger unless it was
        counted later.
        """
        counted, at = self._counted.get(n, []), self._train.sample(n)
        return counted[0] if counted and not self.on_time(n) and counted[0] > at else at

    def has(self, n: int) -> bool:
        """Whether an exposure was counted after trigger `n` and before the next."""
        return n in self._counted

    def extra(self, n: int) -> int:
        """Counts after trigger `n` that are more than one."""
        return max(0, len(self._counted.get(n, ())) - 1)

    def is_unclear(self, n: int) -> bool:
        """Whether samples were lost there, so that nobody knows whether `n` was exposed."""
        return n in self._unclear

    def is_inferred(self, n: int) -> bool:
        """Whether samples were lost there, in which as many exposures as triggers were counted."""
        return n in self._inferred and self._clock.pace is not None

    def is_known(self, n: int) -> bool:
        """Whether the samples in which `n` could be counted have been read."""
        ended = self._clock.phase == "stopped"
        return self.has(n) or ended or self._clock.now >= self._train.sample(n + 1) - 1

    def missed(self, after: int, steps: int, limit: int) -> tuple[int, int] | tuple[()] | None:
        """How many triggers were missed up to the exposure that is `steps` counts after trigger
        `after`, and how many of the counts up to it did not come on time; None while it cannot be
        known yet, nothing if up to trigger `limit` there is none or it is not clear.
        """
        n, begun, doubtful = after, after + steps, 0
        while steps:
            n += 1
            if n > limit or n in self._unclear:
                return ()
            if not self.is_known(n):
                return None
            steps -= self.has(n)
            # only causality can tell a late exposure from a glitch
            is_late = self._clock.pace is not None and self.has(n) and not self.on_time(n)
            doubtful += is_late or self.is_inferred(n)
        return n - begun, doubtful


class Stamps:
    """The camera's own clock, whose zero and whose rare jumps are unknown.

    Of two exposures that are no whole number of periods apart one was late, by as much as nearly a
    period: nobody knows which.
    """

    def __init__(self, train: TriggerTrain, rate_hz: float) -> None:
        self._period_s, self._sample_s = train.divisor / rate_hz, 1 / rate_hz
        self.last: float | None = None

    def periods(self, stamp_s: float | None) -> int | None:
        """Trigger periods from the last stamp to this one, which becomes the last; None if it does
        not tell: there is none, or they are no whole number of periods apart.
        """
        if not stamp_s:
            return None
        last, self.last = self.last, stamp_s
        return None if last is None else self.between(last, stamp_s)

    def between(self, first_s: float, last_s: float) -> int | None:
        """Trigger periods between two stamps; None if they do not tell, as above or because they
        are so far apart that the two clocks may differ by much of a period.
        """
        periods = round((last_s - first_s) / self._period_s)
        off_s = abs(last_s - first_s - periods * self._period_s)
        drift_s = CLOCKS_APART * abs(last_s - first_s)
        allowed_s = min(JITTER * self._sample_s + drift_s, self._period_s / 4)
        return periods if off_s <= allowed_s and drift_s <= self._period_s / 4 else None

    def are_apart(self, first_s: float, last_s: float, samples: int) -> bool:
        """Whether two stamps tell of as many samples as the board has counted between."""
        off_s = abs(last_s - first_s - samples * self._sample_s)
        # either count is up to a sample late
        return off_s <= (JITTER + 1) * self._sample_s + CLOCKS_APART * abs(last_s - first_s)


class Delays:
    """How long after its trigger an image comes, which does not jump by a period at the very image
    that is in doubt.

    It tells only where the images just before the doubt, and all since, came within half a period
    of each other: a delay that scatters more, or that steps meanwhile, says nothing.
    """

    def __init__(self, divisor: int) -> None:
        self._divisor = divisor
        self._known: deque[tuple[float, float]] = deque(maxlen=_KNOWN)

    def learn(self, came_s: float, delay: float) -> None:
        """Note the delay, in samples, of an image whose trigger is certain."""
        self._known.append((came_s, delay))

    def before(self, now_s: float) -> list[float]:
        """Those of the newest images."""
        recent_s = max(_RECENT_S, 2 * PATIENCE_S)
        return [delay for came_s, delay in self._known if now_s - came_s <= recent_s]

    def is_known(self, now_s: float) -> bool:
        """Whether enough of the newest images were of a certain trigger."""
        return len(self.before(now_s)) >= _NEEDED

    def are_steady(self, delays: Sequence[float]) -> bool:
        """Whether there are enough of them, within half a period of each other."""
        return len(delays) >= _NEEDED and max(delays) - min(delays) <= self._divisor / 2

    def rise(self, before: Sequence[float], since: Sequence[float]) -> float:
        """By how many periods the least delay has risen; infinite if none was known before."""
        return (min(since) - min(before, default=-math.inf)) / self._divisor

    def missed(self, before: Sequence[float], since: Sequence[float]) -> int | None:
        """How many triggers were missed as the doubt arose, by the delays before and since, counted
        as if none was; None if they do not tell.
        """
        if not (self.are_steady(before) and self.are_steady(since)):
            return None
        by = median(since) - median(before)
        missed = round(by / self._divisor)
        least = min(since) - min(before) - missed * self._divisor
        off = max(abs(by - missed * self._divisor), abs(least))
        return missed if off <= self._divisor / 4 else None


class Causality:
    """When something can have happened at all."""

    def __init__(self, train: TriggerTrain, clock: SampleClock, exposure_samples: int) -> None:
        self._train, self._clock = train, clock
        self._open = max(0, exposure_samples - 1)  # the exposure time is no whole number of samples
        self.patience_s = max(PATIENCE_S, train.divisor / clock.sample_rate_hz / 2)

    def latest(self, now_s: float) -> int:
        """The last trigger whose image can be here at a time of the wall clock (-1: none)."""
        clock, train = self._clock, self._train
        loose = clock.now + self.patience_s * clock.sample_rate_hz
        sample = math.floor(min(loose, clock.latest(now_s)))
        return max(-1, (sample - self._open - train.first) // train.divisor)
