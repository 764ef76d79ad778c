"""Compliance of the lens holder of a simulated bench, by marks on the lens and by a gauge."""

import numpy as np
import pytest
from test_bench_motion import recorded, values

from app.calibrations.certifying import CalibrationRefused, evaluated
from app.calibrations.lens_holder import LensHolder, LensHolderOptions
from app.settings.config import load
from app.system.errors import UserError

STRIP = 90
MARKED = LensHolderOptions(region=(f"inside 0 0 320 0 320 {STRIP} 0 {STRIP}",), cycles=1)
SMALL = (
    "camera.width=320",
    "camera.height=240",
    "camera.pixel=10",
    "camera.divisor=125",
    "run.velocity=10",
    f"sim.lens_marks={STRIP}",
    "sim.pressure=hertz",
    'sim.errors=["sample.lens_compliance 1.2"]',
    "dic.threads=1",
)


def test_marks_on_the_lens_tell_its_compliance(tmp_path):
    calibration = LensHolder()
    recorded(calibration, MARKED, tmp_path / "c.h5", *SMALL)
    found = evaluated(calibration, [tmp_path / "c.h5"], MARKED)
    told = values(found)["lens_compliance_m_n"]
    true = 1.2 * 0.68e-6  # the settings say 0.68
    assert abs(told.value - true) < 3 * told.sd
    assert told.sd < 0.03 * true
    assert told.systematic == pytest.approx(told.value * 0.0064, rel=0.05)
    settings = found.certificate.settings
    assert settings["sample.lens_compliance"] == pytest.approx(told.value * 1e6)
    assert settings["uncertainty.lens_compliance"] == pytest.approx(100 * told.total / told.value)
    # the block beside the marks moves with its stage
    block = LensHolderOptions(region=("inside 0 130 320 130 320 240 0 240",))
    with pytest.raises(CalibrationRefused, match=r"bend|loop|further from the fit|as a whole"):
        evaluated(calibration, [tmp_path / "c.h5"], block)
    with pytest.raises(UserError, match="it has no channel 'T'"):
        calibration.gather([tmp_path / "c.h5"], LensHolderOptions(region=block.region, channel="T"))


def test_a_gauge_and_a_thermometer(tmp_path):
    rng, time = np.random.default_rng(0), np.arange(120.0)
    Q = 0.4 * (1 - np.cos(time / 10))
    degrees = 21 + 0.3 * np.sin(time / 45)
    moved = 0.7 * Q + 0.05 * degrees + 0.004 * rng.standard_normal(120)
    rows = zip(time, Q, moved, degrees, strict=True)
    text = "\n".join(["time_s,Q_N,moved_um,channel", *(",".join(map(str, one)) for one in rows)])
    (tmp_path / "gauge.csv").write_text(text)
    told = values(evaluated(LensHolder(), [tmp_path / "gauge.csv"], LensHolderOptions()))
    for key, true in (("lens_compliance_m_n", 0.7e-6), ("per_channel_m", 0.05e-6)):
        assert abs(told[key].value - true) < 3 * told[key].sd < 0.5 * true
    (tmp_path / "other.csv").write_text("time_s,Q_N\n1,2\n")
    with pytest.raises(UserError, match="no time_s, Q_N or moved_um"):
        evaluated(LensHolder(), [tmp_path / "other.csv"], LensHolderOptions())


def test_a_run_without_marks_is_refused():
    with pytest.raises(UserError, match="put marks on the lens"):
        LensHolder().plan(load(None), LensHolderOptions())
