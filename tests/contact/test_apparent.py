"""Apparent contact on pictures whose micro-contacts end at a known radius."""

import numpy as np
import pytest

from analysis.contact import apparent
from analysis.contact.apparent import apparent_contact, background_difference

SHAPE = (480, 640)
CENTRE = (327.2, 236.5)


def _assert_found(contact, radius, centre, radius_px=6.4, centre_px=8.0):
    assert abs(contact.radius_px - radius) < radius_px
    assert np.hypot(contact.centre_px[0] - centre[0], contact.centre_px[1] - centre[1]) < centre_px
    assert contact.notes == ()


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "law"), [(220, 0.5), (480, 0.5), (350, 0.0)])
def test_full_size_pictures(pair, radius, law):
    background, image = pair(radius, (1200, 1600), radius, (806.3, 592.1), law=law)
    contact = apparent_contact(background, image)
    _assert_found(contact, radius, (806.3, 592.1))
    np.testing.assert_allclose(contact.shift_px, (7.3, -3.6), atol=0.01)
    assert 0 < contact.radius_sd_px < 5


def test_the_profile_is_bright_inside_and_dark_outside(pair):
    contact = apparent_contact(*pair(1, SHAPE, 150, CENTRE, density=0.01))
    _assert_found(contact, 150, CENTRE)
    r, grey = contact.profile_radius_px, contact.profile_grey
    inside, outside = grey[r < 100].mean(), grey[r > 160]
    assert inside > 3
    assert np.abs(outside).mean() < 0.1 * inside
    assert (np.diff(r) > 0).all()
    # rings of 3000 px: equal areas
    np.testing.assert_allclose(np.diff(np.pi * r[:20] ** 2), 3000, rtol=0.05)
    assert abs(contact.dark_radius_px - 150) < 12


def test_light_changes_nothing(pair):
    plain = apparent_contact(*pair(2, SHAPE, 150, CENTRE, density=0.01, uneven=0.0))
    lit = apparent_contact(
        *pair(2, SHAPE, 150, CENTRE, density=0.01, uneven=0.5, lamp=1.1, shift=(30.4, -25.3))
    )
    _assert_found(lit, 150, CENTRE)
    assert abs(lit.radius_px - plain.radius_px) < 3


def test_the_difference_keeps_the_contact_and_loses_the_speckle(pair):
    background, image = pair(3, SHAPE, 100, CENTRE, density=0.01, noise=1.0, uneven=0.0, lamp=1.2)
    difference, known = background_difference(background, image, (7.3, -3.6))
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    far = known & (np.hypot(u - CENTRE[0], v - CENTRE[1]) > 115)
    assert difference[far].std() < 2.0  # grey levels, where the speckle's is 20
    assert abs(difference[far].mean()) < 0.3
    assert not known[:, :7].any()
    assert not known[-4:].any()
    assert (difference[~known] == 0).all()


def test_no_contact_is_said_to_be_none(pair):
    contact = apparent_contact(*pair(4, SHAPE, 100, CENTRE, density=0.0))
    assert np.isnan([*contact.centre_px, contact.radius_px, contact.radius_sd_px]).all()
    np.testing.assert_allclose(contact.shift_px, (7.3, -3.6), atol=0.02)
    assert "micro-contacts" in contact.notes[0]


def test_bright_spots_all_over_are_no_contact(pair):
    contact = apparent_contact(*pair(7, SHAPE, 1500, CENTRE, law=0.0, density=0.0008))
    assert contact.micro_contacts > 100
    assert np.isnan(contact.radius_px)
    assert "no disc" in contact.notes[0]


def test_another_background_is_said_not_to_fit(pair):
    background, _ = pair(5, SHAPE, 100, CENTRE)
    _, image = pair(6, SHAPE, 100, CENTRE)
    contact = apparent_contact(background, image)
    assert np.isnan(contact.radius_px)
    assert np.isnan(contact.shift_px).all()
    assert "registration" in contact.notes[0]


def test_a_contact_larger_than_the_picture_has_no_radius(pair):
    """The disc that fits what is seen ends at the picture's corners; that is no measurement."""
    found = apparent_contact(*pair(5, (300, 400), 420.0, (205, 148), shift=(2.0, 1.0)))
    assert np.isnan(found.radius_px)
    assert found.notes


@pytest.mark.parametrize(
    ("centre", "seen"),
    [
        ((200, 150), 1.0),
        ((200, 0), 0.5),
        ((200, 299), 0.5),
        ((0, 150), 0.5),
        ((399, 0), 0.25),
        ((200, 250), 2 / 3),  # 50 of 100 px below the centre
    ],
)
def test_the_rim_that_is_seen_is_an_arc_of_the_circle(pair, monkeypatch, centre, seen):
    disc = apparent.Disc(centre, (1.0, 1.0), 100.0, 1.0, 1.0, 1e3, (np.nan, np.nan), np.nan)
    monkeypatch.setattr(apparent, "micro_contact_disc", lambda *_: disc)
    monkeypatch.setattr(apparent, "LEAST_RIM", 1.1)
    (note,) = apparent_contact(*pair(5, (300, 400), 100.0, (200, 150))).notes
    assert abs(float(note.split("%")[0].split()[-1]) - 100 * (1 - seen)) < 2
