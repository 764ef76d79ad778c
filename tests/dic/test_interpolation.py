"""The weights of the taps against their definition, and the reading kernels against a loop over
taps.
"""

import numpy as np
import pytest

from analysis.dic.interpolants import TAPS
from analysis.dic.reading import IMAGE_MARGIN, SLACK, lay_out, read_deformed, room, target_for
from analysis.dic.spectrum import interpolation

RNG = np.random.default_rng(3)
IMAGE = RNG.uniform(0, 255, (40, 50))
WEIGHTS = interpolation(np.exp(-np.linspace(0, 4, 60)))
# of a deformation, px at the box's edge
TERMS = np.array([[0.31, 0.02, -0.4], [-0.27, 0.5, 0.03]])


def slow_read(image, x, y):
    """Values between the pixels, one place after the other."""

    def weights(t):
        return [sum(c * t**p for p, c in enumerate(row)) for row in WEIGHTS]

    out = []
    for px, py in zip(np.ravel(x), np.ravel(y), strict=True):
        i, j = int(np.floor(py)), int(np.floor(px))
        rows = image[i - TAPS // 2 + 1 : i + TAPS // 2 + 1, j - TAPS // 2 + 1 : j + TAPS // 2 + 1]
        out.append(weights(py - i) @ rows @ weights(px - j))
    return np.array(out)


def prepared(kind, box):
    target = target_for(IMAGE.shape, WEIGHTS, kind)
    target.image[IMAGE_MARGIN:-IMAGE_MARGIN, IMAGE_MARGIN:-IMAGE_MARGIN] = IMAGE
    layout = lay_out(box)
    layout = layout._replace(places=layout.places.astype(kind))
    return target, room(target), layout, np.full(box * layout.pitch, np.nan, kind)


def compiled(f):
    return f


def plain(f):
    return f.py_func


@pytest.mark.parametrize(
    ("kind", "error", "jit"),
    [(np.float32, 2e-3, compiled), (np.float64, 1e-9, compiled), (np.float64, 1e-9, plain)],
)
def test_boxes_are_read_as_defined(kind, error, jit):
    box, top, left = (5, 12, 14) if jit is plain else (17, 10, 13)
    y, x = np.mgrid[top : top + box, left : left + box]
    target, memory, layout, out = prepared(kind, box)
    assert jit(read_deformed)(target, memory, layout, TERMS.astype(kind), top, left, out)
    s, t = ((a - a.mean()) / (box / 2) for a in (x, y))
    ux, uy = TERMS @ np.stack([np.ones_like(s), s, t]).reshape(3, -1)
    expected = slow_read(IMAGE, x.ravel() + ux, y.ravel() + uy).reshape(box, box)
    assert out.reshape(box, -1)[:, :box] == pytest.approx(expected, abs=5 * error)


def test_a_box_is_outside_if_it_leaves_by_more_than_a_little():
    box = 9
    target, memory, layout, out = prepared(np.float32, box)
    warp = np.full((2, 3), [0.5, 0, 0], np.float32)

    def inside(top, left):
        return read_deformed(target, memory, layout, warp, top, left, out)

    bottom, right = (size - box + SLACK for size in IMAGE.shape)
    assert inside(-SLACK, -SLACK)
    assert inside(bottom - 1, right - 1)
    assert not any(
        inside(*corner)
        for corner in [(-SLACK - 1, 20), (20, -SLACK - 1), (bottom + 1, 20), (20, right + 1)]
    )
