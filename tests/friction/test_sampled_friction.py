"""Friction in sliding, and its peak after a hold, from the samples of the sensors, on drives whose
truth is known.
"""

import numpy as np
import pytest

from analysis.friction.ageing import slide_friction
from analysis.friction.onset import sliding_onset
from analysis.friction.ratio import forces_around, sample_ratios, sliding_ratio
from app.evaluation.budget import Measured
from app.evaluation.history import DriveForces
from app.evaluation.slides import slide_results
from app.records.record_types import Conditions, Phase, Snapshot
from app.settings.config import load
from benchmarks.onset import MU, NOISE_N, PEAK, L, found, loaded, rise, sliding_friction

P, SPEED = 0.5, 4.85e-6


def dynamic(world, rate_hz, runs, *, has_samples=True):
    """Error of mu_d of some drives, and their onsets."""
    case = P, rate_hz, SPEED
    onsets = [found(world, *case, seed, has_samples=has_samples) for seed in range(runs)]
    true = [sliding_friction(world, *case, seed) for seed in range(runs)]
    return np.subtract([o.mu_d for o in onsets], true), onsets


@pytest.mark.parametrize(("normal", "most"), [(0.1, 0.5e-3), (0.5, 1.5e-3), (1.4, 4e-3)])
def test_friction_that_fluctuates_in_sliding_leaves_q_s_as_certain_as_it_is(normal, most):
    onsets = [found("stick-slip", normal, 5.0, SPEED, seed, has_samples=True) for seed in range(80)]
    error = np.array([one.static_force for one in onsets]) - loaded(normal).static_n
    stated = np.array([one.static_force_sd for one in onsets])
    assert 0.6 < np.mean(np.abs(error) < stated) < 0.86
    assert np.median(stated) < most


@pytest.mark.parametrize(
    ("world", "by_samples", "by_frames"), [("hum", 0.1e-3, 0.8e-3), ("stick-slip", 0.3e-3, 5e-3)]
)
def test_what_comes_and_goes_between_frames_is_in_mu_d(world, by_samples, by_frames):
    assert np.sqrt(np.mean(dynamic(world, 1.0, 30)[0] ** 2)) < by_samples
    error, _ = dynamic(world, 1.0, 30, has_samples=False)
    assert np.sqrt(np.mean(error**2)) > by_frames


def test_the_range_of_sliding_holds_a_peak_between_two_frames_and_no_hum():
    _, onsets = dynamic("drop", 1.0, 8)
    assert min(one.mu_d_range[1] for one in onsets) > 0.965 * MU
    _, onsets = dynamic("drop", 1.0, 8, has_samples=False)
    assert min(one.mu_d_range[1] for one in onsets) < 0.93 * MU
    # 1 mN of hum would be 2.8e-3 of P both ways
    widths = [np.ptp([one.mu_d_range for one in dynamic(w, 1.0, 4)[1]]) for w in ("plain", "hum")]
    assert widths[1] == pytest.approx(widths[0], abs=0.5e-3)


@pytest.mark.parametrize("speed", [1e-6, SPEED, 20e-6])
@pytest.mark.parametrize("decay", [1e-6, 3e-6])
def test_the_peak_after_a_hold_does_not_depend_on_how_many_frames_there_are(speed, decay):
    case = "plain", decay, 2.0 * speed / SPEED, speed
    error, sd = np.array([rise(*case, seed, has_samples=True) for seed in range(30)]).T
    assert abs(error.mean()) < sd.mean()
    assert 0.5 < np.mean(np.abs(error) < sd) < 0.92
    assert sd.mean() < 1e-3
    frames = [rise(*case, seed, has_samples=False)[0] for seed in range(5)]
    # some have too few frames for a peak at all
    assert not np.nanmean(frames) > -0.25 * MU * PEAK


