"""The pattern of a camera that is known: found from dark pictures, a flat field, a moved block."""

import numpy as np
import pytest
from blobs import Speckle
from hidden_benches import (
    MIDDLE,
    PATTERN_SHAPE,
    WAYS,
    camera,
    off_px,
    pictures_of_motion,
    taken,
)

from analysis.calibration.pixel_map import PixelMap, dark_levels, map_of_flat, map_of_motion
from analysis.dic import correlate
from drivers.sim.images import dust


def test_the_spread_of_gains_is_that_before_those_that_stand_out_were_called_bad():
    gain = np.random.default_rng(5).normal(1, 0.02, (250, 250))
    found = PixelMap(0 * gain, gain, np.abs(gain - 1) > 0.05, sd=0.0)
    assert found.unequal()[0] == pytest.approx(0.02, rel=0.015)


def test_gains_that_are_known_badly_are_bad_only_beyond_their_uncertainty():
    gain = 1 + 0.02 * np.random.default_rng(5).normal(size=(250, 250))
    noisy = gain + 0.015 * np.random.default_rng(6).normal(size=gain.shape)
    found = PixelMap(0 * gain, noisy, np.abs(noisy - 1) > 0.075, 0.015)
    assert found.unequal()[0] == pytest.approx(0.02, rel=0.01)


def test_few_dark_pictures_are_in_the_uncertainty():
    """A third of the error of each gain is that of its dark level."""
    gain, dark = camera(0.005, seed=[5, 9]), np.full(PATTERN_SHAPE, 8.0)
    darkened = [taken(0 * gain, n, dark) for n in range(8)]
    level, is_hot, dark_sd = dark_levels(darkened)
    flat = [taken(40 * gain, 100 + n, dark) for n in range(60)]
    found = map_of_flat(flat, level, is_hot, 255, dark_sd)
    error = (found.gain / gain)[~found.is_bad]
    assert np.std(error / np.median(error)) == pytest.approx(found.sd, rel=0.05)
    spread, sd = found.unequal()
    assert abs(spread - 0.005) < 3 * sd
    off = np.random.default_rng(3).normal(0, 0.5, PATTERN_SHAPE).astype(np.float32)
    ways = np.stack([WAYS, 0.03 * WAYS], axis=1)
    found = map_of_motion(pictures_of_motion(gain, first=200), ways, off, dark_sd=0.5)
    error = (found.gain / gain)[MIDDLE][~found.is_bad[MIDDLE]]
    assert np.std(error / np.median(error)) == pytest.approx(found.sd, rel=0.1)


def test_a_lamp_that_is_dimmer_in_the_corners_leaves_the_border_what_it_is():
    """By a fifth, as the fourth power of a cosine."""
    gain, (y, x) = camera(0.005, seed=[5, 9]), np.indices(PATTERN_SHAPE)
    far = np.hypot(x - 139.5, y - 79.5) / 161
    light = 120 * np.cos(far * np.arccos(0.8**0.25)) ** 4
    found = map_of_flat([taken(light * gain, n) for n in range(20)], top=255)
    error = (found.gain / gain)[~found.is_bad]
    assert np.std(error / np.median(error)) == pytest.approx(found.sd, rel=0.15)
    assert found.unequal()[0] == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("spread", [1.0, 3.0, 1e3])
def test_gains_that_are_those_of_no_camera_are_told_to_be_unequal(spread):
    gain = np.random.default_rng(5).normal(1, spread, (50, 50))
    assert PixelMap(0 * gain, gain, np.isnan(gain), sd=0.0).unequal()[0] > spread


def test_a_flat_field_tells_the_pattern_to_a_third_of_a_grey_level():
    gain, dark = camera(0.02), np.random.default_rng(3).normal(8, 1.5, PATTERN_SHAPE)
    level, is_hot, _ = dark_levels([taken(0 * gain, n, dark) for n in range(40)])
    assert np.sqrt(np.mean((level - dark) ** 2)) < 0.3
    assert not is_hot.any()
    found = map_of_flat([taken(120 * gain, 100 + n, dark) for n in range(60)], level, top=255)
    wrong = off_px(found, gain, 100, np.s_[:, :])
    assert wrong < 0.3
    # the rest is the noise of the dark level
    assert found.sd * 100 < wrong < 1.5 * found.sd * 100
    assert off_px(PixelMap(level, np.ones(PATTERN_SHAPE), found.is_bad, 0.0), gain, 100) > 1.5


