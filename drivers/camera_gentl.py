"""Any camera whose vendor has a GenTL producer (.cti), through harvesters: GigE, USB3, or a frame
grabber's Camera Link and CoaXPress.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.clock import SampleClock
from drivers.errors import DeviceNotFound
from drivers.frame_numbers import Delivered
from drivers.genicam_camera import GenICamCamera, library
from drivers.protocols import Found
from drivers.settings import CameraSettings

if TYPE_CHECKING:
    from collections.abc import Iterator

_FIRST_ID = {"GEV": 1, "U3V": 0}
_POLL_MS = 10


def find(producer: str = "") -> list[Found]:
    """The cameras that a GenTL producer sees, or all that are registered on this computer; opens
    none.

    Raises
    ------
    DeviceNotFound
        The package harvesters is not installed, or the producer can not be loaded.
    """
    harvester = _harvester(producer)
    try:
        return [_found(info) for info in harvester.device_info_list]
    finally:
        harvester.reset()


class GenTLCamera(GenICamCamera):
    """A hardware-triggered camera behind the GenTL producer of the settings."""

    kind = "GenTL camera"

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self._harvester: Any = None
        self._acquirer: Any = None
        self._genapi: Any = None
        self._transport = ""
        # harvesters' stop must not come while it looks for an image
        self._receiving = threading.Lock()

    def _claim(self) -> Found:
        self._harvester = _harvester(self._settings.producer)
        self._genapi = library("genicam.genapi")
        self._errors = (self._genapi.GenericException, library("genicam.gentl").GenericException)
        number, info = self._choose(self._harvester.device_info_list)
        with _interrupt_kept():
            self._acquirer = self._harvester.create(number)
        self._acquirer.timeout_period_on_client_fetch_call = 1.0
        # else harvesters looks a thousand times a second
        self._acquirer.timeout_period_on_update_event_data_call = _POLL_MS
        self._transport = _text(info, "tl_type")
        return _found(info)

    def _choose(self, infos: Any) -> tuple[int, Any]:
        wanted, names = (
            self._settings.device,
            ("serial_number", "user_defined_name", "display_name", "id_"),
        )
        named = [
            (n, info)
            for n, info in enumerate(infos)
            if not wanted or wanted in {_text(info, name) for name in names}
        ]
        if len(named) == 1:
            return named[0]
        there = (
            ", ".join(f"{found.device} ({found.description})" for found in map(_found, infos))
            or "none"
        )
        if named:
            raise DeviceNotFound(
                f"{self.name}: there are {len(named)}: {there}; set camera.device to the serial"
                " number of one"
            )
        raise DeviceNotFound(
            f"{self.name}: it was asked, found: {there}; check its cable and power, camera.device"
            " and camera.producer"
        )

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
            # incomplete ones it drops
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
        component = (
            buffer.payload.components[0] if buffer.payload and buffer.payload.components else None
        )
        if component is None or component.data.size != self.shape[0] * self.shape[1]:
            what = (
                "no image in it"
                if component is None
                else f"{component.data.size} pixels in it, not {self.shape[1]} x {self.shape[0]}"
            )
            return Delivered(frame_id, stamp, None, f"a buffer came with {what}")
        image = np.array(component.data, self.dtype).reshape(self.shape)
        image.setflags(write=False)
        return Delivered(frame_id, stamp, image)

    def _node(self, name: str, *, to_read: bool = False) -> Any:
        nodes = self._acquirer.remote_device.node_map
        node = nodes.get_node(name) if nodes.has_node(name) else None
        modes = ("RO", "RW") if to_read else ("WO", "RW")
        return (
            node
            if node is not None and self._genapi.EAccessMode(node.get_access_mode()).name in modes
            else None
        )

    def _value(self, node: Any) -> Any:
        return node.value

    def _assign(self, node: Any, value: Any) -> None:
        node.value = value

    def _offer(self, node: Any) -> tuple[str, ...]:
        if hasattr(node, "symbolics"):
            return tuple(node.symbolics)
        return (
            f"{node.min:g} to {node.max:g}"
            + (f" in steps of {node.inc:g}" if isinstance(node.value, int) else ""),
        )


def _harvester(producer: str) -> Any:
    """The producer loaded, or all those that are registered, and their cameras listed."""
    try:
        harvester = library("harvesters.core").Harvester()
    except ImportError as error:
        raise DeviceNotFound(
            f"GenTL camera: its package can not be loaded ({error}); in the folder of SlipScope:"
            " pip install '.[gentl]'"
        ) from error
    registered = (
        Path(folder)
        for folder in os.environ.get("GENICAM_GENTL64_PATH", "").split(os.pathsep)
        if folder
    )
    for path in (
        [producer]
        if producer
        else [str(file) for folder in registered for file in sorted(folder.glob("*.cti"))]
    ):
        try:
            ctypes.CDLL(path)  # harvesters skips what it can not load
        except OSError as error:
            harvester.reset()
            raise DeviceNotFound(
                f"GenTL camera: producer '{path}' can not be loaded ({error}); install the camera"
                " maker's GenTL producer,"
                " and set camera.producer to its .cti file"
            ) from error
        harvester.add_file(path)
    harvester.update()
    return harvester


@contextmanager
def _interrupt_kept() -> Iterator[None]:
    """The interrupt key, which harvesters takes for itself in the main thread, is given back."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, handler)


def _text(info: Any, name: str) -> str:
    """A property of a camera that its producer may not know."""
    with suppress(library("genicam.gentl").GenericException):
        return str(getattr(info, name))
    return ""


def _found(info: Any) -> Found:
    return Found(
        _text(info, "serial_number"),
        f"{_text(info, 'vendor')} {_text(info, 'model')} ({_text(info, 'tl_type')})",
    )
