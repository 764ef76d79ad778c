"""Size of a pixel, direction of the camera and distortion: from travels of a stage."""

import itertools
import math

import numpy as np
import pytest
from blobs import Speckle, _add

from analysis.calibration.scale import scale_of_travels
from analysis.dic import Correlation, Status, open_tracker
from drivers.sim.optics import Lens

SHAPE, M_PER_PX, ANGLE, K = (480, 640), 7.11e-6, math.radians(3.2), -0.008
X, Y = np.meshgrid(np.arange(20.0, 600, 25), np.arange(20.0, 460, 25))
DRIFT_PX_PER_S = 0.002
STOPS = np.arange(0.0, 661e-6, 60e-6)


def overlapping(rng):
    """Noise of unit variance of boxes that overlap by half along both axes."""
    fine = rng.standard_normal((X.shape[0] + 1, X.shape[1] + 1))
    return (fine[1:, 1:] + fine[:-1, 1:] + fine[1:, :-1] + fine[:-1, :-1]) / 2


def fields(rng, shift, noise=0.01, wander=0.004, k=K):
    """What the correlation finds of a block that was shifted, (n,) complex px: boxes share the
    noise of the first picture, and the stage wanders by nanometres.
    """
    lens, first = Lens.of(k, SHAPE), [overlapping(rng) for _ in range(2)]
    ideal, found = lens.ideal(X, Y), []
    for one in shift:
        way = complex(one) + wander * complex(*rng.standard_normal(2))
        to = lens.seen(ideal[0] + way.real, ideal[1] + way.imag)
        now = [(overlapping(rng) - was) * noise / math.sqrt(2) for was in first]
        found.append([to[0] - X + now[0], to[1] - Y + now[1]])
    return np.moveaxis(np.array(found), 1, 0)


def moved(travel, time=None, drift=0j, play=0.0):
    """Displacements, px, of a block behind a stage with play."""
    at, actual = travel[0] - play / 2, []
    for one in travel:
        at = min(max(at, one - play / 2), one + play / 2)
        actual.append(at)
    shift = np.array(actual) / M_PER_PX * np.exp(1j * ANGLE)
    if time is not None:
        shift = shift + drift * time
    return shift - shift[0]


def test_the_truth_is_within_the_stated_uncertainty():
    """60 hidden benches of each of four kinds: the share of them is that of a Gaussian."""
    pulls = {name: [] for name in ("scale", "angle", "k", "play", "drift")}
    corner_px = []
    for world, seed in itertools.product(
        ("steps", "there and back", "warming", "no pauses"), range(60)
    ):
        rng = np.random.default_rng([20, seed])
        travel = np.concatenate([STOPS, STOPS[::-1]]) if world == "there and back" else STOPS
        if world == "no pauses":
            travel = np.linspace(0, 660e-6, 14)
        time, drift = np.arange(len(travel)) * 1.0, complex(*rng.normal(0, DRIFT_PX_PER_S, 2))
        if world == "warming":
            travel, time = np.repeat(STOPS, 2), np.arange(2 * len(STOPS)) * 1.0
            drift = 0.05 - 0.01j
        u = fields(rng, moved(travel, time, drift, play=2.5e-6))
        drift_sd = DRIFT_PX_PER_S * M_PER_PX
        found = scale_of_travels(travel, X, Y, *u, SHAPE, time_s=time, drift_sd=drift_sd)
        if world == "there and back":
            assert found.m_per_px == pytest.approx(M_PER_PX, rel=5e-4)
            assert found.angle == pytest.approx(ANGLE, abs=math.radians(0.02))
            corner_px.append(abs(found.k - K) * math.hypot(*SHAPE) / 2)
            pulls["play"].append((found.backlash_m - 2.5e-6) / found.backlash_sd)
        else:
            assert math.isnan(found.backlash_m)
        if world in {"there and back", "warming"}:
            pulls["drift"].append((found.drift_px_per_s[0] - drift.real) / found.drift_sd)
        pulls["scale"].append((found.m_per_px - M_PER_PX) / found.m_per_px_sd)
        pulls["angle"].append((found.angle - ANGLE) / found.angle_sd)
        pulls["k"].append((found.k - K) / found.k_sd)
    assert np.median(corner_px) < 0.02
    for name, off in pulls.items():
        inside = [float((np.abs(off) < sigmas).mean()) for sigmas in (1, 2)]
        assert 0.6 <= inside[0] <= 0.76, name
        assert inside[1] >= 0.9, name


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
