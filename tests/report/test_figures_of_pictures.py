"""What Figs 4a to 4c draw: places, signs and units."""

from __future__ import annotations

from dataclasses import replace

import closed_form as exact
import numpy as np
import pytest
from matplotlib.patches import Rectangle

from app.records.study_results import StudyResults
from app.report.paper.collection import draw
from app.report.paper.style import NotDrawn


def boxes_of(panel) -> list[tuple[float, float, float]]:
    """Left, top and width of the rectangles of a panel."""
    held = [patch for patch in panel.patches if isinstance(patch, Rectangle)]
    return [(*patch.get_xy(), patch.get_width()) for patch in held]


def test_fig_4_shows_the_box_the_window_and_the_vector(results: StudyResults) -> None:
    drawn = draw("4", results)  # of 0.3 or 0.7 N, nearest to 0.5 N by ratio
    search = results.runs[0].search
    assert search is not None
    assert search.ux_px == pytest.approx(4.0)
    reference, later, correlation = drawn.figure.axes[:3]
    assert reference.images[0].get_array().tolist() == search.reference.tolist()
    assert later.images[0].get_array().tolist() == search.later.tolist()
    for panel in (reference, later):
        assert panel.images[0].get_extent() == [125.5, 193.5, 153.5, 85.5]
    assert boxes_of(reference) == [(149.5, 109.5, 20)]
    window, found = boxes_of(later)
    assert window == (133.5, 93.5, 52)
    assert found == pytest.approx((149.5 + 4.0, 109.5 - 1.2, 20))
    image = correlation.images[0]
    i, j = np.unravel_index(np.argmax(image.get_array()), image.get_array().shape)
    left, right, below, above = image.get_extent()
    assert (left, right, below, above) == (-16.5, 16.5, 16.5, -16.5)  # y down, as the pictures
    assert (left + j + 0.5, above + i + 0.5) == (4.0, -1.0)
    (dot,) = (line for line in correlation.lines if line.get_marker() == "o")
    assert np.ravel(dot.get_data()) == pytest.approx((4.0, -1.2))
    (arrow,) = correlation.texts
    assert (*arrow.xyann, *arrow.xy) == pytest.approx((0, 0, 4.0, -1.2))
    assert correlation.get_xlabel() == r"$\tau_x$ (px)"


def test_fig_4_says_how_far_in_pixels_and_micrometres(results: StudyResults) -> None:
    drawn = draw("4", results)
    ux_um, uy_um = 4.0 * exact.PIXEL * 1e6, -1.2 * exact.PIXEL * 1e6
    assert f"u_x = 4.00 px = {ux_um:.2f} µm, u_y = -1.20 px = {uy_um:.2f} µm" in drawn.caption
    assert "a box of 20 px (141 µm)" in drawn.caption
    assert "x = 159.5 px and y = 119.5 px" in drawn.caption
    table = drawn.tables["c"]
    top = int(np.argmax(table["C_1"]))
    assert (table["tau_x_px"][top], table["tau_y_px"][top]) == (4.0, -1.0)
    vector = {name: values[0] for name, values in drawn.tables["b"].items()}
    assert vector == pytest.approx({"x_px": 159.5, "y_px": 119.5, "ux_px": 4.0, "uy_px": -1.2})
    cut = drawn.tables["a"]
    at = (cut["x_px"] == 160) & (cut["y_px"] == 120)
    assert cut["reference_counts"][at] == results.runs[0].pictures.reference[120, 160]


def test_results_without_a_search_say_so(results: StudyResults) -> None:
    bare = replace(results, runs=tuple(replace(run, search=None) for run in results.runs))
    with pytest.raises(NotDrawn, match="no box that was found"):
        draw("4", bare)
