"""The real pypylon on pylon's emulated camera: the driver's settings stay those of a triggered
camera, the tests supply the edges.
"""

import time

import cv2
import numpy as np
import pytest
from contracts import TRAIN, CameraContract
from driver_runs import end_of_a_waiting_read, packed, started

from drivers.cameras import pylon_camera as camera_pylon
from drivers.cameras.pylon_camera import PylonCamera
from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import Frame, LostFrame, TriggerTrain
from drivers.settings import CameraSettings

pylon = pytest.importorskip("pypylon.pylon")

SMALL = {"width": 64, "height": 64, "exposure": 0.001}


@pytest.fixture(autouse=True)
def one_emulated_camera(monkeypatch):
    monkeypatch.setenv("PYLON_CAMEMU", "1")


@pytest.fixture
def clock():
    return SampleClock(1000.0)


@pytest.fixture
def bench(clock):
    return Bench(clock)


@pytest.fixture
def make(clock):
    made = []

    def make(**changes):
        made.append(PylonCamera(CameraSettings(**(SMALL | changes)), clock))
        return made[-1]

    yield make
    for camera in made:
        camera.close()


class Bench:
    """The board beside the camera: lets samples pass, counts exposures if asked to, and sends the
    edges.
    """

    def __init__(self, clock, counts=False):
        self.clock, self.counts, self.began = clock, counts, []

    def run_until(self, camera, sample, triggers=(), train=TRAIN):
        """Up to `sample`, the camera sees the given triggers, as (index, samples late)."""
        if self.clock.phase == "idle":
            self.clock.start(counts_exposures=self.counts)
        for index, late in triggers:
            fire(camera)
            self.began.append(train.sample(index) + late)
        counts = (
            np.searchsorted(self.began, np.arange(self.clock.now, sample), side="right")
            if self.counts
            else None
        )
        self.clock.advance(sample, counts)


def fire(camera, times=1):
    assert camera.device.WaitForFrameTriggerReady(5000, pylon.TimeoutHandling_Return)
    for _ in range(times):
        camera.device.TriggerSoftware.Execute()


class TestPylonCamera(CameraContract):
    @pytest.fixture
    def camera(self, make):
        return make()

    @pytest.fixture
    def run_until(self, camera, bench):
        def run(sample):
            first = len(bench.began)
            passed = TRAIN.count_before(sample - camera.exposure_samples + 1)
            bench.run_until(camera, sample, [(index, 0) for index in range(first, passed)])

        return run

    @pytest.fixture
    def end_clock(self, clock):
        return clock.stop


# ------------------------------------------------------------------ what is lost


def test_missed_late_lost_and_failed_are_found_at_their_true_index(clock, make):
    camera, bench = make(), Bench(clock, counts=True)
    started(camera)
    bench.run_until(camera, 150, [(0, 0)])
    bench.run_until(camera, 195)  # trigger 1 is missed
    bench.run_until(camera, 290, [(2, 7)])
    answers = [camera.read(5.0) for _ in range(3)]
    camera.device.ForceFailedBufferCount.Value = 1
    camera.device.ForceFailedBuffer.Execute()
    bench.run_until(camera, 390, [(3, 0)])
    bench.run_until(camera, 490, [(4, 0)])
    answers += [camera.read(5.0) for _ in range(2)]
    assert [type(answer) for answer in answers] == [Frame, LostFrame, Frame, LostFrame, Frame]
    assert [answer.index for answer in answers] == [0, 1, 2, 3, 4]
    assert [answer.sample for answer in answers] == [0, 100, 207, 300, 400]
    assert "no exposure" in answers[1].reason
    assert "grab failed: The buffer was incompletely grabbed" in answers[3].reason
    assert camera.describe() == (
        "Basler Emulation (CamEmu): 64 x 64 Mono8, 1 ms, trigger Line1, TestImageSelector ="
        " Testimage2; frame numbers proved by counted exposures"
    )


def test_twenty_triggers_at_once_are_one_frame_and_nineteen_missed(clock, make):
    camera, bench = make(exposure=0.02), Bench(clock, counts=True)
    started(camera)
    bench.clock.start(counts_exposures=True)
    fire(camera, 20)
    bench.began.append(0)
    bench.run_until(camera, TRAIN.sample(20))
    answers = [camera.read(5.0) for _ in range(20)]
    assert isinstance(answers[0], Frame)
    assert [answer.index for answer in answers if isinstance(answer, LostFrame)] == list(
        range(1, 20)
    )


def test_a_missed_trigger_without_a_counter_leaves_uncertain_frames(make, bench):
    camera = started(make())
    bench.run_until(camera, 1000, [(n, 0) for n in range(9)])  # of ten
    answers = [camera.read(5.0) for _ in range(10)]
    assert [answer.index for answer in answers] == list(range(10))
    assert isinstance(answers[9], LostFrame)
    assert all(not answer.is_certain and answer.last >= 9 for answer in answers)


