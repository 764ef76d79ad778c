"""Nearly black pictures: grey levels of a few units, rounded, and clipped at 0."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from blobs import Speckle, way

from analysis.dic import Correlation, Field, open_tracker
from analysis.dic.clipping import clipped_scatter
from analysis.dic.spectrum import texture
from analysis.dic.threads import Threads
from analysis.dic.tracker import ReferenceImage
from analysis.grid import Grid

SHAPE, SHIFTS = (200, 280), ((0.3, 0.65), (0.72, 0.15))
METHODS = ("shared", "quadratic", "icgn", "direct")


def dark(ux: float, uy: float, mean: float, contrast: float, noise: float, seed: int) -> np.ndarray:
    """A picture of blobs whose mean and standard deviation are these before it is clipped."""
    speckle = Speckle(SHAPE, seed=seed // 100 + 1)
    level = mean - contrast * speckle.grey(contrast=1, level=0).mean()
    return np.asarray(speckle.image(ux, uy, noise, seed, contrast, level))


def tracked(method: str, seed: int, *picture: float) -> list[Field]:
    settings = Correlation(**way(method), min_contrast=0.0)
    reference = dark(0, 0, *picture, seed=seed)
    with closing(open_tracker(settings, reference)) as tracker:
        return [
            tracker.track(dark(*at, *picture, seed=seed + 1 + n)) for n, at in enumerate(SHIFTS)
        ]


@pytest.mark.parametrize(
    ("mean", "contrast", "noise"),
    [(1, 2.5, 1), (2, 2, 1), (2, 5, 1), (4, 8, 2), (3, 1.8, 1), (10, 5, 1), (20, 10, 1)],
)
@pytest.mark.parametrize("method", METHODS)
def test_stated_uncertainties_hold_in_nearly_black_pictures(
    method: str, mean: float, contrast: float, noise: float
) -> None:
    errors = []
    for seed in (0, 100):
        for (ux, uy), field in zip(
            SHIFTS, tracked(method, seed, mean, contrast, noise), strict=True
        ):
            assert np.isfinite(field.ux_px).mean() > 0.9
            errors += [(field.ux_px - ux) / field.ux_std_px, (field.uy_px - uy) / field.uy_std_px]
    scatter = np.sqrt(np.nanmean(np.square(errors)))
    assert 0.85 < scatter < 1.15


def test_black_pixels_that_may_not_be_used_and_a_few_black_ones_change_nothing() -> None:
    picture, black = dark(0, 0, 120, 30, 2, 0), np.zeros(SHAPE, np.bool_)
    black[:, :40] = True
    picture[black] = 0
    grid, threads = Grid.cover(SHAPE, 20, 10), Threads(1)
    grain = texture(picture.astype(np.float32))
    whole = np.asarray(clipped_scatter(ReferenceImage(picture, grid, threads), grain))
    assert np.abs(whole[0, :, 3] - 1).max() > 0.01
    assert whole[:, :, 5:] == pytest.approx(1, abs=1e-6)
    assert clipped_scatter(ReferenceImage(picture, grid, threads, ~black), grain) == 1
    picture[:, 2:40] = 120
    assert clipped_scatter(ReferenceImage(picture, grid, threads), grain) == 1
