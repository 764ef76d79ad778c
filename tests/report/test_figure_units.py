"""Each axis of the figures of several runs shows columns of the exported table in their unit."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app.records.study_results import StudyResults
from app.report.paper.collection import FIGURES, draw

COLUMN_UNITS = {
    "µm": "um",
    "µJ": "uJ",
    "kPa/µm": "GPa_per_m",
    "J/m²": "J_per_m2",
    "m$^{-1}$": "per_m",
    "grey levels": "counts",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(FIGURES) - {"1", "2", "6a", "6b", "10", "budget"}))
def test_what_is_drawn_are_the_columns_in_the_unit_of_the_axis(
    name: str, results: StudyResults
) -> None:
    """At least one curve on each axis is a column of the exported table in the unit that the axis
    names, and no other is far from those.
    """
    figure, checked = draw(name, results), 0
    columns = [(c, np.asarray(v)) for t in figure.tables.values() for c, v in t.items()]
    for axes in [one for panel in figure.figure.axes for one in (panel, *panel.child_axes)]:
        drawn_at = [np.transpose(line.get_xydata()) for line in axes.lines]
        drawn_at += [np.transpose(held.get_offsets()) for held in axes.collections]
        for k, label in enumerate((axes.get_xlabel(), axes.get_ylabel())):
            found = re.search(r"\(([^()]+)\)$", label)
            if not found or not axes.lines:
                continue
            ending = f"_{COLUMN_UNITS.get(found[1], found[1])}"
            held = np.concatenate([v.astype(float) for c, v in columns if c.endswith(ending)])
            curves = [np.asarray(at[k], float) for at in drawn_at if at.shape[1] != 2]
            curves = [c[np.isfinite(c)] for c in curves]
            assert any(c.size and np.isin(c, held).all() for c in curves), label
            widest = np.nanmax(np.abs(held))
            assert all(np.abs(c).max() < 4 * widest for c in curves if c.size), label
            checked += 1
    assert checked >= (1 if name in ("8", "11", "12", "15", "law") else 2)
