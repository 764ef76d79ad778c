"""Pictures that show nothing, too much, or something else, jumps, reversals and the smallest grids:
a point is either right or lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from plain_speckle import Speckle

from analysis.contact.apparent import apparent_contact
from analysis.contact.disc import micro_contact_disc
from analysis.contact.registration import NotRegistered, rigid_shift
from analysis.dic import Correlation, Field, Status, icgn, open_tracker

METHODS = ("shared", "icgn", "direct")
SHAPE = (140, 180)
WORST = {"shared": 0.02, "icgn": 0.02, "direct": 0.35}  # px, of one point in a noisy picture
SPECKLE = Speckle(SHAPE)
REFERENCE = SPECKLE.image(noise=1)


def moved(ux: float, uy: float = 0.0, seed: int = 1) -> np.ndarray:
    return np.asarray(SPECKLE.image(ux, uy, noise=1, seed=seed))


def opened(method: str, reference: np.ndarray = REFERENCE, **more: Any) -> Any:
    kept = {name: more.pop(name) for name in ("usable", "roi") if name in more}
    return closing(open_tracker(Correlation(method=method, **more), reference, **kept))


def ok(field: Field) -> np.ndarray:
    return np.asarray(field.status == Status.OK)


def strangers() -> Iterator[tuple[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    black = np.zeros(SHAPE, np.uint8)
    spot = black.copy()
    spot[70, 90] = 255
    yield "black", black
    yield "constant", np.full(SHAPE, 77, np.uint8)
    yield "saturated", np.full(SHAPE, 255, np.uint8)
    yield "noise only", rng.integers(0, 256, SHAPE).astype(np.uint8)
    yield "another surface", Speckle(SHAPE, seed=9).image(noise=1)
    yield "negative", 255 - REFERENCE
    yield "one hot pixel", spot
    yield "mirrored", REFERENCE[:, ::-1].copy()


@pytest.mark.slow
@pytest.mark.parametrize("box", [12, 20])
@pytest.mark.parametrize("method", METHODS)
def test_no_point_of_a_stranger_is_found_and_the_next_picture_is(method: str, box: int) -> None:
    with opened(method, box=box, step=box // 2) as tracker:
        for name, picture in strangers():
            assert ok(tracker.track(picture)).sum() == 0, name
            after = tracker.track(moved(1.0))
            assert ok(after).mean() > 0.99, name
            assert np.abs(after.ux_px - 1)[ok(after)].max() < 0.3, name


@pytest.mark.parametrize("method", METHODS)
def test_jumps_of_fifty_pixels_and_reversals_are_followed(method: str) -> None:
    with opened(method) as tracker:
        for at in (50, -50, 0, 48, 1, -1, 30, 29):
            field = tracker.track(moved(at, -at / 10))
            inside = (tracker.grid.x_px + at > 20) & (tracker.grid.x_px + at < SHAPE[1] - 21)
            rows = np.abs(tracker.grid.y_px - SHAPE[0] / 2) < SHAPE[0] / 2 - 25
            found = np.ix_(rows, inside)
            assert ok(field)[found].all()
            assert np.abs(field.ux_px - at)[found].max() < 0.15


@pytest.mark.parametrize("method", METHODS)
def test_one_hot_pixel_costs_the_boxes_that_hold_it_at_most(method: str) -> None:
    hot = moved(0.5)
    hot[70, 90] = 255
    with opened(method) as tracker:
        clean, field = tracker.track(moved(0.5)), tracker.track(hot)
        near = np.hypot(*np.meshgrid(tracker.grid.x_px - 90, tracker.grid.y_px - 70)) < 60
    assert ok(field)[~near].all()
    np.testing.assert_allclose(field.ux_px[~near], clean.ux_px[~near], atol=2e-3)
    assert np.abs(field.ux_px - 0.5)[ok(field)].max() < WORST[method]


@pytest.mark.parametrize("factor", [10.0, 0.1])
@pytest.mark.parametrize("method", METHODS)
def test_a_light_ten_times_as_strong_is_no_displacement(method: str, factor: float) -> None:
    deep = REFERENCE.astype(np.uint16) * 20
    changed = (moved(0.5) * (20 * factor)).astype(np.uint16)
    with opened(method, deep) as tracker:
        field = tracker.track(changed)
    assert ok(field).all()
    assert np.abs(field.ux_px - 0.5).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("level", "contrast"), [(0.0, 1e-4), (1e5, 1.0), (-1e3, 1.0), (0.0, 1e6), (1e6, 1e5)]
)
@pytest.mark.parametrize("method", METHODS)
def test_grey_levels_of_any_size_and_offset_give_the_same_displacement(
    method: str, level: float, contrast: float
) -> None:
    def scaled(image: np.ndarray) -> np.ndarray:
        return (level + contrast * image.astype(np.float64)).astype(np.float32)

    with opened(method, scaled(REFERENCE), min_contrast=0.0) as tracker:
        field = tracker.track(scaled(moved(0.5)))
    assert ok(field).all()
    assert np.abs(field.ux_px - 0.5).max() < 0.1


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e30])
def test_pictures_that_are_no_numbers_are_refused(wrong: float) -> None:
    image = REFERENCE.astype(np.float32)
    with opened("shared", image) as tracker:
        image = image.copy()
        image[3, 4] = wrong
        with pytest.raises(ValueError, match="not finite, or beyond"):
            tracker.track(image)
    with pytest.raises(ValueError, match="reference: grey levels"):
        open_tracker(Correlation(), image)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("rows", "columns", "box", "step"), [
    (26, 26, 20, 1), (26, 60, 20, 200), (60, 26, 24, 7), (70, 70, 64, 1)
])  # fmt: skip
def test_the_smallest_grids_find_what_they_see(
    method: str, rows: int, columns: int, box: int, step: int
) -> None:
    part = np.s_[30 : 30 + rows, 40 : 40 + columns]
    with opened(method, REFERENCE[part].copy(), box=box, step=step) as tracker:
        field = tracker.track(moved(0.5)[part].copy())
    assert field.status.shape == tracker.grid.shape
    found = ok(field)
    assert not found.any() or np.abs(field.ux_px - 0.5)[found].max() < 0.15
    assert set(field.status[~found].tolist()) <= {Status.OUT_OF_IMAGE, Status.DECORRELATED}


def test_a_box_larger_than_the_picture_and_a_mask_without_a_pixel_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit the 180 x 140 image"):
        open_tracker(Correlation(box=139), REFERENCE)
    for method in ("shared", "icgn"):
        with pytest.raises(ValueError, match="no pixel of it is usable, and so no box"):
            open_tracker(Correlation(method=method), REFERENCE, usable=np.zeros(SHAPE, np.bool_))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_one_point_per_pixel_agrees_with_a_coarse_grid_and_with_any_number_of_threads(
    method: str,
) -> None:
    fields = {}
    for step, threads in ((1, 1), (1, 3), (7, 1)):
        with opened(method, step=step, threads=threads) as tracker:
            fields[step, threads] = tracker.track(moved(0.5)), tracker.grid
    one, three, (coarse, grid) = fields[1, 1][0], fields[1, 3][0], fields[7, 1]
    for name in ("ux_px", "uy_px", "zncc", "status", "ux_std_px"):
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))
    fine = fields[1, 1][1]
    at = np.ix_(np.isin(fine.y_px, grid.y_px), np.isin(fine.x_px, grid.x_px))
    atol = {"shared": 0.02, "icgn": 1e-6, "direct": 1e-6}[method]
    np.testing.assert_allclose(one.ux_px[at], coarse.ux_px, atol=atol)


@pytest.mark.parametrize("method", ["shared", "icgn"])
def test_what_is_measured_in_a_region_of_one_point_does_not_depend_on_it(method: str) -> None:
    with opened(method) as whole:
        a, x, y = whole.track(moved(0.5)), int(whole.grid.x_px[7]), int(whole.grid.y_px[5])
    with opened(method, roi=(x - 2, y - 2, x + 3, y + 3)) as part:
        b = part.track(moved(0.5))
    assert ok(b).sum() == 1
    np.testing.assert_array_equal(a.ux_px[ok(b)], b.ux_px[ok(b)])
    with pytest.raises(ValueError, match="no box of 20 px lies in the region"):
        open_tracker(Correlation(method=method), REFERENCE, roi=(94, 65, 85, 74))


@pytest.mark.slow
def test_single_precision_agrees_with_double_to_a_thousandth_of_the_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with opened("icgn") as single:
        a = single.track(moved(0.5))
    monkeypatch.setattr(icgn, "KIND", np.float64)
    with opened("icgn") as double:
        b = double.track(moved(0.5))
    assert np.abs(a.ux_px - b.ux_px).max() < 1e-3 * float(np.median(b.ux_std_px))


@pytest.mark.parametrize("method", METHODS)
def test_a_start_from_nowhere_is_no_worse_than_none(method: str) -> None:
    with opened(method) as tracker:
        for far in (np.nan, np.inf, 1e300, 9e4, -64.0):
            tracker.start_from(*np.full((2, *tracker.grid.shape), far))
            field = tracker.track(moved(0.5))
            assert ok(field).all()
            assert np.abs(field.ux_px - 0.5).max() < 0.1


@pytest.mark.parametrize("name", ["black", "constant", "saturated", "noise only", "one hot pixel"])
def test_a_picture_without_speckle_shows_no_contact_and_says_why(name: str) -> None:
    picture = dict(strangers())[name]
    for pair in ((picture, REFERENCE), (REFERENCE, picture), (picture, picture)):
        found = apparent_contact(*pair)
        assert np.isnan(found.radius_px)
        assert found.notes


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_two_equal_pictures_show_no_contact(dtype: type) -> None:
    picture = Speckle((240, 320)).image().astype(dtype)
    picture[97::53, 41::97] = 0  # rounding shows in black pixels
    for other in (picture, (picture * dtype(2) if dtype is not np.uint8 else picture)):
        found = apparent_contact(picture, other)
        assert found.micro_contacts == 0
        assert np.isnan(found.radius_px)


def test_stripes_and_pictures_of_a_few_pixels_are_not_registered() -> None:
    stripes = np.tile(100 + 50 * np.sin(np.arange(320) / 3), (240, 1)).astype(np.uint8)
    with pytest.raises(NotRegistered, match="0 tiles"):
        rigid_shift(stripes, stripes)
    for shape in ((1, 1), (2, 5), (7, 400)):
        with pytest.raises(ValueError, match="8 px or more"):
            rigid_shift(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))


@pytest.mark.parametrize("noise", [0.0, 20.0, 50.0])
def test_the_block_is_registered_under_as_much_noise_as_speckle(noise: float) -> None:
    speckle, rng = Speckle((360, 480)), np.random.default_rng(0)
    first, second = (
        speckle.image(*at).astype(np.float32) + rng.normal(0, noise, (360, 480)).astype(np.float32)
        for at in ((0.0, 0.0), (7.3, -3.6))
    )
    spread = float(speckle.image().std())
    assert 35 < spread < 45  # the largest noise is stronger
    np.testing.assert_allclose(rigid_shift(first, second), (7.3, -3.6), atol=0.06)


@pytest.mark.parametrize("where", ["one place", "a line", "four corners", "the rim"])
def test_micro_contacts_that_fill_no_disc_give_numbers_all_the_same(where: str) -> None:
    rng = np.random.default_rng(0)
    x, y = {
        "one place": np.full((2, 12), 100.0),
        "a line": np.stack([100 + 5 * np.arange(12.0), np.full(12, 150.0)]),
        "four corners": np.array([[2.0, 398, 2, 398] * 5, [2.0, 2, 298, 298] * 5]),
        "the rim": 200 * np.ones((2, 1)) + 199 * np.array([[1.0], [0.7]]) * _circle(rng, 50),
    }[where]
    disc = micro_contact_disc(x, y, (300, 400))
    assert np.isfinite([*disc.centre_px, *disc.centre_sd_px, disc.radius_px, disc.gain]).all()
    assert disc.radius_sd_px >= 0.5


def _circle(rng: np.random.Generator, n: int) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)])
