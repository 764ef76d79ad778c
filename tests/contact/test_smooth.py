"""The edge of a smooth contact: exact pictures of discs, bright, dark, blurred, dusty, cut off."""

import cv2
import numpy as np
import pytest

from analysis.contact.smooth import smooth_contact

SHAPE = 320, 400
SUB = (np.arange(16) + 0.5) / 16 - 0.5


def covered(centre, radius, oval=0.0):
    """Share of each pixel that lies in the disc."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    y, x = y - centre[1], x - centre[0]
    share = (np.hypot(x * (1 - oval), y * (1 + oval)) < radius).astype(float)
    near = np.abs(np.hypot(x, y) - radius) < 2 + 2 * oval * radius
    dx, dy = (d.ravel() for d in np.meshgrid(SUB, SUB))
    r = np.hypot((x[near, None] + dx) * (1 - oval), (y[near, None] + dy) * (1 + oval))
    share[near] = (r < radius).mean(axis=1)
    return share


def photographed(share, rng, contrast=50.0, noise=2.0, light=90.0):
    grey = light + contrast * share + rng.normal(0, noise, SHAPE)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("radius", [30.3, 110.75])
@pytest.mark.parametrize("contrast", [50.0, -50.0])
def test_the_radius_without_noise_is_that_of_the_disc(radius, contrast):
    found = smooth_contact(120 + contrast * covered((199.3, 160.8), radius))
    assert abs(found.radius_px - radius) < 0.02
    np.testing.assert_allclose(found.centre_px, (199.3, 160.8), atol=0.02)
    assert found.contrast == pytest.approx(contrast, rel=0.01)
    assert found.rim > 0.99
    assert found.oval < 1e-3


def test_the_stated_uncertainty_is_the_scatter():
    rng, pulls = np.random.default_rng(3), []
    for _ in range(30):
        radius = rng.uniform(40, 120)
        share = cv2.GaussianBlur(covered(rng.uniform(150, 180, 2), radius), (0, 0), 0.8)
        found = smooth_contact(photographed(share, rng))
        pulls.append((found.radius_px - radius) / found.radius_sd_px)
        assert abs(found.radius_px - radius) < 0.06
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_uneven_light_and_dust_are_those_of_the_background():
    rng = np.random.default_rng(5)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    light = 60 + 0.15 * x + 0.1 * y
    light[150:170, 85:100] *= 0.2  # on the edge itself
    share = covered((180.0, 165.0), 90.4)
    image = light * (1 + 0.4 * share) + rng.normal(0, 1.0, SHAPE)
    free = light + rng.normal(0, 1.0, SHAPE)
    found = smooth_contact(image, free)
    assert abs(found.radius_px - 90.4) < 0.1
    assert found.contrast == pytest.approx(0.4, rel=0.05)


def test_new_specks_of_dust_on_the_edge_change_nothing():
    rng = np.random.default_rng(6)
    image = photographed(covered((180.0, 165.0), 90.4), rng)
    for angle in (0.3, 1.9, 4.0):
        at = 180 + 90 * np.cos(angle), 165 + 90 * np.sin(angle)
        cv2.circle(image, (round(at[0]), round(at[1])), 7, 20, -1)
    assert abs(smooth_contact(image).radius_px - 90.4) < 0.1


def test_a_disc_that_the_picture_cuts_is_measured_where_it_is_seen():
    rng = np.random.default_rng(7)
    found = smooth_contact(photographed(covered((60.0, 160.0), 85.6), rng))
    assert abs(found.radius_px - 85.6) < 0.1
    assert 0.5 < found.rim < 0.9


@pytest.mark.parametrize(
    ("image", "word"),
    [
        (lambda rng: np.full(SHAPE, 90, np.uint8), "evenly bright"),
        (lambda rng: photographed(0, rng), "largest disc|no disc|fills"),
        (lambda rng: photographed(covered((200, 160), 6), rng), "largest disc"),
        (lambda rng: photographed(covered((200, 160), 80, oval=0.08), rng), "no circle"),
        (lambda rng: photographed(covered((-20, 160), 80), rng), "edge is seen|fills"),
        (lambda rng: photographed((rng.random(SHAPE) < 0.02).astype(float), rng), "disc"),
        (lambda rng: np.full(SHAPE, np.nan), "no numbers"),
        (lambda rng: np.zeros((10, 10)), "shape"),
        (lambda rng: np.zeros((3, 100, 100)), "shape"),
    ],
)
def test_what_shows_no_disc_is_refused(image, word):
    with pytest.raises(ValueError, match=f"smooth contact: .*({word})"):
        smooth_contact(image(np.random.default_rng(8)))


def test_a_background_of_another_camera_is_refused():
    with pytest.raises(ValueError, match="same camera"):
        smooth_contact(np.zeros(SHAPE), np.zeros((200, 200)))
