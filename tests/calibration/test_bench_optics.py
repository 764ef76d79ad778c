"""The camera of the simulated bench, from the run of a calibration to its certificate."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import Speckle
from hidden_benches import board, lines, seen
from test_bench_motion import values
from whole_runs import ran

from app.calibrations.camera_noise import CameraCalibration, CameraOptions
from app.calibrations.certifying import evaluated
from app.calibrations.pattern_map import PatternCalibration, PatternOptions
from app.calibrations.pixel_scale import ScaleCalibration, ScaleOptions
from app.settings.config import load
from app.system.errors import UserError

SMALL = ("camera.width=280", "camera.height=200", "run.normal_force=0.3", "dic.threads=1")


def recorded(calibration, options, folder, *settings):
    """The sessions of the runs of a calibration on the simulated bench."""
    plan = calibration.plan(load(None, [*SMALL, *settings]), options)
    return [ran(config, folder / f"{n}.h5") for n, config in enumerate(plan)]


def test_the_scale_of_a_turned_camera_with_a_lens(tmp_path):
    calibration, options = ScaleCalibration(), ScaleOptions(travel=200e-6, velocity=40e-6)
    hidden = ("camera.pixel 1.012",)
    sessions = recorded(
        *(calibration, options, tmp_path, "sim.drive_angle=2", "sim.distortion=0.8"),
        f"sim.errors={list(hidden)}".replace("'", '"'),
    )
    found = evaluated(calibration, sessions, options)
    told = values(found)
    assert told["pixel_m"].value == pytest.approx(7.04e-6 * 1.012, rel=5e-4)
    assert told["angle_degrees"].value == pytest.approx(2, abs=0.02)
    assert told["distortion_percent"].value == pytest.approx(0.8, abs=0.05)
    assert found.result.settings["camera.pixel"] == pytest.approx(7.04 * 1.012, rel=5e-4)
    assert 0.05 <= found.result.settings["uncertainty.pixel"] < 0.1
    found.write(tmp_path / "a.zip", overwrite=False)
    again = evaluated(calibration, [tmp_path / "a.zip"], options)
    assert repr(again.result.values) == repr(found.result.values)  # NaN is not NaN
    assert "do not show whether the picture is mirrored" in found.result.remarks[-1]
    # pushed to the left by hand, turned by half a degree: up in the picture, for a drive along +x
    pictures = [tmp_path / name for name in ("before.png", "left.png", "right.png")]
    block = Speckle((200, 280), seed=3)
    for path, way in zip(pictures, (0.0, -14.0, 14.0), strict=True):
        turn = 0.009 * (way != 0)
        cv2.imwrite(str(path), block.image(turn * (block.y - 100), way - turn * (block.x - 140)))
    for after, says in ((1, "the picture is not mirrored"), (2, "the picture is mirrored")):
        seen_by = evaluated(calibration, [*sessions, pictures[0], pictures[after]], options)
        assert seen_by.result.remarks[-1] == says
        assert repr(seen_by.result.values) == repr(found.result.values)
    picked = [tmp_path / name for name in ("after.png", "before.png")]
    picked[0].write_bytes(pictures[1].read_bytes())
    seen_by = evaluated(calibration, [*picked, *sessions], options)
    assert seen_by.result.remarks[-1] == "the picture is not mirrored"
    with pytest.raises(UserError, match="2 files found; give a session, with two pictures"):
        evaluated(calibration, [*sessions, pictures[0]], options)


@pytest.mark.parametrize("k", [-4.0, 4.0])
def test_a_strong_lens_is_not_seen_stronger(tmp_path, k):
    calibration, options = ScaleCalibration(), ScaleOptions(travel=150e-6, velocity=50e-6)
    sessions = recorded(calibration, options, tmp_path, f"sim.distortion={k}")
    told = values(evaluated(calibration, sessions, options))
    assert told["distortion_percent"].value == pytest.approx(k, abs=0.03)
    assert told["pixel_m"].value == pytest.approx(7.04e-6, rel=3e-4)


@pytest.mark.parametrize("target", ["board", "lines"])
def test_the_scale_of_a_picture(tmp_path, target):
    shape, path = (260, 340), tmp_path / "target.png"
    if target == "board":
        image = board(shape, 0.0, 24.0, (10, 7), (50.3, 30.7))
        options = ScaleOptions(corners=(10, 7), distance=24 * 7.11e-6)
    else:
        image, options = lines(shape), ScaleOptions(distance=11.3 * 7.11e-6)
    cv2.imwrite(str(path), seen(image))
    found = evaluated(ScaleCalibration(), [path], options)
    assert values(found)["pixel_m"].value == pytest.approx(7.11e-6, rel=5e-4)
    assert "camera.angle" not in found.result.settings
    with pytest.raises(UserError, match="a picture needs --distance"):
        evaluated(ScaleCalibration(), [path], ScaleOptions())


@pytest.mark.slow
def test_the_pattern_of_unequal_pixels(tmp_path):
    calibration, options = PatternCalibration(), PatternOptions(pictures=40)
    sessions = recorded(calibration, options, tmp_path, "sim.unequal_pixels=1.5")
    told = values(evaluated(calibration, sessions, options))
    assert told["unequal_percent"].value == pytest.approx(1.5, rel=0.1)
    assert told["gain_sd_percent"].value < 0.4
    assert told["bad_percent"].value < 0.5


def test_the_pattern_of_folders(tmp_path):
    rng = np.random.default_rng(2)
    gain = 1 + 0.02 * rng.standard_normal((120, 160))
    for name, level in (("dark", 0), ("flat", 120)):
        (tmp_path / name).mkdir()
        for n in range(12):
            image = 8 + level * gain + rng.normal(0, 1.2, gain.shape)
            cv2.imwrite(str(tmp_path / name / f"{n:02}.png"), np.rint(image).astype(np.uint8))
    pictures = sorted(tmp_path.glob("*/*.png"))
    found = evaluated(PatternCalibration(), pictures, PatternOptions())
    assert values(found)["unequal_percent"].value == pytest.approx(2, rel=0.05)
    assert np.std(found.data["gain"] / gain) < 0.006
    odd = tmp_path / "0.png"
    odd.write_bytes(pictures[-1].read_bytes())
    session = tmp_path / "s.h5"
    session.write_bytes(b"")
    for sources, said in (
        (pictures[:12], "0 sessions and 0 pictures named flat were given; give one session"),
        ([*pictures, session], "1 session and 12 pictures named flat were given"),
        ([session, tmp_path / "t.h5"], "2 sessions and 0 pictures named flat"),
        ([*pictures, odd], "0.png: neither this picture nor its folder has a name that begins"),
    ):
        with pytest.raises(UserError, match=said):
            PatternCalibration().gather(sources, PatternOptions())


def test_the_noise_of_the_camera(tmp_path):
    calibration, options = CameraCalibration(), CameraOptions()
    hidden = ("sim.read_noise=1.4", "sim.full_well=9000")
    sessions = recorded(calibration, options, tmp_path, *hidden)
    assert len(sessions) == 4
    found = evaluated(calibration, sessions, options)
    told = values(found)
    assert told["gain"].value == pytest.approx(255 / 9000, rel=0.05)
    assert told["read_noise"].value == pytest.approx(1.4, abs=0.1)
    assert told["full_well"].value == pytest.approx(9000, rel=0.05)
    assert told["nonlinearity"].value < 1
    assert "the best exposure is 1" in found.result.remarks[0]  # ms, of 10
    assert not found.result.settings
    pictures: list[Path] = []
    for n, light in enumerate((0.2, 0.2, 0.5, 0.5, 0.9, 0.9)):
        electrons = np.random.default_rng(n).poisson(light * 9000 * board((150, 190)) / 255)
        pictures.append(tmp_path / f"{n}.png")
        cv2.imwrite(str(pictures[-1]), np.rint(electrons * 255 / 9000).astype(np.uint8))
    told = values(evaluated(calibration, pictures, options))
    assert told["gain"].value == pytest.approx(255 / 9000, rel=0.1)
    assert "nonlinearity" not in told  # without exposures there is none
