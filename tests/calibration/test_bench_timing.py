"""Timing of the simulated bench, from the run of a calibration to its certificate."""

import numpy as np
import pytest
from test_bench_motion import recorded, values

from app.calibrations.certifying import evaluated
from app.calibrations.synchronisation import Synchronisation, SynchronisationOptions
from app.session.reader import SessionReader
from app.settings.config import load
from app.system.errors import UserError

COUNTED = "forces.exposure_counter=ctr1"


def test_a_late_exposure_is_known_to_a_sample(tmp_path):
    calibration, options = Synchronisation(), SynchronisationOptions(time=4.0)
    recorded(calibration, options, tmp_path / "t.h5", COUNTED, "sim.exposure_lag=3.3")
    sample = np.arange(0, 4000, 40)
    rows = [f"{n},{17 + 1.00002 * n / 1000:.9f}" for n in sample]
    (tmp_path / "stamps.csv").write_text("\n".join(["sample,stamp_s", *rows]))
    found = evaluated(calibration, [tmp_path / "t.h5", tmp_path / "stamps.csv"], options)
    told = values(found)
    assert told["exposure_lag_s"].value == pytest.approx(3.3e-3, abs=1e-3)
    assert abs(told["exposure_lag_s"].value - 3.3e-3) < 2 * told["exposure_lag_s"].sd
    assert told["exposure_jitter_s"].value == 0
    assert told["clock_drift"].value == pytest.approx(20e-6, abs=1e-8)
    with pytest.raises(UserError, match="does not say the rate"):
        evaluated(calibration, [tmp_path / "stamps.csv"], options)
    for name in ("t.h5", "stamps.csv"):
        both = [tmp_path / "t.h5", tmp_path / "stamps.csv", tmp_path / f"2-{name}"]
        with pytest.raises(UserError, match=rf"{name} and .*2-{name} were given; give one session"):
            calibration.gather(both, options)


def test_channels_without_a_common_signal_and_benches_without_a_counter_are_refused(tmp_path):
    calibration, options = Synchronisation(), SynchronisationOptions(time=3.0, common_signal=True)
    with pytest.raises(UserError, match="wire the camera's exposure output"):
        calibration.plan(load(None), SynchronisationOptions())
    recorded(calibration, options, tmp_path / "t.h5")
    data = calibration.gather([tmp_path / "t.h5"], options)
    with pytest.raises(ValueError, match="wire one source of noise to both"):
        calibration.fit(data, options)
    with pytest.raises(ValueError, match="count no exposures"):
        calibration.fit({"rate_hz": np.array(1000.0)}, options)


@pytest.mark.slow
@pytest.mark.parametrize("time", [240.0, 3600.0])
def test_the_camera_s_clock_is_recorded_and_compared_with_the_board(tmp_path, time):
    calibration, options = Synchronisation(), SynchronisationOptions(time=time, camera_clock=True)
    bench = (COUNTED, "camera.width=64", "camera.height=64", "dic.box=20", "sim.exposure_lag=3.3")
    slow = ("forces.sample_rate=100", "forces.block=400", "camera.divisor=400", "limits.age=10")
    recorded(calibration, options, tmp_path / "t.h5", *bench, *slow, "sim.camera_clock=-37e-6")
    clock = values(evaluated(calibration, [tmp_path / "t.h5"], options))["clock_drift"]
    assert clock.value == pytest.approx(-37e-6, abs=1e-8)
    assert abs(clock.value + 37e-6) < 3 * clock.sd
    assert 1e-11 < clock.sd < 1e-8
    with SessionReader(tmp_path / "t.h5") as reader:
        seen = reader.triggers()
    assert seen["stamp"] == pytest.approx(1000 + seen["sample"] / 100 * (1 - 37e-6), abs=2e-6)
    without = calibration.gather([tmp_path / "t.h5"], SynchronisationOptions())
    assert set(without) == {"rate_hz", "lags"}
