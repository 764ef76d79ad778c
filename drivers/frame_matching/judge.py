"""What the witnesses of an image say together: on which trigger it was exposed, as far as it is
certain, and whom a doubt is settled by.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from operator import attrgetter
from statistics import median

from drivers.clock import SampleClock
from drivers.frame_matching.delivered import Doubt, Item
from drivers.frame_matching.verdict import NOWHERE, Verdict
from drivers.frame_matching.witnesses import Causality, CountedExposures, Delays, Stamps
from drivers.protocols import TriggerTrain

_PROMPT = 3  # images in time that confirm a verdict
_STEADY = 8
_AGREEING = 4  # images whose delay confirms the timestamps against the count
_FAR = 0.5  # periods between the delays of images that are one period apart
_CONFIRMED = 0.75  # of the patience, then a witness that speaks alone is believed
_Choice = Callable[[Verdict], int | None]  # of what was said of an image
_by_count: _Choice = attrgetter("counted")
_by_stamps: _Choice = attrgetter("stamped")
_UNCONFIRMED = "the time at which it came does not confirm the timestamps"
_WIRE = (
    "exposure wire: images come, but the board counts no exposures; check the wire from the"
    " camera's exposure output to the counter"
)


def _as_agreed(verdict: Verdict) -> int | None:
    is_told = verdict.agreed in (verdict.counted, verdict.stamped)
    return verdict.agreed if is_told else None


def _apart(verdict: Verdict) -> tuple[int | None, int | None]:
    """What each witness says beyond what they agree on."""
    counted, stamped = verdict.counted, verdict.stamped
    return (
        None if counted is None else counted - verdict.agreed,
        None if stamped is None else stamped - verdict.agreed,
    )


class Judge:
    """Gives each image of one run its verdict, in the order of the images.

    What the witnesses agree on is certain. Where they differ, or one speaks alone, a doubt opens;
    an image that comes early enough, or enough images in time, end it, for those that wait as well.

    Parameters
    ----------
    train : TriggerTrain
    clock : SampleClock
    exposure_samples : int
    waiting : deque of Item
        Images that wait for an answer, the oldest first; those that were judged keep their verdict.
    notes : set of str
        Takes what the operator must know of the witnesses.
    knows_first : bool
        Whether the first id tells how many exposures were before the first image.

    Attributes
    ----------
    counts, stamps, causality
        The witnesses.
    verdict : Verdict
        On the newest image that was judged.
    may_repeat : int
        Images that may have come before.
    is_noisy : bool
        Whether ids and triggers contradict each other.
    """

    def __init__(
        self,
        train: TriggerTrain,
        clock: SampleClock,
        exposure_samples: int,
        waiting: deque[Item],
        notes: set[str],
        knows_first: bool,
    ) -> None:
        self._train, self._clock, self._open = train, clock, exposure_samples
        self._waiting, self._notes = waiting, notes
        self.counts = CountedExposures(train, clock)
        self.stamps = Stamps(train, clock.sample_rate_hz)
        self.causality = Causality(train, clock, exposure_samples)
        self._patience = self.causality.patience_s * clock.sample_rate_hz  # samples
        self.verdict = Verdict()
        self.may_repeat = 0
        self.is_noisy = False
        self._judged = -1  # number of the newest image that was judged
        self._last_s = 0.0  # timestamp of that image, if it has one
        self._named_low = (0, -1)  # least offset and number of the last with an id
        self._extras_to = -1  # extra counts have been taken up to this trigger
        self._uncounted = 0  # images since the last counted exposure
        # the most that could be missed before the newest images: it varies with their delay
        self._highs: deque[int] = deque(maxlen=_STEADY)
        self._ever_prompt = False  # whether an image came before the next one was exposed
        self._delays = Delays(train.divisor)
        self._doubt: Doubt | None = None
        self._newest = -1  # trigger of the newest image that is certain
        self._off = 0  # exposures up to it by the camera's numbers, less those that were counted
        self._confirmed_off = (
            0  # those of them that timestamps tell, or the first id if it is not defined
        )
        self._suspect: int | None = None  # the first trigger of a doubt that one witness has ended
        self._knows_first = knows_first
        # number, triggers missed before, timestamp: of the last image with a timestamp that tells
        self._stamped: tuple[int, int, float] | None = None

    def judge(self, item: Item, settled: int) -> bool:
        """Give an image its verdict, unless the board's samples that tell have not been read;
        whether it has one. Images exposed before sample `settled` have had time enough to arrive.
        """
        before, doubtful, likely = self.verdict, 0, 0
        counted: int | None = None
        start = before.high + self._judged
        follows = self._clock.counts_exposures and (before.by_rule or before.is_certain)
        if follows and item.steps is not None:
            limit = max(item.limit + item.number, start + item.steps)
            found = self.counts.missed(start, item.steps, limit)
            if found is None and not self.is_wire_dead():
                return False
            if found:
                counted, doubtful = found
                again = self.counts.missed(before.best + self._judged, item.steps, limit)
                likely = again[0] if again else counted
        self._watch_wire(counted is not None or item.steps is None)
        read = self._train.count_before(self._clock.now) - 1  # the trigger whose period is read
        end = min(item.limit + item.number + 1, read)
        if counted is not None:
            end = start + item.steps + counted if item.steps else start
        extras = sum(self.counts.extra(n) for n in range(max(0, self._extras_to), end))
        self._extras_to = max(self._extras_to, end)
        has_stamp = bool(item.delivered.timestamp_s)
        is_off = item.missed is None and has_stamp and item.number > 0
        may_be_noise = is_off and (counted is None or self._is_unexplained(item, before, likely))
        extras = max(extras, int(may_be_noise))
        if item.steps is None:
            verdict = before.with_step(None, 0, 0, None, 0)
            if item.delivered.frame_id is None:  # it may be one that came before
                verdict.low, verdict.extras = verdict.low - 1, verdict.extras + 1
                self.may_repeat += 1
            verdict.why = "the number of images that were lost before it is not known"
        else:
            verdict = before.with_step(counted, doubtful, likely, item.missed, extras)
        counts = self.does_count()
        is_alone = not counts and not has_stamp
        by_delay = self._is_unconfirmed(item, before, verdict, counts=counts)
        if by_delay:
            verdict.low, verdict.why = before.low, _UNCONFIRMED
            verdict.high = verdict.high if counts else item.limit
        verdict.is_blind = not counts and (may_be_noise or not has_stamp)
        if is_alone:  # anything may have come that is not by far too old
            oldest = settled - self._open - round(self._patience)
            verdict.low = self._train.count_before(oldest) - item.number
        if self._doubt is not None and extras:  # it may belong to an image that is held
            for other in self._waiting:
                if other.verdict is not None and not other.verdict.is_certain:
                    other.verdict.low -= extras
        verdict.counted = self._by_count(item, before, start, counted)
        verdict.stamped = self._by_stamp(item)
        is_new = verdict.stamped is None and item.missed is not None
        if is_new and self._doubt is not None and self._stamped is not None:
            self._doubt.regular += 1
            is_jump = self._doubt.regular >= _PROMPT and self._doubt.times == 1
            if not counts and is_jump:  # of the camera's clock
                verdict.low = max(verdict.low, verdict.agreed)
        if counted is not None and self.counts.is_inferred(start + (item.steps or 0) + counted):
            verdict.is_blind = verdict.stamped is None
        if item.named and not is_alone:
            low, number = self._named_low
            verdict.low = max(verdict.low, low + number + item.named - extras - item.number)
            verdict.high = max(verdict.low, verdict.high)
        verdict.low = max(verdict.low, min(item.least - item.number, item.limit))
        verdict.high = max(verdict.low, verdict.high)
        self._bound(item, verdict)
        if item.delivered.frame_id is not None:
            self._named_low = (verdict.low, item.number)
        item.verdict = verdict
        self._resolve(item, before, verdict, by_delay=by_delay)
        self.verdict, self._judged = verdict, item.number
        self._last_s = item.delivered.timestamp_s or 0.0
        return True

    def _by_count(self, item: Item, before: Verdict, start: int, counted: int | None) -> int | None:
        """How many triggers were missed before an image by the board's count alone, an extra count
        being taken for a glitch.
        """
        if item.steps is None or before.counted is None or not self._clock.counts_exposures:
            return None
        begun = before.counted + self._judged
        if begun != start or counted is None:
            limit = max(item.limit + item.number, begun + item.steps)
            found = self.counts.missed(begun, item.steps, limit)
            if not found:
                return None
            counted = found[0]
        if not item.delivered.timestamp_s and any(
            self.counts.is_inferred(n) for n in range(begun + 1, begun + item.steps + counted + 1)
        ):
            return None
        return before.counted + counted

    def _is_unconfirmed(
        self, item: Item, before: Verdict, verdict: Verdict, *, counts: bool
    ) -> bool:
        """Whether two faults may have made what the witnesses say, so that the delay must tell: a
        miss that both of them tell, or, with timestamps alone, that none was, unless the image has
        the next id and the delay was known.
        """
        if not (before.is_certain and verdict.is_certain) or item.missed is None:
            return False
        if self._clock.pace is None:
            return False
        if counts:
            return item.missed > 0
        is_next = item.delivered.frame_id is not None and item.steps == 1
        is_known = self._delays.is_known(item.came_s)
        return item.limit > verdict.high and not (is_next and is_known)

    def _is_unexplained(self, item: Item, before: Verdict, likely: int) -> bool:
        """Whether no exposure that was counted late tells why a timestamp is off the triggers."""
        if not self._last_s:
            return False
        first = before.best + self._judged
        last = first + (item.steps or 0) + likely
        if self.counts.on_time(first) and self.counts.on_time(last):
            return False  # the camera's clock has jumped
        apart = self.counts.began(last) - self.counts.began(first)
        mirrored = (2 * (last - first) - 1) * self._train.divisor - apart  # of noise, not counted
        stamps_s = self._last_s, item.delivered.timestamp_s or 0.0
        is_told = self.stamps.are_apart(*stamps_s, apart)
        return not is_told or self.stamps.are_apart(*stamps_s, mirrored)

    def _by_stamp(self, item: Item) -> int | None:
        """How many triggers were missed before an image by the timestamps alone."""
        stamp_s = item.delivered.timestamp_s
        if self._stamped is None or not stamp_s:
            return None
        number, missed, before_s = self._stamped
        periods = self.stamps.between(before_s, stamp_s)
        if periods is None or periods < 1:
            return None
        missed += periods - (item.number - number)
        self._stamped = item.number, missed, stamp_s
        return missed

    def _bound(self, item: Item, verdict: Verdict) -> None:
        """What causality allows: an image that comes early bounds those before it as well."""
        if item.limit < verdict.low:
            self.is_noisy = True
            self._notes.add("an image came before its trigger; check the trigger line for noise")
            verdict.low = item.limit
        if verdict.high > max(item.limit, verdict.low):
            verdict.high = max(item.limit, verdict.low)
            verdict.by_rule = verdict.high in (
                verdict.counted,
                verdict.stamped,
            )  # who stands for it
        verdict.best = min(max(verdict.best, verdict.low), verdict.high)
        if verdict.is_blind or self._doubt is None:
            return
        for earlier in self._waiting:
            if earlier is item or earlier.verdict is None:
                break
            held = earlier.verdict
            high = min(held.high, verdict.high + verdict.extras - self._doubt.extras)
            held.high = max(high, held.low)
            held.best = min(held.best, held.high)

    def _resolve(self, item: Item, before: Verdict, verdict: Verdict, *, by_delay: bool) -> None:
        """End a doubt, if the witnesses agree again, or if how late the images come, which was
        known before it arose, stands by one of them.
        """
        if (verdict.by_rule and not by_delay) or verdict.is_certain:
            self._ever_prompt |= item.limit <= verdict.high
        self._highs.append(verdict.high)
        if verdict.is_certain:
            trigger, is_noise = item.number + verdict.low, verdict.low < before.low
            verdict.settle(verdict.low)
            self._close_doubt(item, verdict, is_noise=is_noise)
            verdict.is_blind = is_noise and trigger > self._newest  # whose image may have been lost
            return
        if self._doubt is None:
            known = self._delays.before(item.came_s)
            since = max(0, self._judged + before.low + 1)
            self._doubt = Doubt(item.came_s, known, before.extras, since, by_delay=by_delay)
        doubt = self._doubt
        if verdict.high - verdict.low != before.high - before.low or (
            _apart(verdict) != _apart(before) and before.counted is not None
        ):  # it is another one
            doubt.since_s = item.came_s
            doubt.since.clear()
            doubt.times += 1
        if verdict.is_blind:
            return
        by_count, by_stamp = _apart(verdict)
        doubt.by_count |= bool(by_count)
        doubt.by_stamp |= bool(by_stamp)
        doubt.since.append(item.delay - (item.number + verdict.agreed) * self._train.divisor)
        chosen = self._agreed(item, verdict, doubt)
        if chosen is None:
            chosen = self._believed(item, verdict, doubt)
        if chosen is None:
            return
        for other in self._waiting:
            held = other.verdict
            if held is None or held.is_certain or held.is_blind:
                continue
            if other.came_s >= doubt.since_s:
                choice = chosen(held)
                if choice is not None:
                    held.settle(choice)
        choice = chosen(verdict)
        assert choice is not None
        verdict.settle(choice)
        self._bound(item, verdict)
        self._close_doubt(item, verdict, is_noise=False)

    def _close_doubt(self, item: Item, verdict: Verdict, *, is_noise: bool) -> None:
        """Learn from an image whose trigger is certain, unless noise has set it off."""
        trigger, is_stamped = item.number + verdict.low, verdict.stamped == verdict.low
        is_told = is_stamped or (is_noise and item.delivered.timestamp_s)
        if self._doubt and not is_told and self._suspect is None:
            self._suspect = self._doubt.trigger
        self._doubt = None
        verdict.counted = verdict.low
        if is_noise or trigger <= self._newest:  # which has its image already
            return
        begins = self._newest < 0 and not self._knows_first
        self._newest = trigger
        self._off = item.number - self.counts.triggers_before(trigger)
        if begins or (is_stamped and self._suspect is None):
            self._confirmed_off = self._off
        # extra counts after it belong to those that follow
        self._extras_to = min(self._extras_to, trigger)
        if item.delivered.timestamp_s:
            self._stamped = item.number, verdict.low, item.delivered.timestamp_s
        if self._clock.pace is not None:
            self._delays.learn(item.came_s, item.delay - trigger * self._train.divisor)

    def uncertain_from(self) -> int | None:
        """The first trigger of which nothing is certain because the account does not hold, if so.

        It holds if the camera has numbered as many exposures as the board has counted, but for
        those of which timestamps tell that they were not, or by mistake.
        """
        if not self._clock.counts_exposures or _WIRE in self._notes:
            return None
        unclear = sum(map(self.counts.is_unclear, range(self._newest)))
        if 0 <= self._off - self._confirmed_off <= unclear:
            return None
        return self._suspect or 0

    def _agreed(self, item: Item, verdict: Verdict, doubt: Doubt) -> _Choice | None:
        """Count and timestamps say the same again, as before the doubt; or the same once each extra
        count is taken for an exposure without a trigger.
        """
        missed = verdict.stamped
        if missed is None or not verdict.low <= missed <= verdict.high:
            return None
        if not self._clock.counts_exposures or verdict.counted is None:
            is_back = missed == verdict.agreed and not (doubt.by_stamp or doubt.by_count)
            return _by_stamps if is_back and self._is_confirmed(doubt, counts=False) else None
        if not self.counts.on_time(item.number + missed):
            return None
        if missed == verdict.counted == verdict.agreed:
            is_told = not (doubt.by_count and doubt.by_stamp)
            return _as_agreed if is_told and self._is_confirmed(doubt, counts=True) else None
        extras = verdict.extras - doubt.extras
        return _by_stamps if extras and missed == verdict.counted - extras else None

    def _is_confirmed(self, doubt: Doubt, *, counts: bool) -> bool:
        """Whether the delay denies the two faults that a doubt is about: with timestamps alone, an
        image has come too early for one exposed a period later; else, all came too late for those
        exposed a period earlier, or, where the delay tells nothing, enough of them came.
        """
        if not doubt.by_delay:
            return True
        rise = self._delays.rise(doubt.before, doubt.since)
        if not counts:
            return rise <= _FAR
        if self._delays.are_steady(doubt.before):
            return rise >= -_FAR
        return len(doubt.since) >= _AGREEING

    def _believed(self, item: Item, verdict: Verdict, doubt: Doubt) -> _Choice | None:
        """What one witness says and the delay of the images confirms.

        Timestamps against the count are confirmed at once; the count against timestamps is not,
        since a transport becomes slower by a period more easily than a clock jumps by one. A
        witness that speaks alone is confirmed by images of some time. Where images queue up, an
        exposure more makes later images later by a period, so that it hides in their delay.
        """
        by_delay = None if doubt.by_delay else self._delays.missed(doubt.before, doubt.since)
        if by_delay is None or not verdict.low <= verdict.agreed + by_delay <= verdict.high:
            return None
        missed, extras = verdict.agreed + by_delay, verdict.extras - doubt.extras
        counts = self._clock.counts_exposures and verdict.counted is not None
        if counts and verdict.stamped is not None:
            is_enough = len(doubt.since) >= _AGREEING
            return _by_stamps if is_enough and missed == verdict.stamped else None
        counted = verdict.counted
        waited_s = item.came_s - doubt.since_s
        if doubt.times > 1 or waited_s < _CONFIRMED * self.causality.patience_s:
            return None
        if not counts or counted is None:
            return _by_stamps if missed == verdict.stamped else None
        is_queued = median(doubt.before) > self._train.divisor / 2
        if extras:  # which image was the one too many is not known
            is_told = missed == counted - extras or (missed == counted and not is_queued)
            return (lambda held: missed if held is verdict else None) if is_told else None
        return _by_count if missed == counted else None

    def can_tell(self, *, is_first: bool) -> bool:
        """Whether images that come may end the doubt; `is_first`: on the first trigger."""
        if self._ever_prompt:
            return True
        if self._clock.pace is None:
            return False
        return is_first or (self._doubt is not None and bool(self._doubt.before))

    def chosen(self, verdict: Verdict) -> int:
        """How many triggers were missed before an image, if one answer must be given."""
        if verdict.by_rule or verdict.is_certain or verdict.stamped == verdict.best:
            return verdict.best
        if not self._ever_prompt or verdict.high >= NOWHERE:
            return verdict.low
        return max(verdict.low, min(verdict.high, *self._highs))

    def _watch_wire(self, was_counted: bool) -> None:
        self._uncounted = 0 if was_counted else self._uncounted + 1
        if self.is_wire_dead():
            self._notes.add(_WIRE)

    def does_count(self) -> bool:
        """Whether the board counts exposures, and its wire is not dead."""
        return self._clock.counts_exposures and not self.is_wire_dead()

    def is_wire_dead(self) -> bool:
        """Whether images come, but the board has counted no exposures for long."""
        silent = self._clock.now - self.counts.last
        return (
            self._clock.counts_exposures
            and len(self._waiting) + self._uncounted >= _PROMPT
            and silent > max(self._patience, 3 * self._train.divisor)
        )
