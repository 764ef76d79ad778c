"""Size of a pixel, direction of the camera and distortion: from travels of a stage."""

import math
from itertools import product

import numpy as np
import pytest
from blobs import Speckle, _add
from hidden_benches import ANGLE, M_PER_PX, SHAPE, STOPS, K, X, Y, fields, moved, scale_by_travel
from seeds import SEEDS, holds, joined, pulls, seen_by

from analysis.calibration.scale import is_mirrored, scale_of_travels
from analysis.dic import Correlation, Status, open_tracker
from drivers.sim.optics import Lens

TWO = math.radians(0.02)
WORLDS = "steps", "there and back", "warming", "no pauses"


def test_the_truth_is_within_the_stated_uncertainty():
    """Hidden benches of each of four kinds: the share of them is that of a Gaussian."""
    worlds = product(range(SEEDS // 4), WORLDS)
    found = joined(scale_by_travel(seed, world) for seed, world in worlds)
    for one in found.values():
        holds(pulls(one))
    back = seen_by(scale_by_travel, SEEDS // 4)
    for name, most in (("scale by travel", 5e-4 * M_PER_PX), ("angle of the travel", TWO)):
        value, _, true = back[name]
        assert np.abs(value - true).max() < most
    value, _, true = back["distortion by travel"]
    assert np.median(np.abs(value - true)) < 0.02


def test_exact_pictures_give_scale_angle_and_distortion():
    """Blobs integrated over the pixels, each where the lens shows it."""
    shape, speckle = (300, 400), Speckle((300, 400), seed=3)
    lens, travel, pictures = Lens.of(K, shape), np.arange(7) * 40e-6, []
    for way in travel / M_PER_PX * np.exp(1j * ANGLE):
        image = np.zeros(shape)
        places = lens.seen(speckle.x + way.real, speckle.y + way.imag)
        _add(image, *places, speckle.width, speckle.height)
        pictures.append(np.rint(20 + image * (40 / speckle.spread)).astype(np.uint8))
    with open_tracker(Correlation(box=24, step=12), pictures[0]) as tracker:
        x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
        tracked = [tracker.track(image) for image in pictures]
    bad = np.array([field.status for field in tracked]) != Status.OK
    u = np.array([[field.ux_px, field.uy_px] for field in tracked], np.float64)
    u = np.where(bad[:, None], np.nan, u)
    found = scale_of_travels(travel, x, y, u[:, 0], u[:, 1], shape)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=1e-4)  # 5e-4 was asked
    assert found.angle == pytest.approx(ANGLE, abs=math.radians(0.002))  # 0.02
    assert abs(found.k - K) * math.hypot(*shape) / 2 < 0.01  # 0.02 px


def test_a_camera_upside_down_has_its_travel_the_other_way():
    u = fields(np.random.default_rng(2), moved(-STOPS))
    assert scale_of_travels(STOPS, X, Y, *u, SHAPE).angle == pytest.approx(
        ANGLE - math.pi, abs=4e-4
    )


@pytest.mark.parametrize("drive", [0.0, 2.0, -3.0])
def test_a_motion_to_the_left_of_the_drive_tells_a_mirror(drive):
    """In the picture y is down: counterclockwise is from the drive towards -90 degrees."""
    rng, far = np.random.default_rng(1), math.radians(20)
    left = 30 * np.exp(1j * (drive - math.pi / 2 + far)) + rng.normal(0, 1, (2, 9)).T @ [1, 1j]
    left[3] = np.nan
    assert not is_mirrored(drive, left.real, left.imag)
    assert is_mirrored(drive, -left.real, -left.imag)
    assert is_mirrored(-drive, left.real, -left.imag)  # the same in a mirror
    with pytest.raises(ValueError, match=r"mirror: .* straight across"):
        is_mirrored(drive + math.pi / 2, left.real, left.imag)
    with pytest.raises(ValueError, match=r"mirror: .* push it further"):
        is_mirrored(drive, left.real / 5, left.imag / 5)


def spoiled(name):
    """Travel, fields and times of a bench on which the scale cannot be measured."""
    rng, time = np.random.default_rng(3), np.arange(len(STOPS)) * 1.0
    shift, travel = moved(STOPS), STOPS
    if name == "few":
        travel, shift = STOPS[:5], shift[:5]
    elif name == "still":
        shift = 0.1 * shift / abs(shift[-1])
    elif name == "slips":
        shift = np.minimum(abs(shift), 60)
    elif name == "drifts":
        travel = np.concatenate([STOPS, STOPS[::-1]])
        time = np.arange(len(travel)) * 1.0
        shift = moved(travel, time, 0.5 + 0j)
    u = fields(rng, shift)
    if name == "touches":
        u *= 1 - 0.5 * np.exp(-(((X - 300) ** 2 + (Y - 240) ** 2) / 150**2))
    if name == "lost":
        u[:, 4] = np.nan
    return travel, u, time[: len(travel)]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("few", "scale: 4 pictures were taken after the stage had moved, 5"),
        ("still", "has moved by .* px"),
        ("slips", "scale: the displacements scatter"),
        ("touches", "no plain translation; let the block touch nothing"),
        ("drifts", "scale: the picture drifts by .*warm up"),
        ("lost", "0 points were measured"),
    ],
)
def test_what_tells_no_scale_is_refused(name, says):
    travel, u, time = spoiled(name)
    with pytest.raises(ValueError, match=says):
        scale_of_travels(travel, X, Y, *u, SHAPE, time_s=time)


def test_one_picture_that_was_bumped_hardly_matters():
    shift = moved(np.concatenate([STOPS, STOPS[::-1]]))
    shift[7] += 0.3 + 0.2j
    u = fields(np.random.default_rng(4), shift)
    found = scale_of_travels(np.concatenate([STOPS, STOPS[::-1]]), X, Y, *u, SHAPE)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=5e-4)
    assert abs(found.m_per_px - M_PER_PX) < 2.5 * found.m_per_px_sd


def test_positions_that_an_encoder_rounds_are_uncertain_by_its_step():
    """A stage that rests in a few places is off together in all pictures of a rest."""
    found, step = [], 1e-6
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        places = np.repeat(np.arange(5) * rng.uniform(24e-6, 30e-6), 4)
        u = fields(rng, moved(places), wander=0.0)
        read = step * np.rint(places / step)
        one = scale_of_travels(read, X, Y, *u, SHAPE, step_m=step)
        found.append((one.m_per_px, one.m_per_px_sd, M_PER_PX))
    holds(pulls(np.transpose(found)))
