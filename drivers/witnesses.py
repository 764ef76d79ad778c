"""The three witnesses of an image: the board's count of exposures, the camera's timestamps, and
causality, which knows no image before its exposure has ended.

Each of them can fail: a count is missed or made by a glitch, the camera's clock jumps, an image is
late. None of them decides alone (`drivers.verdict`).
"""

from __future__ import annotations

import math

from drivers.clock import SampleClock
from drivers.protocols import TriggerTrain

PATIENCE_S = 2.0
"""Images, and the samples taken with them, reach the program within this time after the exposure,
or within half a trigger period if that is longer: the camera's buffers hold no more.
"""

NONE = (-1, 0)
JITTER = 2.0  # samples, of the start of an exposure that is not late
CLOCKS_APART = 2e-4  # by so much the camera's clock may be faster or slower than the board's


class Counts:
    """Which triggers the board has counted an exposure for; on time is at most one sample off."""

    def __init__(self, train: TriggerTrain, clock: SampleClock) -> None:
        self._train, self._clock = train, clock
        self.total = self._gaps_taken = 0
        self._counted: dict[int, list[int]] = {}  # trigger -> samples of the exposures after it
        self._unclear_to = -1
        self._unclear: set[int] = set()  # triggers in lost samples that were not all exposed
        self.last = 0  # sample of the newest count

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
            else:
                self._unclear.update(slots)

    def _slot(self, sample: int) -> int:
        return (sample + 1 - self._train.first) // self._train.divisor

    def before(self, n: int) -> int:
        """Exposures counted for the triggers before `n`."""
        return sum(len(counted) for slot, counted in self._counted.items() if slot < n)

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

    def is_known(self, n: int) -> bool:
        """Whether the samples in which `n` could be counted have been read."""
        ended = self._clock.phase == "stopped"
        return self.has(n) or ended or self._clock.now >= self._train.sample(n + 1) - 1

    def following(self, after: int, steps: int, limit: int) -> tuple[int, int] | None:
        """The trigger of the exposure that is `steps` counts after trigger `after`, and how many of
        the counts up to it did not come on time; None while it can not be known yet, `NONE` if up
        to trigger `limit` there is none or it is not clear.
        """
        n, doubtful = after, 0
        while steps:
            n += 1
            if n > limit or n in self._unclear:
                return NONE
            if not self.is_known(n):
                return None
            steps -= self.has(n)
            # only causality can tell a late exposure from a glitch
            doubtful += self._clock.pace is not None and self.has(n) and not self.on_time(n)
        return n, doubtful


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
        if last is None:
            return None
        periods = round((stamp_s - last) / self._period_s)
        off_s = abs(stamp_s - last - periods * self._period_s)
        allowed_s = JITTER * self._sample_s + CLOCKS_APART * abs(stamp_s - last)
        return periods if off_s <= min(allowed_s, self._period_s / 4) else None


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
