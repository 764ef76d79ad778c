"""Figures of the paper as pictures: no text on data, no text on text, odd runs left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import closed_form as exact
import numpy as np
import pytest
from covered_texts import covered_or_outside

from app.records.study_results import RunResult, StudyResults
from app.report.paper.collection import FIGURES, draw, stem
from app.report.paper.style import Drawn, NotDrawn, write_table


@pytest.fixture(scope="module")
def drawn(results: StudyResults) -> dict[str, Drawn]:
    return {name: draw(name, results) for name in FIGURES}


@pytest.fixture(scope="module")
def alone(results: StudyResults) -> dict[str, Drawn]:
    """Those of one run of a load that is not in the paper."""
    single = replace(results, runs=(exact.run_of(0.4),))
    return {name: draw(name, single) for name in FIGURES}


def barely_slid(run: RunResult) -> RunResult:
    """Up to 1.2 t_s, so that the curves of Fig. 7 pass low on its right."""
    times = run.frames["time_s"]
    return sliced(run, slice(0, int(np.searchsorted(times[1:], 1.2 * run.summary.onset_time_s))))


def of_rising_friction(run: RunResult) -> RunResult:
    """Loads of 0.1 to 1.4 N of which mu rises, so that Fig. 8 begins low on its left."""
    s = run.summary
    P = 2 * s.normal_force_n if s.normal_force_n > 0.5 else s.normal_force_n
    mu = 0.93 * P**0.01
    told = {"normal_force_n": P, "mu_s": mu, "mu_d": mu + 0.002, "mu_d_range": (mu, mu + 0.004)}
    return replace(run, summary=replace(s, **told))


@pytest.mark.parametrize(("name", "odd"), [("7", barely_slid), ("8", of_rising_friction)])
def test_neither_a_legend_nor_a_text_lies_on_the_data(
    name: str, odd: Any, results: StudyResults
) -> None:
    figure = draw(name, replace(results, runs=tuple(map(odd, results.runs)))).figure
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    (axes,) = figure.axes
    legend = axes.get_legend()
    texts = [text for text in axes.texts if text.get_text() not in ("", "$t_s$")]
    boxes = [one.get_window_extent(renderer) for one in (legend, *texts)]
    fine = np.linspace(0, 1, 400)
    checked = 0
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        if len(x) < 2 or line.get_transform() != axes.transData:
            continue
        at = fine * (len(x) - 1)
        points = [np.interp(at, np.arange(len(x)), v) for v in (x, y)]
        shown = axes.transData.transform(np.column_stack(points))
        checked += 1
        for box in boxes:
            inside = (
                (box.x0 < shown[:, 0]) & (shown[:, 0] < box.x1)
                & (box.y0 < shown[:, 1]) & (shown[:, 1] < box.y1)
            )  # fmt: skip
            assert not inside.any(), line.get_label()
    assert checked >= 2


def test_the_panels_of_fig_13_are_in_order_and_their_model_is_smooth(
    drawn: dict[str, Drawn],
) -> None:
    assert list(drawn["13"].tables) == ["a", "b", "c", "d"]
    assert "84 µm" in drawn["13"].caption  # over which u_x is a mean: 12 px, not the box of 20
    lines = drawn["13"].figure.axes[0].get_lines()
    models = [line for line in lines if line.get_linestyle() == "--"]
    assert max(len(line.get_xdata()) for line in models if line.get_linewidth() < 1) >= 200
    table, fine = drawn["13"].tables["a"], [line for line in models if len(line.get_xdata()) == 200]
    times = np.unique(table["time_s"])
    assert len(fine) == len(times)
    for line, time in zip(fine, times, strict=True):
        rows = table["time_s"] == time
        at_rings = np.interp(table["r_mm"][rows], *line.get_data())
        np.testing.assert_allclose(at_rings, table["sigma_CM_kPa"][rows], atol=1.0)


@pytest.mark.slow
def test_no_text_covers_another_or_leaves_the_figure(drawn: dict[str, Drawn]) -> None:
    wrong = {}
    for name, one in drawn.items():
        every = [axes for axes in one.figure.axes if axes.axison and axes.get_visible()]
        _, *found = covered_or_outside(one.figure, every, spare=1.0)
        if any(found):
            wrong[name] = found
    assert wrong == {}


def test_columns_are_of_one_length_and_name_their_unit(drawn: dict[str, Drawn]) -> None:
    plain = {"instant", "quantity", "input", "relative_sd", "shift", "mu"}
    for one in drawn.values():
        for table in one.tables.values():
            assert len({len(np.atleast_1d(v)) for v in table.values()}) == 1
            for column in set(table) - plain:
                assert "_" in column, column


def test_what_was_not_measured_is_left_out_with_its_reason(results: StudyResults) -> None:
    alone = replace(results, runs=(exact.run_of(0.3, slides=False),))
    reasons = {}
    for name in FIGURES:
        try:
            draw(name, alone)
        except NotDrawn as reason:
            reasons[name] = str(reason)
    assert sorted(reasons) == ["11", "15", "8", "budget", "law", "pressure", "stiffness"]
    assert "no run slides" in reasons["11"]


def test_a_single_run_is_drawn_for_every_load(alone: dict[str, Drawn]) -> None:
    assert all(one.caption for one in alone.values())
    assert "P = 0.4 N (in the paper 0.7 N)" in alone["15"].caption


def test_numbers_in_a_table_come_back(tmp_path: Any) -> None:
    path = tmp_path / "t.csv"
    write_table({"P_N": np.array([0.1, np.nan]), "name": ["=1+1", 'a,"b"']}, path)
    assert path.read_text() == 'P_N,name\n0.1,\'=1+1\nnan,"a,""b"""\n'


