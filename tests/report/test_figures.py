"""The picture of a loading experiment shows what the arrays say."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_form import COMPLIANCE, PIXEL
from covered_texts import covered_or_outside
from matplotlib.figure import Figure

from app.records.record_types import Phase, Snapshot, Traction
from app.records.snapshot_numbers import numbers_of
from app.report.figures import (
    DPI,
    draw_force,
    experiment_figure,
    lay_out,
    numbered_instants,
    write_picture,
)


def draw(loading: Any, **changes: Any) -> Figure:
    given = {
        "snapshots": loading.snapshots,
        "contact": loading.contact,
        "summary": loading.summary,
        "grid_x_px": loading.x_px,
        "grid_y_px": loading.y_px,
        "pixel_m": PIXEL,
    }
    return experiment_figure(**{**given, **changes})


@pytest.fixture(scope="module")
def figure(loading: Any) -> Figure:
    return draw(loading)


@pytest.fixture(scope="module")
def numbered(loading: Any) -> list[Snapshot]:
    """The six snapshots whose fields are shown."""
    return [loading.snapshots[i] for i in numbered_instants(loading.snapshots, loading.summary)]


def panels(figure: Figure) -> list[Any]:
    return [axes for axes in figure.subfigs[1].axes if axes.images]


def test_five_instants_lead_to_the_onset_and_one_slides(
    loading: Any, numbered: list[Snapshot]
) -> None:
    chosen = [s.conditions.time_s for s in numbered]
    onset = loading.summary.onset_time_s
    assert len(chosen) == 6
    assert all(t < onset for t in chosen[:5])
    assert chosen[5] > 1.2 * onset
    assert np.diff(chosen).min() > 0.1 * onset


def test_without_an_onset_the_instants_share_the_drive(loading: Any) -> None:
    early = loading.snapshots[:24]
    chosen = [
        early[i].conditions.time_s
        for i in numbered_instants(early, replace(loading.summary, onset_time_s=math.nan))
    ]
    assert chosen[-1] == early[-1].conditions.time_s
    assert np.ptp(np.diff(chosen)) <= 0.5
    at_rest = replace(early[0].conditions, phase=Phase.REFERENCE)
    assert numbered_instants([replace(early[0], conditions=at_rest)], None) == []
    assert numbered_instants(early[:2], None) == [0, 1]


def test_the_curves_are_in_the_units_that_the_axes_name(figure: Figure, loading: Any) -> None:
    force, stick, sliding = figure.subfigs[0].axes
    drive = [s.conditions for s in loading.snapshots]
    pairs = {
        force: ("travel_m", "stage displacement $\\delta$ (µm)", 1e6),
        sliding: ("time_s", "time $t$ (s)", 1),
    }
    for axes, (name, label, scale) in pairs.items():
        assert axes.get_xlabel() == label
        line = max(axes.lines, key=lambda line: len(line.get_xdata()))
        np.testing.assert_allclose(line.get_xdata(), [scale * getattr(s, name) for s in drive])
    assert force.get_ylabel() == "shear force $Q$ (N)"
    np.testing.assert_allclose(force.lines[0].get_ydata(), [s.shear_force_n for s in drive])
    assert sliding.get_ylabel() == "$u_x(r)$ (µm)"
    outermost = max(float(np.nanmax(line.get_ydata())) for line in sliding.lines)
    rim = [
        np.interp(loading.contact.apparent_radius_m, s.rings.radius_m, s.rings.ux_m)
        for s in loading.snapshots
    ]
    assert outermost == pytest.approx(1e6 * max(rim))
    s, (fit,) = loading.summary, (line for line in sliding.lines if line.get_linestyle() == "-.")
    (begin, end), (at_begin, at_end) = fit.get_data()
    assert (begin, end) == (s.onset_time_s, drive[-1].time_s)
    slid = 1e6 * s.sliding_velocity_m_s * (drive[-1].time_s - s.onset_time_s)
    assert (at_begin, at_end) == pytest.approx((0.0, slid))
    assert (stick.get_xlabel(), stick.get_ylabel()) == (
        "shear force $Q$ (N)",
        "stick radius $c$ (mm)",
    )


def test_the_curve_of_cattaneo_and_mindlin_slides_at_mu_p(figure: Figure, loading: Any) -> None:
    curve = next(line for line in figure.subfigs[0].axes[1].lines if line.get_linestyle() == "--")
    shear_n, stick_mm = np.asarray(curve.get_xdata()), np.asarray(curve.get_ydata())
    share = shear_n / (loading.summary.mu_d * loading.summary.normal_force_n)
    expected = loading.summary.hertz_radius_m * 1e3 * np.cbrt(1 - share)
    np.testing.assert_allclose(stick_mm, expected, atol=1e-9)
    assert (share[0], share[-1]) == (0, 1)


def test_the_numbers_stand_on_the_curve(figure: Figure, numbered: list[Snapshot]) -> None:
    force = figure.subfigs[0].axes[0]
    numbers = {text.get_text(): text.xy for text in force.texts if text.get_text().isdigit()}
    assert sorted(numbers) == list("123456")
    for snapshot, number in zip(numbered, "123456", strict=True):
        now = snapshot.conditions
        assert numbers[number] == (now.travel_m * 1e6, now.shear_force_n)


def test_without_readings_of_the_stage_the_drive_is_steady_in_the_load_curve(loading: Any) -> None:
    bare = [
        replace(s, conditions=replace(s.conditions, travel_m=math.nan)) for s in loading.snapshots
    ]
    axes = Figure().subplots()
    draw_force(axes, bare, bare[:2], loading.summary)
    velocity_um_s = 1e6 * loading.summary.sliding_velocity_m_s
    times_s = [s.conditions.time_s for s in bare]
    np.testing.assert_allclose(axes.lines[0].get_xdata(), velocity_um_s * np.array(times_s))
    places = [text.xy[0] for text in axes.texts if text.get_text().isdigit()]
    np.testing.assert_allclose(places, [velocity_um_s * t for t in times_s[:2]])


def test_the_measured_stick_radii_have_their_error_bars(figure: Figure, loading: Any) -> None:
    axes = figure.subfigs[0].axes[1]
    measured = [s.stick for s in loading.snapshots if s.stick]
    segments = axes.collections[0].get_segments()
    assert len(segments) == len(measured)
    np.testing.assert_allclose(
        [s[1][1] - s[0][1] for s in segments], [2e3 * stick.stick_radius_sd_m for stick in measured]
    )


def test_c_is_the_place_of_the_largest_traction_where_there_is_one(loading: Any) -> None:
    """Not the radius of a fitted Cattaneo-Mindlin profile, which lies below theory where the
    largest traction lies above.
    """
    snapshots = [
        replace(s, traction=Traction(2 * s.stick.stick_radius_m, 1e-5, 0, 0, 0, 0))
        if s.stick
        else s
        for s in loading.snapshots
    ]
    drawn = draw(loading, snapshots=snapshots)
    measured = [s for s in snapshots if s.traction]
    axes = drawn.subfigs[0].axes[1]
    (line,) = axes.containers[0].lines[:1]
    np.testing.assert_allclose(line.get_ydata(), [1e3 * s.traction.peak_radius_m for s in measured])
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "largest traction" in names
    assert any("fitted profile" in name for name in names)


def test_the_fields_are_in_micrometres_with_the_lens_taken_off(
    figure: Figure, numbered: Any
) -> None:
    for panel, snapshot in zip(panels(figure), numbered, strict=True):
        lens = COMPLIANCE * snapshot.conditions.shear_force_n
        expected = (snapshot.field.ux_px.astype(float) * PIXEL - lens) * 1e6
        np.testing.assert_allclose(np.asarray(panel.images[0].get_array()), expected, atol=1e-6)
        # what sticks does not move once the lens is taken off
        assert abs(np.median(expected[28:31, 39:42]) - 1e6 * snapshot.motion.centre_ux_m) < 0.15


def test_the_lens_is_taken_off_along_the_drive_which_need_not_go_to_the_right(loading: Any) -> None:
    last = loading.snapshots[-1]
    for angle, times in ((math.pi, -1.0), (math.pi / 2, 0.0), (math.nan, 1.0)):
        shot = replace(last, motion=replace(last.motion, drive_angle_rad=angle))
        (panel,) = panels(draw(loading, snapshots=[shot]))
        expected = 1e6 * (last.field.ux_px.astype(float) * PIXEL - times * last.motion.lens_m)
        np.testing.assert_allclose(np.asarray(panel.images[0].get_array()), expected, atol=1e-6)


def test_the_circles_are_a_and_c_about_the_contact_in_millimetres(
    figure: Figure, loading: Any, numbered: list[Snapshot]
) -> None:
    for panel, snapshot in zip(panels(figure), numbered, strict=True):
        radii = [patch.get_radius() for patch in panel.patches]
        wanted = [
            loading.contact.apparent_radius_m * 1e3,
            numbers_of(snapshot)["stick_radius_m"] * 1e3,
        ]
        np.testing.assert_allclose(radii, [r for r in wanted if math.isfinite(r)])
        left, right, bottom, top = panel.images[0].get_extent()
        assert left == pytest.approx((9.5 - 812) * PIXEL * 1e3)
        assert right == pytest.approx((1589.5 - 812) * PIXEL * 1e3)
        assert top < 0 < bottom  # y points down


def test_the_cut_is_read_on_the_colour_bar(figure: Figure, loading: Any) -> None:
    panel = panels(figure)[4]
    low, high = panel.images[0].get_clim()
    bottom, top = panel.get_ylim()
    cut = next(line for line in panel.lines if line.get_label() == "cut").get_ydata()
    ux = np.asarray(panel.images[0].get_array())
    middle = int(np.argmin(np.abs(loading.y_px - loading.contact.centre_px[1])))
    np.testing.assert_allclose(
        low + (cut - bottom) / (top - bottom) * (high - low),
        ux[middle - 2 : middle + 3].mean(axis=0),
        atol=1e-6,
    )


def test_no_text_covers_another(figure: Figure) -> None:
    every = [axes for half in figure.subfigs for axes in half.axes]
    count, *wrong = covered_or_outside(figure, every, spare=0.0)
    assert count > 50
    assert wrong == [[], []]


def test_what_was_not_measured_is_not_drawn(loading: Any) -> None:
    bare = [replace(s, stick=None) for s in loading.snapshots[:20]]
    unknown = replace(loading.contact, apparent_radius_m=math.nan)
    figure = draw(loading, snapshots=bare, contact=unknown, summary=None)
    assert all(not panel.patches for panel in panels(figure))
    assert len(panels(draw(loading, snapshots=bare[:2], contact=None, summary=None))) == 2


def test_lost_points_stay_blank(loading: Any) -> None:
    i = numbered_instants(loading.snapshots, loading.summary)[0]
    field = loading.snapshots[i].field
    holed = field.ux_px.copy()
    holed[5, 7] = np.nan
    shots = [*loading.snapshots]
    shots[i] = replace(shots[i], field=replace(field, ux_px=holed))
    image = panels(draw(loading, snapshots=shots))[0].images[0].get_array()
    assert np.argwhere(np.ma.getmaskarray(np.ma.masked_invalid(image))).tolist() == [[5, 7]]


@pytest.mark.slow
def test_the_picture_needs_the_fields_of_its_six_instants_only(
    loading: Any, tmp_path: Path
) -> None:
    kept = set(numbered_instants(loading.snapshots, loading.summary))
    shots = [s if i in kept else replace(s, field=None) for i, s in enumerate(loading.snapshots)]
    path = tmp_path / "p.png"
    write_picture(draw(loading, snapshots=shots), path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_figure_is_laid_out_as_where_it_is_drawn_twice_for_it() -> None:
    def saved(*, is_laid_out: bool) -> bytes:
        figure, held = Figure(figsize=(2, 1.5), layout="constrained"), io.BytesIO()
        figure.subplots().set(xlabel="$x$ (mm)", ylabel="$y$ (mm)", title="title")
        if is_laid_out:
            lay_out(figure)
        figure.savefig(held, dpi=DPI)
        return held.getvalue()

    assert saved(is_laid_out=True) == saved(is_laid_out=False)