def test_the_peak_is_as_uncertain_as_errors_that_last_make_it():
    rng, x, found = np.random.default_rng(2), np.arange(400), []
    shape = 0.7 + 0.05 * np.exp(-((x - 60) ** 2) / 800)
    for _ in range(80):
        errors = np.convolve(rng.normal(size=430), np.ones(30) / 30**0.5, "valid")[:400]
        found.append(slide_friction(shape + 1e-3 * errors, 10))
    scatter = np.std([one.peak for one in found])
    assert scatter == pytest.approx(np.mean([one.peak_sd for one in found]), rel=0.35)
    assert scatter > 0.7e-3


def test_the_rise_is_as_uncertain_as_the_friction_before_it():
    error, sd = np.array([rise("slow", 3e-6, 5.0, SPEED, s, has_samples=True) for s in range(60)]).T
    assert 0.55 < np.mean(np.abs(error) < sd) < 0.85


def test_ratios_are_those_of_mean_forces_and_of_blocks_that_are_known():
    t = np.arange(4000) / 1000
    q, p = np.full(4000, 8e-3), 0.01 + 4e-3 * np.random.default_rng(1).normal(size=4000)
    ratios = sample_ratios((t, q, p), 1.0, 3.0, 0.5)
    assert ratios == pytest.approx(0.8, rel=0.06)  # the mean of q/p would be far more
    p = np.full(4000, 0.01)
    q[1500:1760], q[1810:1820] = np.nan, np.nan
    known = sample_ratios((t, q, p), 1.0, 3.0, 0.1)
    assert np.flatnonzero(np.isnan(known)).tolist() == [5, 6, 7]
    assert known[[4, 8]] == pytest.approx(0.8)
    q[1500:2100] = np.nan  # 30 % of the time
    assert not len(sample_ratios((t, q, p), 1.0, 3.0, 0.1))
    assert not len(sample_ratios((t, q, p), 3.0, 6.0, 0.1))  # most comes after the last sample
    assert not len(sample_ratios((t[::200], q[::200], p[::200]), 1.0, 3.0, 0.1))
    assert not len(sample_ratios(([], [], []), 1.0, 3.0))


@pytest.mark.parametrize(("exposure_s", "window_s"), [(0.011, 0.02), (0.02, 0.02), (0.033, 0.04)])
def test_forces_around_a_frame_are_free_of_hum_and_hold_its_exposure(exposure_s, window_s):
    t = np.arange(4000) / 1000
    q, p = 0.02 * t + 0.3 * t**2, 0.5 - 0.01 * t
    hum = 5e-3 * np.sin(2 * np.pi * 50 * t + 0.7)
    at = 0.3 + 0.2 * np.arange(10) + exposure_s / 2  # one phase
    Q, P = forces_around((t, q + hum, p - hum), at, exposure_s)
    # an exposure begins on a sample, whose reading is that of its begin
    middle = at - 0.5e-3
    bent = 0.3 * window_s**2 / 12
    np.testing.assert_allclose(Q, 0.02 * middle + 0.3 * middle**2 + bent, atol=1e-6)
    np.testing.assert_allclose(P, 0.5 - 0.01 * middle, atol=1e-6)


def test_forces_around_are_none_where_samples_are_missing_or_far_apart():
    t, at = np.arange(4000) / 1000, np.array([0.005, 1.0, 2.0, 2.5, 3.995, np.nan])
    q = np.ones(4000)
    q[1998:2004], q[2498:2502] = np.nan, np.nan  # 30 and 20 % of a window
    assert np.isfinite(forces_around((t, q, q), at)[0]).tolist() == [
        False, True, False, True, False, False,
    ]  # fmt: skip
    assert not np.isfinite(forces_around((t[::20], q[::20], q[::20]), at)).any()
    assert not np.isfinite(forces_around(([], [], []), at)).any()


def test_a_mean_is_over_what_is_known_and_scatters_as_the_steady_part_does():
    ratios = np.append(np.linspace(0.5, 0.7, 20), 0.7 + 1e-3 * np.tile([1.0, -1.0], 50))
    ratios[40] = np.nan
    seen = sliding_ratio(ratios, steady=20)
    assert seen.mean == pytest.approx(np.nanmean(ratios))
    assert seen.sd < 2e-4 < sliding_ratio(ratios).sd
    assert (seen.least, seen.greatest) == (0.5, 0.701)


