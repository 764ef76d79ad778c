"""The real pylon driver on pylon's emulated camera, which sees the simulated world and is triggered
by the pulses of its board.
"""

from __future__ import annotations

import itertools
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analysis.arrays import Array
from drivers.cameras.genicam_camera import library
from drivers.cameras.pylon_camera import PylonCamera
from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceFault, OutOfLimits
from drivers.protocols import Frame, LostFrame, TriggerTrain
from drivers.settings import CameraSettings
from drivers.sim.devices import corrupt
from drivers.sim.row_times import states_shown
from drivers.sim.world import World

if TYPE_CHECKING:
    from drivers.sim.images import Renderer

SERIAL_NUMBER = "0815-0000"
_FILES = 4  # which the emulated camera plays in turn; it reloads a file only after another one
_READY_MS = 100


@contextmanager
def _emulation_listed() -> Iterator[None]:
    """Set the variable that makes pylon list its emulated camera, and restore it, so that the
    camera appears in no other list.
    """
    before = os.environ.get("PYLON_CAMEMU")
    os.environ["PYLON_CAMEMU"] = "1"
    try:
        yield
    finally:
        del os.environ["PYLON_CAMEMU"]
        if before is not None:
            os.environ["PYLON_CAMEMU"] = before


class EmulatedPylonCamera(PylonCamera):
    """A `PylonCamera` whose sensor sees the world: one image per pulse, at the middle of its
    exposure; see `drivers.protocols.Camera`.

    pylon's emulated camera plays image files on software triggers. A thread follows the world: once
    an exposure has passed, it draws the image, writes it to the camera's next file and triggers the
    camera. It runs at 23.8 frames/s at 1600 x 1200 with 24 ms of CPU each, and at 45 frames/s at
    most.
    """

    def __init__(self, settings: CameraSettings, clock: SampleClock, world: World) -> None:
        super().__init__(replace(settings, device=SERIAL_NUMBER), clock)
        self.name = "emulated pylon camera"
        self._world = world
        self._renderer: Renderer | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._thread: threading.Thread | None = None
        self._follows = False
        self._shots = 0  # since the start, after which the camera begins with its first file
        self._failure: Exception | None = None

    def open(self) -> None:
        """Start the emulated camera and open it with the real driver.

        Raises
        ------
        OutOfLimits
            The settings do not have the size and format of the world's images.
        """
        wanted = self._settings
        if wanted.pixel_format != "Mono8" or self.shape != self._world.scenario.camera.shape:
            rows, columns = self._world.scenario.camera.shape
            raise OutOfLimits(
                f"{self.name}: {self.shape[1]} x {self.shape[0]} {wanted.pixel_format} was"
                f" requested, the world that it sees is {columns} x {rows} Mono8; set both alike"
            )
        with _emulation_listed():
            super().open()
        if self._renderer is None:
            from drivers.sim.images import Renderer

            self._renderer = Renderer(self._world.scenario)
        self._folder = tempfile.TemporaryDirectory(
            prefix="slipscope-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None
        )
        for number in range(_FILES):
            self._put(np.zeros(self.shape, np.uint8), number)
        device = self.device
        device.ImageFilename.Value = self._folder.name
        device.ImageFileMode.Value, device.TestImageSelector.Value = "On", "Off"
        # the world has exposed already; pylon would keep a core busy for the exposure time
        device.ExposureTimeAbs.Value = device.ExposureTimeAbs.Min

    def start(self, train: TriggerTrain) -> None:
        """Wait for pulses of the world's board."""
        super().start(train)
        self._world.watch(train)
        self._follows, self._failure, self._shots = True, None, 0
        self._thread = threading.Thread(target=self._follow, name="emulated camera", daemon=True)
        self._thread.start()

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The frame of the next trigger, or why it has none; see `PylonCamera.read`."""
        if self._failure is not None:
            raise DeviceFault(
                f"{self.name}: the emulation failed, {self._failure}; check its settings"
            ) from self._failure
        answer = super().read(timeout_s)
        self._world.frame_was_read()
        return answer

    def stop(self) -> None:
        """Stop waiting for triggers; a waiting `read` ends with `DeviceTimeout`."""
        self._follows = False
        if self._thread is not None:
            self._world.watch(None)
            self._thread.join()
            self._thread = None
        super().stop()

    def close(self) -> None:
        """Stop, close the real driver, end the emulated camera."""
        super().close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    # ------------------------------------------------------------------ the emulation

    def _follow(self) -> None:
        try:
            for pulse in itertools.count():
                if not self._passes(pulse) or not self._expose(pulse):
                    return
        except Exception as error:  # reported by `read`
            self._failure = error

    def _passes(self, pulse: int) -> bool:
        """Wait for the exposure of a pulse; whether it has passed, and not been cancelled."""
        world = self._world

        def end() -> float:
            if world.pulses is None:
                return np.inf
            begin = world.exposure_of(pulse)
            begin = world.pulses.sample(pulse) if begin is None else begin
            return begin + world.scenario.frame_samples

        world.wait_for(
            lambda: not self._follows or world.phase == "stopped" or world.now >= end(),
            threading.TIMEOUT_MAX,
        )
        return self._follows and world.now >= end()

    def _expose(self, pulse: int) -> bool:
        """Take the image of a pulse whose exposure has passed, with its faults; whether the camera
        is still there.
        """
        faults, device = self._world.faults, self.device
        if faults.since("camera-gone", pulse):
            self._await_delivery()
            device.FirePnPCallback.Execute()
            return False
        begin = self._world.exposure_of(pulse)
        if begin is None:
            return True
        assert self._renderer is not None
        first, *later = states_shown(self._world, begin)
        image = self._renderer.image(first, pulse, *later)
        if faults.hits("corrupt-frame", pulse):
            corrupt(image)
        self._put(image, self._shots % _FILES)
        while not device.WaitForFrameTriggerReady(
            _READY_MS, library("pypylon.pylon").TimeoutHandling_Return
        ):
            if not self._follows:
                return False
        if faults.hits("lost-frame", pulse):
            self._await_delivery()
            device.ForceFailedBufferCount.Value = 1
            device.ForceFailedBuffer.Execute()
        device.TriggerSoftware.Execute()
        self._shots += 1
        return True

    def _await_delivery(self) -> None:
        """Wait until all triggered images have arrived; the camera accepts triggers before that."""
        delivered = self.device.GetStreamGrabberNodeMap().GetNode("Statistic_Total_Buffer_Count")
        while self._follows and delivered.GetValue() < self._shots:
            self._world.wait_for(lambda: not self._follows, 0.002)

    def _put(self, image: Array, number: int) -> None:
        assert self._folder is not None
        path = Path(self._folder.name) / f"{number}.tiff"
        if not cv2.imwrite(str(path), image, [cv2.IMWRITE_TIFF_COMPRESSION, 1]):
            raise DeviceError(
                f"{self.name}: an image could not be written to {path}; make room there"
            )
