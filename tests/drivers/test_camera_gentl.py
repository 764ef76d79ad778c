"""The real harvesters on the emulated GenTL producer that comes with the genicam package.

Its cameras run freely and have neither trigger nor exposure. What needs a trigger (that no image
comes without one, missed and late ones, how trigger and exposure are set) is tested with pylon's
camera on the same code, `drivers.cameras.genicam_camera`.
"""

import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from contracts import TRAIN
from driver_runs import ClockedCameraContract, end_of_a_waiting_read, packed, pass_time, started

from drivers.cameras import gentl_camera as camera_gentl
from drivers.cameras.genicam_camera import _NEUTRAL
from drivers.cameras.gentl_camera import GenTLCamera
from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.frame_matching import witnesses
from drivers.protocols import Found, TriggerTrain
from drivers.settings import CameraSettings

genicam = pytest.importorskip("genicam")
pytest.importorskip("harvesters")
# the package may lack a library of the system, as that of Python
pytest.importorskip("genicam.gentl", exc_type=ImportError)

PRODUCER = str(Path(genicam.__file__).with_name("viky.cti"))


@pytest.fixture
def clock():
    return SampleClock(1000.0)


@pytest.fixture
def make(clock):
    made = []

    def make(**changes):
        settings = {
            "height": 100,
            "width": 120,
            "producer": PRODUCER,
            "device": "1",
            "trigger_line": "",
        } | changes
        made.append(GenTLCamera(CameraSettings(**settings), clock))
        return made[-1]

    yield make
    for camera in made:
        camera.close()


class TestGenTLCamera(ClockedCameraContract):
    @pytest.fixture
    def camera(self, make):
        return make()

    # a camera that runs freely sends images without triggers
    test_a_trigger_that_has_not_come_is_a_timeout_and_may_still_come = None
    test_what_was_exposed_when_the_clock_ended_can_still_be_read = None


def test_images_are_those_of_the_producer_in_order(make, clock, monkeypatch):
    # a busy machine may let the producer wait for seconds
    monkeypatch.setattr(witnesses, "PATIENCE_S", 60.0)
    camera = make()
    camera.open()
    assert camera.describe() == (
        "Machine Vision Games Ltd. Viky (Custom): 120 x 100 Mono8, trigger and"
        " exposure as the camera is set"
    )
    camera.start(TRAIN)
    pass_time(clock, 10_000)
    frames = [camera.read(60.0) for _ in range(20)]
    assert [frame.index for frame in frames] == list(range(20))
    assert len({frame.image.tobytes() for frame in frames}) > 10  # a ball moves
    assert all(
        frame.image.shape == (100, 120) and frame.image.dtype == np.uint8 for frame in frames
    )
    assert camera.describe().endswith("; frame numbers inferred from their order")


@pytest.mark.parametrize(
    ("timestamp", "clock_of"),
    [(2_500_000, {"timestamp_frequency": 1_000_000}), (2_500_000_000, {})],
)
def test_timestamps_are_those_of_the_camera_s_clock(make, timestamp, clock_of):
    camera = make()
    camera.open()
    buffer = SimpleNamespace(frame_id=7, timestamp=timestamp, payload=None, **clock_of)
    assert camera._delivered(buffer).timestamp_s == 2.5


def test_images_without_triggers_are_a_fault(make, clock):
    camera = started(make(), TriggerTrain(0, 1000))
    pass_time(clock, 1500)
    assert [camera.read(5.0).index for _ in range(2)] == [0, 1]
    with pytest.raises(DeviceFault, match="an image came long before trigger 4"):
        camera.read(5.0)


def test_it_can_be_stopped_and_started_again(make, clock):
    camera = make()
    camera.open()
    pass_time(clock, 10_000)
    for _ in range(3):
        camera.start(TRAIN)
        assert [camera.read(5.0).index for _ in range(2)] == [0, 1]
        camera.stop()


def test_stop_ends_a_waiting_read(make):
    camera = started(make())
    camera._acquirer.remote_device.node_map.AcquisitionStop.execute()
    error = end_of_a_waiting_read(camera, camera.stop, camera, "_receive")
    assert isinstance(error, DeviceTimeout | DeviceFault)


