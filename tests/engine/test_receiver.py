"""When the camera counts as silent, in virtual time."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.acquisition.receiver import Receiver
from app.settings.sections import Config, Limits
from drivers import turns
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import Frame, TriggerTrain


class Bench:
    """A receiver before a camera whose images are delivered, and answered when the test says so."""

    def __init__(self, monkeypatch, divisor, block_s=0.05):
        self.now_s = 100.0
        monkeypatch.setattr(turns, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        self.camera = SimpleNamespace(name="camera", delivered=0)
        self.history = SimpleNamespace(end=0, exposure_samples=10, sample_rate_hz=1000.0)
        self.divisor, train = divisor, TriggerTrain(0, divisor)
        unused = [None] * 3
        self.receiver = Receiver(self.camera, train, self.history, *unused, Limits(), block_s)
        self.receiver.is_behind(drives=True)

    def pass_time(self, seconds):
        """Let time pass while another thread reads the clock."""
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self.receiver._turns.read()

    def wait(self, seconds, *, delivers, answers):
        """Let time pass in steps of the history."""
        began_s, before = self.now_s, self.camera.delivered
        for step in range(round(seconds / 0.05)):
            self.now_s = began_s + 0.05 * (step + 1)
            self.history.end += 50
            triggers = round((self.now_s - began_s) * 1000) // self.divisor
            self.camera.delivered = before + triggers * delivers
            if answers:
                self.receiver.received = self.camera.delivered
            self.receiver.is_behind(drives=True)


@pytest.mark.parametrize("divisor", [42, 125, 250])
def test_images_that_wait_for_a_proof_are_no_silence(monkeypatch, divisor):
    assert Limits().age == Config().limits.age == 0.8
    bench = Bench(monkeypatch, divisor)
    bench.wait(3.0, delivers=True, answers=True)
    bench.wait(2.0, delivers=True, answers=False)


@pytest.mark.parametrize(("divisor", "within_s"), [(42, 0.8), (125, 0.8), (250, 0.85)])
def test_a_camera_that_delivers_nothing_is_silent_within_the_limit(monkeypatch, divisor, within_s):
    bench = Bench(monkeypatch, divisor)
    bench.wait(3.0, delivers=True, answers=True)
    silent_s = bench.now_s
    with pytest.raises(DeviceTimeout, match=r"camera: no image came for 0\.\d+ s, trigger \d+"):
        bench.wait(3.0, delivers=False, answers=False)
    assert bench.now_s - silent_s <= within_s + 0.05


def test_the_time_in_which_the_program_was_suspended_is_no_silence(monkeypatch):
    bench = Bench(monkeypatch, 125)
    bench.wait(3.0, delivers=True, answers=True)
    bench.now_s += 60.0
    bench.history.end += 60_000  # which the board has kept
    assert bench.receiver.is_behind(drives=True)
    bench.wait(0.2, delivers=True, answers=True)
    with pytest.raises(DeviceTimeout, match="camera: no image came for"):
        bench.wait(3.0, delivers=False, answers=False)


def test_a_camera_is_given_up_as_early_beside_long_blocks_of_forces(monkeypatch):
    bench = Bench(monkeypatch, 125, block_s=0.5)
    bench.receiver.is_behind(drives=False)
    bench.history.end = 1000
    for _ in range(6):
        bench.now_s += 0.5
        assert bench.receiver.is_behind(drives=False)
    bench.now_s += 0.5
    with pytest.raises(DeviceTimeout, match="no image came for 3 s"):
        bench.receiver.is_behind(drives=False)


def test_a_camera_that_does_not_tell_its_deliveries_is_judged_by_its_answers(monkeypatch):
    bench = Bench(monkeypatch, 125)
    bench.wait(3.0, delivers=True, answers=True)
    del bench.camera.delivered
    bench.now_s, bench.history.end = bench.now_s + 0.3, bench.history.end + 300
    assert bench.receiver.is_behind(drives=True)
    bench.pass_time(0.5)
    with pytest.raises(DeviceTimeout, match="no image came"):
        bench.receiver.is_behind(drives=True)


def test_an_image_that_is_being_drawn_is_no_silence_while_nothing_is_driven(monkeypatch):
    bench = Bench(monkeypatch, 125)
    bench.camera.is_drawing = True
    bench.now_s, bench.history.end = bench.now_s + 30, bench.history.end + 300
    assert bench.receiver.is_behind(drives=False)
    bench.pass_time(4)
    with pytest.raises(DeviceTimeout, match="no image came"):
        bench.receiver.is_behind(drives=True)
    bench.camera.is_drawing = False
    with pytest.raises(DeviceTimeout, match="no image came for 3 s"):
        bench.receiver.is_behind(drives=False)


def test_an_image_that_comes_after_its_camera_was_given_up_counts_no_more(monkeypatch):
    bench, records = Bench(monkeypatch, 125), []
    receiver = bench.receiver
    receiver._recorder = SimpleNamespace(append=records.append)
    receiver._to_analysis = SimpleNamespace(end=lambda: None, put=records.append)
    receiver._ending = SimpleNamespace(reason="the camera was given up")
    bench.history.end = 126
    receiver._account()
    assert [record.index for record in records] == [0, 1]
    bench.history.has_ended = False
    images = iter([Frame(0, 0, np.zeros((2, 2), np.uint8))])
    bench.camera.read = lambda timeout_s: next(images)
    receiver._receive()
    assert (receiver.received, receiver.lost, len(records)) == (0, 2, 2)


def test_an_image_that_is_written_over_one_that_still_waits_is_refused(monkeypatch):
    """As by a driver that hands out the buffers of its library's ring."""
    bench, waiting = Bench(monkeypatch, 125), []
    receiver = bench.receiver
    receiver._recorder = SimpleNamespace(append=waiting.append)
    receiver._to_analysis = SimpleNamespace(put=lambda frame: None)
    receiver._ending = SimpleNamespace(is_called=SimpleNamespace(is_set=lambda: False))
    bench.history.end, bench.history.has_ended = 5000, False
    ring, numbers = np.zeros((3, 2, 2), np.uint8), iter(range(100))
    bench.camera.shape, bench.camera.dtype = (2, 2), np.dtype(np.uint8)

    def read(timeout_s):
        index = next(numbers)
        if index < 10:
            del waiting[:-1]  # written in time
        return Frame(index, 125 * index, ring[index % 3])

    bench.camera.read = read
    refused = "trigger 11 was due, its driver gave an image in the memory of that of an earlier"
    with pytest.raises(DeviceFault, match=refused):
        receiver._receive()
    assert receiver.received == 11
