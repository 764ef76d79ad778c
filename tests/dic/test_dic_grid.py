"""Where the boxes lie."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from analysis.dic import Grid


def test_the_papers_grid_on_the_papers_image():
    grid = Grid.cover((1200, 1600), 20, 10)
    assert grid.shape == (118, 158)
    assert (grid.x_px % 1 == 0.5).all()  # an even box has its centre between two pixels


@given(
    st.tuples(st.integers(40, 300), st.integers(40, 300)), st.integers(2, 38), st.integers(1, 60)
)
def test_boxes_cover_the_image_and_stay_inside_by_one_pixel(shape, box, step):
    grid = Grid.cover(shape, box, step)
    for size, corner, centre in [(shape[1], grid.left, grid.x_px), (shape[0], grid.top, grid.y_px)]:
        np.testing.assert_array_equal(centre, corner + (box - 1) / 2)
        assert (np.diff(corner) == step).all()
        before, after = corner[0], size - (corner[-1] + box)
        assert before >= 1
        assert after >= 1
        assert before + after < step + 2
        assert abs(before - after) <= 1


@pytest.mark.parametrize(("box", "step"), [(1, 10), (20, 0), (99, 10)])
def test_a_grid_that_can_not_be_is_refused(box, step):
    with pytest.raises(ValueError, match="grid: "):
        Grid.cover((100, 200), box, step)
