"""A camera that is turned or mirrored against the drive gives the same results."""

import math

import numpy as np
import pytest
import short_run
import whole_runs

from analysis.contact.orientation import Direction, drive_direction
from app.evaluation.conclusions import conclude
from app.evaluation.pipeline import Pipeline
from app.evaluation.setup import is_behind
from app.records.record_types import Conditions, Phase
from app.settings import config

RECORDED = (*short_run.SMALL, "run.travel=48", "sim.law=elasto-plastic")
SETTINGS = (*RECORDED, short_run.TRACTION)


def recorded(path, *more):
    """Settings, and what each frame of a run was: (index, sample, image, conditions)."""
    # correlated when it is analysed, and not before
    whole_runs.recorded(path, *RECORDED, *more, "recording.results=forces")
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_block_behind_its_place_in_the_reference_has_the_results_of_the_same_drive(tmp_path):
    steps = '{do="background"}, {do="approach"}, {do="reference"}'
    steps += ', {do="drive", travel=48}, {do="drive", travel=-110}'
    used, frames = recorded(tmp_path / "a.h5", f"run.steps=[{steps}]")
    with short_run.without_budget():
        snapshots, summary = analysed(used, frames)
    start = next(s.conditions for s in snapshots if s.conditions.phase is Phase.REFERENCE)
    behind = [s for s in snapshots if s.conditions.travel_m < -25e-6]
    assert len(behind) > 50
    for s in behind:
        bent = (s.conditions.shear_force_n - start.shear_force_n) / used.forces.stiffness_shear
        # stage and cantilever tell where the block is
        assert s.traction.block_m == pytest.approx(s.conditions.travel_m - bent, abs=1e-6)
        assert s.traction.stress_force_n == pytest.approx(s.conditions.shear_force_n, abs=3e-3)
        assert abs(s.motion.drive_angle_rad) < 0.05
    assert summary.slide_mu_d == pytest.approx((0.93, 0.93), rel=0.01)
    assert not any(note.startswith("camera") for note in summary.notes)


def test_the_block_is_behind_only_where_stage_and_cantilever_both_say_so():
    used = config.load(None, ["forces.stiffness_shear=10000"])
    start = Conditions(Phase.REFERENCE, math.nan, 0.5, 0.02, 3e-6)

    def at(travel_um, shear_n):
        now = Conditions(Phase.DRIVE, 1.0, 0.5, shear_n, 3e-6 + 1e-6 * travel_um)
        return is_behind(used, now, start)

    assert not at(-50, -0.46)  # the cantilever has let the block go on by 48 um
    assert at(-60, -0.46)
    assert at(-40, 0.3)
    assert not at(20, 0.5)  # a cantilever stiffer than in the settings
    assert not at(math.nan, -0.46)
    assert not at(-60, math.nan)
