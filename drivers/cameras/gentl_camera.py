"""Any camera whose vendor has a GenTL producer (.cti), through harvesters: GigE, USB3, CoaXPress,
or Camera Link behind a frame grabber, also where its producer describes no features of the camera.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers import installation
from drivers.cameras.genicam_camera import GenICamCamera, library
from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceNotFound
from drivers.frame_matching.delivered import Delivered
from drivers.protocols import Found
from drivers.settings import CameraSettings

_FIRST_ID = {"GEV": 1, "U3V": 0}
_POLL_MS = 10


def find(producer: str = "") -> list[Found]:
    """The cameras that a GenTL producer sees, or those of all producers that are registered on this
    computer; none is opened.

    Raises
    ------
    DeviceNotFound
        The package harvesters is not installed, or the producer cannot be loaded.
    """
    harvester = _harvester(producer)
    try:
        return [_found(info) for info in harvester.device_info_list]
    finally:
        harvester.reset()


class GenTLCamera(GenICamCamera):
    """A hardware-triggered camera behind the GenTL producer of the settings."""

    kind = "GenTL camera"
    _shows_in_images = True

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self._harvester: Any = None
        self._acquirer: Any = None
        self._genapi: Any = None
        self._transport = ""
        # harvesters must not be stopped while it fetches an image
        self._receiving = threading.Lock()

    def _claim(self) -> Found:
        self._harvester = _harvester(self._settings.producer)
        self._genapi = library("genicam.genapi")
        self._errors = (self._genapi.GenericException, library("genicam.gentl").GenericException)
        infos = self._harvester.device_info_list
        number = self._choice([(_names(info), _found(info)) for info in infos])
        interrupted = signal.getsignal(signal.SIGINT)  # harvesters replaces it in the main thread
        try:
            self._acquirer = self._harvester.create(number)
        except (AssertionError, AttributeError) as error:
            raise DeviceFault(
                f"{self.name}: its producer gives no way to the camera that harvesters can use"
                f" ({type(error).__name__}: {error}); ask the vendor of the frame grabber for"
                " another producer, or write a driver on the grabber's own library"
            ) from error
        finally:
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, interrupted)
        remote = self._acquirer.remote_device
        if not self._describes(remote.node_map):
            rows, columns = self.shape
            remote._node_map = _NoFeatures(rows * columns * self.dtype.itemsize)
            # what harvesters meets where it needs a feature after all
            self._errors = (*self._errors, AttributeError)
        self._acquirer.timeout_period_on_client_fetch_call = 1.0
        # by default harvesters polls a thousand times a second
        self._acquirer.timeout_period_on_update_event_data_call = _POLL_MS
        self._transport = _text(infos[number], "tl_type")
        return _found(infos[number])

    def _describes(self, nodes: Any) -> bool:
        """Whether a camera has features, of which harvesters needs the first."""
        with suppress(*self._errors):
            return nodes is not None and bool(nodes.has_node("AcquisitionStart"))
        return False

    def _release(self) -> None:
        acquirer, self._acquirer = self._acquirer, None
        harvester, self._harvester = self._harvester, None
        if acquirer is not None:
            acquirer.destroy()
        if harvester is not None:
            harvester.reset()

    def _arm(self, buffers: int) -> None:
        self._acquirer.num_buffers = max(buffers, self._acquirer.min_num_buffers)
        self._acquirer.start()

    def _disarm(self) -> None:
        with self._receiving:
            self._acquirer.stop()

    def _first_id(self) -> int | None:
        return _FIRST_ID.get(self._transport)

    def _receive(self, wait_s: float) -> Delivered | None:
        with self._receiving:
            # this drops incomplete images
            buffer = self._acquirer.try_fetch(timeout=max(wait_s, 1e-3)) if self._waits else None
            if buffer is None:
                return None
            try:
                return self._delivered(buffer)
            finally:
                buffer.queue()

    def _delivered(self, buffer: Any) -> Delivered:
        frame_id = stamp = None
        with suppress(*self._errors):
            frame_id = int(buffer.frame_id)
        if buffer.timestamp:
            stamp = buffer.timestamp / 1e9
            with suppress(*self._errors, AttributeError):
                stamp = buffer.timestamp / buffer.timestamp_frequency
        components = buffer.payload.components if buffer.payload else ()
        component = components[0] if components else None
        if component is not None and self._seen_in_images:
            self._check_image(component.width, component.height, component.data_format)
        if component is None or component.data.size != self.shape[0] * self.shape[1]:
            what = "no image"
            if component is not None:
                what = f"{component.data.size} pixels, not {self.shape[1]} x {self.shape[0]}"
            return Delivered(frame_id, stamp, None, f"a buffer came with {what}")
        image = np.array(component.data, self.dtype).reshape(self.shape)
        image.setflags(write=False)
        return Delivered(frame_id, stamp, image)

    def _node(self, name: str, *, to_read: bool = False) -> Any:
        nodes = self._acquirer.remote_device.node_map
        node = nodes.get_node(name) if nodes.has_node(name) else None
        if node is None:
            return None
        mode = self._genapi.EAccessMode(node.get_access_mode()).name
        return node if mode in (("RO", "RW") if to_read else ("WO", "RW")) else None

    def _value(self, node: Any) -> Any:
        return node.value

    def _assign(self, node: Any, value: Any) -> None:
        node.value = value

    def _offer(self, node: Any) -> tuple[str, ...]:
        if hasattr(node, "symbolics"):
            return tuple(node.symbolics)
        step = f" in steps of {node.inc:g}" if isinstance(node.value, int) else ""
        return (f"{node.min:g} to {node.max:g}{step}",)


class _Nothing:
    """A command that does nothing."""

    def execute(self) -> None:
        """Do nothing."""


class _NoFeatures:
    """The features of a camera that describes none, as behind many frame grabbers: those that
    harvesters uses of each camera.
    """

    AcquisitionStart = AcquisitionStop = _Nothing()
    AcquisitionMode = SimpleNamespace(value="Continuous")

    def __init__(self, image_bytes: int) -> None:
        self.PayloadSize = SimpleNamespace(value=image_bytes)  # where the grabber says no other

    def has_node(self, name: str) -> bool:
        """Whether there is a feature of that name."""
        del name
        return False

    def disconnect(self) -> None:
        """Let go of the camera."""


def _harvester(producer: str) -> Any:
    """Harvesters with the producer, or with all registered ones, and a list of their cameras."""
    try:
        harvester = library("harvesters.core").Harvester()
    except ImportError as error:
        raise DeviceNotFound(
            f"GenTL camera: its package cannot be loaded ({error}); to install it:"
            f" {installation.add('harvesters')}"
        ) from error
    paths = [producer]
    if not producer:
        folders = filter(None, os.environ.get("GENICAM_GENTL64_PATH", "").split(os.pathsep))
        paths = [str(file) for folder in folders for file in sorted(Path(folder).glob("*.cti"))]
    for path in paths:
        try:
            ctypes.CDLL(path)  # harvesters silently skips what it cannot load
        except OSError as error:
            harvester.reset()
            raise DeviceNotFound(
                f"GenTL camera: producer '{path}' cannot be loaded ({error}); install the GenTL"
                " producer of the camera's vendor, and set camera.producer to its .cti file"
            ) from error
        harvester.add_file(path)
    harvester.update()
    return harvester


def _text(info: Any, name: str) -> str:
    """A property of a camera; empty if its producer does not know it."""
    with suppress(library("genicam.gentl").GenericException):
        return str(getattr(info, name))
    return ""


def _names(info: Any) -> set[str]:
    names = ("serial_number", "user_defined_name", "display_name", "id_")
    return {_text(info, name) for name in names}


def _found(info: Any) -> Found:
    return Found(
        _text(info, "serial_number"),
        f"{_text(info, 'vendor')} {_text(info, 'model')} ({_text(info, 'tl_type')})",
    )
