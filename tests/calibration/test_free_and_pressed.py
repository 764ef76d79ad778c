"""Cross-talk and noise from sessions of a simulated bench whose cross-talk and noise are not those
of its settings, and sessions that tell neither.
"""

import math
from dataclasses import replace

import pytest
from whole_runs import ran

from app.calibrations.calibration import calibration_run
from app.calibrations.certifying import CalibrationRefused, evaluated
from app.calibrations.coupling import CouplingCalibration, PressingOptions
from app.calibrations.force_noise import ForceNoiseCalibration, NoiseOptions
from app.settings.config import load
from app.settings.protocol_steps import Hold

SMOOTH = ("sim.law=cattaneo-mindlin", "sim.pressure=hertz")  # made in no time
SMALL = ("camera.width=64", "camera.height=64", "dic.box=20", *SMOOTH)


@pytest.fixture(scope="module")
def pressings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pressings")
    hidden = 'sim.errors=["forces.shear_from_normal 0.013"]'
    plan = CouplingCalibration().plan(load(None, [*SMALL, hidden]), PressingOptions(rest=1.0))
    return [ran(config, folder / f"{i}.h5") for i, config in enumerate(plan)]


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    config = load(None, [*SMALL, "sim.force_noise=1.7", "sim.hum=0.4", "sim.zero_drift=3"])
    (config,) = ForceNoiseCalibration().plan(config, NoiseOptions(time=12.0))
    return ran(config, tmp_path_factory.mktemp("free") / "free.h5")


def test_pressings_on_a_simulated_bench_tell_its_hidden_cross_talk(pressings):
    found = evaluated(CouplingCalibration(), pressings, PressingOptions())
    (value,) = found.result.values
    assert value.value == pytest.approx(0.008 + 0.013, abs=1e-3)
    assert abs(value.value - 0.021) < 3 * value.sd < 5e-4
    # what records do not tell is as it was, and its uncertainty too
    assert list(found.certificate.settings) == ["forces.coupling"]
    assert found.certificate.settings["forces.coupling"] == [
        [1.0, 0.004], [pytest.approx(value.value), 1.0],
    ]  # fmt: skip
    assert any("tilted" in remark for remark in found.result.remarks)


def test_few_records_and_records_without_a_pressing_tell_no_cross_talk(pressings, free):
    with pytest.raises(CalibrationRefused, match="3 or more"):
        evaluated(CouplingCalibration(), pressings[:2], PressingOptions())
    with pytest.raises(CalibrationRefused, match="times its noise"):
        evaluated(CouplingCalibration(), [free], PressingOptions())


def test_sessions_of_other_settings_are_not_put_together(pressings, tmp_path):
    config = load(None, [*SMALL, "forces.coupling=[[1, 0], [0, 1]]"])
    (config, *_) = CouplingCalibration().plan(config, PressingOptions(rest=1.0))
    other = ran(config, tmp_path / "other.h5")
    with pytest.raises(CalibrationRefused, match="different forces"):
        evaluated(CouplingCalibration(), [*pressings, other], PressingOptions())


def test_a_free_block_tells_the_noise_of_its_sensors(free):
    found = evaluated(ForceNoiseCalibration(), [free], NoiseOptions(run_time=3.0))
    values = {one.name: one for one in found.result.values}
    # what the sensors' noise of 1.7 mN is in P and Q, whose cross-talk is undone
    for of in "PQ":
        for name, true in (
            (f"noise of {of}", math.hypot(1.7e-3, 0.4e-3)),
            (f"white noise of {of}", 1.7e-3),
            (f"{of}, mains, 50 Hz, rms", 0.4e-3),
            (f"drift of the zero of {of} in 3 s", 0.15e-3),
        ):
            assert values[name].value == pytest.approx(true, rel=0.15)
            assert abs(values[name].value - true) < 3.5 * values[name].sd + 0.01 * true
    # 3 mN a minute in 3 s, and the noise of means of 3 s
    assert found.certificate.settings["uncertainty.zero"] == pytest.approx(0.157, rel=0.25)
    assert any(
        one.startswith("P: the mean of 2.") and "resolves 1 mN" in one
        for one in found.result.remarks
    )
    found = evaluated(ForceNoiseCalibration(), [free], NoiseOptions())
    assert not found.certificate.settings  # not of a minute
    assert any("record 240 s or more" in remark for remark in found.result.remarks)


def test_only_the_time_before_a_contact_is_free(pressings, tmp_path):
    with pytest.raises(CalibrationRefused, match="5 s or more"):  # it is free for a second
        evaluated(ForceNoiseCalibration(), pressings[:1], NoiseOptions())
    with pytest.raises(CalibrationRefused, match="give one"):
        evaluated(ForceNoiseCalibration(), pressings, NoiseOptions())


def test_a_sensor_that_is_not_connected_has_no_noise(tmp_path):
    config = calibration_run(load(None, SMALL), [Hold(time=8.0)])
    quiet = replace(config, sim=replace(config.sim, force_noise=0.0))
    with pytest.raises(CalibrationRefused, match="does not change by one step"):
        evaluated(ForceNoiseCalibration(), [ran(quiet, tmp_path / "a.h5")], NoiseOptions())
