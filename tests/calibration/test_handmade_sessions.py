"""Calibrations on sessions of pictures that are made by hand, whose motion is known exactly."""

import contextlib
import math
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from blobs import Speckle
from handmade import reader_of
from matplotlib.figure import Figure
from test_photon_transfer import Sensor

from analysis.calibration.pixel_map import PixelMap
from app.calibrations.actuator import ActuatorCalibration, ActuatorOptions
from app.calibrations.camera_noise import CameraCalibration, CameraOptions
from app.calibrations.correlation_noise import CorrelationNoise, CorrelationNoiseOptions
from app.calibrations.coupling import CouplingCalibration, PressingOptions
from app.calibrations.lens_holder import LensHolder, LensHolderOptions
from app.calibrations.pattern_map import PatternCalibration, PatternOptions, _kept
from app.calibrations.pixel_scale import ScaleCalibration, ScaleOptions
from app.calibrations.sample_adhesion import AdhesionCalibration, JkrOptions
from app.calibrations.sample_roughness import MapOptions, RoughnessCalibration
from app.settings.config import load
from app.system.errors import UserError

LIGHTS = 0.05, 0.12, 0.25, 0.45, 0.7, 2.0  # the last cuts the brightest pixels off
SHAPE, STRIP, PIXEL = (140, 160), 60, 10e-6
C = 6e-6  # m/N, of the holder


def pressed_on_a_marked_lens(angle):
    """Pictures of a block that follows its stage along `angle`, below marks on a lens that gives
    way to Q along it; positions and Q.
    """
    Q = 0.8 * np.abs(np.sin(np.linspace(0, 2 * np.pi, 44)))
    stage = 60e-6 * Q
    lens, block = Speckle(SHAPE, seed=1), Speckle(SHAPE, seed=2)
    x, y = math.cos(angle), math.sin(angle)
    pictures = []
    for q, way in zip(Q, stage, strict=True):
        marks = lens.grey(x * C * q / PIXEL, y * C * q / PIXEL, contrast=12, level=30)
        moved = block.grey(x * way / PIXEL, y * way / PIXEL, contrast=12, level=140)
        moved[:STRIP] = marks[:STRIP]
        pictures.append(np.rint(np.clip(moved, 0, 250)).astype(np.uint8))
    return pictures, stage, Q


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degrees", "angle_from"), [(30, "angle"), (180, "angle"), (-75, "motion"), (180, "motion")]
)
def test_the_motion_of_the_lens_is_that_along_the_drive(degrees, angle_from):
    made = pressed_on_a_marked_lens(math.radians(degrees))
    told = degrees if angle_from == "angle" else 0
    settings = f"camera.angle={told}", f"camera.angle_from={angle_from}", "camera.pixel=10"
    reader = reader_of(*made, *settings, "dic.threads=1")
    marks = LensHolderOptions(region=(f"inside 0 0 160 0 160 {STRIP} 0 {STRIP}",))
    data = LensHolder()._seen(reader, marks)
    found = LensHolder().fit(data, marks)
    assert found.values[0].value == pytest.approx(C, rel=0.02)
    off = math.degrees(float(data["angle"])) - degrees
    assert abs((off + 180) % 360 - 180) < 2
    assert any("degrees in the picture" in remark for remark in found.remarks)


def test_a_block_that_does_not_move_tells_no_direction():
    pictures, stage, Q = pressed_on_a_marked_lens(0.0)
    reader = reader_of([pictures[0]] * len(Q), 0 * stage, Q, "camera.pixel=10", "dic.threads=1")
    with pytest.raises(ValueError, match=r"camera\.angle: the block moves by less"):
        LensHolder()._seen(reader, LensHolderOptions(region=("inside 0 0 160 0 160 50 0 50",)))


@pytest.fixture
def open_as(monkeypatch):
    """Has sessions be opened as readers that are given, by their name."""

    def opened(**readers):
        def reader(path):
            return contextlib.nullcontext(readers[path.stem])

        monkeypatch.setattr("app.calibrations.session_readings.SessionReader", reader)
        return [Path(f"{name}.h5") for name in readers]

    return opened


def sessions_of_a_12_bit_camera(*settings, lights=LIGHTS):
    sensor = Sensor(3, gain=0.2, top=4095)
    for n, light in enumerate(lights):
        pictures = [sensor.picture(light) for _ in range(2)]
        exposure = f"camera.exposure={10 * light}"
        yield f"s{n}", reader_of(pictures, np.zeros(2), np.zeros(2), exposure, *settings)


@pytest.mark.parametrize("given", ["camera.pixel_format=Mono12", "camera.pixel_format=Mono16"])
def test_the_grey_scale_of_a_12_bit_camera_ends_where_its_settings_say_or_it_is_cut_off(
    open_as, given
):
    # of files that are imported nobody knows more than the 16 bits of their type
    sources = open_as(**dict(sessions_of_a_12_bit_camera(given)))
    options = CameraOptions(dark=8.0)
    data = CameraCalibration().gather(sources, options)
    assert float(data["top"]) == 4095
    found = CameraCalibration().fit(data, options)
    told = {one.key: one.value for one in found.values}
    assert told["full_well"] == pytest.approx((4095 - 8) / 0.2, rel=0.05)
    assert told["nonlinearity"] < 1
    assert any("4095 and above count as saturated" in one for one in found.remarks)


