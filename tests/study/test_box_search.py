"""The search for a box in a later picture against the formula, written out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from app.settings import config
from app.study.pictures import MARGIN_PX, SEARCH_PX, box_search, grey8

SIZE, BOX, CENTRE = (90, 110), 12, (60.5, 25.5)
FIRST = 55, 20  # column and row of the box there
BOX_OF_12 = config.load(None, ["dic.box=12", "dic.step=6", "camera.width=110", "camera.height=90"])


def pictures(ux: float, uy: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture, and the same displaced to the right by `ux` and down by `uy`."""
    noise = np.random.default_rng(3).uniform(0, 255, SIZE)
    grey = 60 * gaussian_filter(noise, 1.6, mode="wrap") / 20
    grey = np.clip(grey - grey.min(), 0, 255)
    moved = shift(grey, (uy, ux), order=5, mode="grid-wrap")
    return grey.astype(np.uint8), np.clip(moved, 0, 255).astype(np.uint8)


def by_formula(reference: np.ndarray, image: np.ndarray, tau_x: int, tau_y: int) -> float:
    """Normalised correlation of the box with that displaced by tau, pixel by pixel."""
    x0, y0 = FIRST
    pixels = [(x, y) for x in range(x0, x0 + BOX) for y in range(y0, y0 + BOX)]
    f = [float(reference[y, x]) for x, y in pixels]
    g = [float(image[y + tau_y, x + tau_x]) for x, y in pixels]
    mean_f, mean_g = math.fsum(f) / len(f), math.fsum(g) / len(g)
    both = math.fsum((a - mean_f) * (b - mean_g) for a, b in zip(f, g, strict=True))
    own_f = math.fsum((a - mean_f) ** 2 for a in f)
    own_g = math.fsum((b - mean_g) ** 2 for b in g)
    return both / math.sqrt(own_f * own_g)


def test_the_correlation_is_that_of_the_formula() -> None:
    reference, image = pictures(4.3, -2.4)
    found = box_search(BOX_OF_12, reference, CENTRE, [(7, image)])
    assert found is not None
    assert (found.frame, found.box_px, found.x_px, found.y_px) == (7, BOX, *FIRST)
    tried = list(range(-SEARCH_PX, SEARCH_PX + 1))
    assert found.tau_x_px.tolist() == found.tau_y_px.tolist() == tried
    for i in range(0, 2 * SEARCH_PX + 1, 3):
        for j in range(2 * SEARCH_PX + 1):
            expected = by_formula(reference, image, j - SEARCH_PX, i - SEARCH_PX)
            assert found.correlation[i, j] == pytest.approx(expected, abs=2e-5)
    assert (found.ux_px, found.uy_px) == pytest.approx((4.3, -2.4), abs=0.15)
    kept = SEARCH_PX + MARGIN_PX
    assert (found.left_px, found.top_px) == (FIRST[0] - kept, 0)  # cut at the upper edge
    for cut, whole in ((found.reference, reference), (found.later, image)):
        assert cut.tolist() == whole[: FIRST[1] + BOX + kept, FIRST[0] - kept :][:, :60].tolist()


def test_the_first_picture_that_holds_the_box_is_taken() -> None:
    reference, near = pictures(2.0, 0.0)
    _, gone = pictures(40.0, 30.0)
    found = box_search(BOX_OF_12, reference, CENTRE, [(3, gone), (2, near), (1, reference)])
    assert found is not None
    assert found.frame == 2
    assert box_search(BOX_OF_12, reference, CENTRE, [(3, gone)]) is None
    assert box_search(BOX_OF_12, reference, (5.0, 25.5), [(2, near)]) is None
    assert box_search(BOX_OF_12, np.zeros_like(reference), CENTRE, [(2, near)]) is None
    assert box_search(BOX_OF_12, None, CENTRE, [(2, near)]) is None


def test_grey_levels_of_more_bits_are_kept_in_8() -> None:
    wide = config.load(None, ["camera.pixel_format=Mono12"])
    assert grey8(np.array([[0, 2048, 4095]], np.uint16), wide).tolist() == [[0, 127, 255]]
    assert grey8(None, wide).shape == (0, 0)
