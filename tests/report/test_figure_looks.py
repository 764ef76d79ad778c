"""Figures as a journal takes them: their width, their fonts, their colours, and the same bytes."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import closed_form as exact
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from app.cli.figure_files import looks
from app.records.study_results import StudyResults
from app.report.paper import style
from app.report.paper.collection import draw
from app.report.paper.style import FigureStyle, picture
from app.system.errors import UserError

LOOKS = [FigureStyle(), FigureStyle(88), FigureStyle(180, "even"), FigureStyle(88, "grey")]


def millimetres(png: bytes) -> float:
    with Image.open(io.BytesIO(png)) as image:
        assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        return image.width / 300 * 25.4


@pytest.mark.parametrize(("name", "width"), [("5", 88), ("3", 180)])
def test_a_figure_is_as_wide_as_a_column_or_a_page_of_a_journal(
    name: str, width: float, results: StudyResults
) -> None:
    assert millimetres(picture(draw(name, results).figure, "png")) == pytest.approx(width, abs=0.1)
    for wanted in (88, 180):
        figure = draw(name, results, FigureStyle(wanted)).figure
        assert figure.get_figwidth() * 25.4 == pytest.approx(wanted)


def test_panels_stand_below_each_other_in_a_column(results: StudyResults) -> None:
    for width, columns in ((88, 1), (180, 2)):
        (left, right), *_ = [draw("3", results, FigureStyle(width)).figure.axes]
        beside = left.get_subplotspec().rowspan.start == right.get_subplotspec().rowspan.start
        assert beside == (columns == 2)
    fields = draw("6a", results, FigureStyle(88)).figure.axes
    assert {one.get_subplotspec().colspan.start for one in fields} == {0, 1}


@pytest.mark.slow
def test_fonts_are_true_type_and_no_file_has_a_time_of_day(
    results: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    pdf, eps = (picture(draw("3", results).figure, kind) for kind in ("pdf", "eps"))
    assert b"/FontType 42" in eps
    assert b"/Type3" not in pdf
    assert b"/CIDFontType2" in pdf
    assert b"CreationDate" not in eps
    assert b"%%BoundingBox" in eps
    monkeypatch.setattr("time.ctime", lambda *_: "another day")
    assert picture(draw("3", results).figure, "eps") == eps
    width = re.search(rb"%%HiResBoundingBox: \S+ \S+ (\S+) ", eps)
    assert width is not None
    assert float(width[1]) == pytest.approx(180 * 72 / 25.4, abs=1)


@pytest.mark.parametrize("name", ["1", "2", "3", "8", "budget"])
def test_a_figure_in_grey_has_no_colour(name: str, results: StudyResults) -> None:
    look = FigureStyle(88, "grey")
    with Image.open(io.BytesIO(picture(draw(name, results, look).figure, "png", look))) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert np.ptp(pixels, axis=2).max() <= 1
    assert len(np.unique(pixels[..., 0])) > 20


def test_the_curves_of_fig_7_are_told_apart_without_colour(results: StudyResults) -> None:
    curves = draw("7", results).figure.axes[0].lines[1:5]
    patterns = {str(line._unscaled_dash_pattern) for line in curves}
    assert len(patterns) == 4


def test_loads_and_fields_have_the_colours_that_were_asked_for(results: StudyResults) -> None:
    def first(look: FigureStyle) -> tuple[float, float, float]:
        return to_rgb(draw("5", results, look).figure.axes[0].lines[0].get_color())

    assert first(FigureStyle()) == (0, 1, 1)  # cyan, as in the paper
    assert len({first(FigureStyle(colours=name)) for name in style.PALETTES}) == 3
    maps = [draw("6a", results, one).figure.axes[0].images[0].get_cmap().name for one in LOOKS]
    assert maps == ["viridis", "viridis", "cividis", "gray"]
    # what rises is dark enough for white paper, and goes from blue to red
    colours = style.blue_to_red(np.linspace(0, 1, 50))[:, :3]
    assert (colours @ (0.299, 0.587, 0.114)).max() < 0.73
    assert colours[0].argmax() == 2
    assert colours[-1].argmax() == 0


def test_fields_of_a_row_share_their_colours(results: StudyResults) -> None:
    drawn = draw("10", results)
    axes, held = drawn.figure.axes, drawn.tables[""]["sigma_kPa"].reshape(6, -1)
    for row in (slice(0, 3), slice(3, 6)):
        limits = {one.images[0].get_clim() for one in axes[row]}
        assert len(limits) == 1
        ((low, high),) = limits
        assert low == 0
        assert 1.05 < high / np.nanpercentile(held[row], 99.5) < 1.15


def test_the_stick_radius_is_drawn_into_the_fields_in_millimetres(results: StudyResults) -> None:
    run = max(results.runs, key=lambda one: one.summary.normal_force_n)
    known = dict(zip(run.frames["frame"], run.frames["peak_radius_m"], strict=True))
    expected = [1e3 * known[frame] for frame in run.instants.frame]
    for panel, radius in zip(draw("6b", results).figure.axes, expected, strict=True):
        drawn = [patch.get_radius() for patch in panel.patches]
        assert drawn[0] == pytest.approx(1e3 * run.summary.apparent_radius_m)
        assert drawn[1:] == ([pytest.approx(radius)] if np.isfinite(radius) else [])


def test_a_style_sheet_of_ones_own_is_used(results: StudyResults, tmp_path: Path) -> None:
    sheet = tmp_path / "mine.mplstyle"
    sheet.write_text("axes.labelsize: 11\nlines.linewidth: 2.5\n", encoding="utf-8")
    axes = draw("7", results, looks(0, "paper", str(sheet))).figure.axes[0]
    assert axes.xaxis.label.get_fontsize() == 11
    assert axes.lines[1].get_linewidth() == 2.5
    assert draw("7", results).figure.axes[0].xaxis.label.get_fontsize() < 9
    with pytest.raises(UserError, match="--style nowhere: matplotlib has no such style sheet"):
        looks(0, "paper", "nowhere")
    with pytest.raises(UserError, match="--colours pink: not known; use paper, even, grey"):
        looks(0, "pink", "")
    for width in (59, 401, -88, float("nan")):
        with pytest.raises(UserError, match=f"--width {width:g}: a figure is 60 to 400 mm wide"):
            looks(width, "paper", "")


def test_the_bars_of_mu_s_have_both_parts_of_its_uncertainty(results: StudyResults) -> None:
    drawn = draw("8", results)
    table = drawn.tables[""]
    whole = drawn.figure.axes[0].containers[1].lines[2][0].get_segments()
    half = [np.ptp(bar[:, 1]) / 2 for bar in whole]
    np.testing.assert_allclose(half, np.hypot(table["mu_s_sd"], table["mu_s_sd_inputs"]))


def test_the_bar_on_the_image_is_one_millimetre(results: StudyResults) -> None:
    for panel in draw("2", results).figure.axes:
        bar = panel.lines[0].get_xdata()
        assert bar[1] - bar[0] == pytest.approx(1)
        assert "1 mm" in [text.get_text() for text in panel.texts]


def test_one_point_of_three_is_shown_of_the_stick_radius(results: StudyResults) -> None:
    drawn = draw("14", results)
    table = drawn.tables[""]
    Q = np.asarray(table["Q_N"])[np.asarray(table["P_N"]) == 0.7]
    shown = drawn.figure.axes[0].containers[1].lines[0].get_xdata()
    np.testing.assert_allclose(shown, Q[::3])


def test_each_load_has_its_own_curve_of_johnson(results: StudyResults) -> None:
    drawn = draw("11", results)
    dashed = [line for line in drawn.figure.axes[0].lines if line.get_linestyle() == "--"]
    table = drawn.tables[""]
    assert len([line for line in dashed if len(line.get_xdata())]) == len(exact.LOADS)
    for P, line in zip(exact.LOADS, dashed, strict=False):
        rows = np.asarray(table["P_N"]) == P
        np.testing.assert_allclose(
            np.interp(table["r_over_a_H"][rows], *line.get_data()),
            table["johnson_over_mu_aH2_per_m"][rows], rtol=0.01,
        )  # fmt: skip


def test_the_budget_is_told_in_two_digits_with_a_true_minus(results: StudyResults) -> None:
    told = [text.get_text() for text in draw("budget", results).figure.axes[0].texts]
    assert {"\N{MINUS SIGN}0.99", "+0.40", "1.1"} <= set(told)
    assert not any("-" in one for one in told)


def test_the_fall_of_mu_is_told_with_its_uncertainty(results: StudyResults) -> None:
    joint = replace(results.joint, decay=0.0123, decay_sd=0.0021)
    (left, _) = draw("law", replace(results, joint=joint)).figure.axes
    names = [text.get_text() for text in left.get_legend().get_texts()]
    assert any("$n$ = 0.0123 ± 0.0021" in name for name in names)


def test_fig_1_has_the_numbers_of_the_settings_in_their_units(results: StudyResults) -> None:
    drawn = draw("1", results)
    told = "\n".join(text.get_text() for text in drawn.figure.axes[0].texts)
    for wanted in (
        "$R$ = 128.8 ± 0.6 mm", "$k_N$ = 689 ± 5 N/m", "$K_T$ = 9579 ± 25 N/m",
        "$v$ = 5 µm/s", "$p$ = 7.040 ± 0.035 µm", "$E$ = 3.43 ± 0.17 MPa", "$w$ = 2.253 mm",
        "$b$ = 1.69 mm", "$f$ = 8 /s", "$h$ = 0.59 ± 0.06 µm",
    ):  # fmt: skip
        assert wanted in told, (wanted, told)
    assert "$H$" not in told  # a half-space has no thickness
    table = dict(zip(*(drawn.tables[""][name] for name in ("input", "value_in_unit")), strict=True))
    assert table["lens_radius"] == pytest.approx(128.8)
    assert table["field_width"] == pytest.approx(320 * 7.04e-3)
    assert table["field_height"] == pytest.approx(240 * 7.04e-3)
