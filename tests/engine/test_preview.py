"""A bench that is connected without a run: each device for itself, forces, pictures, jog, zero."""

import math
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from processes.launched import wait_until

from app.acquisition import connected_bench as preview_module
from app.acquisition.connected_bench import Preview
from app.evaluation.setup import sensor_chain
from app.records.bench_view import DeviceState
from app.runs.live import make_bench, previewed
from app.settings import config
from app.system.errors import UnderLoad
from app.system.stopping import Stop
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits

PATIENT_S = 60.0
# forces as old as only those of a board that has gone are, however busy the machine
FREE = ("camera.width=64", "camera.height=64", "dic.box=20", "sim.press_time=3000", "limits.age=10")
# under its load from the first samples on
PRESSED = ("sim.press_time=0", "sim.law=elasto-plastic", "run.normal_force=0.1")
TWICE = ("run.normal_force=0.2", "limits.normal_force=1")  # the load of the settings
FAST = 100e-6


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """Nothing is given up because the machine is busy."""
    for name in ("PATIENCE_S", "CAMERA_S", "ADJUST_S"):
        monkeypatch.setattr(preview_module, name, PATIENT_S)
    monkeypatch.setattr("app.acquisition.live_forces.LATE_S", PATIENT_S)
    monkeypatch.setattr("app.acquisition.watchdog.PATIENCE_S", PATIENT_S)


class Wrapped:
    """A device of which some methods are others."""

    def __init__(self, device, **others):
        self._device = device
        self.__dict__.update(others)

    def __getattr__(self, name):
        return getattr(self._device, name)


def raises(error):
    def method(*_):
        raise error

    return method


@contextmanager
def connected(*overrides, pace=2.0, world=(), guard=lambda: None, **others):
    """A preview of simulated devices; `others` replace methods of a device."""
    settings = config.load(None, [*FREE, *overrides])
    bench = make_bench(config.load(None, [*FREE, *overrides, *world]), pace)
    # since Python 3.12 a protocol is looked for in what a device has itself
    others["camera"] = {"adjust": bench.camera.adjust} | others.get("camera", {})
    devices = {
        kind: Wrapped(getattr(bench, kind), **others.get(kind, {}))
        for kind in ("forces", "camera", "actuator")
    }
    preview = Preview(settings, SimpleNamespace(**devices), guard=guard, can_restart=False)
    preview.start()
    try:
        yield preview
    finally:
        with suppress(DeviceTimeout):
            preview.close()


def state(preview, kind):
    return preview.look().devices[kind].state


def all_ready(preview):
    return wait_until(
        lambda: (
            all(device.state is DeviceState.READY for device in preview.look().devices.values())
            and preview.look().forces
            and preview.look().picture
            and preview.look().stage
        )
    )


def hold(preview, direction, seconds=0.0, until=lambda: False, velocity=FAST):
    """Hold a jog as a window does."""
    end = time.monotonic() + (seconds or PATIENT_S)
    while time.monotonic() < end and not until():
        preview.jog(direction, velocity)
        time.sleep(0.05)


def position_um(preview):
    return preview.look().stage.position_m * 1e6


# ---------------------------------------------------------------------- devices


def test_a_bench_that_works_shows_forces_pictures_and_stage():
    with connected("sim.force_noise=2") as preview:
        all_ready(preview)
        wait_until(lambda: math.isfinite(preview.look().forces.noise[0]), "a second of forces")
        view = preview.look()
        assert view.forces.newest == pytest.approx((0, 0), abs=2e-3)
        # the simulated noise, seen through the inverse of the coupling, which is near one
        assert view.forces.noise == pytest.approx((2e-3, 2e-3), rel=0.15)
        assert view.stage.position_m == pytest.approx(12.5e-3, abs=1e-7)
        assert not view.stage.is_moving
        assert view.stage.high_m - view.stage.low_m == pytest.approx(1e-3)
        number = wait_until(lambda: preview.look().picture.number)
        assert preview.look(known=number).picture is None or number != preview.look().picture.number


def brightness(preview):
    number = preview.look().picture.number
    return wait_until(
        lambda: (now := preview.look().picture) and now.number > number + 1 and now.mean
    )


