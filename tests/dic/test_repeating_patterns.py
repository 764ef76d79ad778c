"""Patterns that repeat themselves, as a whole or in part: a displacement is right, or the point is
lost and says why.
"""

from __future__ import annotations

import warnings
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import Speckle, way

from analysis.dic import Correlation, Status, correlate, open_tracker
from analysis.dic.periodicity import repetition
from analysis.dic.spectrum import texture
from analysis.dic.threads import Threads
from analysis.dic.tracker import ReferenceImage
from analysis.grid import Grid
from app.files.correlating import correlate_files

SHAPE = 240, 320
METHODS = ("shared", "quadratic", "icgn", "direct")
SPECKLE = Speckle(SHAPE)


def lattice(period: float, ux: float = 0, uy: float = 0, seed: int = 0) -> np.ndarray:
    """Two crossed cosines, integrated over pixels, from an 8-bit camera with noise."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    waves = np.cos(2 * np.pi * (x - ux) / period) + np.cos(2 * np.pi * (y - uy) / period)
    grey = 110 + 30 * np.sinc(1 / period) * waves
    return np.rint(grey + np.random.default_rng(seed).normal(size=SHAPE)).astype(np.uint8)


def half(period: float, ux: float = 0, uy: float = 0, seed: int = 0) -> np.ndarray:
    """A lattice on the left of a line that moves with it, and speckle on the right."""
    speckle = SPECKLE.image(ux, uy, noise=1, seed=seed, level=60)
    return np.where(np.arange(SHAPE[1]) - ux < 160, lattice(period, ux, uy, seed), speckle)


def found_in(image: np.ndarray, box: int = 20) -> float:
    """The period of what repeats itself, px; 0: nothing."""
    reference = ReferenceImage(image, Grid.cover(image.shape, box, box // 2), Threads(1))
    found = repetition(reference, texture(image.astype(np.float32)), 2.0)
    return 0.0 if found is None else found.period_px


@pytest.mark.parametrize("period", [6, 6.5, 8, 12, 20])
def test_a_pattern_that_repeats_itself_is_found_with_its_period(period: float) -> None:
    assert found_in(lattice(period)) == pytest.approx(period, abs=0.1)
    assert found_in(half(period)) == pytest.approx(period, abs=0.1)


@pytest.mark.parametrize("grain", [(0.75, 1.25), (2, 3), (3, 4.8)])
@pytest.mark.parametrize("density", [0.15, 0.01])
def test_random_speckle_does_not_repeat_itself(grain: tuple[float, float], density: float) -> None:
    for seed in range(4):
        picture = Speckle((400, 500), seed, grain, density).image(noise=2)
        assert not found_in(picture)
        assert not found_in(picture, 12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("period", [8, 12, 20])
def test_a_jump_of_half_a_period_is_not_measured_and_small_steps_are(
    method: str, period: int
) -> None:
    with closing(open_tracker(Correlation(**way(method)), lattice(period))) as tracker:
        at = 0.0
        for n in range(1, 13):
            at = n * period / 6
            field = tracker.track(lattice(period, at, -at / 2, seed=n))
            inside = np.abs(tracker.grid.x_px - 160) < 100
            assert (field.status[4:-4, inside] == Status.OK).mean() > 0.97
            assert np.nanmax(np.abs(field.ux_px - at)) < 0.6
        field = tracker.track(lattice(period, at + 0.45 * period, -at / 2, seed=13))
        wrong = np.abs(field.ux_px - at - 0.45 * period) > 1
        assert not (wrong & (field.status == Status.OK)).any()
        assert tracker.remarks[0].startswith("picture: the pattern of the reference repeats itself")


@pytest.mark.parametrize("method", METHODS)
def test_a_point_that_may_be_another_periods_says_so(method: str) -> None:
    with pytest.warns(UserWarning, match=r"every 8 px in 100% of the boxes"):
        field = correlate(lattice(8), lattice(8, 2.8, seed=1), **way(method))
    assert (field.status != Status.OK).all()
    if method == "icgn":
        assert (field.status == Status.AMBIGUOUS).mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("period", [6, 12, 20])
def test_what_repeats_itself_moves_with_the_speckle_beside_it(method: str, period: int) -> None:
    for periods, least in ((0.6, 0.85), (1, 0.6), (1.7, 0.6), (2.5, 0)):
        with closing(open_tracker(Correlation(**way(method)), half(period))) as tracker:
            for before in (None, 0.0):  # without a field before, and after a jump
                tracker.reset()
                if before is not None:
                    tracker.start_from(*np.full((2, *tracker.grid.shape), before))
                field = tracker.track(half(period, periods * period, 1.0, seed=1))
                assert (field.status == Status.OK).mean() >= least
                miss = np.abs(field.ux_px - periods * period)
                assert (miss[field.status == Status.OK] > 1).sum() < 0.01 * miss.size


def test_speckle_gives_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        correlate(SPECKLE.image(noise=2), SPECKLE.image(1.0, noise=2, seed=1))


def test_a_series_of_files_says_what_repeats_itself(tmp_path: Path) -> None:
    files = [tmp_path / f"{n}.png" for n in range(3)]
    for n, file in enumerate(files):
        cv2.imwrite(str(file), lattice(12, 2.0 * n, seed=n))
    summary = correlate_files(files[0], files[1:], tmp_path / "fields.csv")
    assert "every 12 px in 100% of the boxes" in summary.remarks[0]
    assert summary.statuses["ok"] > 0.95 * summary.frames * summary.points
    assert summary.statuses["ambiguous"] == 0
