"""`slipscope check` on the emulated bench: it sets nothing while nothing moves, and moves the stage
within the limits of a run only.
"""

import re
import threading
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from processes.launched import wait_until
from short_run import SMALL

from app.bench_checks import bench_check
from app.bench_checks.bench_check import (
    _forces,
    _hum,
    _picture,
    _wait_until_still,
    check,
)
from app.bench_checks.bench_move import move
from app.evaluation.setup import sensor_chain
from app.runs import live
from app.settings import config
from drivers.errors import DeviceTimeout, OutOfLimits
from drivers.protocols import SampleBlock

FREE = "sim.press_time=600"  # nothing is pressed meanwhile
PICTURES = config.load(None, [*SMALL, FREE, "camera.width=96", "camera.height=96"])


def found_by_check(settings, benches, home=False, move_um=0.0):
    """What `slipscope check` finds, by its labels."""
    return {f.label: f for f in check(settings, benches, home=home, move_um=move_um)}


@pytest.fixture
def checked():
    def run(move_um=0.0, *overrides, sabotage=None):
        settings = config.load(
            Path("hil-emulated"), [*SMALL, FREE, "limits.age=5", "run.velocity=50", *overrides]
        )
        bench = live.make_bench(settings, 1.0)
        open_, lines = bench.actuator.open, []

        def opened():
            open_()
            lines.append(bench.actuator._far_end)
            if sabotage:
                sabotage(bench)

        bench.actuator.open = opened
        benches = chain([bench], iter(lambda: live.make_bench(settings, 1.0), None))
        findings = found_by_check(settings, benches.__next__, move_um=move_um)
        return findings, [command.decode() for _, command in lines[0].arrivals], bench

    return run


def test_it_sets_nothing_and_moves_nothing_unless_it_may(checked):
    findings, sent, _ = checked()
    assert all(f.is_fine or not f.needed for f in findings.values()), findings
    assert findings["limits"].value == (
        "before it moves, the controller is limited to 0 to 25 mm and below 1000 um/s"
    )
    assert {command[1:3] for command in sent} <= {"VE", "ID", "TS", "TP", "TE"}, sent


def test_a_move_goes_there_and_back(checked):
    findings, sent, bench = checked(20.0)
    assert findings["move"].is_fine, findings["move"]
    assert findings["move"].value.startswith("20 um requested, ")
    assert len([command for command in sent if command[1:3] == "PA"]) == 2
    assert bench.world.stage_m() == pytest.approx(0.0, abs=0.1e-6)


def test_a_move_is_as_fast_as_the_steps_of_the_run_say(checked):
    steps = '{do="approach"}, {do="reference"}, {do="drive", travel=10, velocity=1}'
    findings, sent, _ = checked(2.0, "actuator.max_velocity=2", f"run.steps=[{steps}]")
    assert findings["move"].is_fine, findings["move"]
    assert "1VA0.001" in sent


@pytest.mark.parametrize(
    ("move_um", "overrides", "reason"),
    [
        (2000.0, (), "--move: 2000 um was asked, limits.travel is 500 um"),
        (200.0, ("actuator.travel=[12.45, 12.55]",), "put it where it has room"),
        (-200.0, ("actuator.travel=[12.45, 12.55]",), "put it where it has room"),
    ],
)
def test_a_move_beyond_the_limits_is_refused_and_nothing_moves(checked, move_um, overrides, reason):
    findings, sent, _ = checked(move_um, *overrides)
    assert not findings["move"].is_fine
    assert reason in findings["move"].value
    assert not [command for command in sent if command[1:3] == "PA"]


@pytest.mark.parametrize("way_m", [501e-6, -501e-6])
def test_a_way_beyond_the_limit_of_travel_is_refused_whichever_way(way_m):
    with pytest.raises(OutOfLimits, match=r"was asked, limits\.travel is 500 um"):
        move(config.load(None, []), None, way_m)


@pytest.mark.parametrize("column", [0, 1])
def test_a_force_at_its_limit_stops_the_move(checked, column):
    def loaded(bench):
        read = bench.forces.device.read

        def pulled(timeout_s):
            block = read(timeout_s)
            if isinstance(block, SampleBlock) and bench.world.stage_m() > 20e-6:
                block.volts[:, column] = 9.0
            return block

        bench.forces.device.read = pulled

    findings, sent, bench = checked(
        400.0, "limits.normal_force=1", "limits.shear_force=1", sabotage=loaded
    )
    limit = ("normal_force", "shear_force")[column]
    assert f"limits.{limit} is" in findings["move"].value
    assert "is at rest" in findings["move"].value
    assert "1ST" in sent
    assert bench.world.stage_m() < 300e-6
    wait_until(lambda: not bench.world.is_moving())


# ------------------------------------------------------------------ benches without hardware

PLAIN = [line for line in SMALL if not line.startswith("run.travel")]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "a.h5"
    run = live.make_run(
        config.load(None, [*PLAIN, "recording.results=forces", "run.travel=60"]), path, pace=None
    )
    run.start()
    assert run.wait(120).is_complete
    return path