@pytest.mark.parametrize(("press_time", "free_s"), [(3, 10.0), (30, 30.0)])
def test_a_simulated_bench_is_free_long_enough_to_be_zeroed(press_time, free_s):
    shown = previewed(config.load(None, [f"sim.press_time={press_time}"]))
    assert shown.sim.press_time == free_s
    assert shown.sim.law == "elasto-plastic"  # which can be sheared both ways


def test_exposure_and_gain_change_in_the_picture_at_once_and_only_there():
    with connected("camera.exposure=4", pace=4.0) as preview:
        all_ready(preview)
        before = brightness(preview)
        assert preview.adjust_camera(8e-3, -1)
        assert brightness(preview) == pytest.approx(2 * before, rel=0.02)
        assert preview.adjust_camera(4e-3, 6.0)
        assert brightness(preview) == pytest.approx(1.995 * before, rel=0.02)
        with pytest.raises(OutOfLimits, match="exposure of 200 ms was requested"):
            preview.adjust_camera(0.2, -1)
        assert state(preview, "forces") is DeviceState.READY


def test_a_camera_that_refuses_an_exposure_stays_as_it_was_and_says_so():
    why = OutOfLimits("camera: ExposureTime = 3 was requested, it can have 10 to 1e6")
    with connected(camera={"adjust": raises(why)}) as preview:
        all_ready(preview)
        with pytest.raises(OutOfLimits, match="it can have 10"):
            preview.adjust_camera(3e-6, -1)
        assert brightness(preview) > 0


def test_a_camera_without_such_a_feature_is_connected_anew():
    with connected() as preview:
        all_ready(preview)
        camera = preview._devices["camera"]
        camera.device = SimpleNamespace(name="camera", read=camera.device.read)
        assert preview.adjust_camera(8e-3, -1) is False


@pytest.mark.parametrize("kind", ["forces", "camera", "actuator"])
def test_one_device_that_fails_does_not_hide_the_others(kind):
    why = DeviceNotFound(f"the {kind}: it was not found; check its cable")
    with connected(**{kind: {"open": raises(why)}}) as preview:
        wait_until(lambda: state(preview, kind) is DeviceState.FAILED)
        assert preview.look().devices[kind].sentence == str(why)
        if kind != "forces":
            wait_until(lambda: preview.look().forces)
        else:
            wait_until(lambda: "not triggered" in preview.look().devices["camera"].sentence)
        if kind != "camera":
            wait_until(lambda: state(preview, "camera") in (DeviceState.READY, DeviceState.LOOK))
        if kind != "actuator":
            wait_until(lambda: state(preview, "actuator") is DeviceState.READY)


@pytest.mark.parametrize("kind", ["forces", "camera", "actuator"])
def test_a_device_that_falls_silent_holds_up_neither_the_others_nor_the_end(kind, monkeypatch):
    monkeypatch.setattr(preview_module, "CAMERA_S", 0.2)
    monkeypatch.setattr(preview_module, "PATIENCE_S", 0.5)
    release = threading.Event()
    with connected(**{kind: {"open": release.wait}}) as preview:
        for other in {"forces", "camera", "actuator"} - {kind}:
            wait_until(
                lambda other=other: state(preview, other) in (DeviceState.READY, DeviceState.LOOK)
            )
        if kind != "forces":
            wait_until(lambda: preview.look().forces)
        assert state(preview, kind) is DeviceState.CONNECTING
        began = time.monotonic()
        with pytest.raises(DeviceTimeout, match="no return from a call"):
            preview.close()
        assert time.monotonic() - began < 10.0
        release.set()


def test_a_camera_that_comes_late_shows_its_pictures(monkeypatch):
    monkeypatch.setattr(preview_module, "CAMERA_S", 0.1)
    release, opened = threading.Event(), []

    def comes_late():
        release.wait(PATIENT_S)
        opened.append(1)

    with connected(camera={"open": comes_late}) as preview:
        wait_until(lambda: preview.look().forces)
        assert state(preview, "camera") is DeviceState.CONNECTING
        # the simulated camera itself is opened by the test, as its `open` is replaced
        preview._devices["camera"].device._device.open()
        release.set()
        wait_until(lambda: preview.look().picture)


