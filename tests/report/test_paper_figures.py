"""The data of the figures against closed forms of the contact that the results describe."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import closed_form as exact
import numpy as np
import pytest
from matplotlib.colors import to_hex

from analysis.friction.joint import stiffness_length
from app.records.study_results import RunResult, StudyResults
from app.report.findings import findings, stiffness_at
from app.report.paper.collection import draw
from app.report.paper.runs import FigureRun, experiments
from app.report.paper.style import NotDrawn

SOFTER = 3.0e6  # a block that is softer than the settings say


@pytest.fixture(scope="module")
def softer() -> StudyResults:
    return exact.campaign(SOFTER)


def of_load(table: dict[str, Any], P: float) -> dict[str, np.ndarray]:
    rows = np.asarray(table["P_N"]) == P
    return {name: np.asarray(values)[rows] for name, values in table.items()}


def test_loads_are_coloured_from_cyan_to_pink(results: StudyResults) -> None:
    runs = experiments(results)
    assert [run.P for run in runs] == list(exact.LOADS)
    assert [to_hex(run.colour) for run in runs] == ["#00ffff", "#807fff", "#ff00ff"]


def test_fig_5_is_the_stage_against_cantilever_lens_and_contact(results: StudyResults) -> None:
    drawn = draw("5", results)
    table = drawn.tables[""]
    for P in exact.LOADS:
        curve = of_load(table, P)
        Q, delta = curve["Q_N"], curve["delta_um"] * 1e-6
        a, G = exact.hertz_radius(P, exact.STATED_E), exact.STATED_E / 3
        shift = 3 * exact.MU * P * 1.5 / (16 * G * a)
        loading = Q < 0.999 * exact.MU * P
        expected = shift * (1 - (1 - Q / (exact.MU * P)) ** (2 / 3)) + Q * (
            1 / exact.K_T + exact.COMPLIANCE
        )
        np.testing.assert_allclose(delta[loading], expected[loading], rtol=1e-4)
    numbered = np.asarray(table["instant"])
    # nearest to 0.5 N, by ratio
    assert set(np.asarray(table["P_N"])[numbered > 0]) == {0.7}
    assert sorted(numbered[numbered > 0]) == [1, 2, 3, 4, 5, 6]
    disks = [line.get_data() for line in drawn.figure.axes[0].lines if line.get_marker() == "o"]
    rows = np.argsort(numbered)[-6:]
    np.testing.assert_allclose(np.ravel([x for x, _ in disks]), table["delta_um"][rows])
    np.testing.assert_allclose(np.ravel([y for _, y in disks]), table["Q_N"][rows])


def test_fig_3_is_hertz_and_the_arrows_sqrt_rh(results: StudyResults) -> None:
    table = draw("3", results).tables["b"]
    expected = [1e3 * exact.hertz_radius(P, exact.STATED_E) for P in exact.LOADS]
    np.testing.assert_allclose(table["a_H_mm"], expected, rtol=1e-9)
    np.testing.assert_allclose(table["sqrt_Rh_mm"], 1e3 * np.sqrt(exact.R * 0.595e-6), rtol=1e-9)
    np.testing.assert_allclose(table["a_mm"] - table["a_H_mm"], 0.277, rtol=1e-9)


def test_fig_7_has_four_radii_of_the_apparent_contact(results: StudyResults) -> None:
    drawn = draw("7", results)
    table, run = drawn.tables[""], experiments(results)[2]
    assert "in the paper 0.5 N" in drawn.caption
    assert f"slope {run.summary.sliding_velocity_m_s * 1e6:.3g} µm/s" in drawn.caption
    stuck = table["time_s"] < 0.9 * run.summary.onset_time_s
    assert np.abs(table["ux_0_um"][stuck]).max() == 0
    at = np.array([run.apparent_radius])
    for i in (20, 70):
        Q = table["Q_N"][i]
        c = run.hertz_radius * max(0.0, 1 - Q / (exact.MU * 0.7)) ** (1 / 3)
        D = float(run.series("block_m")[i])
        expected = D - exact.elastic(at, c, 0.7, exact.STATED_E)[0]
        assert table["ux_a_um"][i] == pytest.approx(1e6 * expected, abs=0.02)


def test_fig_8_has_the_extremes_of_q_over_p_for_bars(results: StudyResults) -> None:
    drawn = draw("8", results)
    table = drawn.tables[""]
    np.testing.assert_allclose(table["mu_d_least"], exact.MU - 0.006)
    bars = drawn.figure.axes[0].containers[0].lines[2][0].get_segments()
    np.testing.assert_allclose([np.ptp(bar[:, 1]) for bar in bars], 0.014)
    np.testing.assert_allclose([bar[:, 1].min() for bar in bars], table["mu_d_least"])
    np.testing.assert_allclose(table["Q_s_N"], 0.99 * exact.MU * np.array(exact.LOADS))
    np.testing.assert_allclose(table["mu_s_sd_inputs"], 0.004 * 0.99 * exact.MU)


def test_fig_9_sums_the_traction_by_the_modulus_of_the_run(softer: StudyResults) -> None:
    drawn = draw("9", softer)
    table = drawn.tables[""]
    np.testing.assert_allclose(table["Q_of_stress_N"], table["Q_N"], rtol=1e-12)
    np.testing.assert_allclose(table["Q_of_stress_sd_N"], 1e-4 * SOFTER / exact.STATED_E)
    np.testing.assert_allclose(drawn.tables["_inset"]["E_MPa"], 3.0)
    np.testing.assert_allclose(
        drawn.tables["_inset"]["E_sd_inputs_MPa"], 3 * np.hypot(0.0099, 0.004)
    )


def _without_stage(run: RunResult, velocity_m_s: float = 2e-6) -> RunResult:
    frames = run.frames.copy()
    frames["travel_m"] = np.nan
    summary = replace(run.summary, sliding_velocity_m_s=velocity_m_s)
    return replace(run, frames=frames, summary=summary)


def test_the_caption_names_the_runs_of_a_steady_drive(results: StudyResults) -> None:
    light, middle, heavy = results.runs
    mixed = (_without_stage(light), _without_stage(middle, np.nan), heavy)
    caption = draw("5", replace(results, runs=mixed)).caption
    named = (
        f"at {light.summary.normal_force_n:.2g} N: delta is v t, with the velocity v of sliding."
    )
    assert caption.endswith(f" Nothing read the stage {named}")


@pytest.mark.parametrize("name", ["5", "9", "dissipation"])
def test_without_readings_of_the_stage_the_drive_is_steady(
    name: str, results: StudyResults
) -> None:
    assumed = draw(name, replace(results, runs=tuple(map(_without_stage, results.runs))))
    table = assumed.tables["b" if name == "dissipation" else ""]
    shown = [run for run in results.runs if run.summary.normal_force_n in table["P_N"]]
    assert shown
    for run in shown:
        curve = of_load(table, run.summary.normal_force_n)
        time_s = run.frames["time_s"][-len(curve["delta_um"]) :]
        np.testing.assert_allclose(curve["delta_um"], 2 * time_s)
    assert assumed.caption.endswith("delta is v t, with the velocity v of sliding.")
    assert "v t" not in draw(name, results).caption


def test_fig_4d_has_the_direct_method_beside_the_one_that_was_used(results: StudyResults) -> None:
    drawn = draw("4d", results)
    assert of_load(drawn.tables[""], 0.1)["direct_px"].tolist() == [0.020, 0.009, 0.004]
    lines = {str(line.get_label()): line for line in drawn.figure.axes[0].lines}
    assert list(lines["direct method, 0.1 N"].get_ydata()) == [0.020, 0.009, 0.004]
    assert "Dash-dotted: the direct method" in drawn.caption


def _by_the_direct_method(run: RunResult) -> RunResult:
    settings = run.origin.config_toml.replace('method = "shared"', 'method = "direct"')
    assert settings != run.origin.config_toml
    return replace(run, origin=replace(run.origin, config_toml=settings))


def _of_older_results(run: RunResult) -> RunResult:
    return replace(run, noise=replace(run.noise, direct_px=np.full(3, np.nan)))


@pytest.mark.parametrize("changed", [_by_the_direct_method, _of_older_results])
def test_the_caption_of_fig_4d_names_the_lines_that_are_drawn(
    changed: Callable[[RunResult], RunResult], results: StudyResults
) -> None:
    drawn = draw("4d", replace(results, runs=tuple(map(changed, results.runs))))
    assert not any("direct" in str(line.get_label()) for line in drawn.figure.axes[0].lines)
    assert "direct" not in drawn.caption
    assert "can have. Star: the paper" in drawn.caption


def brute_box_mean(profile: Any, r: float, side: float) -> float:
    """Mean over a square about points of a circle, by many midpoints."""
    offset = side * ((np.arange(60) + 0.5) / 60 - 0.5)
    angle = 2 * np.pi * (np.arange(24) + 0.5) / 24
    x = r * np.cos(angle)[:, None, None] + offset[:, None]
    y = r * np.sin(angle)[:, None, None] + offset
    return float(profile(np.hypot(x, y)).mean())


def test_fig_11_is_johnson_smoothed_by_the_box(results: StudyResults, softer: StudyResults) -> None:
    for found, E in ((results, exact.STATED_E), (softer, SOFTER)):
        table = draw("11", found).tables[""]
        for P in exact.LOADS:
            curve = of_load(table, P)
            stated = exact.hertz_radius(P, exact.STATED_E)
            r = curve["r_mm"] * 1e-3
            np.testing.assert_allclose(curve["r_over_a_H"], r / stated)
            expected = exact.elastic(r, 0, P, E) / (exact.MU * stated**2)
            np.testing.assert_allclose(curve["ux_over_mu_aH2_per_m"], expected, rtol=1e-9)
            for i in (0, 15, 30):
                smooth = brute_box_mean(
                    lambda at, P=P: exact.elastic(at, 0, P, exact.STATED_E),
                    r[i],
                    0.6 * 20 * 7.04e-6,
                )
                here = curve["johnson_over_mu_aH2_per_m"][i] * exact.MU * stated**2
                assert here == pytest.approx(smooth, rel=2e-4)


def test_fig_12_compares_with_the_model_without_adjusting_it(results: StudyResults) -> None:
    drawn = draw("12", results)
    table = drawn.tables["a"]
    # the model is that of Q smoothed over the frames: 7 nm, next to Q_s
    np.testing.assert_allclose(table["ux_over_a_H"], table["ux_CM_over_a_H"], atol=5e-6)
    times = np.unique(table["time_s"])
    assert np.abs(np.diff(times) - 1).max() < 0.35  # a frame every second, as near as they come
    off = drawn.tables["b"]
    assert list(off) == [
        "time_s",
        "Q_N",
        "dux_0_um",
        "dux_0.5a_H_um",
        "dux_a_H_um",
        "dux_1.5a_H_um",
    ]
    for name in list(off)[2:]:
        assert np.nanmax(np.abs(off[name])) < 0.12  # by the straight lines between rings


def test_noise_of_q_does_not_make_the_deviations_of_fig_12_jump(results: StudyResults) -> None:
    """1 mN, of ten samples: the model, which is steep near mu P, took it over by 0.3 to 0.6 um."""
    noisy = []
    for seed, run in enumerate(results.runs):
        frames, rng = run.frames.copy(), np.random.default_rng(seed)
        frames["shear_force_n"] += 1e-3 * rng.standard_normal(len(frames))
        noisy.append(replace(run, frames=frames))
    off = draw("12", replace(results, runs=tuple(noisy))).tables["b"]
    climbs = off["Q_N"] < 0.97 * exact.MU * 0.3
    assert climbs.sum() > 40
    for name in ("dux_0.5a_H_um", "dux_a_H_um", "dux_1.5a_H_um"):
        assert np.abs(np.diff(off[name][climbs])).max() < 0.1


def test_fig_12_shows_what_a_softer_block_does(softer: StudyResults) -> None:
    off = draw("12", softer).tables["b"]
    i, P = 30, 0.3
    Q, a = off["Q_N"][i], exact.hertz_radius(P, SOFTER)
    part = 1 - Q / (exact.MU * P)
    shift = 3 * exact.MU * P * 1.5 / (16 * SOFTER / 3 * a) * (1 - part ** (2 / 3))
    stated = exact.hertz_radius(P, exact.STATED_E)
    at = np.array([1.5 * stated])
    measured = shift - exact.elastic(at, a * part ** (1 / 3), P, SOFTER)
    model = 3 * exact.MU * P * 1.5 / (16 * exact.STATED_E / 3 * stated) * (1 - part ** (2 / 3))
    model -= exact.elastic(at, stated * part ** (1 / 3), P, exact.STATED_E)
    assert off["dux_1.5a_H_um"][i] == pytest.approx(1e6 * (measured - model)[0], abs=0.02)


def test_fig_13_is_the_traction_by_the_modulus_of_the_run(softer: StudyResults) -> None:
    drawn = draw("13", softer)
    assert "P = 0.3 N (in the paper 0.2 N) and P = 0.7 N" in drawn.caption
    for letter, P in (("a", 0.3), ("b", 0.7)):
        table = drawn.tables[letter]
        a = exact.hertz_radius(P, SOFTER)
        for time in np.unique(table["time_s"])[[3, 6]]:
            rows = table["time_s"] == time
            r, Q = table["r_mm"][rows] * 1e-3, table["Q_N"][rows][0]
            c = a * (1 - Q / (exact.MU * P)) ** (1 / 3)
            expected = exact.traction(r, c, P, SOFTER)
            np.testing.assert_allclose(table["sigma_kPa"][rows], 1e-3 * expected, atol=1e-3)
            smooth = [
                brute_box_mean(lambda at, c=c, P=P: exact.traction(at, c, P, SOFTER), one, 84.48e-6)
                for one in r[:6]
            ]
            np.testing.assert_allclose(table["sigma_CM_kPa"][rows][:6] * 1e3, smooth, rtol=2e-3)
    over = drawn.tables["d"]
    np.testing.assert_allclose(over["sigma_0_kPa"], over["sigma_CM_0_kPa"], rtol=0.02, atol=0.05)
    run = next(run for run in experiments(softer) if run.P == 0.7)
    half = np.array([0.5 * run.summary.apparent_radius_m])
    sticks = 1 - over["Q_N"] / (exact.MU * 0.7)
    a = exact.hertz_radius(0.7, SOFTER)
    expected = [exact.traction(half, a * max(s, 0) ** (1 / 3), 0.7, SOFTER)[0] for s in sticks]
    np.testing.assert_allclose(over["sigma_0.5a_kPa"], 1e-3 * np.array(expected), rtol=0.03)


def test_fig_7_of_no_drive_says_so(results: StudyResults) -> None:
    still = [replace(run, frames=run.frames[:1]) for run in results.runs]
    with pytest.raises(NotDrawn, match="no run was driven"):
        draw("7", replace(results, runs=tuple(still)))


def test_fig_14_has_the_radius_of_each_frame_beside_the_equation(results: StudyResults) -> None:
    table = draw("14", results).tables[""]
    for P in (0.3, 0.7):
        curve = of_load(table, P)
        expected = 1e3 * exact.hertz_radius(P, exact.STATED_E) * (
            1 - curve["Q_N"] / (exact.MU * P)
        ) ** (1 / 3)  # fmt: skip
        np.testing.assert_allclose(curve["c_CM_mm"], expected, rtol=1e-9)
        np.testing.assert_allclose(curve["c_mm"], expected, rtol=1e-6)
        run = next(run for run in experiments(results) if run.P == P)
        known = run.loading & np.isfinite(run.series("peak_radius_m"))
        stated = 1e3 * run.series("peak_radius_sd_m")[known]
        np.testing.assert_allclose(curve["c_sd_mm"], stated, rtol=1e-9)


def test_fig_15_is_the_law_at_radii_every_70_um(results: StudyResults) -> None:
    tables = draw("15", results).tables
    radii = np.unique(tables["b"]["r_mm"])
    np.testing.assert_allclose(np.diff(radii), 0.07)
    last = 1e3 * (exact.hertz_radius(0.7, exact.STATED_E) - np.sqrt(exact.R * 0.595e-6))
    assert last - 0.07 <= radii[-1] < last
    alpha, ratio = tables["b"]["s_over_muL"], tables["b"]["sigma_over_mu_p"]
    told = np.isfinite(alpha)
    assert told.sum() > 1000
    np.testing.assert_allclose(ratio[told], 1 - np.exp(-alpha[told]), atol=1e-3)
    sliding = tables["a"]["time_s"] > tables["a"]["time_s"].max() - 1
    np.testing.assert_allclose(tables["a"]["sigma_over_p"][sliding], exact.MU, rtol=2e-3)


def test_the_work_of_the_traction_is_that_of_the_forces(softer: StudyResults) -> None:
    """And, once all slides, mu P times the way."""
    drawn = draw("dissipation", softer)
    for P in exact.LOADS:
        curve = of_load(drawn.tables["b"], P)
        whole = curve["work_of_traction_uJ"][-1]
        off = curve["work_of_traction_uJ"] - curve["work_of_forces_uJ"]
        assert np.abs(off).max() < 0.01 * whole
        way = np.diff(curve["delta_um"])[-1]
        assert np.diff(curve["work_of_traction_uJ"])[-1] == pytest.approx(
            exact.MU * P * way, rel=0.01
        )
    profile = of_load(drawn.tables["a"], 0.7)
    assert profile["work_J_per_m2"][0] < 0.02 * profile["work_J_per_m2"].max()  # it sticks there


def test_the_stiffness_is_the_pressure_over_the_length(results: StudyResults) -> None:
    table = draw("stiffness", results).tables[""]
    good = table["p_kPa"] > 0
    np.testing.assert_allclose(
        table["k_GPa_per_m"][good], table["p_kPa"][good] * 1e-6 / exact.LENGTH
    )


def test_the_noise_of_a_box_is_stated_where_boxes_as_large_and_as_small_were_measured() -> None:
    run_of, found = exact.run_of(0.1), {}  # its noise was measured at 10, 20 and 40 px
    for box in (8, 10, 20, 40, 50):
        run = FigureRun(run_of, None)
        vars(run)["config"] = SimpleNamespace(dic=SimpleNamespace(box=box))
        found[box] = run.noise_px
    expected = dict(zip(found, [math.nan, 0.012, 0.006, 0.003, math.nan], strict=True))
    assert found == pytest.approx(expected, nan_ok=True)


def test_the_stiffness_at_a_pressure_is_that_of_the_rings_that_know_it() -> None:
    """All rings count, each by its uncertainty and that of the pressure, and neighbours share their
    noise; by both is that of the result.
    """
    p, rng, pulls = np.linspace(5e3, 50e3, 20), np.random.default_rng(4), []
    sd, p_sd = np.append(5e4 * p[:-2], [60e9, 80e9]), 0.02 * p

    def noise() -> np.ndarray:
        return np.convolve(rng.normal(size=22), np.ones(3) / np.sqrt(3), "valid")

    for _ in range(100):
        held = SimpleNamespace(
            pressure_pa=p + p_sd * noise(),
            pressure_sd_pa=p_sd,
            interface_stiffness_pa_m=1e6 * p + sd * noise(),
            interface_stiffness_sd_pa_m=sd,
        )
        found, found_sd = stiffness_at(SimpleNamespace(summary=held), 25e3)  # type: ignore[arg-type]
        assert found_sd < 2e9
        pulls.append((found - 25e9) / found_sd)
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.25
    assert all(map(math.isnan, stiffness_length(p, p_sd, (), ())))  # of a run that failed there


def test_inputs_have_their_own_uncertainties(results: StudyResults) -> None:
    found, config = findings(results), experiments(results)[0].config
    inputs = {one.key: one for one in found.inputs}
    for k, name in enumerate(("normal", "shear")):
        one = inputs[f"stiffness_{name}_n_m"]
        assert one.value == config.forces.stiffness[k]
        assert one.systematic == config.forces.stiffness_uncertainty[k]
    joint, told = {one.key: one for one in found.joint}, config.uncertainty
    length = joint["bureau_length_m"]  # as the results have it, with what nu adds
    assert length.total == results.joint.roughness_length_sd_m > length.value * told.roughness
    excess = joint["sqrt_rh_m"]  # a square root halves what is relative
    assert excess.value == pytest.approx(np.sqrt(exact.R * 0.595e-6))
    assert excess.total / excess.value == pytest.approx(
        np.hypot(told.roughness, told.lens_radius) / 2
    )


def test_the_pressure_stands_beside_hertz(results: StudyResults) -> None:
    drawn = draw("pressure", results)
    table = drawn.tables[""]
    np.testing.assert_allclose(table["p_kPa"], table["p_hertz_kPa"], atol=1e-6)
    rough = of_load(table, 0.1)["p_greenwood_tripp_kPa"]
    assert 0.85 < rough[0] / of_load(table, 0.1)["p_hertz_kPa"][0] < 0.97


def test_the_band_of_a_pressure_is_its_uncertainty_to_both_sides(results: StudyResults) -> None:
    drawn = draw("pressure", results)
    for P, panel in zip(exact.LOADS, drawn.figure.axes, strict=False):
        curve = of_load(drawn.tables[""], P)
        x, y = panel.collections[0].get_paths()[0].vertices.T
        for r, p, sd in zip(curve["r_mm"], curve["p_kPa"], curve["p_sd_kPa"], strict=True):
            low, high = min(y[x == r]), max(y[x == r])
            assert (low, high) == pytest.approx((p - sd, p + sd))


def test_the_interface_stands_upright_about_the_centre_of_the_contact(
    results: StudyResults,
) -> None:
    """The first row of pixels is above, at negative y, which points down as in the camera."""
    drawn = draw("2", results)
    pictures = results.runs[-1].pictures
    x0, y0 = experiments(results)[0].contact.centre_px
    left, right, bottom, top = drawn.figure.axes[0].images[0].get_extent()
    pixel = pictures.pixel_m * 1e3
    rows, columns = pictures.reference.shape
    assert (left, top) == pytest.approx(((-0.5 - x0) * pixel, (-0.5 - y0) * pixel))
    assert (right - left, bottom - top) == pytest.approx((columns * pixel, rows * pixel))


def test_the_budget_names_input_and_result(results: StudyResults) -> None:
    drawn = draw("budget", results)
    table, axes = drawn.tables[""], drawn.figure.axes[0]
    rows = [label.get_text() for label in axes.get_yticklabels()]
    columns = [label.get_text() for label in axes.get_xticklabels()]
    told = {text.get_position(): text.get_text() for text in axes.texts}
    assert told[columns.index("pixel size"), rows.index("$L$")] == "+0.66"
    assert told[columns.index("shear force"), rows.index("$E$")] == "+0.40"
    assert told[columns.index("pixel size"), rows.index("$E$")] == "\N{MINUS SIGN}0.99"
    one = {(q, i): s for P, q, i, s in zip(*(table[k] for k in table), strict=True) if P == 0.3}
    assert one["law_length", "pixel size"] == 0.0066
    assert one["young_modulus", "shear force"] == 0.004
    assert len(one) == 8


def test_fields_keep_place_and_unit(results: StudyResults) -> None:
    for name, key, factor, values in (
        ("6a", "ux_um", 1e6, "ux_m"),
        ("6b", "uy_um", 1e6, "uy_m"),
        ("10", "sigma_kPa", 1e-3, "stress_pa"),
    ):
        table = draw(name, results).tables[""]
        instants = results.runs[0].instants  # of 0.7 N
        row = np.flatnonzero(
            (table["instant"] == 3)
            & np.isclose(table["x_mm"], 1e3 * instants.x_m[20])
            & np.isclose(table["y_mm"], 1e3 * instants.y_m[4])
        )
        assert table[key][row] == pytest.approx(factor * getattr(instants, values)[2, 4, 20])
