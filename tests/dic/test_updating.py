"""References that replace one another: totals, drift, losses."""

from __future__ import annotations

import numpy as np
import pytest
from blobs import Speckle
from trackers import inner, tracker_at_rest

from analysis.dic import Correlation, Field, Status, open_tracker
from analysis.dic.updating import UpdatingTracker
from analysis.grid import Grid

SPECKLE = Speckle((240, 320))


def follow(images, **options):
    tracker = tracker_at_rest(images[0], **options)
    return tracker, [tracker.track(image) for image in images[1:]]


@pytest.mark.parametrize(
    "options",
    [{"update": "every", "update_every": 3}, {"update": "quality", "update_below": 0.9999}],
)
def test_displacements_add_up_and_the_drift_is_told(options) -> None:
    steps = [0.45 * n for n in range(10)]
    tracker, fields = follow(
        [SPECKLE.image(ux, -0.2 * ux, noise=2, seed=n) for n, ux in enumerate(steps)], **options
    )
    assert tracker.updates == (3 if options["update"] == "every" else 9)
    for ux, field in zip(steps[1:], fields, strict=True):
        assert (inner(field.status) == Status.OK).all()
        miss = inner(field.ux_px) - ux
        assert np.sqrt(np.mean(miss**2)) < 0.0056 * np.sqrt(tracker.updates + 1) * 1.2
    normalised = (inner(fields[-1].ux_px) - steps[-1]) / inner(fields[-1].ux_std_px)
    # the noise of a replaced reference counts twice in the drift, but cancels in the sum
    assert 0.2 < np.std(normalised) < 1.1
    assert tracker.drift_px == pytest.approx(0.0056 * np.sqrt(tracker.updates), rel=0.15)


def test_a_surface_that_changes_slowly_is_followed_only_with_updates() -> None:
    """From one pattern to another one in 8 steps while it moves: the first reference is no longer
    recognised.
    """
    other = Speckle((240, 320), seed=2)
    images = []
    for n in range(9):
        share, ux = n / 8, 0.3 * n
        grey = 20 + (1 - share) * SPECKLE.grey(ux, level=0) + share * other.grey(ux, level=0)
        images.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    _, never = follow(images)
    tracker, quality = follow(images, update="quality", update_below=0.9)
    assert (never[-1].status == Status.OK).mean() < 0.01
    assert tracker.updates >= 2
    assert (inner(quality[-1].status) == Status.OK).all()
    assert np.abs(np.mean(inner(quality[-1].ux_px)) - 2.4) < 0.05


def test_without_updates_there_is_no_drift() -> None:
    tracker, _ = follow([SPECKLE.image(), SPECKLE.image(0.2)], update="quality", update_below=0.5)
    assert tracker.drift_px == tracker.updates == 0
    with pytest.raises(ValueError, match="mask of the first reference"):
        open_tracker(Correlation(update="every"), SPECKLE.image(), usable=np.ones((240, 320), bool))


class Moving:
    """A tracker that always finds 2 px along x and -1 px along y, and keeps where it began."""

    grid = Grid.cover((60, 80), 20, 10)

    def __init__(self, image: object) -> None:
        self.began: list[tuple[np.ndarray, np.ndarray]] = []

    def track(self, image: object, points: object = None, most_passes: int = 0) -> Field:
        ones = np.ones(self.grid.shape)
        status = np.zeros(self.grid.shape, np.uint8)
        return Field.of(
            self.grid, (2 * ones, -ones), ones, (0.03 * ones, 0.04 * ones), status, status
        )

    def start_from(self, ux: np.ndarray, uy: np.ndarray) -> None:
        self.began.append((ux, uy))

    def close(self) -> None:
        """Nothing is held."""


def test_a_search_begins_with_what_is_left_of_a_displacement_since_the_first_reference() -> None:
    made: list[Moving] = []
    image = np.zeros((60, 80), np.uint8)
    tracker = UpdatingTracker(
        lambda image: made.append(Moving(image)) or made[-1], image, every=2, below=0.0
    )
    ones = np.ones(tracker.grid.shape)
    tracker.start_from(5.0 * ones, ones)
    np.testing.assert_allclose(made[-1].began[-1], (5.0 * ones, ones))
    for _ in range(2):
        tracker.track(image)
    assert tracker.updates == 1
    tracker.start_from(5.0 * ones, ones)
    np.testing.assert_allclose(made[-1].began[-1], (3.0 * ones, 2.0 * ones))
    total = tracker.track(image)
    np.testing.assert_allclose(total.ux_px, 4.0)
    np.testing.assert_allclose(total.ux_std_px, 0.03 * np.sqrt(2), rtol=1e-6)
    np.testing.assert_allclose(total.uy_std_px, 0.04 * np.sqrt(2), rtol=1e-6)