def test_triggers_begin_anew_for_a_real_camera_that_comes_late(monkeypatch):
    monkeypatch.setattr(preview_module, "CAMERA_S", 0.1)
    calls, release = [], threading.Event()

    class Device:
        name = "device"

        def __init__(self, kind, **methods):
            self.kind = kind
            self.__dict__.update(methods)

        def describe(self):
            return self.kind

        def start(self, train):
            calls.append(f"{self.kind} starts")

        def stop(self):
            calls.append(f"{self.kind} stops")

        def open(self): ...
        def close(self): ...

        def read(self, timeout_s):
            time.sleep(0.01)
            raise DeviceTimeout(f"{self.kind}: nothing came")

    bench = SimpleNamespace(
        forces=Device("forces"),
        camera=Device("camera", open=release.wait),
        actuator=Device("actuator", open=raises(DeviceFault("no stage"))),
    )
    preview = Preview(config.load(None, FREE), bench)
    preview.start()
    wait_until(lambda: calls == ["forces starts"])
    monkeypatch.setattr(preview_module, "CAMERA_S", PATIENT_S)
    release.set()
    wait_until(lambda: len(calls) > 3)
    assert calls[1:4] == ["forces stops", "camera starts", "forces starts"]
    preview.close()


def test_a_camera_that_delivers_nothing_is_told_of(monkeypatch):
    monkeypatch.setattr(preview_module, "SHOWN_S", 0.2)
    with connected(camera={"read": raises(DeviceTimeout("nothing"))}) as preview:
        wait_until(lambda: "delivers nothing" in preview.look().devices["camera"].sentence)
        assert state(preview, "camera") is DeviceState.LOOK
        assert "camera.trigger_line" in preview.look().devices["camera"].sentence
        assert preview.look().picture is None
        wait_until(lambda: preview.look().forces.age_s < 1.0, "a new force")


def test_forces_that_fail_on_the_way_say_why():
    with connected("sim.faults=['daq-gone 600']", "limits.age=0.2") as preview:
        wait_until(lambda: state(preview, "forces") is DeviceState.FAILED)
        assert "the board no longer answers" in preview.look().devices["forces"].sentence
        wait_until(lambda: state(preview, "actuator") is DeviceState.READY)
        wait_until(lambda: preview.look().forces.age_s > 0.2)
        with pytest.raises(DeviceError, match="only while forces are read"):
            hold(preview, 1)


def test_samples_that_were_lost_are_told_of_and_the_bench_goes_on(monkeypatch):
    """Also where a run would end by them."""
    monkeypatch.setattr(preview_module, "SHOWN_S", 1e4)
    with connected("sim.faults=['daq-overflow 1000 300']", "forces.on_overflow=end") as preview:
        wait_until(lambda: "were lost: 300 ×" in preview.look().devices["forces"].sentence)
        wait_until(lambda: preview.look().forces is not None)  # further ones came
        assert "were lost: 300 ×" in preview.look().devices["forces"].sentence  # still
        monkeypatch.setattr(preview_module, "SHOWN_S", 0.0)
        all_ready(preview)
        start = position_um(preview)
        hold(preview, 1, until=lambda: position_um(preview) > start + 10)


def test_a_sensor_at_the_end_of_its_range_is_told_of_and_forbids_a_jog():
    with connected("sim.faults=['saturated 0']") as preview:
        wait_until(lambda: state(preview, "forces") is DeviceState.LOOK)
        assert "the shear sensor reads the end of its range" in (
            preview.look().devices["forces"].sentence
        )
        wait_until(lambda: preview.look().stage)
        with pytest.raises(DeviceError, match="shear sensor is at the end of its range"):
            preview.jog(1, FAST)
        with pytest.raises(DeviceError, match="no zero there"):
            preview.zero()


