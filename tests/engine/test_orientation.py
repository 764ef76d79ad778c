"""A camera that is turned or mirrored against the drive gives the same results."""

import math

import numpy as np
import pytest
import short_run
import whole_runs

from analysis.contact.orientation import Direction, drive_direction
from app.evaluation.conclusions import conclude
from app.evaluation.pipeline import Pipeline
from app.records.record_types import Phase
from app.settings import config

RECORDED = (*short_run.SMALL, "run.travel=48", "sim.law=elasto-plastic")
SETTINGS = (*RECORDED, short_run.TRACTION)


def recorded(path, *more):
    """Settings, and what each frame of a run was: (index, sample, image, conditions)."""
    whole_runs.recorded(path, *RECORDED, *more)
    return config.load(None, [*SETTINGS, *more]), whole_runs.frames_of(path)


@pytest.fixture(scope="module")
def upright(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("upright") / "run.h5")


def analysed(used, frames):
    pipeline = Pipeline(used)
    snapshots = [pipeline.step(*frame) for frame in frames]
    pipeline.close()
    return snapshots, pipeline.summary(snapshots)


@pytest.fixture(scope="module")
def expected(upright):
    return analysed(*upright)


TURNS = {
    "by half a turn": (lambda image: image[::-1, ::-1], math.pi, ()),
    "mirrored along the drive": (lambda image: image[:, ::-1], math.pi, ()),
    "mirrored across the drive": (lambda image: image[::-1], 0.0, ()),
    "by a quarter": (
        np.rot90,
        -math.pi / 2,
        ("camera.width=360", "camera.height=480"),
    ),
    "transposed": (lambda image: image.T, math.pi / 2, ("camera.width=360", "camera.height=480")),
}


@pytest.mark.parametrize("turned", TURNS)
def test_a_picture_turned_or_mirrored_gives_the_same_numbers(upright, expected, turned):
    turn, angle, more = TURNS[turned]
    _, frames = upright
    seen = [(i, n, np.ascontiguousarray(turn(image)), now) for i, n, image, now in frames]
    snapshots, summary = analysed(config.load(None, [*SETTINGS, *more]), seen)
    plain, told = expected
    off = (snapshots[-1].motion.drive_angle_rad - angle + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < math.radians(0.5)
    assert summary.onset_time_s == pytest.approx(told.onset_time_s, abs=0.02)
    assert summary.law_mu == pytest.approx(told.law_mu, rel=1e-6)
    assert summary.law_length_m == pytest.approx(told.law_length_m, rel=0.05, nan_ok=True)
    assert summary.young_modulus_pa == pytest.approx(told.young_modulus_pa, rel=0.005)
    a, b = plain[-1], snapshots[-1]
    np.testing.assert_allclose(b.rings.ux_m[:8], a.rings.ux_m[:8], rtol=0.01)
    assert any("from the rows of the picture" in n for n in summary.notes) == bool(angle)


ACROSS = "sim.image_drift=[0.006, 0.008]"


def test_any_angle_and_a_picture_that_drifts(tmp_path, expected):
    used, frames = recorded(tmp_path / "a.h5", "sim.drive_angle=143", ACROSS)
    snapshots, summary = analysed(used, frames)
    assert snapshots[-1].motion.drive_angle_rad == pytest.approx(math.radians(143), abs=0.08)
    assert summary.onset_time_s == pytest.approx(expected[1].onset_time_s, abs=0.1)
    assert summary.young_modulus_pa == pytest.approx(3.43e6, rel=0.03)


def test_an_angle_that_is_given_is_not_measured(upright):
    used, frames = upright
    given = config.load(None, [*SETTINGS, "camera.angle=180", "camera.angle_from=angle"])
    snapshots, summary = analysed(given, frames)
    assert {s.motion.drive_angle_rad for s in snapshots if s.motion} == {math.pi}
    assert math.isnan(summary.onset_time_s)  # this picture is upright
    plain = conclude(used, snapshots[:4], None, []).summary
    assert math.isnan(plain.mu_s)


def test_until_the_block_moves_the_direction_is_that_of_the_settings(upright):
    used, frames = upright
    start = next(k for k, frame in enumerate(frames) if frame[3].phase is Phase.DRIVE)
    snapshots, _ = analysed(used, frames[: start + 1])
    assert {s.motion.drive_angle_rad for s in snapshots if s.motion} == {0.0}


def test_the_direction_is_that_of_the_points_outside_the_contact():
    rng = np.random.default_rng(0)
    u, v = rng.normal(0.6, 0.05, (20, 30)), rng.normal(-0.8, 0.05, (20, 30))
    outside = np.ones((20, 30), bool)
    outside[5:15, 5:25], u[5:15, 5:25], u[0, 0] = False, 0.0, np.nan
    found = drive_direction(u, v, outside, least=0.5)
    assert found.angle == pytest.approx(math.atan2(-0.8, 0.6), abs=0.01)
    assert drive_direction(u, v, outside, least=2.0) is None
    assert drive_direction(u * np.nan, v, outside, least=0.0) is None
    assert found.along(0.6, -0.8) == pytest.approx(1.0, abs=1e-3)
    assert found.across(0.8, 0.6) == pytest.approx(1.0, abs=1e-3)
    for quarter in range(-2, 3):
        exact = Direction.at(quarter * math.pi / 2)
        assert exact == (round(math.cos(exact.angle)), round(math.sin(exact.angle)))