def test_the_interrupt_key_stays_ours(make):
    handler = signal.getsignal(signal.SIGINT)
    camera = make()
    camera.open()
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"width": 2000},
            "camera '1': Width = 2000 was requested, it offers 100 to 800 in steps of 1",
        ),
        ({"pixel_format": "Mono12"}, "PixelFormat = Mono12 was requested, it offers RGBa8, Mono8"),
        (
            {"trigger_line": "Line1"},
            "ExposureTime = 10000.0 was requested, it has no such feature that can be set; see its"
            " manual",
        ),
        ({"offset": (10, 0)}, "OffsetX = 10 was requested, it has no such feature"),
        ({"gain": 3.0}, "Gain = 3.0 was requested, it has no such feature"),
        ({"exposure_line": "Line2"}, "LineSelector = Line2 was requested, it has no such feature"),
    ],
)
def test_what_can_not_be_set_is_refused_with_what_the_camera_offers(make, changes, sentence):
    camera = make(**changes)
    with pytest.raises(OutOfLimits, match=sentence):
        camera.open()


@pytest.mark.parametrize("pixel_format", ["Mono12Packed", "Mono12p", "Mono10p"])
def test_harvesters_unpacks_packed_formats_onto_their_own_scale(pixel_format):
    """The producer offers no packed format: what the driver relies on, checked on bytes packed by
    hand.
    """
    from harvesters.util import pfnc

    values, raw = packed(pixel_format)
    assert getattr(pfnc, pixel_format)().expand(np.frombuffer(raw, np.uint8)).tolist() == values


def test_cameras_are_found_by_producer_and_by_registration(make, monkeypatch):
    expected = [(str(n), "Machine Vision Games Ltd. Viky (Custom)") for n in range(3)]
    assert [(f.device, f.description) for f in camera_gentl.find(PRODUCER)] == expected
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(Path(PRODUCER).parent))
    assert [(f.device, f.description) for f in camera_gentl.find()] == expected
    monkeypatch.setenv("GENICAM_GENTL64_PATH", "")
    assert camera_gentl.find() == []
    with pytest.raises(
        DeviceNotFound,
        match=r"there are 3: 0 \(Machine Vision Games.*; set camera\.device to the serial number"
        r" of one",
    ):
        make(device="").open()
    with pytest.raises(
        DeviceNotFound, match=r"camera '7': it was not found, there are: 0 \(Machine"
    ):
        make(device="7").open()


def test_a_producer_that_can_not_be_loaded(make, tmp_path):
    broken = tmp_path / "broken.cti"
    broken.write_bytes(b"x")
    with pytest.raises(
        DeviceNotFound,
        match=r"broken\.cti' cannot be loaded \(.*file too short\); install the GenTL",
    ):
        make(producer=str(broken)).open()
    with pytest.raises(DeviceNotFound, match=r"missing\.cti' cannot be loaded \(.*No such file"):
        camera_gentl.find(str(tmp_path / "missing.cti"))


def test_without_harvesters_the_sentence_says_what_to_install(make, monkeypatch):
    def missing(name):
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(camera_gentl, "library", missing)
    for call in (camera_gentl.find, make().open):
        with pytest.raises(DeviceNotFound, match=r'pip install "harvesters>=1\.4\.3"'):
            call()


# ------------------------------------------------------------------ behind a frame grabber