def checked_as_it_is(*overrides, home=False, move_um=0.0, pace=None):
    """What `slipscope check` finds, in simulated time that passes as it is read."""
    settings = config.load(None, [*PLAIN, "run.velocity=50", *overrides])
    bench = live.unpressed(settings)
    return found_by_check(settings, lambda: live.make_bench(bench, pace), home, move_um)


@pytest.mark.parametrize(
    "mixed", [(), ("camera.source=replay",), ("forces.source=replay",), "emulated"]
)
def test_a_stage_moves_on_benches_without_hardware_and_data_is_taken(session, mixed):
    if mixed == "emulated":
        mixed = ("actuator.source=smc100-emulated", "forces.source=replay")
    findings = checked_as_it_is(f"replay.session={session}", *mixed, move_um=10.0, pace=1.0)
    assert all(f.is_fine for f in findings.values()), findings
    assert findings["move"].value.startswith("10 um requested, 10.0")
    assert "2000 samples and 16 frames of 16 triggers" in findings["data"].value


def test_a_simulated_stage_finds_its_origin_and_goes_on_from_where_it_stands():
    findings = checked_as_it_is(home=True, move_um=10.0, pace=40.0)
    assert all(f.is_fine for f in findings.values() if f.label != "data"), findings
    assert findings["home"].value == "the origin was found, the stage is at 0.0000 mm"


def test_a_recorded_stage_is_not_moved(session):
    findings = checked_as_it_is(
        f"replay.session={session}", "actuator.source=replay", move_um=10.0, pace=1.0
    )
    assert "a recorded stage goes where it was recorded" in findings["move"].value
    assert findings["data"].is_fine


# ------------------------------------------------------------------ noise


def newtons(config_, deviation_n, drift_n=0.0, seconds=2.0, seed=5):
    """Volts of two unloaded sensors with that noise, and a drift over all of them."""
    f = config_.forces
    n = round(seconds * f.sample_rate)
    forces = np.random.default_rng(seed).normal(0, 1, (n, 2)) * deviation_n
    forces += np.linspace(0, drift_n, n)[:, None]
    # without coupling
    per_volt = np.multiply(f.sensitivity, f.stiffness)
    return np.asarray(f.zero) + forces / per_volt


@pytest.mark.parametrize(
    ("deviation_n", "drift_n", "fine"),
    [
        # 50 samples to a mean: 1 mN is 0.14 mN, 119 mN is 17 mN; 0.5 N allows 3.3 and 1.7 mN
        (1e-3, 0.0, [True, True]),
        (8e-3, 0.0, [True, True]),
        (16e-3, 0.0, [True, False]),
        (119e-3, 0.0, [False, False]),
        (1e-3, 50e-3, [False, False]),
    ],
)
def test_forces_too_noisy_for_a_contact_to_settle_fail(deviation_n, drift_n, fine):
    settings = config.load(None, ["forces.coupling=[[1, 0], [0, 1]]"])
    volts = newtons(settings, deviation_n, drift_n)
    findings = list(_forces(settings, volts, settings.forces.block))
    assert [f.is_fine for f in findings] == fine
    assert [f.needed for f in findings] == [not one for one in fine]
    assert "(limit 3.3 mN)" in findings[0].value
    assert "(limit 1.7 mN)" in findings[1].value
    if not fine[0]:
        assert "too noisy for a contact of 0.5 N" in findings[0].value


def test_a_reading_that_is_no_number_fails():
    """The bench worked, with a normal force of nan N."""
    settings = config.load(None, [])
    volts = newtons(settings, 1e-3)
    volts[700, 1] = np.nan
    for finding in _forces(settings, volts, settings.forces.block):
        assert finding.needed
        assert "a reading is not a number: check the sensor" in finding.value


@pytest.mark.parametrize(
    ("kind", "call", "labels"),
    [
        ("forces", "read", ["data"]),
        ("camera", "read", ["data"]),
        ("camera", "stop", ["camera", "data"]),  # as it is closed, too
        ("forces", "close", ["forces"]),
    ],
)
def test_a_device_that_does_not_return_from_a_call_holds_up_no_check(
    monkeypatch, kind, call, labels
):
    monkeypatch.setattr(bench_check, "STEP_PATIENCE_S", 0.0)
    monkeypatch.setattr(bench_check, "PATIENCE_S", 0.1)
    bench, release = live.make_bench(PICTURES, None), threading.Event()
    done = getattr(getattr(bench, kind), call)
    setattr(getattr(bench, kind), call, lambda *with_: (release.wait(60), done(*with_))[1])
    findings = found_by_check(PICTURES, lambda: bench)
    release.set()
    assert [one.label for one in findings.values() if one.needed] == labels
    for label in labels:
        assert "it did not return from a call within" in findings[label].value


