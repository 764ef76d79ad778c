"""What a tracker does with a stream: starts, jumps, losses, light, dirt, threads, regions, skipped
images.
"""

from __future__ import annotations

import numpy as np
import pytest
from blobs import Speckle, way
from trackers import inner, tracker_at_rest

from analysis.dic import Correlation, Status, open_tracker, refining
from analysis.dic.neighbours import filled

SPECKLE = Speckle((240, 320))
REFERENCE = SPECKLE.image(noise=2, seed=1)
METHODS = ("shared", "quadratic", "icgn")
rng = np.random.default_rng(7)


def misses(field, ux):
    """Errors of u_x away from the edges, where it was found."""
    values = inner(field.ux_px)
    return (values - ux)[np.isfinite(values)]


@pytest.mark.parametrize("method", [*METHODS, "direct"])
def test_a_cold_start_and_a_jump_of_40_px_find_the_whole_field(method: str) -> None:
    pattern = Speckle((400, 520), seed=3)
    reference, image = pattern.image(noise=2, seed=1), pattern.image(40.3, -21.6, noise=2, seed=2)
    tracker = open_tracker(Correlation(**way(method), threads=1), reference)
    for begin in ("cold", "jump"):
        field = tracker.track(image)
        x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
        stays = (x + 40.3 < 520 - 14) & (y - 21.6 > 14)
        assert (field.status[stays] == Status.OK).mean() > 0.999, begin
        assert np.nanmax(np.abs(field.ux_px[stays] - 40.3)) < 0.1
        assert (field.status[x + 40.3 > 520 - 8] == Status.OUT_OF_IMAGE).all()
        tracker.reset()
        assert (tracker.track(reference).status[stays] == Status.OK).all()


def test_single_boxes_do_not_stay_where_a_jump_has_led_them_astray() -> None:
    pattern = Speckle((300, 400), seed=15)
    tracker = tracker_at_rest(pattern.image(noise=0.5, seed=1), method="icgn")
    for seed in (2, 3):
        field = tracker.track(pattern.image(3.3, noise=0.5, seed=seed))
        ok = field.status == Status.OK
        assert ok.mean() > 0.99
        assert np.abs(field.ux_px[ok] - 3.3).max() < 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("gain", "offset"), [(1, 20), (0.5, 60), (1.9, -20)])
def test_light_level_and_contrast_are_no_displacement(
    method: str, gain: float, offset: float
) -> None:
    """The whole image, noise included, is scaled between two frames; contrast is low enough for
    nothing to saturate.
    """
    pattern = Speckle((200, 260), seed=5)
    reference, first, image = (
        pattern.image(ux, noise=1, seed=n, contrast=18, level=40)
        for n, ux in enumerate((0, 0.3, 0.37))
    )
    changed = np.clip(np.rint(gain * image.astype(float) + offset), 0, 255).astype(np.uint8)
    same, other = (
        tracker_at_rest(reference, **way(method)),
        tracker_at_rest(reference, **way(method)),
    )
    same.track(first)
    other.track(first)
    before, after = misses(same.track(image), 0.37), misses(other.track(changed), 0.37)
    assert after.size == before.size
    # scaling down makes rounding coarser
    assert np.std(after) < 1.1 * np.hypot(np.std(before), 0.0006 / gain)
    assert abs(np.mean(after) - np.mean(before)) < 0.001


def test_hot_pixels_pull_little() -> None:
    hot = rng.random(SPECKLE.shape) < 1e-3

    def with_hot(image):
        return np.where(hot, 255, image).astype(np.uint8)

    field = tracker_at_rest(with_hot(REFERENCE)).track(
        with_hot(SPECKLE.image(0.4, noise=2, seed=2))
    )
    assert (inner(field.status) == Status.OK).all()
    assert np.sqrt(np.mean(misses(field, 0.4) ** 2)) < 1.2 * 0.0056


def test_dust_on_a_twentieth_of_every_box_pulls_little() -> None:
    y, x = np.mgrid[: SPECKLE.shape[0], : SPECKLE.shape[1]]
    dust = (y % 20 - 10) ** 2 + (x % 20 - 10) ** 2 <= 2.5**2
    field = tracker_at_rest(REFERENCE).track(
        np.where(dust, 5, SPECKLE.image(0.4, noise=2, seed=2)).astype(np.uint8)
    )
    assert (inner(field.status) == Status.OK).mean() > 0.98
    miss = misses(field, 0.4)
    assert np.sqrt(np.mean(miss**2)) < 0.016
    assert np.std(miss / inner(field.ux_std_px)[np.isfinite(inner(field.ux_std_px))]) < 1.5


