"""What cameras with GenICam features have in common, whichever library reaches them: their
settings, their triggers, their frame numbers.
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any

from analysis.options import quantity
from drivers.cameras.played_images import SetCamera
from drivers.clock import SampleClock
from drivers.errors import (
    DeviceError,
    DeviceFault,
    DeviceNotFound,
    DeviceTimeout,
    OutOfLimits,
)
from drivers.frame_matching.delivered import Delivered
from drivers.frame_matching.frame_numbers import FrameNumbers
from drivers.protocols import Found, Frame, LostFrame, TriggerTrain
from drivers.settings import CameraSettings

_BUFFERED_S = 2.0
_LIMITS = (
    "BslResultingAcquisitionFrameRate",
    "ResultingFrameRate",
    "ResultingFrameRateAbs",
    "AcquisitionResultingFrameRate",
)
_SHUTTER = ("SensorShutterMode", "ShutterMode")  # the second on older cameras
_READOUT_US = ("SensorReadoutTime", "ReadoutTimeAbs")
# features that nobody asks for in the settings, and their values with which images are as taken
_NEUTRAL: dict[str, Any] = {
    **dict.fromkeys(_SHUTTER, "Global"),  # all rows are exposed at one time
    "TestPattern": "Off",
    "TestImageSelector": "Off",
    "ReverseX": False,
    "ReverseY": False,
    "Gamma": 1.0,
    "LUTEnable": False,
    "BinningHorizontal": 1,
    "BinningVertical": 1,
    "DecimationHorizontal": 1,
    "DecimationVertical": 1,
    **dict.fromkeys(("LineDebouncerTime", "LineDebouncerTimeAbs"), 0.0),  # of the trigger line
}


class GenICamCamera(SetCamera, ABC):
    """A camera that the DAQ board triggers on a line; see `drivers.protocols.Camera`. A subclass
    calls the library.

    Without a trigger line in the settings, trigger and exposure stay as the camera (or its frame
    grabber) is set.
    """

    kind = "camera"
    _shows_in_images = False  # whether an image says its size and format

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self.name = f"camera '{settings.device}'" if settings.device else self.kind
        self._settings = settings
        self._numbers: FrameNumbers | None = None
        self._waits = False
        self._seen_in_images: set[str] = set()  # features that the camera does not have
        self._found: Found | None = None  # once open
        self._set_by_hand = ""  # see `_peculiarities`
        self._errors: tuple[type[Exception], ...] = ()  # of the library, once it is loaded

    # ------------------------------------------------------------------ calls of the library

    @abstractmethod
    def _claim(self) -> Found:
        """Load the library, find the camera and open it."""

    @abstractmethod
    def _release(self) -> None: ...

    @abstractmethod
    def _arm(self, buffers: int) -> None: ...

    @abstractmethod
    def _disarm(self) -> None: ...

    @abstractmethod
    def _receive(self, wait_s: float) -> Delivered | None: ...

    @abstractmethod
    def _first_id(self) -> int | None:
        """Frame id of the first exposure after a start; see `FrameNumbers`."""

    @abstractmethod
    def _node(self, name: str, *, to_read: bool = False) -> Any:
        """A feature that the camera has and that can be set (or read); else None."""

    @abstractmethod
    def _value(self, node: Any) -> Any: ...

    @abstractmethod
    def _assign(self, node: Any, value: Any) -> None: ...

    @abstractmethod
    def _offer(self, node: Any) -> tuple[str, ...]:
        """The choices of a feature, or its least and largest value and the step."""

    # ------------------------------------------------------------------ the life of the device

    def open(self) -> None:
        """Find the camera, claim it, and apply the settings.

        Raises
        ------
        DeviceNotFound
            It is not there, or there are several and the settings name none.
        OutOfLimits
            It does not have one of the settings; the message says what it offers.
        """
        try:
            with self._named("it cannot be opened", "end other programs that use it"):
                self._found = self._claim()
                self._configure()
                self._set_by_hand = self._peculiarities()
        except DeviceError:
            self.close()
            raise

    def describe(self) -> str:
        """Model, settings, and how frames get their numbers."""
        s = self._settings
        if self._found is None:
            return f"{self.name}, not open"
        trigger = "trigger and exposure as the camera is set"
        if s.trigger_line:
            trigger = f"{quantity(s, 'exposure')}, trigger {s.trigger_line}"
        images = f"{s.shape[1]} x {s.shape[0]} {s.pixel_format}"
        text = f"{self._found.description}: {images}, {trigger}{self._set_by_hand}"
        return f"{text}; {self._numbers.describe()}" if self._numbers else text

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; `OutOfLimits` if they come faster than the camera can follow."""
        if self._found is None:
            raise DeviceFault(
                f"{self.name}: it cannot wait for triggers before it is open; open it first"
            )
        rate = self._clock.sample_rate_hz
        nodes = (self._node(name, to_read=True) for name in _LIMITS)
        limits = [self._value(node) for node in nodes if node is not None]
        limit = min([*limits[:1], rate / self.exposure_samples])
        if rate / train.divisor > limit * 1.001:
            raise OutOfLimits(
                f"{self.name}: {rate / train.divisor:.4g} Hz asked, {limit:.4g} Hz is its limit"
                " with an exposure of"
                f" {quantity(self._settings, 'exposure')}; use a divisor of"
                f" {math.ceil(rate / limit / 1.001)} or more, or expose shorter"
            )
        with self._named("it cannot wait for triggers", "close it and open it again"):
            self._arm(max(10, math.ceil(_BUFFERED_S * rate / train.divisor)))
        self._numbers = FrameNumbers(
            self.name, train, self._clock, self.exposure_samples, self._first_id()
        )
        self._waits = True

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The frame of the next trigger, or why it has none; see `drivers.protocols.Camera.read`.

        Raises
        ------
        DeviceTimeout
            Nothing is known about the trigger yet, or the camera was stopped meanwhile.
        DeviceFault
            The camera is gone, or its images can no longer be assigned to triggers.
        """
        if self._numbers is None or not self._waits:
            raise DeviceFault(
                f"{self.name}: it has no frames before it waits for triggers; start it first"
            )
        return self._numbers.answer(self._fetch, timeout_s)

    @property
    def delivered(self) -> int:
        """Results that the library has given since the start, answered or not."""
        return self._numbers.delivered if self._numbers else 0

    def balance(self) -> str:
        """What came of the triggers since the start; see `FrameNumbers.balance`."""
        return self._numbers.balance() if self._numbers else ""

    def uncertain_from(self) -> int | None:
        """The first trigger of which nothing is certain; see `FrameNumbers.uncertain_from`."""
        return self._numbers.uncertain_from() if self._numbers else None

    def _fetch(self, wait_s: float) -> Delivered | None:
        if not self._waits:
            raise DeviceTimeout(
                f"{self.name}: it was stopped before the next frame came; start it again"
            )
        with self._named("a frame cannot be read", "check its cable and power"):
            return self._receive(wait_s)

    def stop(self) -> None:
        """Stop waiting for triggers; a waiting `read` ends with `DeviceTimeout`."""
        if self._waits:
            self._waits = False
            with self._named("it cannot be stopped", "check its cable and power"):
                self._disarm()

    def close(self) -> None:
        """Stop, and let go of the camera."""
        try:
            self.stop()
        finally:
            self._found = None
            with self._named("it cannot be stopped", "check its cable and power"):
                self._release()

    @contextmanager
    def _named(self, problem: str, remedy: str) -> Iterator[None]:
        """Calls of the library, whose errors become a `DeviceFault` with problem and remedy."""
        try:
            yield
        except self._errors as error:
            raise DeviceFault(f"{self.name}: {problem} ({sentence(error)}); {remedy}") from error

    def _choice(self, cameras: list[tuple[set[str], Found]]) -> int:
        """Number of the camera that the settings name, among all (with their names) that are there.

        Raises
        ------
        DeviceNotFound
            It is not there, or there are several and the settings name none.
        """
        wanted = self._settings.device
        named = [n for n, (names, _) in enumerate(cameras) if not wanted or wanted in names]
        if len(named) == 1:
            return named[0]
        there = ", ".join(f"{found.device} ({found.description})" for _, found in cameras) or "none"
        if named:
            raise DeviceNotFound(
                f"{self.name}: there are {len(named)}: {there}; set camera.device to the serial"
                " number of one"
            )
        raise DeviceNotFound(
            f"{self.name}: it was not found, there are: {there}; check its cable and power, and"
            " camera.device"
        )

    # ------------------------------------------------------------------ features

    def _configure(self) -> None:
        s = self._settings
        self._set_or_see("PixelFormat", s.pixel_format, "pixel_format")
        self._prefer("OffsetX", 0)  # only there is the whole width available
        self._prefer("OffsetY", 0)
        self._set_or_see("Width", s.shape[1], "width")
        self._set_or_see("Height", s.shape[0], "height")
        if any(s.offset):
            self._set("OffsetX", s.offset[0])
            self._set("OffsetY", s.offset[1])
        self._prefer("AcquisitionMode", "Continuous")
        self._prefer("AcquisitionFrameRateEnable", False)
        if s.gain >= 0:
            self._prefer("GainAuto", "Off")
            self._set_gain(s.gain)
        if s.exposure_line:
            self._set("LineSelector", s.exposure_line)
            self._prefer("LineMode", "Output")
            self._prefer("LineInverter", False)
            self._set("LineSource", "ExposureActive")
        if s.trigger_line:
            for name in _SHUTTER:
                self._prefer_one(name, _NEUTRAL[name])
            self._prefer("ExposureAuto", "Off")
            self._prefer("ExposureMode", "Timed")
            self._set("ExposureTime", s.exposure * 1e6, "ExposureTimeAbs")
            self._set_trigger(s.trigger_line)

    def adjust(self, exposure_s: float, gain_db: float) -> None:
        """See `drivers.protocols.AdjustableCamera.adjust`."""
        if not self._settings.trigger_line:
            raise OutOfLimits(
                f"{self.name}: an exposure of {exposure_s * 1e3:g} ms was requested, it has trigger"
                " and exposure as it is set by hand; name camera.trigger_line"
            )
        with self._named("exposure and gain cannot be changed", "connect it again"):
            self._set("ExposureTime", exposure_s * 1e6, "ExposureTimeAbs")
            if gain_db >= 0:
                self._prefer("GainAuto", "Off")
                self._set_gain(gain_db)

    def _set_trigger(self, line: str) -> None:
        """Let a rising edge on the line start one frame, and switch all other triggers off."""
        selector = self._node("TriggerSelector")
        for other in self._offer(selector) if selector is not None else ():
            self._set("TriggerSelector", other)
            self._prefer("TriggerMode", "Off")
        self._prefer("TriggerSelector", "FrameStart")
        self._set("TriggerMode", "On")
        self._set("TriggerSource", line)
        self._prefer("TriggerActivation", "RisingEdge")
        # otherwise triggers during the readout are lost
        self._prefer_one("TriggerOverlap", "ReadOut", "PreviousFrame")
        for name in ("TriggerDelay", "TriggerDelayAbs"):
            self._prefer(name, 0.0)
        self._prefer("LineSelector", line)
        self._prefer("LineMode", "Input")
        self._prefer("LineInverter", False)

    def _set_gain(self, gain: float) -> None:
        """Set the gain in dB; a camera that counts it in steps of its own is set by hand."""
        raw = self._node("GainRaw")
        if raw is not None and self._node("Gain") is None and self._node("GainAbs") is None:
            raise OutOfLimits(
                f"{self.name}: a gain of {gain:g} dB was requested, it has none in dB but GainRaw,"
                f" {', '.join(self._offer(raw))}; set that with the vendor's program, and"
                " camera.gain = -1"
            )
        self._set("Gain", gain, "GainAbs")

    def _set_or_see(self, name: str, value: Any, setting: str) -> None:
        """Set a feature. Where it can only be read it must have the value already; where the camera
        has none, as behind many frame grabbers, its images must show it.

        Raises `OutOfLimits`.
        """
        node = None if self._node(name) is not None else self._node(name, to_read=True)
        if node is not None:
            if (found := self._value(node)) != value:
                raise OutOfLimits(
                    f"{self.name}: {name} = {value} was requested, it is {found} and cannot be set"
                    f" from here; set it with the vendor's program, or camera.{setting} to it"
                )
        elif self._node(name) is None and self._shows_in_images:
            self._seen_in_images.add(name)
        else:
            self._set(name, value)

    def _check_image(self, width: int, height: int, pixel_format: str) -> None:
        """See that an image is as the settings say, where the camera could not be set to it.

        Raises `DeviceFault`.
        """
        s = self._settings
        asked = {"Width": s.width, "Height": s.height, "PixelFormat": s.pixel_format}
        found = {"Width": width, "Height": height, "PixelFormat": pixel_format}
        if any(found[name] != asked[name] for name in self._seen_in_images):
            raise DeviceFault(
                f"{self.name}: its images are {width} x {height} px of {pixel_format}, and the"
                f" settings say {s.width} x {s.height} px of {s.pixel_format}; let camera.width,"
                " camera.height and camera.pixel_format agree with the settings of the frame"
                " grabber"
            )

    def _prefer(self, name: str, value: Any) -> None:
        """Set a feature if the camera has it; a camera without it behaves in this way anyhow."""
        if self._node(name) is not None:
            self._set(name, value)

    def _prefer_one(self, name: str, *values: str) -> None:
        """Set a feature to the first of these values that the camera offers, if it offers one."""
        node = self._node(name)
        offered = self._offer(node) if node is not None else ()
        for value in [value for value in values if value in offered][:1]:
            self._set(name, value)

    def _peculiarities(self) -> str:
        """Features that somebody has set by hand and that change the images."""
        said = ""
        for name, neutral in _NEUTRAL.items():
            with suppress(*self._errors):  # one that cannot be read now is no reason not to open
                node = self._node(name, to_read=True)
                value = neutral if node is None else self._value(node)
                is_near = isinstance(value, float) and math.isclose(value, neutral, rel_tol=1e-3)
                said += "" if value == neutral or is_near else f", {name} = {value}"
                if name in _SHUTTER and node is not None:
                    said += self._check_readout(name, value)
        return said

    def _check_readout(self, name: str, shutter: Any) -> str:
        """What is to be said of the times of the rows with such a shutter.

        Raises `OutOfLimits` if they are to be corrected, and all rows are exposed at one time.
        """
        readout = quantity(self._settings, "readout")
        if shutter == _NEUTRAL[name]:
            if self._settings.readout:
                raise OutOfLimits(
                    f"{self.name}: camera.readout = {readout} was requested, it exposes all rows"
                    f" at one time ({name} = {shutter}); set camera.readout to 0"
                )
            return ""
        if self._settings.readout:
            return f" (corrected by camera.readout = {readout})"
        nodes = (self._node(one, to_read=True) for one in _READOUT_US)
        times_us = [self._value(node) for node in nodes if node is not None]
        for time_us in times_us:
            if isinstance(time_us, int | float):
                return f" (its rows take about {time_us * 1e-3:.3g} ms: set camera.readout)"
        return ""

    def _set(self, name: str, value: Any, other_name: str = "") -> None:
        """Set a feature, which GigE cameras may have under another name.

        Raises `OutOfLimits`, with the possible values, if the value is not one of them.
        """
        node = self._node(name)
        if node is None and other_name:
            node = self._node(other_name)
        if node is None:
            remedy = "see its manual"
            if self._seen_in_images:
                remedy = (
                    "trigger, exposure and gain of a camera behind a frame grabber are set by the"
                    " grabber's own program: leave camera.trigger_line and camera.exposure_line"
                    ' empty, "", and camera.gain at -1'
                )
            raise OutOfLimits(
                f"{self.name}: {name} = {value} was requested, it has no such feature that can be"
                f" set; {remedy}"
            )
        try:
            self._assign(node, value)
        except self._errors as error:
            raise OutOfLimits(
                f"{self.name}: {name} = {value} was requested, it offers"
                f" {', '.join(self._offer(node))}"
            ) from error


def library(name: str) -> Any:
    """A vendor's module. Warnings during its import are ignored: pypylon crashes if one of them is
    made an error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return import_module(name)


def sentence(error: Exception) -> str:
    """The library's message without the place in its source."""
    return str(error).split(" : ")[0].strip(". ")
