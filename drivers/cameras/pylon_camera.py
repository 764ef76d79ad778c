"""A Basler camera through pylon, triggered on a line by the DAQ board; no image is replaced by a
newer one.
"""

from __future__ import annotations

from typing import Any

from drivers import installation
from drivers.cameras.genicam_camera import GenICamCamera, library
from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceNotFound
from drivers.frame_matching.delivered import Delivered
from drivers.protocols import Found
from drivers.settings import CameraSettings

_FIRST_ID = {"BaslerGigE": 1, "BaslerUsb": 0, "BaslerCamEmu": 0}
_NO_ID = 2**64 - 1


def find() -> list[Found]:
    """All cameras that pylon sees: serial number, model and kind of connection; none is opened.

    Raises
    ------
    DeviceNotFound
        The package pypylon is not installed.
    """
    return [_found(info) for info in _library().TlFactory.GetInstance().EnumerateDevices()]


class PylonCamera(GenICamCamera):
    """A hardware-triggered Basler camera.

    Attributes
    ----------
    device : pypylon.pylon.InstantCamera or None
        The vendor's camera, while open.
    """

    kind = "pylon camera"

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self.device: Any = None
        self._pylon: Any = None
        self._genicam: Any = None

    def _claim(self) -> Found:
        self._pylon, self._genicam = _library(), library("pypylon.genicam")
        self._errors = (self._genicam.GenericException,)
        factory = self._pylon.TlFactory.GetInstance()
        infos = factory.EnumerateDevices()
        info = infos[self._choice([(_names(info), _found(info)) for info in infos])]
        self.device = self._pylon.InstantCamera(factory.CreateDevice(info))
        self.device.Open()
        return _found(info)

    def _release(self) -> None:
        device, self.device = self.device, None
        if device is not None:
            device.Close()

    def _arm(self, buffers: int) -> None:
        self.device.MaxNumBuffer.Value = buffers
        self.device.StartGrabbing(self._pylon.GrabStrategy_OneByOne)

    def _disarm(self) -> None:
        self.device.StopGrabbing()

    def _first_id(self) -> int | None:
        return _FIRST_ID.get(self.device.GetDeviceInfo().GetDeviceClass())

    def _receive(self, wait_s: float) -> Delivered | None:
        # RetrieveResult must not wait itself: after a start, its first wait may never end (pylon
        # 12.4)
        if self.device.GetGrabResultWaitObject().Wait(round(wait_s * 1e3)):
            result = self.device.RetrieveResult(0, self._pylon.TimeoutHandling_Return)
            if result:
                return self._delivered(result)
        if self.device.IsCameraDeviceRemoved():
            raise DeviceFault(
                f"{self.name}: the camera is gone; check its cable and power, then start a new run"
            )
        return None

    def _delivered(self, result: Any) -> Delivered:
        frame_id = None if result.BlockID == _NO_ID else int(result.BlockID)
        stamp = None
        if result.TimeStamp:
            ticks_per_s = self._node("GevTimestampTickFrequency", to_read=True)
            stamp = result.TimeStamp / (
                self._value(ticks_per_s) if ticks_per_s is not None else 1e9
            )
        if not result.GrabSucceeded():
            return Delivered(
                frame_id,
                stamp,
                None,
                f"grab failed: {result.ErrorDescription} (0x{result.ErrorCode:08x})",
            )
        image = result.Array  # an unpacked copy
        image.setflags(write=False)
        return Delivered(frame_id, stamp, image)

    def _node(self, name: str, *, to_read: bool = False) -> Any:
        node = self.device.GetNodeMap().GetNode(name)
        usable = self._genicam.IsReadable if to_read else self._genicam.IsWritable
        return node if node is not None and usable(node) else None

    def _value(self, node: Any) -> Any:
        return node.GetValue()

    def _assign(self, node: Any, value: Any) -> None:
        node.SetValue(value)

    def _offer(self, node: Any) -> tuple[str, ...]:
        if hasattr(node, "GetSettableValues"):
            return tuple(node.GetSettableValues())
        has_step = hasattr(node, "GetInc") and getattr(node, "HasInc", lambda: True)()
        step = f" in steps of {node.GetInc():g}" if has_step else ""
        return (f"{node.GetMin():g} to {node.GetMax():g}{step}",)


def _names(info: Any) -> set[str]:
    return {info.GetSerialNumber(), info.GetUserDefinedName(), info.GetFriendlyName()}


def _found(info: Any) -> Found:
    return Found(
        info.GetSerialNumber(),
        f"{info.GetVendorName()} {info.GetModelName()}"
        f" ({info.GetDeviceClass().removeprefix('Basler')})",
    )


def _library() -> Any:
    try:
        return library("pypylon.pylon")
    except ImportError as error:
        raise DeviceNotFound(
            f"pylon camera: its package cannot be loaded ({error}); to install it:"
            f" {installation.add('pypylon')}"
        ) from error
