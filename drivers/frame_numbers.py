"""Which trigger each delivered image belongs to: one answer per trigger, in order, without a silent
shift.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import Frame, Image, LostFrame, TriggerTrain

PATIENCE_S = {"proved": 2.0, "timed": 2.0, "inferred": 1.0}
"""Images, and the samples taken with them, reach the program within this time after the exposure,
or within half a trigger period if that is longer.
"""

_IDS = 65535  # after 65535 a 16-bit frame id continues with 1; 0 is not used
_BACK = 32768  # a step of this length or more is a step back
_SLICE_S = 0.02
_REMEDY = (
    "wire the camera's exposure output to a counter of the board, which proves each frame's trigger"
)
_MISSED = "missed trigger: the board counted no exposure for it"


@dataclass(frozen=True, slots=True)
class Delivered:
    """The result of one exposure, from the camera's library.

    Attributes
    ----------
    frame_id : int or None
        The camera's own number; None if the library has lost it.
    timestamp_s : float or None
        Of the camera's clock; None if it has none.
    image : ndarray or None
        None if the grab failed, for the `reason`.
    """

    frame_id: int | None
    timestamp_s: float | None
    image: Image | None
    reason: str = ""


class FrameNumbers:
    """The account of one run: takes what the camera delivers, and gives a `Frame` or `LostFrame`
    for each trigger.

    There are three ways, and the best possible one is used. *proved*: the board counts exposures;
    each of them belongs to the last trigger before it, and the camera numbers images as it exposes.
    *timed*: gaps between the camera's timestamps are multiples of the trigger period. *inferred*:
    images come in the order of the triggers. In all three, a jump of the camera's frame ids is a
    loss. Without a counter, it is certain which trigger the camera has missed only if images come
    slowly enough to belong to a single trigger; otherwise that is a `DeviceFault`.

    Parameters
    ----------
    name : str
        The camera, in messages.
    train : TriggerTrain
    clock : SampleClock
    exposure_samples : int
    first_id : int or None
        Frame id of the first exposure (GigE Vision 1, USB3 Vision 0); None if the transport does
        not define it: that of the first image is taken.
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
        self._next = 0  # the trigger to be answered
        self._exposure = 0  # its exposure, if the board counts them
        self._last_id: int | None = None
        self._stamp: float | None = None
        self._newest = -1  # number of the newest image's exposure (proved) or of its trigger
        self._waiting: dict[int, Delivered] = {}
        self._lost: dict[int, str] = {}
        self._complaint = ""  # about a failed grab without a frame id
        self._is_certain = True  # whether all images so far have their true numbers
        self._unclear_to = -1
        # (wall clock, sample clock) at times when no image was waiting
        self._seen: deque[tuple[float, int]] = deque()
        self._settled = -1  # images exposed before this sample have had time enough to arrive

    @property
    def way(self) -> str:
        """How images get their trigger numbers: "proved", "timed" or "inferred"."""
        if self._clock.counts_exposures:
            return "proved"
        return "inferred" if self._stamp is None else "timed"

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
            The images can no longer be assigned to triggers.
        """
        give_up = time.monotonic() + timeout_s
        while (answer := self.next()) is None:
            left = give_up - time.monotonic()
            wait = max(0.0, min(left, _SLICE_S))
            if self._waiting:  # an image is here whose exposure has not been counted yet
                self._await_clock(self._clock.now, wait)
                wait = 0.0
            delivered = fetch(wait)
            if delivered is not None:
                self.arrived(delivered)
            else:
                self.nothing_came(time.monotonic())
                if left <= 0:
                    raise DeviceTimeout(
                        f"{self._name}: trigger {self._next} had no answer within {timeout_s:g} s"
                        f" (it falls on sample {self._train.sample(self._next)}, the clock is at"
                        f" {self._clock.now}); wait longer, or check the trigger line"
                    )
        return answer

    def arrived(self, delivered: Delivered) -> None:
        """Assign what was delivered to its exposure or trigger; DeviceFault if that is not
        possible.
        """
        if delivered.frame_id is None:
            if delivered.image is not None:
                raise self._fault("an image came without a frame id; check cable and camera")
            self._complaint = f" ({delivered.reason})"
            return
        before, step = self._newest, self._step(delivered.frame_id)
        number, missed = before + step, ""
        if not self._clock.counts_exposures:
            number, missed = self._trigger(step, delivered.timestamp_s)
        reason = missed or (
            f"lost on its way: the camera's frame ids jump to {delivered.frame_id}{self._complaint}"
        )
        self._lost.update((n, reason) for n in range(before + 1, number))
        self._newest, self._complaint = number, ""
        self._stamp = delivered.timestamp_s or self._stamp
        # an earlier one has been given up already
        if number >= (self._exposure if self._clock.counts_exposures else self._next):
            self._waiting[number] = delivered

    def nothing_came(self, now_s: float) -> None:
        """Note that no image is waiting at this time of the wall clock: what was exposed long
        before is lost.
        """
        patience_s = max(PATIENCE_S[self.way], self._train.divisor / self._rate / 2)
        self._seen.append((now_s, self._clock.now))
        while self._seen and self._seen[0][0] <= now_s - patience_s:
            self._settled = self._seen.popleft()[1]

    def next(self) -> Frame | LostFrame | None:
        """The next trigger's answer; None while nothing is known about it.

        Raises
        ------
        DeviceFault
            Nothing will ever be known.
        """
        index, sample = self._next, self._train.sample(self._next)
        way = self._by_exposure if self._clock.counts_exposures else self._by_order
        answer = way(index, sample)
        if answer is not None:
            self._next += 1
        return answer

    # ------------------------------------------------------------------ with a counter of exposures

    def _by_exposure(self, index: int, sample: int) -> Frame | LostFrame | None:
        if index <= self._unclear_to:
            return LostFrame(
                index,
                sample,
                "samples were lost here, so that it is unknown which of these triggers the camera"
                " missed",
            )
        k, clock, train = self._exposure, self._clock, self._train
        began = clock.exposure(k)
        if began is None:
            cut = clock.phase == "stopped" and clock.now > sample + 1
            is_missed = cut or clock.now >= sample + train.divisor
            return LostFrame(index, sample, _MISSED) if is_missed else None
        # the trigger of this exposure, which may be counted one sample early and no more
        last = (began + 1 - train.first) // train.divisor
        at_once = 1  # lost samples put several exposures on one
        while clock.exposure(k + at_once) == began:
            at_once += 1
        pending = last - index + 1
        if at_once > max(pending, 0):
            raise self._fault(
                f"exposure {k} began on sample {began}, before trigger {index} on {sample}; check"
                " the trigger line for noise"
            )
        if at_once < pending:
            if at_once == 1:
                return LostFrame(index, sample, _MISSED)
            self._unclear_to, self._exposure = last, k + at_once
            return self._by_exposure(index, sample)
        alone = at_once == 1 and (k == 0 or clock.exposure(k - 1) != began)
        answer = self._image(k, index, began if alone and began > sample + 1 else sample, began)
        self._exposure += answer is not None
        return answer

    # ------------------------------------------------------------------ without

    def _by_order(self, index: int, sample: int) -> Frame | LostFrame | None:
        answer = self._image(index, index, sample, sample)
        if isinstance(answer, LostFrame) and index > self._newest and not self._is_certain:
            raise self._fault(
                f"up to trigger {index} there is one image less than triggers, and it is unknown"
                f" which trigger was missed; {_REMEDY}"
            )
        return answer

    def _trigger(self, step: int, stamp_s: float | None) -> tuple[int, str]:
        """Number of the trigger of an image `step` frame ids after the last one, and why the
        triggers between have none, if that step is not the reason.
        """
        fits = self._newest + step
        if stamp_s and self._stamp:
            gap = round((stamp_s - self._stamp) * self._rate / self._train.divisor)
            if gap < step:
                raise self._fault(
                    f"{step} images came within {gap} trigger periods; check the trigger line for"
                    f" noise, or {_REMEDY}"
                )
            missed = gap - step
            number, why = self._newest + gap, ""
            if missed:
                why = f"missed trigger: by timestamps {missed} of {gap - 1} were missed here"
        else:
            number, why = max(fits, self._next), ""
        latest = self._clock.now + max(PATIENCE_S["inferred"] * self._rate, self._train.divisor / 2)
        if latest < self._train.sample(number):
            raise self._fault(
                f"an image came long before trigger {number}; check the trigger line for noise, and"
                " its setting"
            )
        # the image of the next trigger can not have come yet
        if latest < self._train.sample(number + 1) + self._open:
            self._is_certain = True
        elif number > fits and not why:
            raise self._fault(
                f"an image came after trigger {number - 1} had none, and it is unknown whether it"
                f" is that of trigger {number}; {_REMEDY}"
            )
        elif not (stamp_s and self._stamp):
            self._is_certain = False
        return number, why

    # ------------------------------------------------------------------ both

    def _image(self, number: int, index: int, sample: int, began: int) -> Frame | LostFrame | None:
        delivered = self._waiting.pop(number, None)
        if delivered is not None and delivered.image is not None:
            return Frame(index, sample, delivered.image)
        if delivered is not None:
            return LostFrame(index, self._train.sample(index), delivered.reason)
        if number <= self._newest:
            return LostFrame(
                index, self._train.sample(index), self._lost.pop(number, "its image came too late")
            )
        if began + self._open <= self._settled:
            if self._newest >= 0 and not self._is_certain:
                raise self._fault(
                    f"up to trigger {index} an image is missing, and it is unknown which one;"
                    f" {_REMEDY}"
                )
            return LostFrame(
                index,
                self._train.sample(index),
                f"no image came in time: trigger missed, or image lost{self._complaint}",
            )
        return None

    def _step(self, frame_id: int) -> int:
        """Number of exposures from the last delivered one to this one."""
        last, self._last_id = self._last_id, frame_id
        if last is None:
            self._is_certain = self._first_id is not None or frame_id == 0
            return 1 + max(0, frame_id - (frame_id if self._first_id is None else self._first_id))
        step = frame_id - last if frame_id > last else (frame_id - last) % _IDS
        if not 0 < step < _BACK:
            raise self._fault(
                f"its frame id went from {last} to {frame_id}; check cable and camera, and start a"
                " new run"
            )
        return step

    def _await_clock(self, now: int, timeout_s: float) -> None:
        self._clock.wait_for(lambda: self._clock.now != now, timeout_s)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(f"{self._name}: frames can not be numbered: {what}")
