"""A webcam, or any camera or file that OpenCV opens (UVC, DirectShow, V4L2, GStreamer).

It has no trigger, so that the number of each frame is uncertain: see
`drivers.cameras.software_trigger`.
"""

from dataclasses import dataclass

import cv2

from analysis.options import Section, option
from drivers.cameras.software_trigger import SoftwareTriggered
from drivers.errors import DeviceFault, DeviceNotFound, OutOfLimits


class Webcam(SoftwareTriggered):
    """The camera of that number (`camera.device`, 0 if empty), or the file of that name."""

    name = "webcam"

    @dataclass(frozen=True, kw_only=True)
    class Options(Section):
        """A webcam."""

        latency: float = option(
            200.0, "Longest time from the light to the program", "ms", gt=0, le=5000
        )
        stale: int = option(
            1, "Old images that its driver holds, skipped before each", "images", ge=0, le=10
        )

    def __init__(self, settings, clock):
        super().__init__(settings, clock, settings.options.latency)
        self._capture = None

    def claim(self):
        device, (rows, columns) = self.settings.device or "0", self.shape
        self._capture = cv2.VideoCapture(int(device) if device.isdigit() else device)
        if not self._capture.isOpened():
            raise DeviceNotFound(
                f"{self.name}: '{device}' cannot be opened; set camera.device to the number of the"
                " camera, 0 for the first, and close other programs that use it"
            )
        sizes = (cv2.CAP_PROP_FRAME_WIDTH, columns), (cv2.CAP_PROP_FRAME_HEIGHT, rows)
        for name, value in (*sizes, (cv2.CAP_PROP_BUFFERSIZE, 1)):
            self._capture.set(name, value)
        found = tuple(round(self._capture.get(name)) for name, _ in sizes)
        if found != (columns, rows):
            raise OutOfLimits(
                f"{self.name}: {columns} x {rows} was requested, it gives {found[0]} x {found[1]};"
                " set camera.width and camera.height to that"
            )

    def grab(self):
        for _ in range(self.settings.options.stale):
            self._capture.grab()
        is_there, image = self._capture.read()
        if not is_there:
            raise DeviceFault(f"{self.name}: it gives no image any more; check its cable")
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)

    def release(self):
        if self._capture is not None:
            self._capture.release()
            self._capture = None