@pytest.fixture
def grabber(make, monkeypatch):
    """Opens a camera that describes no features, or not these; its size and format are set by the
    program of the frame grabber, and it runs as that lets it.
    """
    core = pytest.importorskip("harvesters.core")
    create = core.Module._create_node_map
    own = []

    def described(module, **how):
        nodes = create(module, **how)
        if not isinstance(module, core.RemoteDevice):
            return nodes
        own.append(nodes)
        return core.NodeMap()

    monkeypatch.setattr(core.Module, "_create_node_map", described)

    def opened(has, *, width=120, height=100, pixel_format="Mono8", **changes):
        if has is not None:
            monkeypatch.setattr(core.Module, "_create_node_map", create)
        camera = make(**changes)
        node = camera._node
        if has is not None:
            monkeypatch.setattr(camera, "_node", lambda name, **k: node(name, **k) if has else None)
        camera.open()
        nodes = own[-1] if own else camera._acquirer.remote_device.node_map
        nodes.PixelFormat.value, nodes.Width.value = pixel_format, width
        nodes.Height.value = height
        if own:  # the stream of a frame grabber says it, this one does not
            camera._acquirer.remote_device.node_map.PayloadSize.value = nodes.PayloadSize.value
        arm = camera._arm

        def arm_and_run(buffers):
            arm(buffers)
            if own:
                nodes.AcquisitionStart.execute()

        monkeypatch.setattr(camera, "_arm", arm_and_run)
        return camera

    return opened


@pytest.mark.parametrize("has", [None, ()])
def test_a_camera_without_features_is_used_as_its_frame_grabber_sets_it(grabber, clock, has):
    camera = grabber(has)
    assert "120 x 100 Mono8, trigger and exposure as the camera is set" in camera.describe()
    camera.start(TRAIN)
    pass_time(clock, 10_000)
    frames = [camera.read(60.0) for _ in range(3)]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert all(frame.image.shape == (100, 120) for frame in frames)
    camera.stop()
    camera.close()


@pytest.mark.parametrize("has", [None, ()])
@pytest.mark.parametrize(
    ("other", "found"),
    [
        ({"width": 140}, "140 x 100 px of Mono8"),
        ({"width": 100, "height": 120}, "100 x 120 px of Mono8"),
        ({"pixel_format": "RGBa8"}, "120 x 100 px of RGBa8"),
    ],
)
def test_images_of_a_frame_grabber_that_are_not_as_the_settings_say_are_told(
    grabber, clock, has, other, found
):
    camera = grabber(has, **other)
    camera.start(TRAIN)
    pass_time(clock, 10_000)
    with pytest.raises(DeviceFault, match=f"its images are {found}, and the settings say 120 x 1"):
        camera.read(60.0)


def test_what_a_frame_grabber_alone_can_set_is_refused_with_what_to_write(grabber):
    with pytest.raises(
        OutOfLimits, match=r"ExposureTime = .*no such feature .*leave camera\.trigger_line and"
    ):
        grabber(None, trigger_line="Line1")


def test_a_producer_that_gives_no_way_to_the_camera_is_told(make, monkeypatch):
    core = pytest.importorskip("harvesters.core")
    monkeypatch.setattr(core.Module, "_create_node_map", lambda module, **how: None)
    with pytest.raises(DeviceFault, match="gives no way to the camera that harvesters can use"):
        make().open()


def test_a_feature_that_can_only_be_read_must_have_the_value_asked(make, monkeypatch):
    camera = make()
    node = camera._node

    def read_only(name, *, to_read=False):
        return None if name == "Width" and not to_read else node(name, to_read=to_read)

    monkeypatch.setattr(camera, "_node", read_only)
    with pytest.raises(
        OutOfLimits, match=r"Width = 120 was requested, it is \d+ and cannot be set from here"
    ):
        camera.open()


@pytest.mark.parametrize(
    ("offered", "chosen"),
    [
        (("Off", "ReadOut", "PreviousFrame"), ["ReadOut"]),
        (("Off", "PreviousFrame"), ["PreviousFrame"]),
        (("Off",), []),
        (None, []),
    ],
)
def test_triggers_during_the_readout_count_where_the_camera_can(make, monkeypatch, offered, chosen):
    camera, assigned = make(trigger_line="Line1"), []
    given = None if offered is None else "TriggerOverlap"
    monkeypatch.setattr(camera, "_node", lambda n, **_: given if n == given else f"node {n}")
    monkeypatch.setattr(camera, "_offer", lambda n: offered if n == given else ())
    monkeypatch.setattr(camera, "_assign", lambda n, value: assigned.append((n, value)))
    camera._set_trigger("Line1")
    assert [value for n, value in assigned if n == "TriggerOverlap"] == chosen
    assert ("node TriggerMode", "On") in assigned
    line = [("LineSelector", "Line1"), ("LineMode", "Input"), ("LineInverter", False)]
    assert assigned[-3:] == [(f"node {name}", value) for name, value in line]


