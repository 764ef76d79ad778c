"""Fields of which only some points are wanted, or only one pass."""

from functools import cache

import numpy as np
import pytest
from blobs import Speckle, way
from trackers import tracker_at_rest

from analysis.dic import Correlation, Status

SPECKLE = Speckle((360, 480))


@cache
def moved():
    return [SPECKLE.image(0.35 * n, -0.1 * n, noise=2, seed=n) for n in range(9)]


def tracker_of(**options):
    tracker = tracker_at_rest(moved()[0], **options)
    x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
    return tracker, np.hypot(x - 240, y - 180) < 110


@pytest.mark.parametrize("method", ["shared", "quadratic", "icgn", "direct"])
def test_wanted_points_are_measured_as_in_a_whole_field_and_others_are_masked(method):
    (whole, _), (part, wanted) = tracker_of(**way(method)), tracker_of(**way(method))
    for n, image in enumerate(moved()[1:], 1):
        all_points, some = whole.track(image), part.track(image, wanted)
        assert (some.status[~wanted] == Status.MASKED).all()
        assert np.isnan(some.ux_px[~wanted]).all()
        assert (some.status[wanted] == Status.OK).all()
        miss = some.ux_px[wanted] - 0.35 * n
        assert np.sqrt(np.mean(miss**2)) < {"direct": 0.03, "quadratic": 0.015}.get(method, 0.01)
        change = (some.ux_px - all_points.ux_px)[wanted] / all_points.ux_std_px[wanted]
        assert np.sqrt(np.mean(change**2)) < 0.15


@pytest.mark.parametrize("method", ["shared", "quadratic", "icgn"])
def test_the_rest_is_found_again_when_it_is_wanted_again(method):
    tracker, wanted = tracker_of(**way(method))
    for image in moved()[1:8]:
        tracker.track(image, wanted)
    field = tracker.track(moved()[8])
    inside = np.s_[2:-2, 2:-2]
    assert (field.status[inside] == Status.OK).all()
    assert np.abs(field.ux_px[inside] - 0.35 * 8).max() < 0.1


@pytest.mark.parametrize("method", ["shared", "quadratic"])
def test_one_pass_is_one_pass_of_the_shared_method(method):
    tracker, wanted = tracker_of(**way(method), quality="auto")
    for n, image in enumerate(moved()[1:], 1):
        field = tracker.track(image, wanted, 1)
        assert set(np.unique(field.iterations[wanted])) == {1}
        # from the second image on its motion is foreseen
        assert np.abs(np.mean(field.ux_px[wanted]) - 0.35 * n) < (0.02 if n > 1 else 0.1)


def test_what_nothing_can_be_left_out_of_is_refused():
    with pytest.raises(ValueError, match="quality 'auto' asked with method 'direct'"):
        Correlation(method="direct", quality="auto")
    with pytest.raises(ValueError, match="update 'every'"):
        Correlation(update="every", quality="auto")


def test_further_passes_measure_again_only_where_the_prediction_has_changed():
    tracker, _ = tracker_of()
    for seed in (20, 21, 22):
        tracker.track(SPECKLE.image(noise=2, seed=seed))  # how noisy images are
    x, _ = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
    shift = np.where(x > 380, 0.4, 0.0)  # one side has moved
    images = [
        SPECKLE.image(noise=2, seed=41).astype(float),
        SPECKLE.image(0.4, 0, noise=2, seed=40).astype(float),
    ]
    side = np.clip((np.arange(480) - 360) / 40, 0, 1)
    blended = (images[0] * (1 - side) + images[1] * side).round().astype(np.uint8)
    field = tracker.track(blended)
    assert field.iterations[x > 400].min() >= 2
    assert (field.iterations[x < 240] == 1).mean() > 0.9
    far = np.abs(x - 380) > 40
    assert np.nanmax(np.abs(field.ux_px - shift)[far]) < 0.1
