"""LabJack's library as the driver sees it, with a device whose sensors follow a script: a normal
force that is pressed on after a second, in real time or as fast as it is read.
"""

import sys
import time
import types


class LJMError(Exception):
    """An error of the library."""

    def __init__(self, code, text):
        super().__init__(text)
        self.errorCode = code


class Device:
    """The device: registers that were written, and its stream."""

    def __init__(self, volts, *, paced):
        self.volts, self.paced = volts, paced
        self.registers, self.stream, self.skipped = {}, None, range(0)

    def start(self, scans_per_read, scan_list, rate):
        if self.stream:
            raise LJMError(1300, "LJME_STREAM_IS_ACTIVE")
        self.stream = types.SimpleNamespace(
            n=scans_per_read, list=scan_list, rate=rate, next=0, began=time.monotonic()
        )
        return rate

    def read(self, timeout_s):
        stream = self.stream
        if stream is None:
            raise LJMError(1303, "LJME_STREAM_NOT_RUNNING")
        first, stream_end = stream.next, stream.next + stream.n
        wait = stream.began + stream_end / stream.rate - time.monotonic() if self.paced else 0.0
        if wait > timeout_s:
            time.sleep(timeout_s)
            raise LJMError(1306, "LJME_NO_SCANS_RETURNED")
        time.sleep(max(0.0, wait))
        stream.next = stream_end
        scans = range(first, stream_end)
        flat = [
            -9999.0 if scan in self.skipped else volt
            for scan in scans
            for volt in self.volts(scan / stream.rate)
        ]
        flat += [0.0] * (stream.n * len(stream.list) - len(flat))  # outputs count, and are not read
        behind = int((time.monotonic() - stream.began) * stream.rate) - stream_end
        return flat, 0, max(0, behind) if self.paced else 0

    def triggers(self):
        """Samples of a period at which FIO0 is on; none while it is an input, as FIO_STATE leaves
        it.
        """
        pattern = self.registers["STREAM_OUT0_BUFFER_U16"] if "FIO0" in self.registers else []
        return [n for n, value in enumerate(pattern) if value & 1]


def install(monkeypatch, device):
    """Let `from labjack import ljm` find a library with this device."""
    ljm, config = types.ModuleType("labjack.ljm"), {}
    ljm.LJMError = LJMError
    ljm.errorcodes = types.SimpleNamespace(NO_SCANS_RETURNED=1306)

    def open_s(model, connection, identifier):
        if identifier != "440010":
            raise LJMError(1227, "LJME_DEVICE_NOT_FOUND")
        return 1

    def end(handle):
        device.stream = None

    ljm.openS = open_s
    ljm.close = end
    ljm.eStreamStop = end
    write = device.registers.update
    ljm.eWriteNames = lambda handle, n, names, values: write(zip(names, values, strict=True))
    ljm.eWriteNameArray = lambda handle, name, n, values: write({name: values})
    ljm.namesToAddresses = lambda n, names: ([2 * int(name[3:]) for name in names], [3] * n)
    ljm.eStreamStart = lambda handle, n, count, scans, rate: device.start(n, scans, rate)
    ljm.eStreamRead = lambda handle: device.read(config["LJM_STREAM_RECEIVE_TIMEOUT_MS"] / 1e3)
    ljm.writeLibraryConfigS = lambda name, value: config.update({name: value})
    package = types.ModuleType("labjack")
    package.ljm = ljm
    monkeypatch.setitem(sys.modules, "labjack", package)
    monkeypatch.setitem(sys.modules, "labjack.ljm", ljm)
