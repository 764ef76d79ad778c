"""Size of a pixel, angle and distortion from pictures of targets, drawn through a known lens."""

import math

import numpy as np
import pytest
from hidden_benches import (
    M_PER_PX,
    TARGET_ANGLE,
    board,
    lines,
    scale_by_board,
    scale_by_lines,
    seen,
)
from seeds import SEEDS, holds, pulls, seen_by

from analysis.calibration.targets import scale_of_checkerboard, scale_of_lines


@pytest.mark.parametrize("k", [0.0, -0.01])
def test_a_picture_of_a_checkerboard(k):
    shape = (300, 400)
    picture = board(shape, k)
    found = scale_of_checkerboard(seen(picture), (11, 8), 30 * M_PER_PX)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=1e-4)  # 5e-4 was asked
    assert found.angle == pytest.approx(TARGET_ANGLE, abs=math.radians(0.003))  # 0.02
    assert abs(found.k - k) * math.hypot(*shape) / 2 < 0.02  # px at the corners
    assert found.rms_px < 0.004  # 0.012 with corners that follow the grid of the pixels
    wide = seen(picture, top=4095, kind=np.uint16)
    assert scale_of_checkerboard(wide, (11, 8), 30 * M_PER_PX).m_per_px == pytest.approx(
        M_PER_PX, rel=1e-4
    )


@pytest.mark.parametrize("k", [0.0, -0.02])
def test_a_picture_of_ruled_lines(k):
    shape = (300, 400)
    found = scale_of_lines(seen(lines(shape, k)), 11.3 * M_PER_PX, 7.5e-6)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=5e-5)  # 5e-4 was asked
    assert found.angle == pytest.approx(TARGET_ANGLE, abs=math.radians(0.001))  # 0.02
    assert abs(found.k - k) * math.hypot(*shape) / 2 < 0.01  # px at the corners


def test_lines_down_the_picture_and_a_scale_bar_of_them():
    """Upright and lying lines, and lines that end in the middle of the picture."""
    for angle in (0.0, math.pi / 2):
        found = scale_of_lines(seen(lines((240, 300), angle=angle)), 11.3 * M_PER_PX, 7e-6)
        assert abs(found.angle) == pytest.approx(angle, abs=1e-4)
    short = lines((240, 300))
    short[:120] = 200
    found = scale_of_lines(seen(short), 11.3 * M_PER_PX, 7e-6)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=5e-4)


@pytest.mark.parametrize("target", [scale_by_lines, scale_by_board])
def test_the_truth_is_within_the_uncertainty_that_a_target_states(target):
    holds(np.concatenate([pulls(one) for one in seen_by(target, SEEDS // 4).values()]))


@pytest.mark.parametrize(
    ("find", "says"),
    [
        (lambda: scale_of_checkerboard(seen(lines((200, 260))), (7, 5), 1e-4), "not found"),
        (
            lambda: scale_of_checkerboard(
                seen(board((240, 300), 0, 28.0, (7, 5), stretched=1.03)), (7, 5), 1e-4
            ),
            "lay it flat into the plane",
        ),
        (lambda: scale_of_lines(seen(lines((200, 260))), 2e-4, 7e-6), "repeats most is 11.3 px"),
        (lambda: scale_of_lines(seen(np.full((200, 260), 90.0), 3), 1e-4, 7e-6), "no 8 lines"),
        (lambda: scale_of_lines(np.zeros((9, 9, 3)), 1e-4, 7e-6), "a grey image is needed"),
    ],
)
def test_a_picture_that_tells_no_scale_is_refused(find, says):
    with pytest.raises(ValueError, match=says):
        find()
