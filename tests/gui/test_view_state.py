"""What the window shows, which is decided without Qt, against a run made of closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from python_program import python
from scripted_run import HERTZ_M, MU, PERIOD, REFERENCE, P, ScriptedRun
from window_hands import look

from app.gui import run_charts, run_curves
from app.gui.cells import Tone, count_cells, disk_cell, grouped, number, queue_cell
from app.gui.charts import Chart
from app.gui.frame_results import FrameResults, shown_image
from app.gui.run_charts import RunCharts
from app.gui.run_curves import NO_CURVES, Curves, extended, force_strips
from app.gui.source import setup_of
from app.gui.view_state import read, resolve
from app.records.record_types import Counts, End, Outcome, Phase, Snapshot, Stick
from app.records.snapshot_numbers import RADII


@pytest.fixture(scope="module")
def script() -> ScriptedRun:
    return ScriptedRun(320, 240, frames=330)


@pytest.fixture
def run(script: ScriptedRun) -> ScriptedRun:
    script.started, script.stopped, script.reason = True, False, ""
    return script.at(0)


def results(run: ScriptedRun, frame: int) -> FrameResults:
    """What is drawn of the frame that a run is at."""
    found = look(run.at(frame)).frame
    assert found is not None
    return found


def charts_of(run: ScriptedRun, **curves: np.ndarray) -> RunCharts:
    """Charts of nothing but these curves."""
    none, setup = np.empty(0), setup_of(run)
    forces = force_strips((none, none, none), math.nan, setup)
    return RunCharts(setup, replace(NO_CURVES, **curves), None, forces, None, Chart("", "", ""))


def test_deciding_what_is_shown_loads_no_qt() -> None:
    code = (
        "import sys, app.gui.view_state, app.system.display; sys.exit(any('PySide6' in m or"
        " 'pyqtgraph' in m for m in sys.modules))"
    )
    assert python("-c", code).returncode == 0


def test_before_the_first_frame_there_is_nothing_to_draw(run: ScriptedRun) -> None:
    run.started = False
    view = look(run)
    assert view.image is None
    assert view.frame is None
    assert view.circles.centre_px is None
    assert "Start (F5)" in view.sentence
    assert [cell.value for cell in view.result][:3] == ["0.5", "5", "190"]


def test_curves_grow_by_what_is_new_and_equal_one_look_at_all(run: ScriptedRun) -> None:
    view = None
    for frame in (5, 30, 31, 31, 120, 200):
        view = look(run.at(frame), view)
    once = look(run)
    assert view is not None
    assert view.curves.seen == once.curves.seen == 200
    for name in ("loading", "sticking", "peaks", "sliding", "noise"):
        np.testing.assert_array_equal(getattr(view.curves, name), getattr(once.curves, name))


def test_curves_follow_the_closed_forms(run: ScriptedRun) -> None:
    curves = look(run.at(200)).curves
    travel_um = curves.loading[:, 0]
    assert travel_um[-1] == pytest.approx((199 - REFERENCE) * 0.125 * 4.85)
    # there are no points of the free block, nor of the contact while it is made
    assert len(travel_um) == 200 - (REFERENCE - 4)
    shear_n, stick_mm, _, normal_n = curves.sticking.T
    expected = run.radius_m * 1e3 * np.cbrt(1 - shear_n / (MU * P))
    np.testing.assert_allclose(stick_mm, expected, rtol=1e-12)
    np.testing.assert_array_equal(normal_n, P)


def test_time_counts_from_the_start_of_the_drive(run: ScriptedRun) -> None:
    before, during = look(run.at(20)), look(run.at(200))
    first, later = before.charts["forces"], during.charts["forces"]
    assert first.lines[0].x[0] == 0.0
    assert "first sample" in first.x_label
    assert later.lines[0].x[0] == pytest.approx(-REFERENCE * PERIOD / 1000)
    assert "start of the drive" in later.x_label


def test_overlay_is_u_x_without_the_motion_of_the_lens(run: ScriptedRun) -> None:
    frame = look(run.at(200)).frame
    snapshot = run.snapshots_since(199)[0]
    assert frame is not None
    field = frame.field("ux_um")
    expected = snapshot.field.ux_px * 7.04 - 0.68 * snapshot.conditions.shear_force_n
    np.testing.assert_allclose(field.values, expected, rtol=1e-4, atol=1e-3)
    assert np.isnan(field.values[0, 0])
    rect = (5.0, 5.0, 10.0 * len(run.grid_x_px), 10.0 * len(run.grid_y_px))
    assert setup_of(run).grid_rect_px == rect


def test_the_traction_stands_beside_cattaneo_and_mindlins(run: ScriptedRun) -> None:
    assert results(run, REFERENCE + 2).traction_kpa is None
    view, frame = look(run.at(200)), results(run, 200)
    profile = frame.traction_kpa
    assert profile is not None
    # the scripted traction exceeds the model by so much
    np.testing.assert_allclose((profile.values - profile.model), 2.0, atol=1e-9)
    np.testing.assert_allclose(profile.sd, 0.5)
    assert frame.peak_mm == pytest.approx(frame.stick_mm + 0.05)
    guides = {guide.text: guide.value for guide in view.charts["traction"].guides}
    assert guides["c"] == pytest.approx(guides["c fitted"] + 0.05)
    assert guides["a"] == pytest.approx(run.radius_m * 1e3)
    assert guides["a_H"] == pytest.approx(HERTZ_M * 1e3, rel=1e-3)
    assert frame.balance.startswith("∫σ dA = 0.4000 ± 0.0020 N, Q = ")


def test_both_radii_called_c_are_drawn_over_q(run: ScriptedRun) -> None:
    curves = look(run.at(120)).curves
    assert len(curves.peaks) > 20
    peak_shear_n, peak_mm, _ = curves.peaks.T
    shear_n, stick_mm, *_ = curves.sticking.T
    stick_mm = np.interp(peak_shear_n, shear_n, stick_mm)
    np.testing.assert_allclose(peak_mm - stick_mm, 0.05, atol=1e-3)


def test_the_traction_of_every_point_is_a_field_of_its_own(run: ScriptedRun) -> None:
    frame = results(run, 200)
    traction = frame.field("sigma_kPa")
    np.testing.assert_allclose(traction.values, 12, rtol=1e-6)
    assert traction.label == "σₓz (kPa)"
    assert "sigma_kPa" not in results(run, REFERENCE + 2).keys


def test_circles_have_the_contacts_size_in_pixels(run: ScriptedRun) -> None:
    circles = look(run.at(200)).circles
    assert circles.centre_px == run.centre_px
    assert circles.apparent_px == pytest.approx(run.radius_m / 7.04e-6)
    assert circles.hertz_px == pytest.approx(HERTZ_M / 7.04e-6, rel=1e-3)
    traction = run.snapshots_since(199)[0].traction  # c is where it is largest
    assert circles.stick_px == pytest.approx(traction.peak_radius_m / 7.04e-6)


def test_a_stick_radius_that_is_lost_in_its_uncertainty_is_a_bound_and_no_circle(
    run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    slides = replace(run._snapshots[200], stick=Stick(0.20e-3, 0.24e-3, 9e4, 1.0), traction=None)
    monkeypatch.setattr(run, "_snapshots", [*run._snapshots[:200], slides, *run._snapshots[201:]])
    view = look(run.at(201))
    assert (view.readouts[-1].value, view.readouts[-1].unit) == ("< 0.7", "mm")
    assert math.isnan(view.circles.stick_px)
    sticks = replace(slides, stick=Stick(0.60e-3, 0.24e-3, 9e4, 1.0))
    monkeypatch.setattr(run, "_snapshots", [*run._snapshots[:200], sticks, *run._snapshots[201:]])
    assert look(run.at(201)).readouts[-1].value == "0.60"


def test_the_uncertainty_of_u_x_is_in_the_unit_of_its_label(run: ScriptedRun) -> None:
    frame = results(run, 200)
    field = frame.field("ux_sd_um")
    assert field.label == "noise of uₓ (µm)"
    np.testing.assert_allclose(field.values, 0.03 * 7.04, rtol=1e-6)


def test_what_did_not_change_is_the_same_object(run: ScriptedRun) -> None:
    first = look(run.at(100))
    second = look(run, first)
    assert second.image is first.image
    assert second.frame is first.frame
    assert second.curves is first.curves


def test_wide_images_are_thinned_and_keep_their_place() -> None:
    full = (np.arange(1200 * 1600) % 65535).reshape(1200, 1600).astype(np.uint16)
    view = shown_image(full)
    assert view.caption == "display 1:2, data full"
    np.testing.assert_array_equal(view.pixels, full[::2, ::2] // 257)
    # shown pixel (i, j) is centred on camera pixel (2i, 2j)
    assert view.rect_px == (-1.0, -1.0, 1600.0, 1200.0)
    assert shown_image(full[:600, :800]).caption == "display 1:1"


def test_saturated_pixels_are_found_also_between_those_that_are_shown() -> None:
    full = np.full((1200, 1600), 100, np.uint8)
    full[301, 501] = 255
    view = shown_image(full)
    np.testing.assert_array_equal(np.argwhere(view.pixels == 255), [[150, 250]])
    assert "saturated" in view.caption
    assert "saturated" not in shown_image(full[:300]).caption


def test_slip_is_shown_inside_the_contact_only(run: ScriptedRun) -> None:
    frame = results(run, 200)
    slip, along = frame.field("slip_um").values, frame.field("ux_um").values
    x, y = np.meshgrid(run.grid_x_px, run.grid_y_px)
    inside = np.hypot(x - run.centre_px[0], y - run.centre_px[1]) <= run.radius_m / 7.04e-6
    # the centres of boxes as the window places them are the grid's
    np.testing.assert_array_equal(np.isfinite(slip), inside & np.isfinite(along))
    np.testing.assert_array_equal(slip[np.isfinite(slip)], along[np.isfinite(slip)])


def test_the_median_can_be_taken_off(run: ScriptedRun) -> None:
    frame = results(run, 200)
    whole = frame.field("ux_um")
    rest = whole.about_median()
    assert not whole.is_diverging
    assert rest.is_diverging
    assert np.nanmedian(rest.values) == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(rest.values + rest.offset, whole.values, atol=1e-4)
    assert rest.label.startswith("uₓ − ")


def test_u_x_in_time_is_read_from_the_rings(script: ScriptedRun) -> None:
    run = script.at(60)
    run.started = True
    radii = np.linspace(0, 3e-3, 31)
    newest = run.snapshots_since(59)[0]
    rings = replace(newest.rings, radius_m=radii, ux_m=4e-3 * radii, sd_m=0 * radii)
    reading = replace(read(run, 0), snapshots=(replace(newest, rings=rings),))
    time_s, *values = resolve(setup_of(run), reading, None).curves.sliding[-1]
    assert time_s == newest.conditions.time_s
    a_um = run.radius_m * 1e6
    np.testing.assert_allclose(values, [4e-3 * share * a_um for share in RADII], rtol=1e-9)


def test_the_noise_of_u_x_is_that_of_the_images(run: ScriptedRun) -> None:
    # the scripted fields have 0.033 px of noise on a smooth displacement
    noise_px = look(run.at(REFERENCE + 12)).curves.noise[:, 1]
    assert len(noise_px) == 12
    assert noise_px.mean() == pytest.approx(0.033, rel=0.15)


def test_a_last_frame_that_was_not_analysed_takes_nothing_of_the_frame_before(
    run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    *measured, last = run._snapshots[:150]
    bare = Snapshot(last.frame, last.sample, last.conditions)
    monkeypatch.setattr(run, "_snapshots", [*measured, bare])
    monkeypatch.setattr(run, "frames", 150)
    view = look(run.at(150))
    assert view.outcome is not None
    assert view.readouts[-1].value == number(measured[-1].stick_radius[0] * 1e3, 2)
    assert view.readouts[3].value == number(last.conditions.travel_m * 1e6, 1)
    assert all(
        len(line.x) for key in ("traction", "displacement") for line in view.charts[key].lines
    )
    assert view.circles.stick_px > 0


def test_the_charts_stand_beside_theory_and_limits(run: ScriptedRun) -> None:
    charts = look(run.at(330)).charts
    model = next(line for line in charts["sticking"].lines if "Mindlin" in line.name)
    np.testing.assert_allclose(model.y, np.cbrt(1 - model.x), atol=1e-12)
    fitted = next(line for line in charts["sticking"].lines if line.sd is not None)
    mu = look(run).outcome.summary.mu_s
    aH_mm = 1e3 * np.cbrt(0.75 * P * 128.8e-3 * 0.75 / 3.43e6)
    np.testing.assert_allclose(
        fitted.y * aH_mm, run.radius_m * 1e3 * np.cbrt(1 - fitted.x * mu / MU), rtol=1e-9
    )
    normal, shear = (charts["forces"].lines[k] for k in (0, 1))
    assert (normal.name, normal.columns) == ("P", ("time_s", "P_N"))
    assert (shear.name, shear.columns) == ("Q", ("time_s", "Q_N"))
    assert normal.y[-1] == pytest.approx(P, abs=2e-3)
    assert shear.y[-1] == pytest.approx(MU * P, abs=2e-3)
    np.testing.assert_allclose(np.diff(normal.x), 0.05)
    assert shear.x[-1] == pytest.approx((330 - REFERENCE) * PERIOD / 1000, abs=0.06)
    limits = {guide.text: guide.value for guide in charts["forces"].guides}
    assert limits["limit of P and Q"] == 1.9
    assert limits["tₛ"] == 20.43
    (band,) = charts["forces"].spans
    assert (band.low, band.high) == pytest.approx((0.49, 0.51))


def test_a_chart_is_made_once_it_is_asked_for_and_ready_while_it_is_in_view(
    run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, made = run_charts._sticking, list[str]()

    def noted(*args: object) -> Chart:
        made.append("sticking")
        return make(*args)

    monkeypatch.setattr(run_charts, "_sticking", noted)
    view = look(run.at(200))
    assert made == []
    assert view.charts["sticking"] is view.charts["sticking"]
    assert made == ["sticking"]
    later = look(run.at(201), view)
    assert made == ["sticking"] * 2
    assert len(later.charts["sticking"].lines[1].x) > 0
    assert made == ["sticking"] * 2
    for frame in range(202, 202 + run_charts.LATELY):
        later = look(run.at(frame), later)
    assert made == ["sticking"] * (2 + run_charts.LATELY)
    look(run.at(220), later)  # nobody has asked for its chart since
    assert made == ["sticking"] * (2 + run_charts.LATELY)


def test_c_is_over_the_hertz_radius_of_the_load_of_its_own_frame(run: ScriptedRun) -> None:
    """Frames under loads that fall, in which Q/P comes in no order."""
    loads, ratio = np.array([1.0, 0.5, 0.25, 0.125]), np.array([0.4, 0.1, 0.6, 0.2])
    c_mm = np.array([0.4, 0.3, 0.2, 0.1])
    Q = ratio * loads
    sticking = np.column_stack([Q, c_mm, 0.1 * c_mm, loads])
    peaks = np.column_stack([Q, c_mm, loads])
    lines = charts_of(run, sticking=sticking, peaks=peaks)["sticking"].lines
    hertz_mm = 1e3 * HERTZ_M * np.cbrt(loads / P)
    for name in ("fitted profile", "largest σ"):
        (line,) = (one for one in lines if one.name == name)
        places = np.interp(line.x, np.sort(ratio), (c_mm / hertz_mm)[np.argsort(ratio)])
        np.testing.assert_allclose(line.y, places, rtol=1e-3)
        if line.sd is not None:
            np.testing.assert_allclose(line.sd, 0.1 * line.y)


def test_u_x_in_time_is_named_by_its_radius(run: ScriptedRun) -> None:
    sliding = np.column_stack([np.arange(3.0), *(np.full(3, share) for share in RADII)])
    chart = charts_of(run, sliding=sliding)["sliding"]
    drawn = {line.name: float(line.y[0]) for line in chart.lines}
    assert drawn == {"r = 0": 0.0, "a/2": 0.5, "3a/4": 0.75, "a": 1.0}


def test_the_sentence_says_what_to_do(run: ScriptedRun) -> None:
    assert "Press the contact to P = 0.500 N; now 0.000 N" in look(run.at(9)).sentence
    assert "reference image" in look(run.at(22)).sentence
    assert "81.8" not in look(run.at(160)).sentence
    assert "82 of 190 µm" in look(run.at(160)).sentence


def test_the_end_shows_the_result_and_why(run: ScriptedRun) -> None:
    view = look(run.at(330))
    assert (view.state, view.tone, view.phase, view.ended) == ("done", Tone.GOOD, "end", True)
    assert view.sentence == "The drive of 190 µm is complete"
    shown = {row.symbol: (row.value, row.noise) for row in view.card.rows}
    assert [shown[symbol] for symbol in ("a", "Q_s", "mu_s", "mu_d", "t_s")] == [
        ("0.450", "0.030"),
        ("0.4638", "0.0010"),
        ("0.9276", "0.0021"),
        ("0.9301", "0.9260 to 0.9340"),
        ("20.43", "0.12"),
    ]


def test_a_run_that_ended_early_has_dashes_for_results(run: ScriptedRun) -> None:
    run.at(40).stop_motion()
    view = look(run)
    assert (view.card.verdict, view.card.rows) == ("stopped", ())
    assert view.sentence == "STOP MOTION was pressed"


@pytest.mark.parametrize(
    ("end", "reason", "shown", "tone"),
    [
        (End.COMPLETE, "the drive of 190 um is complete", "done", Tone.GOOD),
        (End.STOPPED, "STOP MOTION was pressed", "stopped", Tone.WARN),
        (End.FAILED, "camera: trigger 5 had no answer", "failed", Tone.BAD),
    ],
)
def test_a_run_ends_done_stopped_or_failed(
    run: ScriptedRun, end: End, reason: str, shown: str, tone: Tone
) -> None:
    reading = read(run.at(165), 0)
    ended = replace(reading, outcome=Outcome(end, reason, Counts(), None))
    view = resolve(setup_of(run), ended, None)
    assert (view.state, view.tone, view.ended) == (shown, tone, True)
    assert view.progress == pytest.approx(0.5)  # of what was planned


def test_a_run_that_ends_between_two_looks_is_not_called_done_too_early(run: ScriptedRun) -> None:
    reading = read(run.at(40), 0)
    reading = replace(reading, health=replace(reading.health, state="done"))
    assert resolve(setup_of(run), reading, None).state == "stopping"


def test_losses_are_red(run: ScriptedRun) -> None:
    health = replace(run.health(), counts=Counts(frames_lost=2, samples=41250))
    cells = {cell.name: cell for cell in count_cells(health)}
    assert cells["frames lost"].tone is Tone.BAD
    assert cells["samples lost"].tone is Tone.NEUTRAL
    assert cells["samples"].value == "41\u202f250"


@pytest.mark.parametrize(("fill", "tone"), [(0.1, Tone.GOOD), (0.6, Tone.WARN), (0.9, Tone.BAD)])
def test_a_filling_queue_changes_colour(run: ScriptedRun, fill: float, tone: Tone) -> None:
    cell = queue_cell(replace(run.health(), queue_fill=fill))
    assert (cell.tone, cell.value) == (tone, f"{4 * fill:.1f} of 4.0")
    reading = read(run.at(50), 0)
    sentence = resolve(
        setup_of(run), replace(reading, health=replace(reading.health, queue_fill=fill)), None
    ).sentence
    assert (f"{4 * fill:.1f} of 4.0 s of data wait" in sentence) is (tone is not Tone.GOOD)


@pytest.mark.parametrize(
    ("skipped", "detail", "tone"),
    [(0, "", Tone.NEUTRAL), (20, "20%", Tone.NEUTRAL), (60, "60%", Tone.WARN)],
)
def test_an_analysis_that_lags_changes_colour(
    run: ScriptedRun, skipped: int, detail: str, tone: Tone
) -> None:
    counts = Counts(frames_received=100, frames_skipped=skipped)
    found = count_cells(replace(run.health(), counts=counts))
    (cell,) = (one for one in found if one.name == "skipped live")
    assert (cell.detail, cell.tone) == (detail, tone)


def test_an_unknown_phase_does_not_upset_the_window(run: ScriptedRun) -> None:
    reading = read(run.at(50), 0)
    view = resolve(setup_of(run), replace(reading, health=replace(reading.health, phase="")), None)
    assert view.sentence == ""
    assert str(Phase.DRIVE) not in view.phase


def test_numbers_are_typeset() -> None:
    assert number(-1.25, 1) == "−1.2"
    assert number(math.nan, 1) == "–"
    assert grouped(1234567) == "1\u202f234\u202f567"


@pytest.mark.parametrize(
    ("free_bytes", "text", "tone"),
    [
        (182_000_000_000, "182 GB", Tone.NEUTRAL),
        (1_500_000_000_000, "1.5 TB", Tone.NEUTRAL),
        (1_500_000_000, "1.5 GB", Tone.WARN),
        (40_000_000, "40 MB", Tone.BAD),
        (-1, "–", Tone.NEUTRAL),
    ],
)
def test_a_disk_with_room_for_few_images_changes_colour(
    run: ScriptedRun, free_bytes: int, text: str, tone: Tone
) -> None:
    cell = disk_cell(replace(run.health(), disk_free_bytes=free_bytes), run.config)
    assert (cell.value, cell.tone) == (text, tone)


@pytest.mark.parametrize(("pixel_format", "bytes_a_pixel"), [("Mono8", 1), ("Mono12", 2)])
def test_the_disk_is_judged_by_the_bytes_of_a_pixel(
    run: ScriptedRun, pixel_format: str, bytes_a_pixel: int
) -> None:
    camera = replace(run.config.camera, pixel_format=pixel_format)
    config = replace(run.config, camera=camera)
    a_second = camera.width * camera.height * bytes_a_pixel * config.frame_rate_hz
    for seconds, tone in ((610, Tone.NEUTRAL), (590, Tone.WARN), (59, Tone.BAD)):
        health = replace(run.health(), disk_free_bytes=int(seconds * a_second))
        assert disk_cell(health, config).tone is tone, seconds


def test_the_difference_is_to_the_image_that_the_correlation_uses(run: ScriptedRun) -> None:
    views = [None]
    for frame in range(REFERENCE - 4, REFERENCE + 10, 3):
        run.pressed = run.pressed.copy()  # another image with each look
        views.append(look(run.at(frame), views[-1]))
    assert views[-1].reference.full is run.reference
    assert views[-1].reference is views[-2].reference


def test_how_a_run_ended_is_told_with_proper_symbols(run: ScriptedRun) -> None:
    run.request_stop("the drive of 190 um is complete at mu_s = -0.5")
    view = look(run.at(60))
    assert view.sentence == "The drive of 190 µm is complete at μₛ = −0.5"
    assert "190 um" not in "".join(line.note for line in view.steps.lines)


def test_curves_of_a_long_run_stay_short_and_show_all_of_it(
    run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    def looked_at() -> Curves:
        curves = NO_CURVES
        for at in range(1, run.frames + 1):
            curves = extended(curves, tuple(run.at(at).snapshots_since(curves.seen)), setup_of(run))
        return curves

    whole = looked_at()
    monkeypatch.setattr(run_curves, "MOST_POINTS", 40)
    short = looked_at()
    assert (short.seen, whole.every) == (whole.seen, 1)
    assert short.every >= 4
    assert len(whole.loading) > 40 >= len(short.loading) > 15
    points = whole.loading[:, :2].tolist()  # the times before the drive are NaN
    assert all(point in points for point in short.loading[:, :2].tolist())
    step_um = 1.5 * short.every * np.diff(whole.loading[:, 0]).max()
    travel_um = np.append(short.loading[:, 0], whole.loading[-1, 0])
    assert np.diff(travel_um).max() <= step_um  # no part of the run is thinner than the others
