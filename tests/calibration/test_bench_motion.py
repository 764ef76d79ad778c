"""How the simulated stage moves, from the run of a calibration to its certificate."""

import numpy as np
import pytest
from whole_runs import ran

from app.calibrations.actuator import ActuatorCalibration, ActuatorOptions
from app.calibrations.certifying import evaluated
from app.calibrations.correlation_noise import CorrelationNoise, CorrelationNoiseOptions
from app.runs.live import scenario
from app.settings.config import load

TIME = np.arange(0, 20, 0.1)
SMALL = ("camera.width=240", "camera.height=200", "run.normal_force=0.3")


def recorded(calibration, options, path, *settings):
    """The session of the only run of a calibration on the simulated bench."""
    (config,) = calibration.plan(load(None, [*SMALL, *settings]), options)
    ran(config, path)
    return config


def values(found):
    return {one.key: one for one in found.result.values}


@pytest.mark.slow
def test_the_slow_stage_is_measured_to_a_thousandth(tmp_path):
    calibration, options = ActuatorCalibration(), ActuatorOptions(travel=60e-6, velocity=10e-6)
    config = recorded(calibration, options, tmp_path / "a.h5", "sim.drive_angle=1")
    found = evaluated(calibration, [tmp_path / "a.h5"], options)
    told, true = values(found), scenario(config).speed_factor
    assert told["velocity_ratio"].value == pytest.approx(true, abs=1e-3)
    assert abs(told["velocity_ratio"].value - true) < 3 * told["velocity_ratio"].sd
    seen = told["velocity_m_s"]
    assert seen.value == pytest.approx(true * 10e-6, rel=1e-3)
    assert seen.sd == pytest.approx(seen.value * 0.005, rel=0.1)  # that of the pixel
    assert told["angle_degrees"].value == pytest.approx(1, abs=0.05)
    assert abs(told["backlash_m"].value) < 4 * told["backlash_m"].sd < 1e-7
    # the correlation repeats itself with each pixel
    assert told["periodic_error_m"].value < 0.02e-6
    found.write(tmp_path / "a.zip", overwrite=False)
    again = evaluated(calibration, [tmp_path / "a.zip"], options)
    assert repr(again.result.values) == repr(found.result.values)  # NaN is not NaN


def test_lost_motion_and_the_pitch_of_a_screw_are_found(tmp_path):
    calibration, options = ActuatorCalibration(), ActuatorOptions(travel=150e-6, velocity=20e-6)
    hidden = ("sim.backlash=1.3", "sim.screw_error=0.15", "sim.screw_pitch=40")
    recorded(calibration, options, tmp_path / "a.h5", *hidden)
    told = values(evaluated(calibration, [tmp_path / "a.h5"], options))
    for key, true in (("backlash_m", 1.3e-6), ("periodic_error_m", 0.15e-6), ("period_m", 40e-6)):
        assert abs(told[key].value - true) < 3 * told[key].sd < 0.2 * true, key
    assert not told["periodic_error_m"].doubt


def motion(ux_um):
    """Of a stage that reads 5 um/s forth and back, and a block that is seen to move so."""
    return {
        "stage_time_s": TIME, "stage_m": 5e-6 * (10 - np.abs(TIME - 10)), "time_s": TIME,
        "ux_m": 1e-6 * ux_um, "uy_m": 1e-8 * np.sin(7 * TIME),
        "asked_m_s": np.array(5e-6), "scale_sd": np.array(0.005), "pixel_m": np.array(7e-6),
    }  # fmt: skip


def test_an_encoder_of_another_scale_does_not_hide_that_the_stage_is_slow():
    seen = np.random.default_rng(1).normal(4.75 * (10 - np.abs(TIME - 10)), 0.01)
    found = ActuatorCalibration().fit(motion(seen), ActuatorOptions())
    told = {one.key: one for one in found.values}
    assert told["stage_m_s"].value == pytest.approx(5e-6, rel=1e-6)
    assert told["velocity_ratio"].value == pytest.approx(0.95, abs=1e-3)
    assert told["velocity_ratio"].sd == pytest.approx(0.95 * 0.005, rel=0.1)  # that of the pixel


def test_a_block_in_contact_is_refused():
    calibration = ActuatorCalibration()
    held = motion(5 * np.maximum(8 - np.abs(TIME - 10), 0))
    with pytest.raises(ValueError, match=r"changes by|further from the fit"):
        calibration.fit(held, ActuatorOptions())


def test_noise_of_the_correlation_is_at_its_floor_and_a_box_follows(tmp_path):
    calibration, options = CorrelationNoise(), CorrelationNoiseOptions(wanted=0.01)
    camera = ("camera.divisor=250", "dic.threads=1")
    recorded(calibration, options, tmp_path / "n.h5", *camera)
    found = evaluated(calibration, [tmp_path / "n.h5"], options)
    told, data = values(found), found.data
    assert data["box"].tolist() == [10, 14, 20, 28]
    assert np.all(abs(data["sigma"] / data["floor"] - 1) < 0.25)
    assert told["recommended_box_px"].value in range(14, 21)
    assert data["shift"][-1] == pytest.approx(15, abs=0.6)
    assert data["peak"][0] == pytest.approx(data["shift"][len(data["shift"]) // 2 - 1], abs=0.7)
    strict = CorrelationNoiseOptions(wanted=1e-4)
    assert any("ask for less" in remark for remark in calibration.fit(data, strict).remarks)