def test_values_that_are_not_known_are_no_values(open_as):
    sources = open_as(**dict(sessions_of_a_12_bit_camera("camera.pixel_format=Mono12")))
    data = CameraCalibration().gather(sources[:2] + sources[-1:], CameraOptions(dark=8.0))
    found = CameraCalibration().fit(data, CameraOptions(dark=8.0))
    assert "nonlinearity" not in {one.key for one in found.values}
    assert all(math.isfinite(one.value) for one in found.values)


def test_files_of_16_bits_need_the_end_of_their_scale(tmp_path):
    sensor, paths = Sensor(4, gain=0.2, top=4095), []
    for n, light in enumerate((0.1, 0.1, 0.3, 0.3, 0.7, 0.7)):
        paths.append(tmp_path / f"{n}.png")
        cv2.imwrite(str(paths[-1]), sensor.picture(light))
    with pytest.raises(UserError, match="give --top"):
        CameraCalibration().gather(paths, CameraOptions())
    data = CameraCalibration().gather(paths, CameraOptions(top=4095.0))
    assert float(data["top"]) == 4095
    with pytest.raises(UserError, match="--longest 20 cannot be kept"):
        CameraCalibration().fit(data, CameraOptions(longest=0.02))


def test_a_flat_field_of_12_bits_that_is_cut_off_is_refused(tmp_path):
    (tmp_path / "flat").mkdir()
    flat = np.random.default_rng(1).normal(4060, 25, (9, 60, 80))
    for n, image in enumerate(np.rint(np.clip(flat, 0, 4095)).astype(np.uint16)):
        cv2.imwrite(str(tmp_path / "flat" / f"{n}.png"), image)
    pictures = sorted(tmp_path.glob("flat/*"))
    for options in (PatternOptions(), PatternOptions(top=4095.0)):
        with pytest.raises(ValueError, match="saturated"):
            PatternCalibration().gather(pictures, options)


MOVING = (
    (ActuatorCalibration(), ActuatorOptions()),
    (CorrelationNoise(), CorrelationNoiseOptions()),
    (ScaleCalibration(), ScaleOptions()),
)
SEEN = (CameraCalibration(), CameraOptions()), (PatternCalibration(), PatternOptions())


@pytest.mark.parametrize(("calibration", "options"), MOVING)
def test_a_session_at_rest_says_that_its_stage_does_not_move(open_as, calibration, options):
    pictures = [np.rint(Speckle((64, 64), seed=1).grey()).astype(np.uint8)] * 20
    sources = open_as(rest=reader_of(pictures, np.full(20, 0.01), np.zeros(20)))
    with pytest.raises(ValueError, match="travel: the stage moves by 0 um"):
        calibration.gather(sources, options)
    sources = open_as(unread=reader_of(pictures, np.zeros(20)[:0], np.zeros(20)))
    with pytest.raises(ValueError, match="travel: the stage was not read"):
        calibration.gather(sources, options)


@pytest.mark.parametrize(("calibration", "options"), MOVING + SEEN)
def test_a_session_without_pictures_says_so(open_as, calibration, options):
    reader = reader_of([], np.zeros(0), np.zeros(0))
    reader.positions = lambda: (np.arange(0, 1000, 10), np.linspace(0, 1e-4, 100))
    with pytest.raises(ValueError, match=r"pictures: made\.h5 has none"):
        calibration.gather(open_as(blind=reader), options)


def test_a_session_without_pictures_of_its_motion_says_so(open_as):
    pictures = [np.rint(Speckle((64, 64), seed=1).grey()).astype(np.uint8)] * 20
    reader = reader_of(pictures, np.zeros(20), np.zeros(20))
    reader.positions = lambda: (np.array([0, 186, 187]), np.array([0, 1e-6, 1e-4]))
    with pytest.raises(ValueError, match="has none while its stage moves"):
        CorrelationNoise().gather(open_as(late=reader), CorrelationNoiseOptions())


def test_a_map_is_kept_as_well_as_it_is_known():
    rng = np.random.default_rng(5)
    gain, dark = rng.normal(1, 0.02, (40, 50)), rng.normal(200, 3, (40, 50))
    found = PixelMap(np.float32(dark), np.float32(gain), np.zeros(gain.shape, bool), 2e-4)
    kept = _kept(found, 3000 * gain)
    assert np.abs(kept["gain"] - gain).max() < 1e-6  # of 3000 grey levels, 0.003
    assert np.abs(kept["dark"] - dark).max() < 1e-4


def test_the_uncertainty_of_poissons_ratio_is_that_of_the_session(open_as, monkeypatch):
    monkeypatch.setattr(
        "app.calibrations.smooth_contacts._of_session", lambda *_: {"a": np.array([1e-3])}
    )
    pictures = [np.zeros((64, 64), np.uint8)]
    reader = reader_of(pictures, np.zeros(1), np.zeros(1), "uncertainty.poisson=0.03")
    files = open_as(jkr=reader)
    opened = contextlib.nullcontext(reader)
    monkeypatch.setattr("app.calibrations.smooth_contacts.SessionReader", lambda _: opened)
    data = AdhesionCalibration().gather(files, JkrOptions())
    assert float(data["nu_sd"]) == 0.03


