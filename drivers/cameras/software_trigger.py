"""Cameras that no board triggers: a webcam, or any camera whose images the program asks for.

An image is asked for when the trigger's sample has been read, which is later than the trigger, and
it shows a moment that nobody measures. So its trigger is uncertain by construction, and each frame
says between which triggers it was taken. For forces and stage beside an image that is enough at a
few micrometres per second; for the onset of sliding to one frame, wire a trigger.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from functools import partial

from drivers.cameras.played_images import SetCamera
from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.protocols import Frame, Image, LostFrame, TriggerTrain
from drivers.settings import CameraSettings

LOOK_S = 0.1  # pause between two looks whether to go on
MOST_WAITING = 64  # answers that nobody reads
PATIENCE_S = 3.0  # a camera that does not return from a call is given up after it


class SoftwareTriggered(SetCamera, ABC):
    """Base of such cameras; a thread asks for an image at each trigger, from `start` to `stop`.

    Parameters
    ----------
    latency_s : float
        How much older or newer than the newest sample that was read an image can be: the longest
        time that it waits in camera and computer, and that samples wait for the program.
    """

    is_triggered = False

    def __init__(self, settings: CameraSettings, clock: SampleClock, latency_s: float) -> None:
        super().__init__(settings, clock)
        self.settings = settings
        self._latency = max(1, round(latency_s * clock.sample_rate_hz))
        self._is_open = False
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._changed = threading.Condition()
        self._answers: deque[Frame | LostFrame] = deque()
        self._error: DeviceError | None = None

    @abstractmethod
    def claim(self) -> None:
        """Claim the hardware."""

    @abstractmethod
    def grab(self) -> Image:
        """A new image of `shape` and `dtype`, taken after this call if that is possible."""

    @abstractmethod
    def release(self) -> None:
        """Let go of the hardware; also called where `claim` failed."""

    def open(self) -> None:
        """Claim the camera."""
        self.close()
        try:
            self.claim()
        except BaseException:
            self.release()
            raise
        self._is_open = True

    def describe(self) -> str:
        """Size, and that the triggers of its frames are uncertain."""
        rows, columns = self.shape
        late = self._latency / self._clock.sample_rate_hz
        return (
            f"{columns} x {rows}, triggered by software: the trigger of each frame is uncertain by"
            f" {late * 1e3:g} ms"
        )

    def start(self, train: TriggerTrain) -> None:
        """Ask for an image at each trigger from now on."""
        if not self._is_open:
            raise DeviceFault(f"{self.name}: it cannot start while it is closed; open it first")
        self.stop()
        self._ending.clear()
        self._answers.clear()
        self._error = None
        self._thread = threading.Thread(
            target=self._work, args=(train,), name=self.name, daemon=True
        )
        self._thread.start()

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The frame of the next trigger; see `drivers.protocols.Camera.read`."""
        if self._thread is None:
            raise DeviceFault(f"{self.name}: it has no frames before it starts; start it first")
        with self._changed:
            self._changed.wait_for(lambda: self._answers or self._error, timeout_s)
            if self._answers:
                return self._answers.popleft()
            if self._error is not None:
                raise self._error
        raise DeviceTimeout(
            f"{self.name}: no image was due within {timeout_s:g} s; wait longer, or end here"
        )

    def stop(self) -> None:
        """Ask for no more images.

        Raises
        ------
        DeviceTimeout
            The camera does not return from a call; it is neither released nor asked again.
        """
        self._ending.set()
        if self._thread is not None:
            self._thread.join(PATIENCE_S)
            if self._thread.is_alive():
                raise DeviceTimeout(
                    f"{self.name}: it did not return from a call within {PATIENCE_S:g} s; check the"
                    " camera, its connection and its driver"
                )
            self._thread = None

    def close(self) -> None:
        """Stop, and let go of the camera."""
        self.stop()
        if self._is_open:
            self._is_open = False
            self.release()

    def _work(self, train: TriggerTrain) -> None:
        index, clock, has_run = 0, self._clock, False
        try:
            while not self._ending.is_set():
                due = train.sample(index)
                has_come = clock.wait_for(partial(self._has_come, due), LOOK_S)
                has_run = has_run or clock.phase == "running"
                before = clock.now
                newest = train.count_before(before) - 1
                if has_run and clock.phase == "stopped":
                    self._lose(train, range(index, newest + 1), "the samples ended first")
                    return
                if not has_come:
                    continue
                self._lose(train, range(index, newest), "the next trigger came first")
                image = self.grab()
                image.setflags(write=False)
                first = max(0, train.count_before(before - self._latency + 1) - 1)
                last = train.count_before(clock.now + self._latency)
                if image.shape != self.shape or image.dtype != self.dtype:
                    raise DeviceFault(
                        f"{self.name}: an image of {image.shape} {image.dtype} came instead of"
                        f" {self.shape} {self.dtype}; correct camera.width and camera.height"
                    )
                self._answer(Frame(newest, train.sample(newest), image, first, last))
                index = newest + 1
        except DeviceError as error:
            self._fail(error)
        except Exception as error:
            text = f"{self.name}: no image came ({type(error).__name__}: {error}); check its cable"
            self._fail(DeviceFault(text))

    def _has_come(self, sample: int) -> bool:
        return self._clock.phase == "running" and self._clock.now > sample

    def _answer(self, answer: Frame | LostFrame) -> None:
        with self._changed:
            if len(self._answers) >= MOST_WAITING:
                reason = f"{self.name}: {MOST_WAITING} images wait to be read"
                answer = LostFrame(answer.index, answer.sample, reason)
            self._answers.append(answer)
            self._changed.notify_all()

    def _fail(self, error: DeviceError) -> None:
        with self._changed:
            self._error = error
            self._changed.notify_all()

    def _lose(self, train: TriggerTrain, indices: range, why: str) -> None:
        reason = f"{self.name}: it was not asked for an image, {why}"
        for index in indices:
            self._answer(LostFrame(index, train.sample(index), reason))