@pytest.mark.parametrize("method", METHODS)
def test_a_covered_point_is_lost_by_name_and_comes_back_by_itself(method: str) -> None:
    tracker = tracker_at_rest(REFERENCE, **way(method))
    covered = SPECKLE.image(0.3, noise=2, seed=2)
    covered[100:160, 120:200] = 30
    field = tracker.track(covered)
    x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
    inside = (x > 131) & (x < 188) & (y > 111) & (y < 148)
    assert (field.status[inside] == Status.LOW_CONTRAST).all()
    assert np.isnan(field.ux_px[inside]).all()
    assert np.isnan(field.ux_std_px[inside]).all()
    back = tracker.track(SPECKLE.image(0.6, noise=2, seed=3))
    assert (back.status[inside] == Status.OK).all()
    assert np.abs(back.ux_px[inside] - 0.6).max() < 0.04


def test_after_a_dark_image_all_points_are_found_where_they_have_gone() -> None:
    tracker = tracker_at_rest(REFERENCE)
    tracker.track(SPECKLE.image(0.5, noise=2, seed=2))
    assert not (tracker.track(np.full(SPECKLE.shape, 90, np.uint8)).status == Status.OK).any()
    field = tracker.track(SPECKLE.image(9.4, noise=2, seed=3))
    assert (inner(field.status) == Status.OK).all()
    assert np.abs(misses(field, 9.4)).max() < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_another_surface_is_not_recognised(method: str) -> None:
    found = total = 0
    for seed in range(2):
        tracker = tracker_at_rest(REFERENCE, **way(method))
        field = tracker.track(Speckle(SPECKLE.shape, seed=100 + seed).image(noise=2, seed=seed))
        found, total = found + int((field.status == Status.OK).sum()), total + field.status.size
    assert found <= 1e-3 * total


def test_saturated_boxes_are_named() -> None:
    bright = np.clip(REFERENCE.astype(float) * 1.0, 0, 255)
    bright[60:140, 60:200] = np.clip(bright[60:140, 60:200] * 3 + 80, 0, 255)
    tracker = tracker_at_rest(bright.astype(np.uint8))
    field = tracker.track(bright.astype(np.uint8))
    x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
    inside = (x > 72) & (x < 188) & (y > 72) & (y < 128)
    assert (field.status[inside] == Status.SATURATED).mean() > 0.95
    assert (field.status[(x > 220)] == Status.OK).all()


@pytest.mark.parametrize("method", METHODS)
def test_threads_and_regions_change_no_bit(method: str) -> None:
    images = [SPECKLE.image(0.3 * n, 0.1 * n, noise=2, seed=n) for n in range(1, 4)]
    images[1][50:90, 50:120] = 20
    region = (150, 110, 270, 200)
    trackers = [tracker_at_rest(REFERENCE, **way(method), threads=n) for n in (1, 2, 3)] + [
        tracker_at_rest(REFERENCE, **way(method), roi=region)
    ]
    for image in images:
        first, *others, part = [tracker.track(image) for tracker in trackers]
        for name in ("ux_px", "uy_px", "zncc", "status", "ux_std_px", "uy_std_px"):
            for other in others:
                np.testing.assert_array_equal(getattr(other, name), getattr(first, name))
            inside = part.status != Status.MASKED
            assert inside.any()
            assert not inside.all()
            np.testing.assert_array_equal(getattr(part, name)[inside], getattr(first, name)[inside])


