"""What tests do to a driver: they open and start it, let its clock pass, end a read of it that
waits, and give it packed pixels.
"""

import threading

import pytest
from contracts import TRAIN, CameraContract

PATIENT_S = 60.0


def started(device, train=TRAIN):
    """A device, opened and started."""
    device.open()
    device.start(train)
    return device


def pass_time(clock, sample):
    """Let a clock come to `sample`, and begin where it has not."""
    if clock.phase == "idle":
        clock.start()
    clock.advance(sample)


class ClockedCameraContract(CameraContract):
    """Fixtures `camera` and its `clock`, which alone says how far a run has come."""

    @pytest.fixture
    def run_until(self, clock):
        return lambda sample: pass_time(clock, sample)

    @pytest.fixture
    def end_clock(self, clock):
        return clock.stop


def end_of_a_waiting_read(device, end, asked, name):
    """What a thread that reads and reads ends with, as `end` is called once it waits in the method
    `name` of `asked`.
    """
    errors, waits = [], threading.Event()
    method = getattr(asked, name)
    setattr(asked, name, lambda *args: (waits.set(), method(*args))[1])

    def read():
        try:
            while True:
                device.read(PATIENT_S)
        except Exception as error:
            errors.append(error)

    reader = threading.Thread(target=read)
    reader.start()
    assert waits.wait(PATIENT_S)
    end()
    reader.join(PATIENT_S)
    assert not reader.is_alive()
    return errors[0]


def packed(pixel_format):
    """Four pixels of 10 bits, and their bytes in a packed format of 10 or 12."""
    values, bits = [0x123, 0x2BC, 0x3FF, 0x001], int(pixel_format[4:6])
    if pixel_format.endswith("p"):  # one stream of bits, lowest first
        return values, sum(v << bits * i for i, v in enumerate(values)).to_bytes(
            bits // 2, "little"
        )
    # eight high bits of the first, then the low bits of both, then eight high bits of the second
    pairs = values[:2], values[2:]
    return values, b"".join(bytes([x >> 4, x & 15 | (y & 15) << 4, y >> 4]) for x, y in pairs)
