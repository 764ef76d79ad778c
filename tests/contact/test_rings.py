"""Ring means against a slow loop over the rings, and against fields whose azimuthal mean is
known.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from analysis.contact.rings import central_value, ring_means

X, Y = np.meshgrid(np.arange(15, 1586, 10.0), np.arange(15, 1186, 10.0))


def _polar(centre=(803.2, 598.7)):
    x, y = X - centre[0], Y - centre[1]
    return np.hypot(x, y), np.arctan2(y, x)


def _of_overlapping_boxes(rng):
    """Noise of 0.1 that neighbours share, as boxes of two pitches do, shape (25, 25)."""
    white = rng.normal(0, 0.1, (26, 26))
    return (white[1:, 1:] + white[:-1, 1:] + white[1:, :-1] + white[:-1, :-1]) / 2


def _bowl_elsewhere(rng, bend, sd):
    """A noisy bowl of 2.0 at its lowest point, which is off by `sd` along each axis."""
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    off_x, off_y = sd * rng.normal(size=2)
    bowl = 1.2 * (x - off_x) ** 2 + 0.8 * (y - off_y) ** 2
    return 2.0 + bend * bowl + _of_overlapping_boxes(rng)


def test_agrees_with_a_loop_over_the_rings():
    rng = np.random.default_rng(0)
    r = rng.uniform(0, 100, 3000)
    values = rng.normal(size=3000)
    values[::50] = np.nan
    rings = ring_means(r, values, 10, 95)
    assert len(rings.mean) == 9
    for k in range(9):
        inside = (r >= 10 * k) & (r < 10 * (k + 1)) & np.isfinite(values)
        assert rings.count[k] == inside.sum()
        np.testing.assert_allclose(rings.radius[k], r[inside].mean())
        np.testing.assert_allclose(rings.mean[k], values[inside].mean())
        np.testing.assert_allclose(
            rings.standard_error[k], values[inside].std(ddof=1) / np.sqrt(inside.sum())
        )


def test_outliers_are_left_out():
    rng = np.random.default_rng(1)
    r, theta = _polar()
    values = 3 * np.exp(-r / 300) + rng.normal(0, 0.033, r.shape)
    clean = [ring_means(r, values, 10, 560, theta=t) for t in (None, theta)]
    values[rng.random(r.shape) < 0.01] += 10
    for before, t in zip(clean, (None, theta), strict=True):
        after = ring_means(r, values, 10, 560, theta=t)
        assert np.nanmax(np.abs(after.mean - before.mean)[3:]) < 0.03
        assert after.count.sum() < before.count.sum()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_rounding_makes_no_outlier(dtype):
    """In a stick zone without noise all points but a few have one value."""
    x, y = np.meshgrid(np.linspace(-2e-3, 2e-3, 41), np.linspace(-2e-3, 2e-3, 41))
    r = np.hypot(x, y)
    u = (8e-5 - np.maximum(r - 1e-3, 0.0) ** 2).astype(dtype)
    u[::3] = np.nextafter(u[::3], dtype(1))
    rings = ring_means(r, u, 1e-4, theta=np.arctan2(y, x))
    assert rings.count[:10].sum() == (r / 1e-4 < 10).sum()
    assert rings.mean[:10] == pytest.approx(8e-5, rel=1e-6)


def test_with_the_azimuth_the_second_harmonic_does_not_leak():
    # the cos 2 theta of a sheared contact, 0.3 px, on top of 0.033 px of noise
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        r, theta = _polar((800 + rng.uniform(-5, 5), 600 + rng.uniform(-5, 5)))
        values = (
            3 * np.exp(-r / 300)
            + 0.3 * np.cos(2 * theta) * np.exp(-r / 400)
            + rng.normal(0, 0.033, r.shape)
        )
        rings = ring_means(r, values, 10, 560, theta=theta)
        scores.append((rings.mean - 3 * np.exp(-rings.radius / 300))[3:] / rings.standard_error[3:])
    assert 0.85 < np.std(scores) < 1.15
    assert np.max(np.abs(scores)) < 5


def test_a_ring_cut_by_the_border_keeps_its_mean():
    r, theta = _polar((800, 250))
    values = 5 + 2 * np.cos(2 * theta)
    assert abs(ring_means(r, values, 10, 500).mean[40] - 5) > 0.2
    assert abs(ring_means(r, values, 10, 500, theta=theta).mean[40] - 5) < 1e-9


def test_empty_rings_are_nan_at_their_middle():
    rings = ring_means([1.0, 2.0, 25.0, np.nan], [1.0, 3.0, 7.0, 1.0], 10, 40)
    np.testing.assert_array_equal(rings.count, [2, 0, 1, 0])
    np.testing.assert_array_equal(rings.mean, [2, np.nan, 7, np.nan])
    np.testing.assert_array_equal(rings.radius, [1.5, 15, 25, 35])
    assert np.isnan(rings.standard_error[1:]).all()


def test_a_field_that_is_lost_everywhere():
    r, theta = _polar()
    for t in (None, theta):
        rings = ring_means(r, np.full(r.shape, np.nan), 10, 560, theta=t)
        assert np.isnan(rings.mean).all()
        assert len(rings.mean) == 56


def test_central_value_is_that_of_the_middle_of_a_bent_field():
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    r = np.hypot(x, y)
    values = 2.0 + 3e-3 * r**2 + 0.5 * np.cos(2 * np.arctan2(y, x)) * (r > 0)
    values[12, 14] = 1e3  # an outlier near the centre
    # the mean over the disc is 5.7
    assert central_value(r, np.arctan2(y, x), values, 50)[0] == pytest.approx(2.0, abs=0.05)
    assert np.isnan(central_value(r + 100, np.arctan2(y, x), values, 50)).all()
    assert np.isnan(central_value(r, np.arctan2(y, x), values, np.nan)).all()


def test_the_bending_over_a_box_is_taken_off_and_the_noise_of_overlapping_boxes_is_stated():
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    r, rng, found = np.hypot(x, y), np.random.default_rng(1), []
    for _ in range(200):
        noise = _of_overlapping_boxes(rng)
        values = 2.0 + 3e-3 * (r**2 + 10.0**2 / 6) + noise  # boxes of two pitches
        found.append(central_value(r, np.arctan2(y, x), values, 50, box=10.0, shared=4.0))
    value, sd = np.array(found).T
    assert value.mean() == pytest.approx(2.0, abs=4 * value.std() / np.sqrt(200))
    assert np.median(sd) == pytest.approx(value.std(), rel=0.3)


@pytest.mark.parametrize(("bend", "least_gain"), [(3e-3, 5.0), (3e-4, 1.5), (0.0, 0.0)])
def test_a_centre_that_is_off_does_not_lift_the_value_there(bend, least_gain):
    """A bowl is never lower than at its own centre: about a centre that is off by 8 along each axis
    its value came out too high, by twelve stated uncertainties where it bends most.
    """
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    r, theta, rng, found = np.hypot(x, y), np.arctan2(y, x), np.random.default_rng(1), []
    for _ in range(300):
        values = _bowl_elsewhere(rng, bend, 8.0)
        both = [central_value(r, theta, values, 50, shared=4.0, centre_sd=sd) for sd in (0.0, 8.0)]
        found.append(both)
    (plain, _), (value, sd) = np.transpose(found, (1, 2, 0))
    assert abs(value.mean() - 2.0) < 0.2 * np.median(sd)
    assert 0.5 < np.sqrt(np.mean(((value - 2.0) / sd) ** 2)) < 1.3
    assert plain.mean() - 2.0 >= least_gain * np.median(sd) - 4e-3
    assert np.median(sd) < 0.06


@pytest.mark.parametrize("bend", [3e-4, 3e-5])
def test_the_uncertainty_holds_a_centre_that_is_known_to_half_of_the_disc(bend):
    """It left out that of the correction: the value of a field that bends as little as its noise
    was off by 1.6 stated uncertainties.
    """
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    r, theta, rng, scores = np.hypot(x, y), np.arctan2(y, x), np.random.default_rng(1), []
    for _ in range(400):
        values = _bowl_elsewhere(rng, bend, 25.0)
        value, sd = central_value(r, theta, values, 50, shared=4.0, centre_sd=25.0)
        scores.append((value - 2.0) / sd)
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("offs", [4.0, 8.0, 20.0])
def test_a_tilt_that_is_not_of_the_centre_hardly_moves_the_value(offs, angle):
    """A slope that a centre off by so many of its uncertainties would explain moved the value by
    the square of that number times 0.05, up to 100 stated uncertainties.
    """
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    bowl = 2.0 + 3e-3 * (x**2 + y**2) + np.random.default_rng(2).normal(0, 0.01, x.shape)
    tilt = 2 * 3e-3 * 4.0 * offs * (x * np.cos(angle) + y * np.sin(angle))
    polar = np.hypot(x, y), np.arctan2(y, x)
    value, sd = central_value(*polar, bowl + tilt, 50, centre_sd=4.0)
    assert abs(value - 2.0) < 0.6
    assert abs(value - 2.0) < 4 * sd
    assert central_value(*polar, bowl, 50, centre_sd=4.0) == pytest.approx((2.0, 0.0), abs=0.01)


def test_a_field_without_bend_and_noise_is_what_it_is_however_badly_its_centre_is_known():
    x, y = np.meshgrid(np.arange(-60.0, 61, 5), np.arange(-60.0, 61, 5))
    even = central_value(np.hypot(x, y), np.arctan2(y, x), np.full(x.shape, 3.0), 50, centre_sd=8.0)
    assert even == (pytest.approx(3.0), pytest.approx(0.0, abs=1e-9))


def test_a_ring_of_few_points_at_its_middle_tells_no_slope():
    """The innermost ring has four points, all of them at its middle, so that no harmonics are
    fitted; that they were taken for known ended the run.
    """
    x, y = np.meshgrid(np.arange(-20.5, 21), np.arange(-20.5, 21))
    r, radius = np.hypot(x, y), 8 * np.hypot(0.5, 0.5)
    inside = (r < radius / 4) & (r > 0)
    assert (r[inside] == radius / 8).all()
    assert 1 < inside.sum() < 12
    values = 2.0 + 0.1 * r**2
    found = central_value(r, np.arctan2(y, x), values, radius, centre_sd=1.0)
    assert found[0] == pytest.approx(2.0, abs=3e-3)
    assert np.isfinite(found[1])


def test_a_width_of_zero_is_refused():
    with pytest.raises(ValueError, match="width"):
        ring_means([1.0], [1.0], 0.0)


@settings(max_examples=25)
@given(st.integers(1, 300), st.floats(1, 40), st.integers(0, 1000))
def test_no_point_is_counted_twice_and_a_constant_stays_one(n, width, seed):
    r = np.random.default_rng(seed).uniform(0, 100, n)
    rings = ring_means(r, np.full(n, 3.5), width)
    assert rings.count.sum() == n
    np.testing.assert_allclose(rings.mean[rings.count > 0], 3.5)
