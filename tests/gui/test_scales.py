"""Ranges that grow in rounded steps, ticks that say what they are, and even colour maps."""

import cv2
import numpy as np
import pytest

from app.gui.scales import colour_range, diverging, round_range, sequential, ticks


@pytest.mark.parametrize(
    ("ends", "most", "texts"),
    [
        ((0.0, 30.0), 4, ["0", "10", "20", "30"]),
        ((-7.5, 7.5), 6, ["−7.5", "−5.0", "−2.5", "0.0", "2.5", "5.0", "7.5"]),
        ((0.0, 0.1), 4, ["0.000", "0.025", "0.050", "0.075", "0.100"]),
        ((0.0, 1000.0), 4, ["0", "250", "500", "750", "1000"]),
        ((-0.2, 0.61), 5, ["−0.2", "0.0", "0.2", "0.4", "0.6"]),
    ],
)
def test_ticks_have_the_decimals_that_they_need(
    ends: tuple[float, float], most: int, texts: list[str]
) -> None:
    assert [text for _, text in ticks(*ends, most)] == texts
    for value, text in ticks(*ends, most):
        assert float(text.replace("−", "-")) == pytest.approx(value, abs=1e-12)


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


def test_lightness_rises_evenly_along_the_sequential_map() -> None:
    steps = np.diff(lightness(sequential()))
    assert steps.sum() > 70
    np.testing.assert_allclose(steps, steps.mean(), atol=0.3)


def test_lightness_says_the_magnitude_in_the_diverging_map() -> None:
    light = lightness(diverging())
    np.testing.assert_allclose(np.diff(light[:128]), np.diff(light[:128]).mean(), atol=0.4)
    np.testing.assert_allclose(np.diff(light[128:]), np.diff(light[128:]).mean(), atol=0.4)
    assert light[127] > 95
    assert light[0] == pytest.approx(light[-1], abs=4)