def pressings(noise, coupling=((1.0, 0.004), (0.008, 1.0))):
    """Three records whose shear sensor reads 2 % of P."""
    P = 0.5 * np.clip(np.linspace(-1, 2, 3000), 0, 1)
    rng = np.random.default_rng(4)
    each = [np.column_stack([P, 0.02 * P]) + rng.normal(0, noise, (3000, 2)) for _ in range(3)]
    held = {"rate": 1000.0, "coupling": coupling, "coupling_sd": 0.003}
    return {"readings": np.concatenate(each), "counts": np.full(3, 3000)} | {
        name: np.array(value) for name, value in held.items()
    }


def test_the_uncertainty_of_the_cross_talk_is_not_below_what_is_found():
    calibration, options = CouplingCalibration(), PressingOptions()
    assert "uncertainty.coupling" not in calibration.fit(pressings(1e-3), options).settings
    wide = pressings(1e-3) | {"coupling_sd": np.array(1e-5)}
    found = calibration.fit(wide, options)
    assert found.settings["uncertainty.coupling"] == pytest.approx(100 * found.values[0].sd)


def test_the_picture_of_the_cross_talk_shows_the_share_that_was_found():
    data = pressings(1e-4, coupling=((2.0, 0.0), (0.0, 1.0)))
    found = CouplingCalibration().fit(data, PressingOptions())
    assert found.settings["forces.coupling"][1][0] == pytest.approx(2 * 0.02, rel=0.01)
    figure = Figure()
    CouplingCalibration().draw(figure, data, found)
    slopes = [
        np.ptp(line.get_ydata()) / np.ptp(line.get_xdata())
        for line in figure.axes[0].lines
        if len(line.get_xdata()) == 2
    ]
    assert slopes == pytest.approx([20, 20, 20], rel=0.01)  # mN/N


def test_a_record_that_is_given_twice_counts_as_no_other(monkeypatch):
    read = np.random.default_rng(1).normal(size=(50, 2))
    told = {"a": read, "b": read + 1, "c": read}
    monkeypatch.setattr(
        "app.calibrations.stretches.pressed_readings",
        lambda path: (told[path.stem], load(None, ["uncertainty.coupling=0.7"])),
    )
    a, b, c = (Path(f"{name}.h5") for name in "abc")
    with pytest.raises(ValueError, match=r"c\.h5 has the readings of a\.h5"):
        CouplingCalibration().gather([a, b, c], PressingOptions())
    data = CouplingCalibration().gather([a, b], PressingOptions())
    assert float(data["coupling_sd"]) == pytest.approx(0.007)


def loaded_holder(noise_m=1e-9):
    """Readings of Q and of a gauge at a holder that gives way by 0.7 um/N."""
    rng, time = np.random.default_rng(0), np.arange(120.0)
    Q = 0.4 * (1 - np.cos(time / 10))
    moved = 0.7e-6 * Q + rng.normal(0, noise_m, 120)
    return {"time_s": time, "shear_force_n": Q, "moved_m": moved}


def test_the_uncertainties_of_a_gauge_and_of_q_are_in_that_of_the_compliance(tmp_path):
    columns = zip(*loaded_holder().values(), strict=True)
    rows = [f"{t},{q},{1e6 * x}" for t, q, x in columns]
    (tmp_path / "gauge.csv").write_text("\n".join(["time_s,Q_N,moved_um", *rows]))
    data = LensHolder().gather([tmp_path / "gauge.csv"], LensHolderOptions())
    for share in (0.005, 0.03):  # 0.5 % unless another is given
        options = (
            LensHolderOptions() if share == 0.005 else LensHolderOptions(gauge_uncertainty=0.03)
        )
        found = LensHolder().fit(data, options)
        value, of_Q = found.values[0].value, math.hypot(0.003, 25 / 9579)
        assert found.values[0].systematic == pytest.approx(value * math.hypot(share, of_Q))
        told = found.settings["uncertainty.lens_compliance"]
        assert told == pytest.approx(100 * found.values[0].total / value)


def test_a_compliance_within_its_uncertainty_is_refused():
    data = loaded_holder(noise_m=20e-6) | {"scale_sd": np.array(0.0)}
    with pytest.raises(ValueError, match=r"um/N is not resolved"):
        LensHolder().fit(data, LensHolderOptions())


def test_heights_that_hardly_tell_their_rms_are_refused(monkeypatch):
    def each(self, data, options):
        return tuple(
            SimpleNamespace(h=h, h_sd=h, correlation_length=1e-5, notes=()) for h in (1e-6,)
        )

    monkeypatch.setattr(RoughnessCalibration, "_each", each)
    with pytest.raises(ValueError, match="roughness: h is"):
        RoughnessCalibration().fit({}, MapOptions())
