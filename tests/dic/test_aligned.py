"""Pictures that are turned and stretched by more than a correlation follows, against blobs that are
turned, stretched and integrated over the pixels without interpolation.
"""

import math
from functools import partial

import cv2
import numpy as np
import pytest

from analysis.dic import Correlation, Grid, Status, open_tracker
from analysis.dic.aligned import alignment, track_aligned
from analysis.settings import Correlation as Settings
from app.files.correlating import correlate_files
from drivers.sim.speckle import add_blobs

SHAPE = (300, 400)
CENTRE = np.array([200.0, 150.0])


def picture(matrix, shift, noise=2.0, seed=0):
    """The pattern after x -> CENTRE + matrix (x - CENTRE) + shift."""
    rng = np.random.default_rng(1)
    n = int(0.15 * 900 * 900)
    x = rng.uniform(-250, 650, (2, n)) - [[0], [50]]
    sigma, peak = rng.uniform(0.75, 1.25, n), rng.uniform(0.4, 1.0, n)
    there = CENTRE[:, None] + matrix @ (x - CENTRE[:, None]) + np.asarray(shift)[:, None]
    c = matrix @ matrix.T
    peak = peak / abs(np.linalg.det(matrix))
    image = np.zeros(SHAPE)
    add_blobs(image, *there, *(sigma**2 * v for v in (c[0, 0], c[0, 1], c[1, 1])), peak)
    grey = 20 + 60 * image + noise * np.random.default_rng(seed).standard_normal(SHAPE)
    return grey.clip(0, 255).round().astype(np.uint8)


def deformation(degrees, strain):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s], [s, c]]) @ np.diag([1 + strain, 1.0])


REFERENCE = picture(np.eye(2), (0, 0), seed=5)
make = partial(open_tracker, Correlation(threads=1))


def expected(grid, matrix, shift):
    x = np.stack(np.meshgrid(grid.x_px, grid.y_px)) - CENTRE[:, None, None]
    return np.tensordot(matrix, x, 1) - x + np.asarray(shift)[:, None, None]


@pytest.mark.parametrize(("degrees", "strain"), [(170, 0.3), (170, 0.0), (0, 0.3), (-8, -0.2)])
def test_turned_and_stretched_pictures_are_measured(degrees, strain):
    matrix, shift = deformation(degrees, strain), (3.3, -2.7)
    image = picture(matrix, shift, seed=6)
    found = alignment(REFERENCE, image)
    assert found.matches > 50
    np.testing.assert_allclose(found.matrix, matrix, atol=0.01)
    field = track_aligned(make, REFERENCE, image, found)
    grid = Grid.cover(SHAPE, 20, 10)
    ux, uy = expected(grid, matrix, shift)
    ok = field.status == Status.OK
    x, y = (np.stack(np.meshgrid(grid.x_px, grid.y_px)) + np.stack([ux, uy])).reshape(2, -1)
    stays = ((x > 20) & (x < 380) & (y > 20) & (y < 280)).reshape(ok.shape)
    assert ok[stays].mean() > 0.97
    assert not ok[~stays & ((x < 0) | (x > 399) | (y < 0) | (y > 299)).reshape(ok.shape)].any()
    for measured, true in ((field.ux_px, ux), (field.uy_px, uy)):
        miss = (measured - true)[ok & stays]
        assert abs(np.median(miss)) < 0.01
        assert np.sqrt(np.mean(miss**2)) < 0.03
    assert np.median(np.abs((field.ux_px - ux)[ok] / field.ux_std_px[ok])) < 1.5


def test_pictures_that_share_nothing_have_no_alignment():
    rng = np.random.default_rng(3)
    assert alignment(REFERENCE, np.full(SHAPE, 90, np.uint8)) is None
    noise = rng.integers(0, 255, SHAPE).astype(np.uint8)
    assert alignment(REFERENCE, noise) is None
    field = make(REFERENCE).track(noise)
    assert (field.status != Status.OK).all()


def test_slipscope_dic_turns_back_only_what_is_lost(tmp_path):
    files = []
    for n, image in enumerate(
        (
            REFERENCE,
            picture(np.eye(2), (1.3, 0.2), seed=7),
            picture(deformation(170, 0.3), (0, 0), seed=8),
        )
    ):
        files.append(tmp_path / f"{n}.png")
        assert cv2.imwrite(str(files[-1]), image)
    output = tmp_path / "fields.npz"
    summary = correlate_files(files[0], files[1:], output, Settings(threads=1))
    assert summary.aligned == 1
    with np.load(output) as held:
        status, ux, x, y = (held[name] for name in ("status", "ux_px", "x_px", "y_px"))
    true = np.tensordot(
        deformation(170, 0.3) - np.eye(2),
        np.stack(np.meshgrid(x, y)) - CENTRE[:, None, None],
        1,
    )[0]
    ok = status[1] == 0
    assert ok.mean() > 0.5
    assert np.sqrt(np.mean((ux[1] - true)[ok] ** 2)) < 0.03
    assert np.nanmax(np.abs(ux[0] - 1.3)) < 0.1