def set_by_hand(camera, monkeypatch, held, offered=(), value=None):
    """Open a camera that has these features and values, and all others as they are set to."""
    others = {"SensorShutterMode", "ShutterMode", "TestPattern", "Gamma", "ReverseX"} - held.keys()
    monkeypatch.setattr(camera, "_node", lambda n, **_: None if n in others else n)
    monkeypatch.setattr(camera, "_offer", lambda n: offered if n.endswith("ShutterMode") else ())
    monkeypatch.setattr(camera, "_assign", held.__setitem__)
    value = value or (lambda n: held.get(n, _NEUTRAL.get(n)))
    monkeypatch.setattr(camera, "_value", value)
    monkeypatch.setattr(camera, "_claim", lambda: Found("1", "camera X"))
    monkeypatch.setattr(camera, "_release", lambda: None)
    camera.open()
    return camera.describe().partition("trigger Line1")[2]


@pytest.mark.parametrize("name", ["SensorShutterMode", "ShutterMode"])
@pytest.mark.parametrize("offered", [("Rolling", "Global"), ("Global",), ("Rolling", "Reset")])
def test_all_rows_are_exposed_at_one_time_or_it_is_said(make, monkeypatch, name, offered):
    held = {name: offered[0]}
    said = set_by_hand(make(trigger_line="Line1"), monkeypatch, held, offered)
    is_global = "Global" in offered
    assert held[name] == ("Global" if is_global else "Rolling")
    assert said == ("" if is_global else f", {name} = Rolling")


@pytest.mark.parametrize("held_us", ["SensorReadoutTime", "ReadoutTimeAbs"])
@pytest.mark.parametrize("name", ["SensorShutterMode", "ShutterMode"])
def test_what_a_rolling_shutter_asks_of_the_settings_is_said(make, monkeypatch, name, held_us):
    held = {name: "Rolling", held_us: 24310.0}
    said = set_by_hand(make(trigger_line="Line1"), monkeypatch, held, ("Rolling",))
    assert said == f", {name} = Rolling (its rows take about 24.3 ms: set camera.readout)"
    said = set_by_hand(make(trigger_line="Line1", readout=0.024), monkeypatch, held, ("Rolling",))
    assert said == f", {name} = Rolling (corrected by camera.readout = 24 ms)"


def test_a_global_shutter_is_not_corrected_as_a_rolling_one(make, monkeypatch):
    held = {"SensorShutterMode": "Global"}
    with pytest.raises(
        OutOfLimits, match=r"readout = 24 ms was requested, .* at one time \(SensorShutterMode ="
    ):
        set_by_hand(make(trigger_line="Line1", readout=0.024), monkeypatch, held, ("Global",))


def test_what_changes_the_images_and_was_set_by_hand_is_said(make, monkeypatch):
    held = {"Gamma": 0.45, "TestPattern": "Off", "ReverseX": True, "BinningVertical": 1}
    held["LineDebouncerTime"] = 500.0
    camera = make(trigger_line="Line1", exposure_line="Line2")
    said = set_by_hand(camera, monkeypatch, held)
    assert said == ", ReverseX = True, Gamma = 0.45, LineDebouncerTime = 500.0"
    assert held["LineSelector"] == "Line1"  # whose debouncer it is


def test_a_feature_that_cannot_be_read_keeps_no_camera_from_opening(make, monkeypatch):
    camera = make(trigger_line="Line1")
    monkeypatch.setattr(camera, "_errors", (LookupError,))
    held = {"Gamma": 0.9999, "TestPattern": "Off", "ReverseX": False}

    def read(name):
        if name == "TestPattern":
            raise LookupError("not readable now")
        return held.get(name, _NEUTRAL.get(name))

    said = set_by_hand(camera, monkeypatch, held, value=read)
    assert said == ""