def test_a_device_that_does_not_return_as_it_is_opened_or_made_ready_holds_up_no_check(monkeypatch):
    monkeypatch.setattr(bench_check, "OPEN_S", 0.1)
    release = threading.Event()

    def made():
        bench = live.make_bench(PICTURES, None)
        bench.camera.open = lambda: release.wait(20)
        bench.actuator.make_ready = lambda: release.wait(20)
        return bench

    findings = found_by_check(PICTURES, made, move_um=20.0)
    release.set()
    told = {label: one.value for label, one in findings.items() if one.needed}
    assert told.keys() == {"camera", "move"}
    assert told["camera"].startswith("simulated camera: it did not return from a call within 0.1 s")
    assert told["move"].startswith("simulated actuator: it did not return from a call")


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda frame: None, "trigger 3 was due, its driver gave NoneType, which is neither"),
        (lambda frame: replace(frame, index=2), "trigger 3 was due, its driver gave that of 2"),
        (
            lambda frame: replace(frame, image=frame.image[:-1]),
            "that is uint8 of shape (95, 96)",
        ),
    ],
)
def test_a_picture_that_a_run_would_refuse_fails(spoil, told):
    """The bench was said to work, or the line of the camera was blamed."""
    bench = live.make_bench(PICTURES, None)
    read = bench.camera.read

    def spoilt(timeout_s):
        frame = read(timeout_s)
        return spoil(frame) if frame.index == 3 else frame

    bench.camera.read = spoilt
    findings = found_by_check(PICTURES, lambda: bench)
    assert findings["data"].needed
    assert told in findings["data"].value


def test_a_camera_of_another_size_than_the_settings_say_fails():
    bench = live.make_bench(PICTURES, None)
    bench.camera.shape = (90, 96)
    findings = found_by_check(PICTURES, lambda: bench)
    assert "images of 96 x 96 were asked, it gives 96 x 90" in findings["data"].value


def test_the_lowest_load_of_a_protocol_decides():
    steps = '{do="approach", normal_force=1}, {do="approach", normal_force=0.05}'
    settings = config.load(None, [f'run.steps=[{steps}, {{do="reference"}}, {{do="drive"}}]'])
    findings = list(_forces(settings, newtons(settings, 5e-3), settings.forces.block))
    assert "too noisy for a contact of 0.05 N" in findings[0].value


def test_recorded_forces_are_what_an_operator_pressed_as_well():
    settings = config.load(None, ["forces.source=replay", "replay.session=a.h5"])
    findings = list(_forces(settings, newtons(settings, 1e-3, 0.5), settings.forces.block))
    assert [f.is_fine for f in findings] == [True, True]


@pytest.mark.parametrize(
    ("hz", "mn", "is_told"), [(50.0, 3.0, True), (60.0, 3.0, True), (50.0, 0.2, False)]
)
def test_hum_of_the_mains_is_named_with_what_averages_it_out(hz, mn, is_told):
    settings = config.load(None, ["forces.source=nidaqmx"])
    t = np.arange(2000) / settings.forces.sample_rate
    newtons = np.random.default_rng(1).normal(0.0, 0.5e-3, (2000, 2))
    newtons[:, 1] += mn * 1e-3 * np.sqrt(2.0) * np.sin(2 * np.pi * hz * t + 0.3)
    volts = sensor_chain(settings).volts(newtons)
    normal, shear = _forces(settings, volts, 50)
    assert "rms" in normal.found
    assert normal.is_fine
    assert shear.is_fine != is_told
    assert not shear.needed  # it forbids no run
    if is_told:
        told = re.search(rf"at {hz:g} Hz (\S+) mN rms", shear.found)
        assert float(told[1]) == pytest.approx(mn, rel=0.02)
        assert f"a block of {2 * round(1000 / hz)} samples (forces.block)" in shear.advice


def test_hum_is_no_number_where_the_samples_do_not_reach_it():
    settings = config.load(None, ["forces.source=nidaqmx", "forces.sample_rate=100"])
    assert np.isnan(_hum(np.zeros(200), 60.0, settings)[1])
    assert np.isfinite(_hum(np.zeros(2000), 40.0, settings)[1])


# ------------------------------------------------------------------ pictures, and the origin


@pytest.mark.parametrize("pixel_format", ["Mono8", "Mono12"])
@pytest.mark.parametrize(("share", "is_fine"), [(0.9, False), (1.1, True)])
def test_a_picture_without_contrast_is_told_on_every_scale(pixel_format, share, is_fine):
    settings = config.load(None, [f"camera.pixel_format={pixel_format}"])
    full = {"Mono8": 255, "Mono12": 4095}[pixel_format]
    contrast = share * settings.dic.min_contrast * full / 255
    found = _picture(settings, full / 2 + contrast * np.array([[-1.0, 1.0]]))
    assert found.is_fine == is_fine
    assert ("no contrast" in found.advice) != is_fine


def test_a_search_of_the_origin_that_takes_too_long_is_stopped():
    stops = []
    stage = SimpleNamespace(
        name="stage X", is_moving=lambda: True, stop=lambda: stops.append("stop")
    )
    with pytest.raises(DeviceTimeout, match="stage X: it still moves after 0 s; it was stopped"):
        _wait_until_still(stage, 0.0, lambda: None)
    assert stops == ["stop"]
