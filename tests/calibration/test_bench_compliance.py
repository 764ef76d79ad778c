"""Compliance of the lens holder of a simulated bench, by marks on the lens and by a gauge."""

import numpy as np
import pytest
from test_bench_motion import recorded, values

from app.calibrations.certifying import CalibrationRefused, evaluated
from app.calibrations.lens_holder import LensHolder, LensHolderOptions
from app.calibrations.pattern_map import PatternCalibration, PatternOptions
from app.records.pixel_pattern import PixelPattern
from app.session.reader import SessionReader
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


def test_a_map_of_the_pixels_frees_the_compliance_from_their_pull(tmp_path, monkeypatch):
    uneven, session = "sim.unequal_pixels=3", tmp_path / "c.h5"
    options = PatternOptions(pictures=40)
    recorded(PatternCalibration(), options, tmp_path / "p.h5", *SMALL, uneven, "sim.lens_marks=0")
    gain = PatternCalibration().gather([tmp_path / "p.h5"], options)["gain"]
    recorded(LensHolder(), MARKED, session, *SMALL, uneven)

    def told(gain):
        pattern = None if gain is None else PixelPattern(gain, np.zeros_like(gain))
        monkeypatch.setattr(SessionReader, "pattern", lambda self: pattern)
        found = evaluated(LensHolder(), [session], MARKED)
        assert any("no map of its pixels" in one for one in found.certificate.remarks) is (
            gain is None
        )
        value = values(found)["lens_compliance_m_n"]
        return (value.value - 1.2 * 0.68e-6) / value.sd

    assert told(None) < -3  # what stays in the picture hides a part of the motion
    assert abs(told(gain)) < 2
    marked = gain.copy()
    marked[:STRIP] *= np.random.default_rng(0).uniform(0.7, 1.3, marked[:STRIP].shape)
    with pytest.raises(CalibrationRefused, match=r"2\d % in the region of the marks and by [23]"):
        told(marked)


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