def test_a_stage_that_would_refuse_a_move_says_so_before():
    why = DeviceFault("stage: it is NOT REFERENCED; home it")
    with connected(actuator={"make_ready": raises(why)}) as preview:
        wait_until(lambda: state(preview, "actuator") is DeviceState.LOOK)
        assert preview.look().devices["actuator"].sentence == str(why)
        wait_until(lambda: preview.look().forces)
        with pytest.raises(DeviceFault, match="NOT REFERENCED"):
            preview.jog(1, FAST)


# ---------------------------------------------------------------------- jog


def test_a_jog_goes_on_while_it_is_held_and_stops_by_itself():
    with connected() as preview:
        all_ready(preview)
        start = position_um(preview)
        hold(preview, 1, until=lambda: position_um(preview) > start + 30 and preview.motion()[2])
        wait_until(lambda: not preview.motion()[2], "the dead man's stop")
        stood, sample = preview._devices["actuator"].device.position_m(), preview.motion()[0]
        wait_until(lambda: preview.motion()[0] > sample + 600)
        assert preview._devices["actuator"].device.position_m() == stood
        hold(preview, -1, until=lambda: position_um(preview) < start)
        answer = preview.stop_motion()
        assert answer.kind is Stop.AT_REST
        assert preview.look().said == ""


def test_a_jog_that_was_let_go_while_the_stage_was_asked_does_not_begin():
    moves = []
    with connected() as preview:
        all_ready(preview)
        actuator = preview._devices["actuator"].device
        actuator.set_velocity = lambda velocity: preview._stage.stop_now()
        actuator.move_to = moves.append
        preview.jog(1, FAST)
        assert not moves


@pytest.mark.parametrize("way", [1, -1])
def test_a_jog_ends_at_its_limit_and_says_which(way):
    with connected("limits.travel=40", "run.travel=30") as preview:
        all_ready(preview)
        start = position_um(preview)
        with pytest.raises(DeviceError, match=r"40 um \(limits.travel\) from where it was connect"):
            hold(preview, way)
        wait_until(lambda: way * (position_um(preview) - start) > 38.9)
        assert way * (position_um(preview) - start) < 40.1


@pytest.mark.parametrize(("way", "end"), [(1, "12.5200"), (-1, "12.4800")])
def test_a_jog_ends_at_the_end_of_the_stage(way, end):
    with connected(actuator={"travel_limits_m": (12.48e-3, 12.52e-3)}) as preview:
        all_ready(preview)
        with pytest.raises(DeviceError, match=rf"at the end of its travel, {end} mm"):
            hold(preview, way)


def test_a_jog_stops_at_the_limit_of_the_shear_force_and_only_leads_back():
    with connected(*PRESSED, "limits.shear_force=0.03", "sim.force_noise=0", pace=4.0) as preview:
        all_ready(preview)
        wait_until(lambda: preview.look().forces.newest[0] > 0.099, "the contact")
        with pytest.raises(DeviceError, match=r"limits\.shear_force is 0\.03 N"):
            hold(preview, 1, velocity=3e-6)
        wait_until(lambda: not preview.motion()[2])
        assert preview.let_go().kind is Stop.AT_REST
        assert 0.03 < preview.look().forces.newest[1] < 0.09
        with pytest.raises(DeviceError, match="jog the other way"):
            preview.jog(1, FAST)
        hold(preview, -1, until=lambda: preview.look().forces.newest[1] < 0.02, velocity=20e-6)


def test_a_jog_is_refused_beyond_the_limit_of_the_normal_force():
    with connected(*PRESSED, "limits.normal_force=0.11", world=TWICE) as preview:
        all_ready(preview)
        wait_until(lambda: preview.look().forces.newest[0] > 0.19, "the contact")
        with pytest.raises(DeviceError, match=r"normal force reached .* limits\.normal_force is"):
            preview.jog(1, FAST)


def test_a_jog_stops_when_the_forces_stop():
    with connected("limits.age=2") as preview:
        all_ready(preview)
        start = position_um(preview)
        hold(preview, 1, until=lambda: position_um(preview) > start + 5, velocity=10e-6)
        preview._devices["forces"].device.read = raises(DeviceTimeout("nothing came"))
        with pytest.raises(DeviceError, match=r"no force came for 2 s"):
            hold(preview, 1, velocity=10e-6)
        wait_until(lambda: not preview.motion()[2])