def test_a_slide_of_few_values_has_a_peak_without_doubt_or_failure():
    assert slide_friction(np.full(14, 0.7)).peak_sd == pytest.approx(0.0, abs=1e-12)


def test_few_blocks_leave_the_uncertainty_of_their_mean_as_large_as_it_is():
    rng = np.random.default_rng(4)
    for count, joined, least in ((20, 10, 0.4), (30, 10, 0.5), (42, 4, 0.6)):
        errors = 1e-3 * rng.normal(size=(500, count))
        seen = [sliding_ratio(0.7 + one, joined) for one in errors]
        off = np.array([abs(one.mean - 0.7) / one.sd for one in seen])
        assert np.mean(off > 3) < 0.03
        size = np.array([one.sd for one in seen]) / (1e-3 / count**0.5)
        assert least < size.min()
        assert size.max() < 2.5
    assert np.isnan(sliding_ratio(np.array([0.7, 0.71])).sd)


@pytest.mark.parametrize("slid_s", [0.026, 0.05, 0.4])
def test_sliding_of_a_few_blocks_is_told_by_frames(slid_s):
    rng, t = np.random.default_rng(5), np.arange(0, 1 + slid_s, 1e-4)
    q = 0.7 * P * np.minimum(t, 1) + NOISE_N * rng.normal(size=len(t))
    at = slice(5, None, 10)
    u = 100e-6 * np.maximum(t[at] - 1, 0) + 1e-9 * rng.normal(size=len(t[at]))
    onset = sliding_onset(t[at], u, q[at], P, samples=(t, q, np.full(len(t), P)))
    assert ("mu_d from frames" in onset.notes[0]) == (slid_s < 0.1)
    assert "mu_d from" in onset.notes[0]
    assert onset.mu_d == pytest.approx(0.7, abs=4 * onset.mu_d_sd)
    assert onset.mu_d_sd > 0.5 * NOISE_N / P / (t >= 1).sum() ** 0.5


@pytest.mark.parametrize("side", [1, -1])
def test_all_peaks_of_a_run_are_measured_in_one_way(side):
    """The samples of the last slide come after those that are kept."""
    moves, hold = "{do='drive', travel=40, velocity=5}", "{do='hold', time=2}"
    steps = f"{{do='approach'}}, {{do='reference'}}, {moves}, {hold}, {moves}, {hold}, {moves}"
    config, shots = load(None, [f"run.steps=[{steps}]"]), []
    t = np.arange(28_000) / 1000
    q = side * 0.7 * P * (1 + 0.05 * np.exp(-(((t % 10 - 0.5) / 0.1) ** 2)))
    for i in np.arange(100, 28_000, 200).tolist():
        n, since = divmod(t[i], 10)
        step, since = 3 + 2 * int(n) + (since >= 8), since % 8
        way = side * (40e-6 * n + 5e-6 * min(t[i] % 10, 8))
        now = Conditions(Phase.DRIVE, t[i], P, q[i], way, step, since)
        shots.append(Snapshot(len(shots), i, now))
    forces, notes = DriveForces(t, q, np.full(len(t), P)), []
    by_frames = slide_results(Measured(config, shots, None), notes, MU * L)
    whole = slide_results(Measured(config, shots, None, forces=forces), notes, MU * L)
    assert "slides: " not in str(notes)
    assert min(whole["slide_peak"]) > max(by_frames["slide_peak"]) + 1e-3
    kept = DriveForces(*(column[:19_000] for column in forces))
    found = slide_results(Measured(config, shots, None, forces=kept), notes, MU * L)
    for name in ("slide_peak", "slide_peak_sd", "slide_mu_d", "slide_mu_d_sd"):
        assert found[name] == by_frames[name]
    assert "because samples of step 7 are missing" in str(notes)