def test_images_wait_for_two_seconds_of_triggers(make, bench):
    train = TriggerTrain(0, 40)
    camera = started(make(), train)
    assert camera.device.MaxNumBuffer.Value == 50
    bench.run_until(camera, 2000, [(n, 0) for n in range(50)], train)
    assert [camera.read(5.0).index for _ in range(50)] == list(range(50))


def test_a_camera_that_is_unplugged_is_a_fault_at_once(make, bench):
    camera = started(make())
    bench.run_until(camera, 150, [(0, 0)])
    assert camera.read(5.0).index == 0
    camera.device.FirePnPCallback.Execute()
    began = time.monotonic()
    with pytest.raises(DeviceFault, match="pylon camera: the camera is gone; check its cable"):
        camera.read(600.0)
    assert time.monotonic() - began < 60.0
    camera.close()
    camera.open()  # plugged in again


def test_stop_ends_a_waiting_read(make):
    camera = started(make())
    error = end_of_a_waiting_read(camera, camera.stop, camera, "_receive")
    assert isinstance(error, DeviceTimeout)
    assert "stopped before the next frame" in str(error)


# ------------------------------------------------------------------ settings


@pytest.mark.parametrize(
    ("pixel_format", "full"),
    [("Mono8", 255), ("Mono10", 1023), ("Mono12", 4095), ("Mono16", 65535)],
)
def test_images_are_on_the_scale_of_their_format(make, bench, pixel_format, full):
    camera = make(pixel_format=pixel_format, height=300, width=256)
    camera.open()
    camera.device.TestImageSelector.Value = "Testimage1"  # a ramp of 8 bits, one level a pixel
    camera.start(TRAIN)
    bench.run_until(camera, 50, [(0, 0)])
    image = camera.read(5.0).image
    assert image.dtype == camera.dtype == (np.uint8 if pixel_format == "Mono8" else np.uint16)
    assert image.shape == (300, 256)
    assert full / 2 < image.max() <= full
    steps = np.unique(np.diff(np.unique(image)))
    assert steps.tolist() == [(full + 1) // 256]


@pytest.mark.parametrize("pixel_format", ["Mono12p", "Mono12packed", "Mono10p"])
def test_pypylon_unpacks_packed_formats_onto_their_own_scale(pixel_format):
    """The emulated camera offers no packed format: what the driver relies on, checked on a packed
    image made by hand.
    """
    values, raw = packed(pixel_format)
    image = pylon.PylonImage()
    image.AttachMemoryView(
        memoryview(bytearray(raw)), getattr(pylon, f"PixelType_{pixel_format}"), 4, 1, 0
    )
    assert image.Array.tolist() == [values]


def test_a_region_of_the_sensor(make, bench, tmp_path):
    sensor = np.random.default_rng(1).integers(0, 256, (200, 300), np.uint8)
    cv2.imwrite(str(tmp_path / "sensor.tiff"), sensor)
    camera = make(offset=(30, 20))
    camera.open()
    device = camera.device
    device.ImageFilename.Value, device.ImageFileMode.Value, device.TestImageSelector.Value = (
        str(tmp_path),
        "On",
        "Off",
    )
    camera.start(TRAIN)
    bench.run_until(camera, 50, [(0, 0)])
    np.testing.assert_array_equal(camera.read(5.0).image, sensor[20:84, 30:94])


def test_the_camera_is_set_as_asked(make):
    camera = make(gain=6.0, exposure=0.0125, trigger_line="Line2", exposure_line="Line3")
    camera.open()
    device = camera.device
    assert device.Gain.Value == pytest.approx(6.0, abs=0.1)
    assert device.ExposureTime.Value == 12500.0
    assert (device.TriggerSource.Value, device.TriggerActivation.Value) == ("Line2", "RisingEdge")
    for selector in device.TriggerSelector.Symbolics:
        device.TriggerSelector.Value = selector
        device.TriggerMode.Value = "On"  # as another program has left it
    camera._configure()
    modes = {}
    for selector in device.TriggerSelector.Symbolics:
        device.TriggerSelector.Value = selector
        modes[selector] = device.TriggerMode.Value
    assert [selector for selector, mode in modes.items() if mode == "On"] == ["FrameStart"]
    device.LineSelector.Value = "Line3"
    assert (device.LineMode.Value, device.LineSource.Value) == ("Output", "ExposureActive")


def older_names(camera, monkeypatch, names):
    """Let a camera have features under other names, as GigE cameras of older firmware do."""
    node = camera._node
    monkeypatch.setattr(
        camera, "_node", lambda name, **how: node(n) if (n := names.get(name, name)) else None
    )


def test_a_delay_of_the_trigger_is_reset_under_either_name(make, monkeypatch):
    camera = make()
    camera.open()
    for older in ({}, {"TriggerDelay": "", "TriggerDelayAbs": "TriggerDelay"}):
        camera.device.TriggerDelay.Value = 500.0
        with monkeypatch.context() as patch:
            older_names(camera, patch, older)
            camera._configure()
        assert camera.device.TriggerDelay.Value == 0.0


def test_a_gain_in_steps_is_refused_with_its_range(make, monkeypatch):
    camera = make(gain=0.0)
    older_names(camera, monkeypatch, {"Gain": ""})  # GainRaw only, as an acA1600-20gm
    with pytest.raises(
        OutOfLimits, match=r"gain of 0 dB .* GainRaw, 192 to 1023 in steps of 1; set"
    ):
        camera.open()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"width": 5000}, r"Width = 5000 was requested, it offers 1 to 4096"),
        ({"offset": (4090, 0)}, r"OffsetX = 4090 was requested, it offers 0 to 4032"),
        ({"exposure": 1e-7}, r"ExposureTime = 0\.\d+ was requested, it offers 1 to 1e\+07"),
        ({"gain": 60.0}, r"Gain = 60.0 was requested, it offers 0 to 48"),
        (
            {"trigger_line": "Line9"},
            r"TriggerSource = Line9 was requested, it offers .*Line1, Line2, Line3",
        ),
        (
            {"pixel_format": "Mono12p"},
            r"PixelFormat = Mono12p was requested, it offers Mono8, Mono10, Mono12, Mono16",
        ),
    ],
)
def test_what_can_not_be_set_is_refused_with_what_the_camera_offers(make, changes, sentence):
    camera = make(**changes)
    with pytest.raises(OutOfLimits, match=f"pylon camera: {sentence}"):
        camera.open()
    with pytest.raises(DeviceError):
        camera.start(TRAIN)