@pytest.mark.parametrize("fails", ["at once", "silent"])
def test_a_stop_that_fails_is_never_called_sent(fails, monkeypatch):
    monkeypatch.setattr("app.acquisition.watchdog.PATIENCE_S", 0.3)
    release = threading.Event()
    stop = raises(DeviceFault("stage: its line is cut")) if fails == "at once" else release.wait
    with connected() as preview:
        all_ready(preview)
        preview._devices["actuator"].device.stop = stop
        answer = preview.stop_motion()
        assert answer.kind is Stop.FAILED
        assert ("its line is cut" if fails == "at once" else "did not return") in answer.sentence
        release.set()


def test_a_stop_without_a_stage_says_that_nothing_was_sent():
    with connected(actuator={"open": raises(DeviceFault("no stage"))}) as preview:
        wait_until(lambda: state(preview, "actuator") is DeviceState.FAILED)
        assert preview.stop_motion().kind is Stop.NOT_CONNECTED
        with pytest.raises(DeviceFault, match="no actuator is connected"):
            preview.jog(1, FAST)


def test_nothing_moves_where_the_guard_forbids_it():
    guard = raises(DeviceFault("the supervisor does not start"))
    with connected(guard=guard) as preview:
        all_ready(preview)
        start = position_um(preview)
        with pytest.raises(DeviceFault, match="supervisor"):
            hold(preview, 1)
        assert position_um(preview) == start


# ---------------------------------------------------------------------- zero


@pytest.mark.parametrize("true", [(0.25, -0.125), (-0.25, -0.125)])
def test_zero_gives_the_readings_without_a_force(true):
    with connected(world=(f"forces.zero={list(true)}",)) as preview:
        all_ready(preview)
        assert abs(preview.look().forces.newest[0]) > 0.03
        with pytest.raises(UnderLoad, match=r"P reads -?0\.05"):
            preview.zero()
        assert abs(preview.look().forces.newest[0]) > 0.03  # and the zero is as it was
        found = preview.zero(under_load=True)
        assert found == pytest.approx(true, abs=1e-3)
        assert np.median(np.abs(preview.look().forces.history)) < 2e-3  # also those before it
        wait_until(lambda: abs(preview.look().forces.newest[0]) < 1e-3)
        settings = config.load(None, FREE)
        settings = replace(settings, forces=replace(settings.forces, zero=found))
        newtons = sensor_chain(settings).forces(np.array([true]))
        assert newtons == pytest.approx(np.zeros((1, 2)), abs=1e-3)


def test_a_free_block_is_zeroed_without_a_question():
    with connected() as preview:
        all_ready(preview)
        assert preview.zero() == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_pressed_block_is_not_zeroed_without_a_word_and_the_zero_can_be_given_back():
    with connected("sim.press_time=0.01", "run.normal_force=0.5") as preview:
        all_ready(preview)
        wait_until(lambda: preview.look().forces.newest[0] > 0.4)
        with pytest.raises(UnderLoad, match=r"zero: P reads 0\.(4|5)\d\d N .* hang free"):
            preview.zero()
        assert preview.look().forces.newest[0] > 0.4
        preview.zero(under_load=True)
        wait_until(lambda: abs(preview.look().forces.newest[0]) < 0.01)
        preview.set_zero((0.0, 0.0))
        wait_until(lambda: preview.look().forces.newest[0] > 0.4)


def test_zero_is_refused_while_the_stage_moves(monkeypatch):
    monkeypatch.setattr("app.acquisition.jog.HOLD_S", PATIENT_S)
    with connected() as preview:
        all_ready(preview)
        preview.jog(1, 10e-6)
        with pytest.raises(DeviceFault, match="the stage moves"):
            preview.zero()


def test_every_device_is_closed_at_the_end():
    with connected() as preview:
        all_ready(preview)
        preview.close()
        assert {d.state for d in preview.look().devices.values()} == {DeviceState.CLOSED}
        for device in preview._devices.values():
            assert not device.device._is_open