def test_skipped_images_change_less_than_a_tenth_of_the_uncertainty() -> None:
    images = [SPECKLE.image(0.12 * n, noise=2, seed=n) for n in range(1, 9)]
    every, some = tracker_at_rest(REFERENCE), tracker_at_rest(REFERENCE)
    for n, image in enumerate(images):
        field = every.track(image)
        if n in (0, 3, 4, 7):
            other = some.track(image)
            change = inner(np.abs(other.ux_px - field.ux_px) / field.ux_std_px)
            assert np.quantile(change, 0.95) < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_masked_pixels_are_not_looked_at(method: str) -> None:
    usable = np.ones(SPECKLE.shape, bool)
    usable[80:120, 100:160] = False
    usable[::17, ::13] = False

    def spoilt(image):
        return np.where(usable, image, 255).astype(np.uint8)

    tracker = tracker_at_rest(spoilt(REFERENCE), usable, **way(method))
    x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
    field = tracker.track(SPECKLE.image(0.3, noise=2, seed=2))
    assert (field.status[(x > 108) & (x < 152) & (y > 88) & (y < 112)] == Status.MASKED).all()
    far = (np.abs(x - 130) > 45) | (np.abs(y - 100) > 35)
    far &= (x > 25) & (x < 295) & (y > 25) & (y < 215)
    assert (field.status[far] == Status.OK).all()
    assert np.sqrt(np.mean((field.ux_px[far] - 0.3) ** 2)) < (0.012 if method == "shared" else 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("contrast", [2.5, 40.0])
@pytest.mark.parametrize("noise", [0.0, 16.0])
@pytest.mark.parametrize("grain", [(0.3, 0.45), (3.0, 5.0)])
def test_wrong_points_are_not_called_right(
    method: str, contrast: float, noise: float, grain: tuple[float, float]
) -> None:
    """At the extremes of contrast, noise and grain: no crash, and what is called OK is right."""
    pattern = Speckle((160, 200), seed=2, grain=grain, density=0.15 / np.mean(grain) ** 2)
    reference, image = (
        pattern.image(ux, noise=noise, seed=n, contrast=contrast, level=90)
        for n, ux in enumerate((0, 0.7))
    )
    tracker = tracker_at_rest(reference, **way(method))
    for field in (
        tracker.track(image),
        tracker.track(pattern.image(1.4, noise=noise, seed=9, contrast=contrast, level=90)),
    ):
        ok = field.status == Status.OK
        assert np.isfinite(field.ux_px[ok]).all()
        assert (field.ux_std_px[ok] > 0).all()
    wrong = ok & (np.abs(field.ux_px - 1.4) > np.maximum(0.5, 6 * field.ux_std_px))
    assert wrong.sum() == 0


def test_holes_are_filled_smoothly() -> None:
    y, x = np.mgrid[:20, :33]
    field = np.array([0.1 * x + 0.02 * y, 0.0 * x])
    valid = (x - 15) ** 2 + (y - 10) ** 2 > 16
    out = filled(np.where(valid, field, np.nan), valid)
    np.testing.assert_array_equal(out[:, valid], field[:, valid])
    assert np.abs(out[0] - field[0]).max() < 0.25
    assert not filled(np.full((2, 3, 3), np.nan), np.zeros((3, 3), bool)).any()


@pytest.mark.parametrize(
    "options",
    [
        {"method": "fft"},
        {"order": 3},
        {"box": 3},
        {"box": 201},
        {"step": 0},
        {"tolerance": -1.0},
        {"tolerance": float("nan")},
        {"update": "sometimes"},
        {"update_every": 0},
        {"threads": 0},
    ],
)
def test_settings_that_can_not_be_used_are_refused_in_one_sentence(options) -> None:
    with pytest.raises(ValueError, match=r"^(\w+ must be .+; found .+|correlation: .+; use .+)$"):
        Correlation(**options)


def test_images_that_can_not_be_used_are_refused() -> None:
    tracker = tracker_at_rest(REFERENCE)
    for image in (
        REFERENCE[:-1],
        REFERENCE[..., None],
        REFERENCE.astype(np.uint16),
        REFERENCE.astype(complex),
    ):
        with pytest.raises(ValueError, match=r"image: .*found"):
            tracker.track(image)
    with pytest.raises(ValueError, match="mask: shape"):
        tracker_at_rest(REFERENCE, usable=np.ones((3, 3), bool))
    with pytest.raises(ValueError, match="no box of 20 px lies in the region"):
        tracker_at_rest(REFERENCE, roi=(0, 0, 3, 3))
    with pytest.raises(ValueError, match="start field: shape"):
        tracker.start_from(np.zeros((3, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize("method", [*METHODS, "direct"])
@pytest.mark.parametrize("shape", [(6, 6), (7, 40), (22, 22), (23, 131), (300, 24)])
def test_tiny_and_narrow_images_are_correlated(method: str, shape: tuple[int, int]) -> None:
    pattern = Speckle(shape, seed=4)
    box = min(20, min(shape) - 2)
    tracker = open_tracker(
        Correlation(**way(method), box=box, step=5, threads=1), pattern.image(noise=1)
    )
    field = tracker.track(pattern.image(0.2, noise=1, seed=1))
    ok = field.status == Status.OK
    assert np.isfinite(field.ux_px[ok]).all()
    if box == 20:
        assert ok.mean() > 0.5
        assert np.median(np.abs(field.ux_px[ok] - 0.2)) < 0.06


@pytest.mark.parametrize("method", [*METHODS, "direct"])
def test_absurd_starts_do_no_harm(method: str) -> None:
    tracker = open_tracker(Correlation(**way(method), threads=1), REFERENCE)
    for start in (1e30, -np.inf, 5000.0):
        tracker.start_from(*np.full((2, *tracker.grid.shape), start))
        tracker.track(SPECKLE.image(0.3, noise=2, seed=2))
        field = tracker.track(SPECKLE.image(0.3, noise=2, seed=2))
        assert (inner(field.status) == Status.OK).all()


@pytest.mark.parametrize("level", [0.0, 1e6, 1e7])
def test_contrast_on_a_high_level_of_grey_is_seen_in_single_precision(level: float) -> None:
    picture = (level + np.random.default_rng(1).normal(0, 20, (60, 60))).astype(np.float32)
    corners, found = np.array([[0, 20, 40]]), np.zeros((1, 3), np.uint8)
    refining.explain(picture, corners, corners, 20, 2.0, np.inf, 0.0, found)
    assert (found == Status.OK).all()
