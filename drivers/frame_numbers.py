"""Which trigger each delivered image belongs to: one answer per trigger, in order, without a silent
shift.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from drivers.clock import SampleClock
from drivers.delivered import Account, Delivered, Item
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import Frame, LostFrame, TriggerTrain
from drivers.verdict import NOWHERE, Verdict
from drivers.witnesses import NONE, Causality, Counts, Stamps

_IDS = 65535  # after 65535 a 16-bit frame id continues with 1; 0 is not used
_BACK = 32768  # a step of this length or more is a step back
_SLICE_S = 0.02
_PROMPT = 3  # images in time that confirm a verdict
_RECENT_S = 10.0
_MISSED = "missed trigger: the board counted no exposure for it"
_WIRE = (
    "exposure wire: images come, but the board counts no exposures; check the wire from the"
    " camera's exposure output to the counter"
)


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
        self._counts = Counts(train, clock)
        self._stamps = Stamps(train, clock.sample_rate_hz)
        self._causality = Causality(train, clock, exposure_samples)
        self.account = Account()
        self._next = 0  # the trigger to be answered
        self._last_id: int | None = None
        self._seen: deque[int] = deque(maxlen=64)  # the newest ids
        self._may_repeat = 0  # images that may have come before
        self._nameless = 0  # images without an id since the last with one
        self._named_low = (0, -1)  # least offset and number of the last with one
        self._number = -1  # of the newest image
        self._items: deque[Item] = deque()
        self._complaint = ""  # about a failed grab without a frame id
        self._verdict = Verdict()  # on the newest image that was judged
        self._judged = -1  # its number
        self._extras_to = -1  # extra counts have been taken up to this trigger
        self._uncounted = 0  # images since the last counted exposure
        self._is_noisy = False  # ids and triggers contradict each other
        self._prompt_s = -1e9  # when the last image came in time
        self._ever_prompt = False
        self._claimed_s = 0.0  # when the present doubt arose
        self._was_prompt = False  # whether images came in time before it
        self._confirming = 0
        self._given: tuple[int, int] | None = None  # the doubt that was given last
        # (wall clock, sample clock) at times when no image was waiting
        self._idle: deque[tuple[float, int]] = deque()
        self._least = 0  # the first trigger that the next image can have
        self._settled = -1  # images exposed before this sample have had time enough to arrive

    @property
    def way(self) -> str:
        """How images get their trigger numbers: "proved", "timed" or "inferred"."""
        if self._clock.counts_exposures and not self._is_wire_dead():
            return "proved"
        return "inferred" if self._stamps.last is None else "timed"

    def describe(self) -> str:
        """The way, in words."""
        return {
            "proved": "frame numbers proved by counted exposures",
            "timed": "frame numbers by the camera's timestamps",
            "inferred": "frame numbers inferred from their order",
        }[self.way]

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
            The images can not be assigned to triggers.
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
        if delivered.frame_id is None and delivered.image is None:
            self._complaint = f" ({delivered.reason})"
            return
        steps, named = self._steps(delivered.frame_id)
        periods = None if steps == 0 else self._stamps.periods(delivered.timestamp_s)
        if steps == 0:
            self.account.surplus += 1  # it came twice
            return
        self._nameless += delivered.frame_id is None
        advance = steps or 1
        if delivered.frame_id is None and periods is not None:
            steps = 1 if periods > 0 else None
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
        )
        self._complaint = ""
        # samples that the board has taken may wait to be read: while it is silent, its clock stands
        newest = self._clock.now if self._clock.pace is None else self._clock.latest(now_s)
        far = max(self._clock.now, newest) + self._causality.patience_s * self._rate
        if self._train.sample(self._number - self._may_repeat) > far:
            raise DeviceFault(
                f"{self._name}: frames can not be numbered: an image came long before trigger"
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
            if item.verdict is None and not self._judge(item):
                break
        if self._train.sample(self._next) >= self._clock.now:
            return None  # its sample may never be read
        while self._items and (verdict := (item := self._items[0]).verdict) is not None:
            if self._may_wait(item, verdict, now_s):
                return None
            number = self._chosen(verdict) + item.number
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

    # ------------------------------------------------------------------ judging

    def _judge(self, item: Item) -> bool:
        """Give an image its verdict, unless the board's samples that tell have not been read."""
        before, doubtful, likely = self._verdict, 0, 0
        counted: int | None = None
        start = before.high + self._judged
        follows = self._clock.counts_exposures and (before.by_rule or before.is_certain)
        if follows and item.steps is not None:
            limit = max(item.limit + item.number, start + item.steps)
            found = self._counts.following(start, item.steps, limit)
            if found is None and not self._is_wire_dead():
                return False
            if found and found != NONE:
                counted, doubtful = found[0] - start - item.steps, found[1]
                likely = counted
                begun = before.best + self._judged
                again = self._counts.following(begun, item.steps, limit)
                if again and again != NONE:
                    likely = again[0] - begun - item.steps
        self._watch_wire(counted is not None or item.steps is None)
        extras = 0
        if counted is not None:
            end = start + item.steps + counted if item.steps else start
            extras = sum(self._counts.extra(n) for n in range(max(0, self._extras_to), end))
            self._extras_to = max(self._extras_to, end)
        if item.steps is None:
            verdict = before.with_step(None, 0, 0, None, 0)
            if item.delivered.frame_id is None:  # it may be one that came before
                verdict.low, verdict.extras = verdict.low - 1, verdict.extras + 1
                self._may_repeat += 1
            verdict.why = "the number of images that were lost before it is not known"
        else:
            verdict = before.with_step(counted, doubtful, likely, item.missed, extras)
        if item.named:
            low, number = self._named_low
            verdict.low = max(verdict.low, low + number + item.named - extras - item.number)
            verdict.high = max(verdict.low, verdict.high)
        verdict.low = max(verdict.low, min(item.least - item.number, item.limit))
        verdict.high = max(verdict.low, verdict.high)
        self._bound(item, verdict)
        if item.delivered.frame_id is not None:
            self._named_low = (verdict.low, item.number)
        self._confirm(item, before, verdict)
        item.verdict, self._verdict, self._judged = verdict, verdict, item.number
        return True

    def _bound(self, item: Item, verdict: Verdict) -> None:
        """What causality allows: an image that comes early bounds those before it as well."""
        if item.limit < verdict.low:
            self._is_noisy = True
            self._note("an image came before its trigger; check the trigger line for noise")
            verdict.low = item.limit
        if verdict.high > max(item.limit, verdict.low):
            verdict.high = max(item.limit, verdict.low)
            verdict.by_rule = False  # no witness stands for it
        verdict.best = min(max(verdict.best, verdict.low), verdict.high)
        for earlier in self._items:
            if earlier is item or earlier.verdict is None:
                break
            held = earlier.verdict
            high = min(held.high, verdict.high + verdict.extras - held.extras)
            held.high = max(high, held.low)
            held.best = min(held.best, held.high)

    def _confirm(self, item: Item, before: Verdict, verdict: Verdict) -> None:
        """Take what a witness says for certain if for `PATIENCE_S` no image has come early enough
        to disprove it although they come in time.
        """
        is_prompt = item.limit <= verdict.high and (verdict.by_rule or verdict.is_certain)
        if verdict.high > before.high or (before.is_certain and not verdict.is_certain):
            self._claimed_s, self._confirming = item.came_s, 0
            self._was_prompt = item.came_s - self._prompt_s < max(
                _RECENT_S, 4 * self._causality.patience_s
            )
        self._confirming += is_prompt
        if is_prompt:
            self._prompt_s, self._ever_prompt = item.came_s, True
        if verdict.is_certain:
            verdict.by_rule, verdict.why = True, ""
        elif (
            verdict.by_rule
            and self._was_prompt
            and self._confirming >= _PROMPT
            and item.came_s - self._claimed_s >= self._causality.patience_s
        ):
            for other in (*self._items, item):
                if other.came_s >= self._claimed_s and other.verdict is not None:
                    other.verdict.low = other.verdict.high
            verdict.low = verdict.high
            verdict.why = ""

    def _may_wait(self, item: Item, verdict: Verdict, now_s: float) -> bool:
        """Whether a proof may still come, and has not been waited for already."""
        doubt = (verdict.low, verdict.high)
        return (
            not verdict.is_certain
            and (self._ever_prompt or (self._next == 0 and self._clock.pace is not None))
            and doubt != self._given
            and now_s - item.came_s < self._causality.patience_s
        )

    def _chosen(self, verdict: Verdict) -> int:
        if verdict.by_rule or verdict.is_certain:
            return verdict.best
        return verdict.high if self._ever_prompt and verdict.high < NOWHERE else verdict.low

    def _watch_wire(self, was_counted: bool) -> None:
        self._uncounted = 0 if was_counted else self._uncounted + 1
        if self._is_wire_dead():
            self._note(_WIRE)

    def _is_wire_dead(self) -> bool:
        silent = self._clock.now - self._counts.last
        return (
            self._clock.counts_exposures
            and len(self._items) + self._uncounted >= _PROMPT
            and silent > max(self._causality.patience_s * self._rate, 3 * self._train.divisor)
        )

    def _note(self, text: str) -> None:
        self.account.notes.add(text)

    # ------------------------------------------------------------------ answering

    def _give(self, answer: Frame | LostFrame) -> Frame | LostFrame:
        account = self.account
        self._next += 1
        if isinstance(answer, Frame):
            account.images += 1
        elif answer.reason.startswith("missed"):
            account.missed += 1
        else:
            account.lost += 1
        account.uncertain += not answer.is_certain
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
            text += f"; it does not hold: the board counted {counted} exposures"
        return text

    def _answer(self, item: Item, verdict: Verdict) -> Frame | LostFrame:
        index = self._next
        first, last = self._range(item, verdict, index)
        if not verdict.is_certain:
            self._given = (verdict.low, verdict.high)
        if item.delivered.image is None:
            sample = self._train.sample(index)
            return LostFrame(index, sample, item.delivered.reason, first, last)
        doubts = [*sorted(self.account.notes), verdict.why * (first < last)]
        doubt = "; ".join(filter(None, doubts))
        return Frame(index, self._counts.began(index), item.delivered.image, first, last, doubt)

    def _range(self, item: Item, verdict: Verdict, index: int) -> tuple[int, int]:
        """The triggers that an image can belong to; two at least where nothing is certain."""
        first = min(index, max(0, verdict.low + item.number))
        last = max(index, min(verdict.high + item.number, index + _BACK))
        if first == last and self._is_noisy:
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
        if self._clock.counts_exposures and self._counts.is_unclear(index):
            reason = "samples were lost here, so that it is unknown whether the camera exposed"
        elif self._clock.counts_exposures and not self._is_wire_dead():
            reason = lost if self._counts.has(index) else _MISSED
        elif item.missed:
            gap = item.missed + (steps or 1)
            reason = f"missed trigger: by timestamps {item.missed} of {gap - 1} were missed here"
        elif steps is not None and steps > between:
            reason = lost
        else:
            reason = f"no image came of it: trigger missed, or image lost{item.complaint}"
        doubt = 0 if verdict.is_certain else verdict.high - verdict.low
        return LostFrame(
            index,
            self._train.sample(index),
            reason,
            max(0, index - doubt),
            index + min(doubt, _BACK),
        )

    def _silent(self) -> LostFrame:
        """The loss of a trigger of which nothing came in time."""
        index = self._next
        reason = f"no image came in time: trigger missed, or image lost{self._complaint}"
        if self._clock.counts_exposures and not self._counts.is_unclear(index):
            reason = _MISSED
            if self._counts.has(index):
                reason = f"no image came in time: it was exposed and lost{self._complaint}"
        doubt = 0 if self._verdict.is_certain else self._verdict.high - self._verdict.low
        first, last = max(0, index - doubt), index + min(doubt, _BACK)
        if not self._clock.counts_exposures and self._slow():
            self._least = index + 1  # later images can not belong to this trigger any more
        return LostFrame(index, self._train.sample(index), reason, first, last)

    def _slow(self) -> bool:
        return self._train.divisor / self._rate >= self._causality.patience_s

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
            step = frame_id - last if frame_id > last else (frame_id - last) % _IDS
        if not 0 < step < _BACK:
            raise DeviceFault(
                f"{self._name}: frames can not be numbered: its frame id went from {last} to"
                f" {frame_id}; check cable and camera, and start a new run"
            )
        return max(1, step - nameless), step

    def _await_clock(self, now: int, timeout_s: float) -> None:
        self._clock.wait_for(lambda: self._clock.now != now, timeout_s)