@pytest.mark.parametrize(("marks", "most"), [(0, 0.3), (8, 0.5)])
def test_a_block_that_is_moved_tells_the_pattern(marks, most):
    gain = camera(0.01, marks)
    found = map_of_motion(pictures_of_motion(gain), np.stack([WAYS, 0.03 * WAYS], axis=1))
    is_mark = np.abs(dust(PATTERN_SHAPE, marks, 1) - 1) > 0.08
    assert (
        off_px(found, gain, 97) < most
    )  # grey levels; 0.97 of unequal pixels before, 4 with marks
    if not marks:
        assert found.sd * 97 == pytest.approx(off_px(found, gain, 97), rel=0.1)
    if marks:
        assert found.is_bad[MIDDLE][is_mark[MIDDLE]].mean() > 0.9
    assert found.is_bad[MIDDLE].mean() < 0.02 + 3 * is_mark[MIDDLE].mean()


@pytest.mark.slow
def test_the_spread_of_unequal_pixels_is_read_neither_too_small_nor_too_large():
    """Waves along the motion are found in part; the border of the picture is told by few."""
    spreads = []
    for seed in range(1, 7):
        gain, ways = camera(0.007, seed=[7, seed]), np.stack([WAYS, 0.03 * WAYS], axis=1)
        found = map_of_motion(pictures_of_motion(gain, first=1000 * seed), ways)
        spreads.append(found.unequal()[0])
    assert np.mean(spreads) / 0.007 == pytest.approx(1, abs=0.002)


def test_displacements_are_not_pulled_any_more():
    gain, way = camera(0.05), 0.4
    block = Speckle(PATTERN_SHAPE, seed=3)
    few = WAYS[::3]
    found = map_of_motion(pictures_of_motion(gain, few), np.stack([few, 0.03 * few], axis=1))
    pair = [
        taken(block.grey(u, contrast=25, level=60) * gain, 90 + n) for n, u in enumerate((0, way))
    ]
    pulled, right = (
        float(np.nanmedian(correlate(*images, box=30, step=15, threads=1).ux_px[1:-1, 3:-3]))
        for images in (pair, [found.corrected(one) for one in pair])
    )
    assert pulled < way - 0.02
    assert right == pytest.approx(way, abs=0.006)


def test_a_picture_is_corrected_in_its_own_type():
    dark, gain = np.full(PATTERN_SHAPE, 8, np.float32), np.float32(camera(0.1))
    found = PixelMap(dark, gain, gain > 9, 0.0)
    for kind, top in ((np.uint8, 255), (np.uint16, 65535), (np.float32, None)):
        image = np.rint(8 + 100 * gain).astype(kind)
        if top:
            image[3, 4] = top
        even = found.corrected(image)
        assert even.dtype == kind
        assert np.abs(np.delete(even, 3, axis=0).astype(float) - 108).max() < 2
        assert not top or even[3, 4] == top  # saturated as before
    with pytest.raises(ValueError, match="a picture of shape"):
        found.corrected(image[1:])


def test_hot_pixels_and_light_in_dark_pictures():
    dark = np.full(PATTERN_SHAPE, 8.0)
    dark[50, 60] = 40
    _, is_hot, _ = dark_levels([taken(0 * dark, n, dark) for n in range(10)])
    assert np.argwhere(is_hot).tolist() == [[50, 60]]
    leak = 8 + 20 * np.exp(-np.linspace(0, 4, PATTERN_SHAPE[1])) * np.ones(PATTERN_SHAPE)
    with pytest.raises(ValueError, match="cover the lens"):
        dark_levels([taken(leak, n) for n in range(10)])


@pytest.mark.parametrize(
    ("measure", "says"),
    [
        (lambda: dark_levels([np.zeros(PATTERN_SHAPE)] * 3), "dark pictures: 3 were given"),
        (lambda: map_of_flat([np.full(PATTERN_SHAPE, 255, np.uint8)] * 8, top=255), "saturated"),
        (
            lambda: map_of_flat([np.full(PATTERN_SHAPE, 90 + 3 * n) for n in range(8)]),
            "light steady",
        ),
        (lambda: map_of_flat(pictures_of_motion(camera(0.0), [0.0] * 8)), "a texture is seen"),
        (
            lambda: map_of_motion(pictures_of_motion(camera(0.0), WAYS[:9]), np.zeros((9, 2))),
            "add travels",
        ),
        (
            lambda: map_of_motion(
                pictures_of_motion(camera(0.0), WAYS[::3]),
                np.stack([-WAYS[::3], 0 * WAYS[::3]], axis=1),
            ),
            "the block must be free, and its ways right",
        ),
        (
            lambda: map_of_motion(
                [
                    one + np.uint8(n)
                    for n, one in enumerate(pictures_of_motion(camera(0), WAYS[::3]))
                ],
                np.stack([WAYS[::3], 0 * WAYS[::3]], axis=1),
            ),
            "the light changed",
        ),
    ],
)
def test_pictures_that_tell_no_pattern_are_refused(measure, says):
    with pytest.raises(ValueError, match=says):
        measure()
