"""Ranges that grow in rounded steps, and even colour maps."""

import cv2
import numpy as np
import pytest

from app.gui.plots.picture import colour_indices, colour_table
from app.gui.scales import colour_range, robust_range, round_range, round_step


def test_a_range_changes_seldom_while_a_curve_grows() -> None:
    held, changes = None, 0
    for top in np.linspace(0.001, 0.465, 400):
        new = round_range(0.0, float(top), held)
        assert new[0] <= 0.0
        assert top <= new[1]
        changes += new != held
        held = new
    assert changes < 25
    assert held == (0.0, 0.5)


def test_a_range_is_left_when_little_of_it_is_used() -> None:
    assert round_range(0.0, 40.0, (0.0, 100.0)) == (0.0, 100.0)
    assert round_range(0.0, 8.0, (0.0, 100.0)) == (0.0, 8.0)


def test_noise_below_zero_takes_no_step_of_the_axis() -> None:
    low, high = round_range(-0.001, 0.465)
    assert -0.02 < low < 0
    assert high == pytest.approx(0.5)


def test_values_that_are_all_the_same_have_a_range() -> None:
    low, high = round_range(3.0, 3.0)
    assert low < 3.0 < high
    assert round_range(np.nan, np.nan) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("low", "high", "is_diverging", "ends"),
    [
        (-0.2, 19.1, False, (0.0, 20.0)),
        (-19.1, 0.2, False, (-20.0, 0.0)),
        (-3.0, 7.4, True, (-8.0, 8.0)),
        (85.0, 133.0, False, (80.0, 140.0)),
    ],
)
def test_a_colour_scale_wastes_no_half(
    low: float, high: float, is_diverging: bool, ends: tuple[float, float]
) -> None:
    assert colour_range(low, high, None, is_diverging=is_diverging) == pytest.approx(ends)


def lightness(colours: np.ndarray) -> np.ndarray:
    """CIE L of sRGB colours, by another program."""
    lab = cv2.cvtColor((colours[None] / 255).astype(np.float32), cv2.COLOR_RGB2Lab)
    return np.asarray(lab[0, :, 0])


def test_a_few_wild_points_do_not_stretch_the_colours() -> None:
    values = np.linspace(-1.0, 4.0, 4000).reshape(50, 80)
    values[3, 5], values[20, 60], values[40, 40] = 1e6, -1e6, np.nan
    assert robust_range(values) == pytest.approx((-0.95, 3.95), abs=0.01)


def test_lightness_rises_along_the_sequential_map() -> None:
    steps = np.diff(lightness(colour_table(is_diverging=False)[1::4, :3]))
    assert steps.min() > 0
    assert steps.sum() > 70


def test_lightness_says_the_magnitude_in_the_diverging_map() -> None:
    light = lightness(colour_table(is_diverging=True)[1:, :3])
    assert np.all(np.diff(light[:127]) > 0)
    assert np.all(np.diff(light[127:]) < 0)
    assert light[127] > 90
    assert light[0] == pytest.approx(light[-1], abs=4)


@pytest.mark.parametrize("is_diverging", [False, True])
def test_what_was_not_measured_has_no_colour_and_saturation_one_of_its_own(
    is_diverging: bool,
) -> None:
    table = colour_table(is_diverging=is_diverging)
    values = np.array([np.nan, -3.0, -2.0, 2.0, 3.0])
    np.testing.assert_array_equal(colour_indices(values, (-2.0, 2.0)), [0, 1, 1, 255, 255])
    assert table[0, 3] == 0
    assert np.all(table[1:, 3] == 255)
    red = np.array([(255, 32, 32)])
    lab, far = (
        cv2.cvtColor((c[None] / 255).astype(np.float32), cv2.COLOR_RGB2Lab)[0]
        for c in (table[1:, :3], red)
    )
    assert np.linalg.norm(lab - far, axis=1).min() > 20  # of CIE76, far more than just noticeable


@pytest.mark.parametrize(
    ("least", "step"), [(13.4 / 10, 2.0), (13.4 / 14, 1.0), (2.2, 2.5), (75.0, 100.0), (0.06, 0.1)]
)
def test_times_and_colours_have_round_steps(least: float, step: float) -> None:
    assert round_step(least) == pytest.approx(step)
