"""Which trigger each delivered image belongs to: one answer per trigger, in order, without a silent
shift.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.frame_matching.delivered import Delivered, Item, TriggerAccount
from drivers.frame_matching.judge import Judge
from drivers.frame_matching.verdict import Verdict
from drivers.protocols import Frame, LostFrame, TriggerTrain

_SHORT, _LONG = 1 << 16, 1 << 32  # frame ids begin again here; in GigE Vision, at 1
_BACK = 32768  # a step of this length or more is a step back
_SLICE_S = 0.02
_MISSED = "missed trigger: the board counted no exposure for it"


class FrameNumbers:
    """The account of one run: takes what the camera delivers, and gives a `Frame` or `LostFrame`
    for each trigger.

    The camera numbers its images as it exposes; the witnesses tell which triggers it has missed:
    the board's count of exposures (*proved*), the camera's timestamps (*timed*), and in any case
    the time at which an image came (*inferred*). What they agree on is certain. What one of them
    says alone waits for `PATIENCE_S` at most, until an image that comes early enough disproves it,
    or enough of them come in time to confirm it; then it is given as uncertain.

    Parameters
    ----------
    name : str
        The camera, in messages.
    train : TriggerTrain
    clock : SampleClock
    exposure_samples : int
    first_id : int or None
        Frame id of the first exposure (GigE Vision 1, USB3 Vision 0); None if the transport does
        not define it: which exposure the first image shows is then told by the time alone.
    """

    def __init__(
        self,
        name: str,
        train: TriggerTrain,
        clock: SampleClock,
        exposure_samples: int,
        first_id: int | None,
    ) -> None:
        self._name, self._train, self._clock = name, train, clock
        self._rate, self._open, self._first_id = clock.sample_rate_hz, exposure_samples, first_id
        self.account = TriggerAccount()
        self._items: deque[Item] = deque()
        self._judge = Judge(
            train,
            clock,
            exposure_samples,
            self._items,
            self.account.notes,
            knows_first=first_id is not None,
        )
        self._counts, self._causality = self._judge.counts, self._judge.causality
        self.uncertain_from = self._judge.uncertain_from
        self.delivered = 0  # results that the camera's library gave, failed grabs among them
        self._next = 0  # the trigger to be answered
        self._last_id: int | None = None
        # id after the largest; None: 0 or 1, which timestamps have to tell each time
        self._begins_at = 1 if first_id else None
        self._seen: deque[int] = deque(maxlen=64)  # the newest ids
        self._nameless = 0  # images without an id since the last with one
        self._number = -1  # of the newest image
        self._complaint = ""  # about a failed grab without a frame id
        self._given: tuple[int, int] | None = None  # the doubt that was given last
        # (wall clock, sample clock) at times when no image was waiting
        self._idle: deque[tuple[float, int]] = deque()
        self._least = 0  # the first trigger that the next image can have
        self._settled = -1  # images exposed before this sample have had time enough to arrive

    def describe(self) -> str:
        """How images get their trigger numbers."""
        if self._judge.does_count():
            return "frame numbers proved by counted exposures"
        if self._judge.stamps.last is None:
            return "frame numbers inferred from their order"
        return "frame numbers by the camera's timestamps"

    def answer(
        self, fetch: Callable[[float], Delivered | None], timeout_s: float
    ) -> Frame | LostFrame:
        """The frame of the next trigger, or why it has none, within `timeout_s`.

        Parameters
        ----------
        fetch : callable
            Gives the next image, or None if none comes within the given number of seconds; may
            raise a `DeviceError`.

        Raises
        ------
        DeviceTimeout
            Nothing is known about the trigger yet.
        DeviceFault
            The images cannot be assigned to triggers.
        """
        give_up = time.monotonic() + timeout_s
        while (answer := self.next(time.monotonic())) is None:
            left = give_up - time.monotonic()
            wait = max(0.0, min(left, _SLICE_S))
            if self._items:  # an image is here that waits for its count, or for a proof
                self._await_clock(self._clock.now, wait)
                wait = 0.0
            delivered = fetch(wait)
            if delivered is not None:
                self.arrived(delivered, time.monotonic())
            else:
                self.nothing_came(time.monotonic())
                if left <= 0:
                    raise DeviceTimeout(
                        f"{self._name}: trigger {self._next} had no answer within {timeout_s:g} s"
                        f" (it falls on sample {self._train.sample(self._next)}, the clock is at"
                        f" {self._clock.now}); wait longer, or check the trigger line"
                    )
        return answer

    def arrived(self, delivered: Delivered, now_s: float) -> None:
        """Note what was delivered by this time of the wall clock, and what its witnesses say.

        Raises
        ------
        DeviceFault
            The camera has numbered its images anew, or sends them without triggers.
        """
        self.delivered += 1
        if delivered.frame_id is None and delivered.image is None:
            self._complaint = f" ({delivered.reason})"
            return
        steps, named = self._steps(delivered.frame_id)
        periods = None if steps == 0 else self._judge.stamps.periods(delivered.timestamp_s)
        if steps == 0:
            self.account.surplus += 1  # it came twice
            return
        self._nameless += delivered.frame_id is None
        advance = steps or 1
        if delivered.frame_id is None and periods is not None:
            steps = 1 if periods > 0 else None
        elif (steps, delivered.frame_id, periods) == (None, 1, 1):
            steps = 1  # ids began again with 1, and one exposure is all that has passed
        missed = None
        if periods is not None and periods >= advance and steps is not None:
            missed = periods - advance
        self._number += advance
        limit = self._causality.latest(now_s) - self._number
        item = Item(
            delivered,
            self._number,
            steps,
            named,
            missed,
            now_s,
            limit,
            self._least,
            self._complaint,
            (now_s - self._clock.began_s) * self._rate * (self._clock.pace or 1.0)
            - self._train.first,
        )
        self._complaint = ""
        # samples that the board has taken may wait to be read: while it is silent, its clock stands
        newest = self._clock.now if self._clock.pace is None else self._clock.latest(now_s)
        far = max(self._clock.now, newest) + self._causality.patience_s * self._rate
        if self._train.sample(self._number - self._judge.may_repeat) > far:
            raise DeviceFault(
                f"{self._name}: frames cannot be numbered: an image came long before trigger"
                f" {self._number}; check the trigger line for noise, and its setting"
            )
        self._items.append(item)

    def nothing_came(self, now_s: float) -> None:
        """Note that no image is waiting at this time of the wall clock: what was exposed long
        before is lost.
        """
        self._idle.append((now_s, self._clock.now))
        while self._idle and self._idle[0][0] <= now_s - self._causality.patience_s:
            self._settled = self._idle.popleft()[1]

    def next(self, now_s: float) -> Frame | LostFrame | None:
        """The next trigger's answer at this time of the wall clock; None while nothing is known
        about it, its sample has not been read, or a doubt may still be resolved.
        """
        if self._train.sample(self._next) >= self._clock.now:
            return None
        if self._clock.counts_exposures:
            self._counts.update()
        for item in self._items:
            if item.verdict is None and not self._judge.judge(item, self._settled):
                break
        while self._items and (verdict := (item := self._items[0]).verdict) is not None:
            if self._may_wait(item, verdict, now_s):
                return None
            number = self._judge.chosen(verdict) + item.number
            if verdict.high + item.number < self._next:  # given up already
                self._items.popleft()
                self.account.surplus += 1
                continue
            if number > self._next:
                return self._give(self._missing(item, verdict, number))
            self._items.popleft()
            return self._give(self._answer(item, verdict))
        if not self._items and self._counts.began(self._next) + self._open <= self._settled:
            return self._give(self._silent())
        return None

    def _may_wait(self, item: Item, verdict: Verdict, now_s: float) -> bool:
        """Whether a proof may still come, and has not been waited for already."""
        doubt = (verdict.low, verdict.high)
        return (
            not verdict.is_certain
            and not verdict.is_blind
            and self._judge.can_tell(is_first=self._next == 0)
            and doubt != self._given
            and now_s - item.came_s < self._causality.patience_s
        )

    # ------------------------------------------------------------------ answering

    def _give(self, answer: Frame | LostFrame) -> Frame | LostFrame:
        self._next += 1
        self.account.uncertain += not answer.is_certain
        return answer

    def balance(self) -> str:
        """The account of all triggers that were answered, as an equality, and what contradicts it:
        the board's count of exposures, and images too many.
        """
        a = self.account
        exposed = a.images + a.lost
        text = (
            f"account: {self._next} triggers = {exposed} exposures + {a.missed} missed; {exposed}"
            f" exposures = {a.images} images + {a.lost} lost; {a.uncertain} are uncertain"
        )
        if a.surplus:
            text += f"; {a.surplus} images more than that came"
        counted = self._counts.before(self._next)
        if self._clock.counts_exposures and counted != exposed:
            text += f"; the board counted {counted} exposures"
        if (first := self.uncertain_from()) is not None:
            text += f"; it does not hold: the trigger of every frame from {first} on is uncertain"
        return text

    def _answer(self, item: Item, verdict: Verdict) -> Frame | LostFrame:
        index = self._next
        first, last = self._range(item, verdict, index)
        if not verdict.is_certain:
            self._given = (verdict.low, verdict.high)
        if item.delivered.image is None:
            self.account.lost += 1
            sample = self._train.sample(index)
            return LostFrame(index, sample, item.delivered.reason, first, last)
        self.account.images += 1
        doubts = [*sorted(self.account.notes), verdict.why * (first < last)]
        doubt = "; ".join(filter(None, doubts))
        began, stamp_s = self._counts.began(index), item.delivered.timestamp_s or math.nan
        return Frame(index, began, item.delivered.image, first, last, stamp_s, doubt)

    def _range(self, item: Item, verdict: Verdict, index: int) -> tuple[int, int]:
        """The triggers that an image can belong to; two at least where nothing is certain."""
        first = min(index, max(0, verdict.low + item.number))
        last = max(index, min(verdict.high + item.number, index + _BACK))
        if first == last and not (verdict.is_certain and not self._judge.is_noisy):
            first, last = max(0, first - 1), last + 1
        return first, last

    def _missing(self, item: Item, verdict: Verdict, number: int) -> LostFrame:
        """The loss of a trigger before that of the next image."""
        index = self._next
        steps, between = item.steps, number - index
        lost = (
            f"lost on its way: the camera's frame ids jump to {item.delivered.frame_id}"
            f"{item.complaint}"
        )
        is_missed = False
        if self._clock.counts_exposures and self._counts.is_unclear(index):
            reason = "samples were lost here, so that it is unknown whether the camera exposed"
        elif self._judge.does_count():
            is_missed = not self._counts.has(index)
            reason = _MISSED if is_missed else lost
        elif item.missed:
            is_missed = True
            gap = item.missed + (steps or 1)
            reason = f"missed trigger: by timestamps {item.missed} of {gap - 1} were missed here"
        elif steps is not None and steps > between:
            reason = lost
        else:
            reason = f"no image came of it: trigger missed, or image lost{item.complaint}"
        return self._lost(reason, verdict, is_missed=is_missed)

    def _silent(self) -> LostFrame:
        """The loss of a trigger of which nothing came in time."""
        index = self._next
        is_missed = False
        reason = f"no image came in time: trigger missed, or image lost{self._complaint}"
        if self._clock.counts_exposures and not self._counts.is_unclear(index):
            is_missed = not self._counts.has(index)
            reason = f"no image came in time: it was exposed and lost{self._complaint}"
        is_slow = self._train.divisor / self._rate >= self._causality.patience_s
        if is_slow and not self._clock.counts_exposures:
            self._least = index + 1  # later images cannot belong to this trigger any more
        reason = _MISSED if is_missed else reason
        return self._lost(reason, self._judge.verdict, is_missed=is_missed)

    def _lost(self, reason: str, verdict: Verdict, *, is_missed: bool) -> LostFrame:
        """The loss of the next trigger, which the camera has missed or not."""
        self.account.missed += is_missed
        self.account.lost += not is_missed
        index, doubt = self._next, 0 if verdict.is_certain else verdict.high - verdict.low
        first, last = max(0, index - doubt), index + min(doubt, _BACK)
        return LostFrame(index, self._train.sample(index), reason, first, last)

    # ------------------------------------------------------------------ frame ids

    def _steps(self, frame_id: int | None) -> tuple[int | None, int]:
        """Number of exposures from the last image to this one (0: it came before, None: nobody
        knows), and from the last with an id (0: nobody knows).
        """
        if frame_id is None:
            return None, 0
        if frame_id in self._seen:
            return 0, 0
        last, self._last_id = self._last_id, frame_id
        nameless, self._nameless = self._nameless, 0
        self._seen.append(frame_id)
        if last is None:
            if self._first_id is None and frame_id != 0:
                return None, 0
            step = 1 + max(0, frame_id - (self._first_id or 0))
        else:
            if frame_id == 0:
                self._begins_at = 0
            ids = (_SHORT if last < _SHORT else _LONG) - (self._begins_at or 0)
            step = frame_id - last if frame_id > last else (frame_id - last) % ids
        if not 0 < step < _BACK:
            raise DeviceFault(
                f"{self._name}: frames cannot be numbered: its frame id went from {last} to"
                f" {frame_id}; check cable and camera, and start a new run"
            )
        if self._begins_at is None and last is not None and frame_id < last:
            return None, 0
        return max(1, step - nameless), step

    def _await_clock(self, now: int, timeout_s: float) -> None:
        self._clock.wait_for(lambda: self._clock.now != now, timeout_s)
