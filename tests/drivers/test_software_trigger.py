"""A camera whose images the program asks for, and that does not give them."""

import threading

import numpy as np
import pytest
from driver_runs import pass_time, started

from drivers.cameras import software_trigger
from drivers.cameras.software_trigger import SoftwareTriggered
from drivers.clock import SampleClock
from drivers.errors import DeviceTimeout
from drivers.protocols import TriggerTrain
from drivers.settings import CameraSettings


class Hanging(SoftwareTriggered):
    name = "webcam"

    def __init__(self, clock):
        super().__init__(CameraSettings(), clock, 0.01)
        self.grabs, self.may_return, self.released = threading.Event(), threading.Event(), []

    def claim(self):
        pass

    def grab(self):
        self.grabs.set()
        self.may_return.wait(60)
        return np.zeros(self.shape, self.dtype)

    def release(self):
        self.released.append(True)


def test_a_camera_that_does_not_return_keeps_nobody(monkeypatch):
    monkeypatch.setattr(software_trigger, "PATIENCE_S", 0.1, raising=False)
    clock = SampleClock(1000.0)
    camera = started(Hanging(clock))
    (thread,) = (t for t in threading.enumerate() if t.name == "webcam")
    pass_time(clock, 150)
    assert camera.grabs.wait(30)
    assert thread.daemon  # it does not keep the program
    problems, returned = [], threading.Event()

    def close():
        try:
            camera.close()
        except DeviceTimeout as error:
            problems.append(str(error))
        returned.set()

    threading.Thread(target=close, daemon=True).start()
    assert returned.wait(30)
    assert "webcam: it did not return from a call within 0.1 s" in problems[0]
    assert not camera.released  # the library is in use
    with pytest.raises(DeviceTimeout, match="did not return"):
        camera.start(TriggerTrain(0, 100))  # no second thread beside the first
    camera.may_return.set()
    thread.join(30)
    camera.close()
    assert camera.released


class Webcam(Hanging):
    def grab(self):
        return np.zeros(self.shape, self.dtype)


def test_triggers_that_were_passed_over_are_losses_and_an_image_is_as_old_as_the_latency():
    clock = SampleClock(1000.0)
    pass_time(clock, 305)  # 10 samples of latency: it may show the sample 295, or 315
    camera = started(Webcam(clock))
    answers = [camera.read(30.0) for _ in range(4)]
    camera.close()
    assert [answer.index for answer in answers] == [0, 1, 2, 3]
    assert all("the next trigger came first" in lost.reason for lost in answers[:3])
    assert (answers[3].sample, answers[3].first, answers[3].last) == (300, 2, 4)
