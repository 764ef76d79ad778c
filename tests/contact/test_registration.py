"""Rigid shift against an exact Fourier shift of band-limited speckle."""

import numpy as np
import pytest

from analysis.contact.registration import NotRegistered, rigid_shift, shifted

SHAPE = (360, 480)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, -0.5), (7.3, -3.6), (-21.37, 12.81)])
def test_shift_is_found_beside_a_contact(pair, shift):
    background, image = pair(1, SHAPE, 110, (243, 171), shift=shift, density=0.01)
    np.testing.assert_allclose(rigid_shift(background, image), shift, atol=0.006)


def test_forty_pixels_at_full_size(pair):
    background, image = pair(2, (1200, 1600), 480, (800, 600), shift=(-40.2, 38.6))
    np.testing.assert_allclose(rigid_shift(background, image), (-40.2, 38.6), atol=0.0015)


def test_a_brighter_lamp_and_uneven_light_change_nothing(pair):
    plain = rigid_shift(*pair(3, SHAPE, 110, (243, 171), uneven=0.0))
    lit = rigid_shift(*pair(3, SHAPE, 110, (243, 171), uneven=0.5, lamp=1.15))
    np.testing.assert_allclose(lit, plain, atol=0.003)
    np.testing.assert_allclose(lit, (7.3, -3.6), atol=0.003)


def test_a_contact_over_most_of_the_rim_pulls_it_nowhere(pair):
    """Its edge lies 30 px from two sides of the picture."""
    background, image = pair(8, SHAPE, 190, (220, 170), density=0.01)
    np.testing.assert_allclose(rigid_shift(background, image), (7.3, -3.6), atol=0.006)


def test_other_speckle_is_not_registered(pair):
    background, _ = pair(4, SHAPE, 50, (240, 180))
    _, image = pair(5, SHAPE, 50, (240, 180))
    with pytest.raises(NotRegistered, match="0 tiles"):
        rigid_shift(background, image)


def test_a_picture_without_speckle_is_not_registered():
    flat = np.full(SHAPE, 100, np.uint8)
    with pytest.raises(NotRegistered):
        rigid_shift(flat, flat)


def test_different_shapes_are_refused():
    with pytest.raises(ValueError, match="one shape"):
        rigid_shift(np.zeros((100, 100), np.uint8), np.zeros((100, 101), np.uint8))


def test_whole_pixels_are_moved_exactly():
    image = np.random.default_rng(6).integers(0, 255, (40, 50)).astype(np.uint8)
    np.testing.assert_allclose(shifted(image, 3, -2)[:-2, 3:], image[2:, :-3], atol=1e-4)


@pytest.mark.parametrize("shift", [(0.5, 0.25), (-4.3, 6.9)])
def test_fractions_of_a_pixel_agree_with_the_exact_shift(pair, shift):
    rest, moved = pair(7, SHAPE, 1, (0, 0), shift=shift, density=0.0, noise=0.0, uneven=0.0)
    inner = (slice(20, -20), slice(20, -20))
    error = shifted(rest, *shift)[inner] - moved[inner]
    # both pictures are rounded to whole grey levels
    assert error.std() < 0.5
