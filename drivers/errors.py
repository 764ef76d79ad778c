"""What can go wrong with a device, as one small tree.

Every message is one sentence that an operator can act on: who, what was asked, what was found, what
to do.
"""


class DeviceError(Exception):
    """A device can not do what the bench needs; the message says who, what and what to do."""


class DeviceNotFound(DeviceError):
    """The device, or the vendor library that drives it, is not there."""


class DeviceTimeout(DeviceError):
    """The device did not answer, or sent no data, in the time it had."""


class OutOfLimits(DeviceError):
    """A command asked for a position, speed or rate outside the device's limits; nothing was done."""


class DeviceFault(DeviceError):
    """The device reported a failure of its own: stalled, overflowed, unplugged."""
