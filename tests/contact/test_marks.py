"""Marks that stay while the block moves, by their formula, on pictures that are moved exactly."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.special import ndtr

from analysis.contact.apparent import apparent_contact
from analysis.contact.marks import Marks, marks
from analysis.contact.microcontacts import far_from_dark_spots

SHAPE = (480, 640)
CENTRE = (327.2, 236.5)
SHIFTS = [(7.3, -3.6), (-7.3, 3.6), (0.4, 5.2), (-2.7, 0.0)]


def dusty(seed=1, number=120, bright=4):
    """Share of the light that passes round marks, of which one in `bright` adds light."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    passed = np.ones(SHAPE)
    for n in range(number):
        x, y, radius = rng.uniform(0, SHAPE[1]), rng.uniform(0, SHAPE[0]), rng.uniform(2, 12)
        near = tuple(slice(max(0, round(at) - 40), round(at) + 41) for at in (y, x))
        covered = ndtr((radius - np.hypot(u[near] - x, v[near] - y)) / rng.uniform(0.8, 2.5))
        passed[near] *= 1 + (1 if n % bright == 0 else -1) * rng.uniform(0.1, 0.45) * covered
    return passed


def light_of(found):
    """Share of the light that passes every pixel."""
    out = np.ones(SHAPE)
    if found is not None:
        out.reshape(-1)[found.where] = found.passed
    return out


@pytest.mark.parametrize("shift", SHIFTS)
def test_marks_are_found_where_they_are_and_as_strong_as_they_are(pair, shift):
    true = np.log(dusty())
    found = marks(*pair(1, SHAPE, 1, CENTRE, shift=shift, density=0, passed=np.exp(true)), shift)
    inner = (slice(24, -24), slice(24, -24))  # what has entered the picture is not known
    true, measured = true[inner], np.log(light_of(found))[inner]
    strong = np.abs(true) > 0.05
    assert (measured * true)[strong].sum() / (true**2)[strong].sum() == pytest.approx(1, abs=0.08)
    assert (measured - true)[strong].std() < 0.2 * true[strong].std()
    assert (measured - true)[~strong].std() < 0.015
    seen = ndimage.binary_closing(np.abs(np.exp(true) - 1) > 0.05, np.ones((5, 5)))
    assert found.count == pytest.approx(ndimage.label(seen)[1], rel=0.1)
    assert found.covered == pytest.approx(np.mean(np.abs(dusty() - 1) > 0.05), rel=0.2)
    assert found.darkest == pytest.approx(dusty().min(), abs=0.1)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_single_mark_takes_or_adds_light_where_it_is(pair, sign):
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    covered = ndtr((14 - np.hypot(u - 400.3, v - 150.8)) / 1.2)
    passed = 1 + sign * 0.3 * covered
    found = marks(*pair(3, SHAPE, 1, CENTRE, density=0, passed=passed), SHIFTS[0])
    assert found.count == 1
    weight = np.abs(light_of(found) - 1)
    place = (u * weight).sum() / weight.sum(), (v * weight).sum() / weight.sum()
    np.testing.assert_allclose(place, (400.3, 150.8), atol=0.3)
    assert light_of(found)[covered > 0.9].mean() == pytest.approx(1 + sign * 0.3, abs=0.04)


@pytest.mark.parametrize("density", [0.0, 0.003, 0.01])
@pytest.mark.parametrize("shift", SHIFTS[:2])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_clean_pictures_have_no_marks(pair, density, shift, seed):
    assert marks(*pair(seed, SHAPE, 150, CENTRE, shift=shift, density=density), shift) is None


def test_marks_on_the_block_move_with_it_and_are_none(pair):
    background, image = pair(4, SHAPE, 1, CENTRE, density=0, shift=(7.0, -4.0))
    passed = dusty()
    background = (background * passed).astype(np.uint8)
    image = (image * np.roll(passed, (-4, 7), (0, 1))).astype(np.uint8)
    assert marks(background, image, (7.0, -4.0)) is None


def test_a_block_that_has_not_moved_tells_no_marks(pair):
    shift = (1.5, 1.0)
    images = pair(5, SHAPE, 1, CENTRE, density=0, shift=shift, passed=dusty())
    assert marks(*images, shift) is None


def test_a_block_that_is_stretched_has_no_marks(pair):
    """Its texture does not cancel; what is left is not seen in the background as a mark is."""
    background, _ = pair(6, SHAPE, 1, CENTRE, density=0)
    column = np.arange(SHAPE[1])
    from_column = column - 5.0 - 0.004 * (column - SHAPE[1] / 2)
    stretched = np.array([np.interp(from_column, column, row) for row in background])
    assert marks(background, np.rint(stretched).astype(np.uint8), (5.0, 0.0)) is None


def test_a_picture_without_them_keeps_its_type_and_its_scale():
    where, passed = np.array([1, 5]), np.array([0.5, 0.8], np.float32)
    found = Marks(1, 0.1, 0.5, where, passed)
    grey = np.array([[10, 20, 30], [40, 50, 240]], np.uint8)
    assert found.taken_off(grey).tolist() == [[10, 40, 30], [40, 50, 255]]
    assert found.taken_off(grey).dtype == np.uint8
    assert found.taken_off(grey.astype(np.float32))[1, 2] == pytest.approx(300)
    assert grey[0, 1] == 20


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_contact_is_found_behind_marks(pair, seed):
    clean = apparent_contact(*pair(seed, SHAPE, 150, CENTRE, density=0.006))
    images = pair(seed, SHAPE, 150, CENTRE, density=0.006, passed=dusty(seed, 60))
    found = apparent_contact(*images)
    assert clean.marks is None
    assert found.marks is not None
    assert abs(found.radius_px - 150) < 1.5 * found.radius_sd_px
    assert found.radius_sd_px < 2 * clean.radius_sd_px
    np.testing.assert_allclose(found.centre_px, CENTRE, atol=8)
    left = apparent_contact(*images, take_marks_off=False)
    assert left.marks is None
    assert left.micro_contacts > 1.25 * clean.micro_contacts
    assert 0.9 * clean.micro_contacts < found.micro_contacts <= clean.micro_contacts
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    outside = np.hypot(u - CENTRE[0], v - CENTRE[1]) > 160
    still, off, without = (c.difference[outside].std() for c in (left, found, clean))
    assert still > 1.7 * without > 1.4 * off


def test_a_bright_spot_beside_a_dark_one_is_an_echo():
    rng = np.random.default_rng(1)
    difference = rng.normal(0, 1, (200, 300)).astype(np.float32)
    v, u = np.mgrid[:200, :300]
    for x, y, grey in ((100, 80, 40), (104, 78, -40), (200, 80, 40), (212, 80, -40)):
        difference += grey * np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / 1.5**2)
    x, y = np.array([100.0, 200.0]), np.array([80.0, 80.0])
    assert far_from_dark_spots(difference, x, y, 7.0).tolist() == [False, True]