def test_names_of_files_are_in_order() -> None:
    assert [stem(n) for n in ("2", "4d", "6a", "15", "law")] == [
        "fig02", "fig04d", "fig06a", "fig15", "law",
    ]  # fmt: skip


def sliced(run: RunResult, rows: slice) -> RunResult:
    """A run with some of its frames."""
    rings, law = (
        type(part)(*(getattr(part, name)[rows] for name in part.__slots__))
        for part in (run.rings, run.law)
    )
    return replace(run, frames=run.frames[rows], rings=rings, law=law)


def at_rest(run: RunResult) -> RunResult:
    frames = run.frames.copy()
    frames["phase"] = "reference"
    return replace(run, frames=frames)


def without_forces(run: RunResult) -> RunResult:
    frames = run.frames.copy()
    frames["shear_force_n"] = np.nan
    return replace(run, frames=frames)


def unpictured(run: RunResult) -> RunResult:
    nothing = np.empty((0, 0), np.uint8)
    return replace(run, contact=None, pictures=replace(run.pictures, reference=nothing))


def turned(run: RunResult) -> RunResult:
    """As of forces that were imported with another sign."""
    return replace(run, summary=replace(run.summary, mu_d=-run.summary.mu_d))


ODD = {  # what is odd -> the run, and figures that are left out for it among others
    "no frame": (lambda run: sliced(run, slice(0, 0)), {"5", "7", "11", "12", "13", "14", "15"}),
    "at rest": (at_rest, {"5", "7", "11", "12", "14", "15"}),
    "one frame": (lambda run: sliced(run, slice(0, 2)), {"11"}),
    "no force": (without_forces, {"12", "13"}),
    "no picture": (unpictured, {"2", "3"}),
    "negative friction": (turned, {"11", "14"}),
    "instants of other frames": (
        lambda run: replace(run, instants=replace(run.instants, frame=run.instants.frame + 1000)),
        set(),
    ),
    "lighter than its rim": (
        lambda run: replace(run, summary=replace(run.summary, normal_force_n=1e-6)),
        {"15"},
    ),
}


def is_same(one: Drawn, other: Drawn) -> bool:
    """Whether two figures show the same numbers."""
    try:
        np.testing.assert_equal(one.tables, other.tables)
    except AssertionError:
        return False
    return one.caption == other.caption


@pytest.mark.slow
@pytest.mark.parametrize("what", ODD)
def test_an_odd_run_is_drawn_or_left_out(
    what: str, results: StudyResults, alone: dict[str, Drawn]
) -> None:
    change, missing = ODD[what]
    odd = replace(results, runs=(change(exact.run_of(0.4)),))
    left_out = set()
    for name in FIGURES:
        try:
            drawn = draw(name, odd)
        except NotDrawn:
            left_out.add(name)
        else:
            if is_same(drawn, alone[name]):
                continue
            drawn.figure.set_layout_engine("none")  # which takes longest, and is tested above
            drawn.figure.draw_without_rendering()
    assert missing <= left_out
    assert len(left_out) < 14
