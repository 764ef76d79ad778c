"""A camera whose images exist before the run: image n is given for trigger n, once the exposure of
that trigger has passed on the clock.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import Frame, Image, LostFrame, TriggerTrain
from drivers.settings import CameraSettings

_SLICE_S = 0.05


class SetCamera:
    """What every camera takes from its settings; see `drivers.protocols.Camera`."""

    name = "camera"

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        self.shape, self.dtype = settings.shape, settings.dtype
        self.exposure_samples = settings.exposure_samples(clock.sample_rate_hz)
        self._clock = clock


class PlayedImages(SetCamera, ABC):
    """Base of such cameras; see `drivers.protocols.Camera`."""

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self._is_open = False
        self._train: TriggerTrain | None = None
        self._next = 0

    @abstractmethod
    def image(self, index: int) -> Image | str:
        """The image of a trigger, or the reason why it has none."""

    def open(self) -> None:
        """Nothing has to be claimed."""
        self._is_open = True

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; the first one shows the first image."""
        if not self._is_open:
            raise DeviceFault(
                f"{self.name}: it cannot wait for triggers while it is closed; open it first"
            )
        self._train, self._next = train, 0

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The image of the next trigger; see `drivers.protocols.Camera.read`."""
        train, clock, index = self._train, self._clock, self._next
        if train is None:
            raise DeviceFault(f"{self.name}: it has no frames before it starts; start it first")
        sample = train.sample(index)
        end = sample + self.exposure_samples
        give_up = time.monotonic() + timeout_s
        # in slices: `stop` does not change the clock
        while not clock.wait_for(
            lambda: clock.now >= end or clock.phase == "stopped" or self._train is None,
            min(_SLICE_S, timeout_s),
        ):
            if time.monotonic() >= give_up:
                break
        if clock.now < end or self._train is None:
            raise DeviceTimeout(
                f"{self.name}: trigger {index} had no answer within {timeout_s:g} s (sample"
                f" {clock.now} of {end}); wait longer, or end here"
            )
        self._next = index + 1
        image = self.image(index)
        if isinstance(image, str):
            return LostFrame(index, sample, image)
        image.setflags(write=False)
        return Frame(index, sample, image)

    def stop(self) -> None:
        """Stop waiting for triggers; a waiting `read` ends with `DeviceTimeout`."""
        self._train = None

    def close(self) -> None:
        """Stop, and let go of the images."""
        self.stop()
        self._is_open = False
