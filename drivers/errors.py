"""What can go wrong with a device, as one small tree of errors.

Every message is one sentence that an operator can act on: which device, what it should have done,
what happened instead, and what to do about it.
"""


class DeviceError(Exception):
    """A device cannot do what the bench needs."""


class DeviceNotFound(DeviceError):
    """The device, or the vendor library that drives it, is not there."""


class DeviceTimeout(DeviceError):
    """The device did not answer, or sent no data, within the time it was given."""


class OutOfLimits(DeviceError):
    """A requested position, speed or rate is outside the device's limits; nothing was done."""


class DeviceFault(DeviceError):
    """The device reported a failure of its own: it stalled, overflowed or was unplugged."""