@pytest.mark.parametrize(
    ("exposure", "divisor", "limit"),
    [
        (
            0.05,
            42,
            "23.81 Hz asked, 20 Hz is its limit with an exposure of 50 ms; use a divisor of 50 or"
            " more",
        ),
        (0.001, 9, "use a divisor of 10"),
    ],
)
def test_triggers_faster_than_the_camera_are_refused(make, exposure, divisor, limit):
    camera = make(exposure=exposure)
    camera.open()
    with pytest.raises(OutOfLimits, match=limit):
        camera.start(TriggerTrain(0, divisor))


def test_exposure_and_gain_change_while_it_takes_images(make, bench):
    camera = started(make())
    bench.run_until(camera, 150, [(0, 0)])
    assert isinstance(camera.read(5.0), Frame)
    camera.adjust(0.002, 3.0)
    node = camera.device.GetNodeMap().GetNode
    exposure = node("ExposureTime") or node("ExposureTimeAbs")
    assert exposure.GetValue() == pytest.approx(2000, rel=0.01)
    bench.run_until(camera, 250, [(1, 0)])
    assert isinstance(camera.read(5.0), Frame)
    with pytest.raises(OutOfLimits, match="ExposureTime = 1e-06 was requested"):
        camera.adjust(1e-12, -1)
    assert exposure.GetValue() == pytest.approx(2000, rel=0.01)


def test_exposure_and_gain_that_are_set_by_hand_are_left_alone(make):
    camera = make(trigger_line="")
    camera.open()
    with pytest.raises(OutOfLimits, match=r"as it is set by hand; name camera\.trigger_line"):
        camera.adjust(0.002, 3.0)


# ------------------------------------------------------------------ which camera


def test_cameras_are_found_and_chosen_by_serial_number_or_name(make, monkeypatch):
    monkeypatch.setenv("PYLON_CAMEMU", "2")
    assert [(f.device, f.description) for f in camera_pylon.find()] == [
        ("0815-0000", "Basler Emulation (CamEmu)"),
        ("0815-0001", "Basler Emulation (CamEmu)"),
    ]
    for device in ("0815-0001", "Basler Emulation (0815-0001)"):
        camera = make(device=device)
        camera.open()
        assert camera.device.GetDeviceInfo().GetSerialNumber() == "0815-0001"
        camera.close()
    with pytest.raises(
        DeviceNotFound,
        match=r"there are 2: 0815-0000 .*; set camera\.device to the serial number of one",
    ):
        make().open()


def test_no_camera_and_a_wrong_serial_number(make, monkeypatch):
    with pytest.raises(
        DeviceNotFound,
        match=r"camera '4711': it was not found, there are: 0815-0000 \(Basler Emulation",
    ):
        make(device="4711").open()
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    assert camera_pylon.find() == []
    with pytest.raises(
        DeviceNotFound,
        match="pylon camera: it was not found, there are: none; check its cable and power",
    ):
        make().open()


def test_without_pypylon_the_sentence_says_what_to_install(make, monkeypatch):
    def missing(name):
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(camera_pylon, "library", missing)
    for call in (camera_pylon.find, make().open):
        with pytest.raises(DeviceNotFound, match=r'pip install "pypylon>=26"'):
            call()
