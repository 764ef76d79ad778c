"""The emulated camera in front of the simulated world: the contract, pictures to the bit, and every
fault at its true index.
"""

import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from contracts import TRAIN, CameraContract
from driver_runs import started
from worlds import scenario

from drivers.clock import SampleClock
from drivers.emulators.camera import EmulatedPylonCamera
from drivers.errors import DeviceFault, DeviceTimeout, OutOfLimits
from drivers.protocols import Frame, LostFrame, TriggerTrain
from drivers.sim.images import Renderer
from drivers.sim.row_times import states_shown
from drivers.sim.world import World

pytest.importorskip("pypylon")

SHAPE = (96, 128)
FREE = scenario(width=128, height=96, press_time=3600.0)
PRESSED = scenario(FREE, press_time=0.1, press_samples=100, pixel=100e-6)


class Here:
    """A world, its clock, and an emulated camera of the world's settings."""

    def __init__(self, scenario, pace=None, camera=None):
        self.world, self.clock = World(scenario, pace), SampleClock(1000.0)
        self.camera = EmulatedPylonCamera(camera or scenario.camera, self.clock, self.world)


def board(here, counts, until):
    """Lets the world's time pass up to a sample and feeds the clock, as forces do that are read."""
    world, clock = here.world, here.clock
    while world.now < until:
        assert world.wait_for_turn(50, 60.0)
        first = world.advance(50).first
        clock.advance(world.now, world.exposure_counts(first, 50) if counts else None)


def run(here, train, samples, counts=True):
    """All answers of a run with two threads, and the error that ended it."""
    camera = started(here.camera, train)
    here.clock.start(counts_exposures=counts)
    here.world.start(train)
    answers, error = [], None

    def forces():
        board(here, counts, samples)
        here.world.stop()
        here.clock.stop()

    sampling = threading.Thread(target=forces)
    sampling.start()
    try:
        while len(answers) < train.count_before(samples - camera.exposure_samples + 1):
            answers.append(camera.read(20.0))
    except (DeviceFault, DeviceTimeout) as caught:
        error = caught
    camera.stop()
    here.world.watch(None)
    sampling.join()
    camera.close()
    return answers, error


class TestEmulatedPylonCamera(CameraContract):
    @pytest.fixture
    def here(self):
        return Here(FREE)

    @pytest.fixture
    def camera(self, here):
        yield here.camera
        here.camera.close()

    @pytest.fixture
    def run_until(self, here):
        def run(sample):
            if here.world.phase == "idle":
                here.clock.start()
                here.world.start(TRAIN)
            here.world.advance(sample - here.world.now)
            here.clock.advance(sample)

        return run

    @pytest.fixture
    def end_clock(self, here):
        def end():
            here.world.stop()
            here.clock.stop()

        return end


@pytest.mark.parametrize(("pace", "readout"), [(None, 0.0), (4.0, 0.0), (None, 0.015)])
def test_each_picture_is_that_of_its_pulse_to_the_bit(pace, readout):
    here, train = Here(scenario(PRESSED, readout=readout), pace), TriggerTrain(3, 42)
    answers, error = run(here, train, 1000)
    assert error is None
    renderer = Renderer(here.world.scenario)
    assert [(a.index, a.sample) for a in answers] == [(n, train.sample(n)) for n in range(24)]
    for frame in answers:
        first, *later = states_shown(here.world, frame.sample)
        assert first == here.world.state(frame.sample + PRESSED.exposure_samples // 2)
        assert bool(later) == bool(readout)
        expected = renderer.image(first, frame.index, *later)
        np.testing.assert_array_equal(frame.image, expected)
    assert len({frame.image.tobytes() for frame in answers}) == 24


def test_every_fault_is_found_at_its_true_index():
    faults = (
        "lost-trigger 4 2",
        "late-trigger 8 9",
        "lost-frame 12 2",
        "corrupt-frame 16",
        "lost-frame 23",
    )
    here, train = Here(scenario(PRESSED, faults=faults)), TriggerTrain(0, 42)
    answers, error = run(here, train, 1000)
    assert error is None
    assert [a.index for a in answers] == list(range(24))
    lost = {a.index: a.reason for a in answers if isinstance(a, LostFrame)}
    assert set(lost) == {4, 5, 12, 13, 23}
    assert all("counted no exposure" in lost[n] for n in (4, 5))
    assert all("grab failed" in lost[n] for n in (12, 13, 23))
    frames = {a.index: a for a in answers if isinstance(a, Frame)}
    assert {
        n: frame.sample - train.sample(n)
        for n, frame in frames.items()
        if frame.sample != train.sample(n)
    } == {8: 9}
    renderer = Renderer(here.world.scenario)
    upper = SHAPE[0] // 2
    for n, frame in frames.items():
        expected = renderer.image(here.world.state(frame.sample + PRESSED.exposure_samples // 2), n)
        np.testing.assert_array_equal(frame.image[:upper], expected[:upper])
        assert np.array_equal(frame.image[upper:], expected[upper:]) == (n != 16)


def test_a_missed_trigger_that_no_counter_proves_leaves_uncertain_frames():
    here = Here(scenario(PRESSED, faults=("lost-trigger 4",)))
    answers, _ = run(here, TriggerTrain(0, 42), 1000, counts=False)
    assert not any(answer.is_certain for answer in answers[4:])


def test_a_camera_that_goes_is_a_fault_after_its_last_image():
    here = Here(scenario(PRESSED, faults=("camera-gone 5",)), 4.0)
    answers, error = run(here, TriggerTrain(0, 42), 1000)
    assert [type(answer) for answer in answers[:5]] == 5 * [Frame]
    assert not [answer for answer in answers[5:] if isinstance(answer, Frame)]
    assert isinstance(error, DeviceFault)
    assert "emulated pylon camera: the camera is gone" in str(error)


def test_what_stops_the_emulation_is_told(monkeypatch):
    def no_room(*_):
        raise OSError("no space left on the device")

    here = Here(PRESSED)
    camera = here.camera
    camera.open()
    monkeypatch.setattr(camera, "_put", no_room)
    camera.start(TRAIN)
    here.clock.start()
    here.world.start(TRAIN)
    board(here, False, 50)
    camera._thread.join(20.0)
    with pytest.raises(DeviceFault, match="the emulation failed, no space left on the device"):
        camera.read(1.0)
    camera.close()


@pytest.mark.parametrize("changes", [{"width": 64}, {"pixel_format": "Mono12"}])
def test_other_images_than_those_of_the_world_are_refused(changes):
    camera = Here(PRESSED, camera=replace(PRESSED.camera, **changes)).camera
    with pytest.raises(
        OutOfLimits, match="the world that it sees is 128 x 96 Mono8; set both alike"
    ):
        camera.open()


def test_it_runs_the_real_driver_and_leaves_nothing_behind(monkeypatch):
    monkeypatch.delenv("PYLON_CAMEMU", raising=False)
    camera = Here(PRESSED).camera
    camera.open()
    assert "PYLON_CAMEMU" not in os.environ
    folder = camera._folder.name
    assert camera.describe().startswith(
        "Basler Emulation (CamEmu): 128 x 96 Mono8, 10 ms, trigger Line1"
    )
    assert camera.device.TriggerSource.Value == "Line1"
    camera.close()
    assert not Path(folder).exists()
    assert "emulated camera" not in {thread.name for thread in threading.enumerate()}
