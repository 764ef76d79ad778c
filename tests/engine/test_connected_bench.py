"""Parts of a connected bench, without its threads."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.acquisition.connected_bench import Preview, _ConnectedDevice
from app.acquisition.live_forces import LiveForces
from app.records.bench_view import DeviceState
from app.settings import config
from drivers.errors import DeviceFault, OutOfLimits
from drivers.protocols import Frame, LostFrame


def preview(divisor):
    settings = config.load(None, [f"camera.divisor={divisor}"])
    device = SimpleNamespace(name="x", adjust=lambda exposure_s, gain_db: None)
    return Preview(settings, SimpleNamespace(forces=device, camera=device, actuator=device))


@pytest.mark.parametrize(("divisor", "every"), [(42, 100), (250, 250)])
def test_a_connected_camera_is_triggered_ten_times_a_second_at_most(divisor, every):
    assert preview(divisor)._train.divisor == every


def test_an_exposure_longer_than_the_period_of_the_triggers_is_refused():
    with pytest.raises(OutOfLimits, match="a connected camera is triggered every 100 ms"):
        preview(42).adjust_camera(0.101, 0.0)


def with_pictures(*answers):
    """A connected bench whose camera has answered so."""
    shown, left = preview(250), list(answers)

    def read(timeout_s):
        if len(left) == 1:
            shown._closing.set()
        return left.pop(0)

    camera = SimpleNamespace(name="x", shape=(3, 4), dtype=np.dtype(np.uint8), read=read)
    camera.start = lambda train: None
    shown._devices["camera"].device = camera
    shown._may_start.set()
    shown._sampling.set()
    shown._take_pictures()
    return shown.look()


def test_triggers_without_an_image_are_counted():
    image = np.zeros((3, 4), np.uint8)
    seen = with_pictures(
        LostFrame(0, 0, "missed"), Frame(1, 250, image), LostFrame(2, 500, "missed")
    )
    assert seen.devices["camera"].state is DeviceState.LOOK
    assert seen.devices["camera"].sentence == "2 triggers without an image: missed"
    assert seen.picture.number == 1


def test_a_picture_that_breaks_the_rules_of_drivers_is_refused_as_in_a_run():
    image = np.zeros((3, 4), np.uint8)
    with pytest.raises(DeviceFault, match=r"trigger 1 was due, its driver gave that of 0; correct"):
        with_pictures(Frame(0, 0, image), Frame(0, 0, image))


@pytest.mark.parametrize(
    ("error", "told"),
    [(DeviceFault("x: it is off"), "x: it is off"), (SystemExit(3), "x: SystemExit: 3")],
    ids=repr,
)
@pytest.mark.parametrize("where", ["open", "work"])
def test_a_device_that_fails_is_closed(where, error, told):
    """After a SystemExit it was shown as ready, with its last reading, and stayed open."""
    calls = []

    def do(what):
        calls.append(what)
        if what == where:
            raise error

    device = SimpleNamespace(
        name="x", open=lambda: do("open"), describe=lambda: "an x", close=lambda: do("close")
    )
    connected = _ConnectedDevice(device, lambda: do("work"))
    connected._run()
    assert calls[-1] == "close"
    assert (connected.state, connected.sentence) == (DeviceState.FAILED, told)
    assert not connected.is_open


def test_forces_do_not_wait_for_a_camera_that_was_closed():
    def fail(_):
        raise AssertionError("it is waited for")

    bench = SimpleNamespace(
        _may_start=SimpleNamespace(set=lambda: None),
        _is_started=SimpleNamespace(wait=fail),
        _devices={"camera": SimpleNamespace(is_open=False, state=DeviceState.CLOSED)},
    )
    Preview._start_camera(bench)


@pytest.mark.parametrize("sign", [1, -1])
def test_either_end_of_the_range_of_a_sensor_counts(sign):
    volts = sign * np.array([[9.0, -1.0], [9.8, 4.0]])
    forces = SimpleNamespace(
        _chain=SimpleNamespace(volts=lambda _: volts),
        _config=SimpleNamespace(forces=SimpleNamespace(range=(10.0, 5.0))),
    )
    assert LiveForces._used(forces, np.zeros((2, 2))) == pytest.approx((0.98, 0.8))


def test_the_noise_of_the_forces_is_without_their_drift():
    reader = SimpleNamespace(history=SimpleNamespace(sample_rate_hz=1000.0))
    noise = np.where(np.arange(1000) % 2, 1e-3, -1e-3)
    drift = np.linspace(-0.4e-3, 0.4e-3, 1000)
    forces = np.column_stack([noise, noise + drift])
    assert LiveForces._noise(reader, forces) == pytest.approx((1e-3, 1e-3), rel=5e-3)
    assert np.isnan(LiveForces._noise(reader, forces[1:])).all()  # not a second of it
    # of forces that change by more than their noise there is none
    for way in (1, -1):
        found = LiveForces._noise(reader, np.column_stack([noise, noise + way * 10 * drift]))
        assert np.isnan(found).tolist() == [False, True]
