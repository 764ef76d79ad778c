"""Size of a pixel, angle and distortion from pictures of targets, drawn through a known lens."""

import math

import numpy as np
import pytest
from scipy.special import erf

from analysis.calibration.targets import scale_of_checkerboard, scale_of_lines
from drivers.sim.optics import Lens

M_PER_PX, ANGLE = 7.11e-6, math.radians(4.3)
FINER = (np.arange(4) - 1.5) / 4


def pictured(scene, shape, k):
    """Grey levels of a scene, a function of the ideal place, through a lens, averaged over the
    pixels.
    """
    lens, (y, x) = Lens.of(k, shape), np.mgrid[: shape[0], : shape[1]].astype(float)
    return np.mean([scene(*lens.ideal(x + dx, y + dy)) for dx in FINER for dy in FINER], axis=0)


def board(shape, k=0.0, square=30.0, corners=(11, 8), origin=(55.3, 30.7), stretched=1.0):
    def scene(x, y):
        at = ((x - origin[0]) + 1j * (y - origin[1])) * np.exp(-1j * ANGLE) / square
        sides, inside = 1.0, 1.0
        for along, n in ((at.real, corners[0]), (at.imag / stretched, corners[1])):
            line = np.clip(np.rint(along), 0, n - 1)
            sides = sides * (1 - 2 * (line % 2)) * erf((along - line) * square)
            inside = inside * (1 + erf((np.abs(along - (n - 1) / 2) - (n + 1) / 2) * -square)) / 2
        return 200 - 160 * (0.5 - 0.5 * sides) * inside

    return pictured(scene, shape, k)


def lines(shape, k=0.0, pitch=11.3, wide=3.0, angle=ANGLE):
    def scene(x, y):
        at = (x * math.cos(angle) + y * math.sin(angle)) / pitch + 0.3
        off = (at - np.rint(at)) * pitch
        return 200 - 70 * (erf(off + wide / 2) - erf(off - wide / 2))

    return pictured(scene, shape, k)


def seen(grey, noise=0.0, seed=0, top=255, kind=np.uint8):
    noisy = grey * (top / 255) + noise * np.random.default_rng(seed).normal(size=grey.shape)
    return np.clip(np.rint(noisy), 0, top).astype(kind)


@pytest.mark.parametrize("k", [0.0, -0.01])
def test_a_picture_of_a_checkerboard(k):
    shape = (300, 400)
    picture = board(shape, k)
    found = scale_of_checkerboard(seen(picture), (11, 8), 30 * M_PER_PX)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=1e-4)  # 5e-4 was asked
    assert found.angle == pytest.approx(ANGLE, abs=math.radians(0.003))  # 0.02
    assert abs(found.k - k) * math.hypot(*shape) / 2 < 0.02  # px at the corners
    assert found.rms_px < 0.02
    wide = seen(picture, top=4095, kind=np.uint16)
    assert scale_of_checkerboard(wide, (11, 8), 30 * M_PER_PX).m_per_px == pytest.approx(
        M_PER_PX, rel=1e-4
    )


@pytest.mark.parametrize("k", [0.0, -0.02])
def test_a_picture_of_ruled_lines(k):
    shape = (300, 400)
    found = scale_of_lines(seen(lines(shape, k)), 11.3 * M_PER_PX, 7.5e-6)
    assert found.m_per_px == pytest.approx(M_PER_PX, rel=5e-5)  # 5e-4 was asked
    assert found.angle == pytest.approx(ANGLE, abs=math.radians(0.001))  # 0.02
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


def share_inside(pulls):
    return [float((np.abs(pulls) < sigmas).mean()) for sigmas in (1, 2)]


def test_the_truth_is_within_the_uncertainty_that_lines_state():
    clean, pulls = lines((220, 300), 0.01), []
    for seed in range(60):
        found = scale_of_lines(seen(clean, 8.0, seed), 11.3 * M_PER_PX, 7e-6)
        pulls += [
            (found.m_per_px - M_PER_PX) / found.m_per_px_sd,
            (found.angle - ANGLE) / found.angle_sd,
            (found.k - 0.01) / found.k_sd,
        ]
    inside = share_inside(pulls)
    assert 0.6 <= inside[0] <= 0.76
    assert inside[1] >= 0.9


def test_the_truth_is_within_the_uncertainty_that_a_board_states():
    pulls = []
    for seed in range(60):
        if seed % 10 == 0:
            k = seed / 3000 - 0.01
            clean = board((140, 180), k, 20.0, (7, 5), (28 + seed / 11, 30.3))
        found = scale_of_checkerboard(seen(clean, 3.0, seed), (7, 5), 20 * M_PER_PX)
        pulls += [
            (found.m_per_px - M_PER_PX) / found.m_per_px_sd,
            (found.angle - ANGLE) / found.angle_sd,
            (found.k - k) / found.k_sd,
        ]
    inside = share_inside(pulls)
    assert 0.6 <= inside[0] <= 0.76
    assert inside[1] >= 0.9


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
