"""A LabJack T7 through LabJack's own `labjack.ljm`, in stream mode.

The scans are the samples. The camera's triggers leave at FIO0 in the same stream, as a pattern that
the scan clock itself puts out, so that trigger and sample are never apart.
"""

from collections import deque
from contextlib import contextmanager

import numpy as np

from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import LostSamples, SampleBlock

SKIPPED = -9999.0  # what the library puts in the place of a scan that was lost
STREAM_OUT0, FIO_STATE, LONGEST = 4800, 2500, 4096  # two addresses; values of a pattern


class LabJackForces:
    """Sensors on `forces.channels`, such as AIN0; `forces.device` is its serial number."""

    counts_exposures = False

    def __init__(self, settings, clock):
        self.name = f"LabJack {settings.device}"
        self.sample_rate_hz, self.block_samples = clock.sample_rate_hz, settings.block
        self._settings, self._ljm, self._read, self._is_running = settings, None, deque(), False
        self._handle, self._next, self._waiting = 0, 0, []

    def open(self):
        try:
            from labjack import ljm
        except ImportError as error:
            raise DeviceNotFound(f"{self.name}: {error}; pip install labjack-ljm") from None
        self.close()
        with self._asked(ljm, "it", DeviceNotFound):
            self._handle = ljm.openS("T7", "ANY", self._settings.device)
            names = [*(f"{channel}_RANGE" for channel in self._settings.channels), "FIO0"]
            ljm.eWriteNames(self._handle, 3, names, [*self._settings.range, 0])  # FIO0: an output
        self._ljm = ljm

    def describe(self):
        return f"T7, {self._settings.channels}, triggers from FIO0"

    def start(self, train):
        if self._ljm is None or self._is_running:
            raise DeviceFault(f"{self.name}: it is not open, or runs; open it, or stop it first")
        if not 0 <= train.first < train.divisor <= LONGEST:
            raise OutOfLimits(f"{self.name}: {train} was requested; use {LONGEST} samples at most")
        ljm, inputs, rate = self._ljm, self._settings.channels, self.sample_rate_hz
        pattern = [0xFE00 + (n == train.first) for n in range(train.divisor)]  # of FIO0 only
        out = [("ENABLE", [0]), ("TARGET", [FIO_STATE]), ("BUFFER_ALLOCATE_NUM_BYTES", [8192])]
        out += [("ENABLE", [1]), ("BUFFER_U16", pattern), ("LOOP_NUM_VALUES", [train.divisor])]
        with self._asked(ljm, "a start"):
            for name, values in [*out, ("SET_LOOP", [1])]:
                ljm.eWriteNameArray(self._handle, f"STREAM_OUT0_{name}", len(values), values)
            scans = [*ljm.namesToAddresses(len(inputs), inputs)[0], STREAM_OUT0]
            ljm.eStreamStart(self._handle, self.block_samples, len(scans), scans, rate)
        self._next, self._waiting, self._is_running = 0, [], True
        self._read.clear()

    def read(self, timeout_s):
        if not self._is_running:
            raise DeviceFault(f"{self.name}: it does not run; read between start and stop")
        if not self._read:
            wait_ms = max(1, round(timeout_s * 1e3))
            with self._asked(self._ljm, "a block"):
                self._ljm.writeLibraryConfigS("LJM_STREAM_RECEIVE_TIMEOUT_MS", wait_ms)
                flat, *self._waiting = self._ljm.eStreamRead(self._handle)  # in device and library
            volts = np.array(flat[: 2 * self.block_samples]).reshape(-1, 2)  # inputs alone are read
            for part in np.split(volts, np.flatnonzero(np.diff(volts[:, 0] == SKIPPED)) + 1):
                gap = LostSamples(self._next, len(part), f"{self.name}: scans were skipped")
                block = SampleBlock(self._next, part.copy())
                self._read.append(gap if part[0, 0] == SKIPPED else block)
                self._next += len(part)
        return self._read.popleft()

    def backlog(self):
        return sum(self._waiting)

    def stop(self):
        if self._is_running:
            self._is_running = False
            with self._asked(self._ljm, "to stop"):
                self._ljm.eStreamStop(self._handle)

    def close(self):
        self.stop()
        ljm, self._ljm = self._ljm, None
        if ljm is not None:
            ljm.close(self._handle)

    @contextmanager
    def _asked(self, ljm, what, kind=DeviceFault):
        try:
            yield
        except ljm.LJMError as error:
            kind = DeviceTimeout if error.errorCode == ljm.errorcodes.NO_SCANS_RETURNED else kind
            raise kind(f"{self.name}: {what} was requested, LJM says {error}") from error
