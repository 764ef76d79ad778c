"""Q_s from the samples of the sensors before t_s, on drives whose Q_s is known."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.friction.onset import SHARES_BEFORE, sliding_onset
from benchmarks.onset import found, loaded, sliding_friction

P, SPEED = 0.5, 4.85e-6
FRAMES = "a line through three frames"


def drives(world, rate_hz, runs, *, has_samples=True, normal=P, speed=SPEED):
    """The onsets of some drives, and the error of each Q_s in newtons."""
    onsets = [
        found(world, normal, rate_hz, speed, seed, has_samples=has_samples) for seed in range(runs)
    ]
    return onsets, np.array([one.static_force for one in onsets]) - loaded(normal).static_n


@pytest.mark.parametrize("speed", [SPEED, 30e-6])
@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 23.8])
def test_q_s_does_not_depend_on_how_many_frames_there_are(rate_hz, speed):
    if speed > SPEED and rate_hz == 1:
        rate_hz = 2.0
    onsets, error = drives("plain", rate_hz, 60, speed=speed)
    scatter = error.std() / np.sqrt(len(error))
    assert abs(error.mean()) < 0.03e-3 + 3 * scatter
    assert error.std() < (0.16e-3 if speed == SPEED else 0.4e-3)
    assert all(FRAMES not in one.notes[0] for one in onsets)


def test_between_frames_q_s_is_too_low_where_q_bends_and_says_by_how_much():
    onsets, error = drives("plain", 1.0, 60, has_samples=False)
    assert -2.6e-3 < error.mean() < -1.9e-3
    stated = np.array([one.static_force_sd for one in onsets])
    assert 0.7 < np.median(stated) / np.sqrt(np.mean(error**2)) < 1.4
    assert all(FRAMES in one.notes[0] for one in onsets)


@pytest.mark.parametrize("world", ["plain", "hum", "slow", "lost"])
@pytest.mark.parametrize("normal", [0.1, pytest.param(0.5, marks=pytest.mark.slow)])
def test_the_stated_uncertainties_are_the_scatter(world, normal):
    """Of Q_s, mu_s and mu_d."""
    onsets, error = drives(world, 5.0, 150, normal=normal)
    size = np.abs(error) / [one.static_force_sd for one in onsets]
    assert 0.6 < np.mean(size < 1) < 0.82
    assert np.mean(size < 2) > 0.9
    ratio = np.array([one.mu_s for one in onsets]) - loaded(normal).static_n / normal
    assert 0.6 < np.mean(np.abs(ratio) < [one.mu_s_sd for one in onsets]) < 0.82
    if world != "lost":
        true = [sliding_friction(world, normal, 5.0, SPEED, seed) for seed in range(150)]
        size = np.abs([one.mu_d - mu for one, mu in zip(onsets, true, strict=True)])
        size /= [one.mu_d_sd for one in onsets]
        assert 0.58 < np.mean(size < 1) < 0.86
        assert np.mean(size < 2) > 0.88


@pytest.mark.parametrize(("world", "most"), [("drop", 0.15e-3), ("stick-slip", 0.9e-3)])
def test_a_peak_of_q_at_the_onset_is_not_cut_off(world, most):
    onsets, error = drives(world, 1.0, 40)
    assert abs(error.mean()) < most
    assert np.mean(np.abs(error) < [2 * one.static_force_sd for one in onsets]) > 0.9
    assert abs(drives(world, 1.0, 40, has_samples=False)[1].mean()) > 6e-3


def measured(noise_m=1e-8):
    """Frames and samples of a drive whose Q rises on a line to t_s = 20 s, and on a parabola just
    before it.
    """
    rng, t = np.random.default_rng(2), np.arange(34_000) / 1000
    q = 0.4 - 4e-3 * np.maximum(20 - t, 0) - 3e-3 * np.clip(20 - t, 0, 1) ** 2
    q, p = q + 1e-3 * rng.normal(size=(2, t.size)) * [[1], [0]], P + 1e-3 * rng.normal(size=t.size)
    at = np.arange(125, 33_900, 125)
    u = SPEED * np.maximum(t[at] - 20, 0) + noise_m * rng.normal(size=at.size)
    return (t[at], u, q[0][at], p[at]), np.array([t, q[0], p])


def read(frames, samples, **options):
    return sliding_onset(*frames, settled=6e-6, samples=tuple(samples), **options)


def test_what_comes_after_the_onset_changes_neither_force():
    frames, samples = measured()
    whole, later = read(frames, samples), samples.copy()
    later[1:, later[0] > whole.time] *= 0.5
    other = read(frames, later)
    assert (other.static_force, other.mu_s) == (whole.static_force, whole.mu_s)
    assert whole.static_force == pytest.approx(0.4, abs=5e-4)
    assert other.static_force_sd > 5 * whole.static_force_sd  # t_s may be a little later


def test_the_uncertainty_of_the_onset_counts_as_much_as_q_changes_with_it():
    frames, samples = measured(noise_m=2e-6)
    onset = read(frames, samples, shared_sd=2e-6)
    assert onset.time_sd > 0.3
    assert onset.static_force_sd == pytest.approx(4e-3 * onset.time_sd, rel=0.5)
    assert onset.static_force_sd > 1e-3


@pytest.mark.parametrize(
    ("seconds", "is_from_samples"),
    [((19.5, 19.6), True), ((19.5, 19.9), False), ((20.1, 20.5), True), ((0.0, 34.0), False)],
)
def test_where_samples_are_missing_frames_tell_the_forces(seconds, is_from_samples):
    frames, samples = measured()
    samples[1:, (samples[0] >= seconds[0]) & (samples[0] < seconds[1])] = np.nan
    onset = read(frames, samples)
    assert (FRAMES not in onset.notes[0]) == is_from_samples
    assert onset.static_force == pytest.approx(0.4, abs=1e-3)
    if not is_from_samples:
        expected = sliding_onset(*frames, settled=6e-6)
        if seconds[1] < 34:  # what is lost before t_s is of no consequence for mu_d
            whole = read(frames, measured()[1])
            later = {name: getattr(whole, name) for name in ("mu_d", "mu_d_sd", "mu_d_range")}
            expected = replace(expected, **later, notes=onset.notes)
        assert onset == expected


@pytest.mark.parametrize(("rows_hz", "is_from_samples"), [(10, False), (200, True)])
def test_samples_that_only_lie_between_rows_of_a_table_are_no_readings(rows_hz, is_from_samples):
    frames, samples = measured()
    t = samples[0]
    rows = slice(None, None, 1000 // rows_hz)
    between = np.array([t, *(np.interp(t, t[rows], y[rows]) for y in samples[1:])])
    assert (FRAMES not in read(frames, between).notes[0]) == is_from_samples


def test_a_drive_that_ends_soon_after_the_onset_has_q_s_too():
    frames, samples = measured()
    frames, samples = [column[:190] for column in frames], samples[:, :23_800]
    onset = sliding_onset(*frames, settled=15e-6, samples=tuple(samples))
    assert FRAMES not in onset.notes[0]
    assert onset.window[0] > 23
    assert onset.static_force == pytest.approx(0.4, abs=3 * onset.static_force_sd)


def test_samples_that_end_before_the_onset_are_not_continued():
    frames, samples = measured()
    onset = read(frames, samples[:, samples[0] < 19.8])
    assert onset == sliding_onset(*frames, settled=6e-6)


def test_mu_s_is_that_of_the_load_at_the_onset():
    frames, samples = measured()
    samples[2] = P * (1 - 0.02 * samples[0]) + 1e-3 * np.random.default_rng(3).normal(
        size=samples[0].size
    )
    onset = read(frames, samples)
    assert onset.mu_s == pytest.approx(0.4 / (0.6 * P), abs=2.5 * onset.mu_s_sd)
    assert onset.mu_s_sd < 0.01 * onset.mu_s  # the load falls by 2 % in the span before t_s


def test_no_samples_at_all_are_none():
    frames, samples = measured()
    assert read(frames, samples[:, :0]) == sliding_onset(*frames, settled=6e-6)
    slow = samples[:, ::200]  # 5 samples a second: none of their own before t_s
    assert read(frames, slow) == sliding_onset(*frames, settled=6e-6)


def test_the_samples_are_those_of_half_the_slip_until_sliding_is_steady():
    frames, samples = measured()
    for settled, seconds in ((6e-6, 3e-6 / SPEED), (0.0, 20 * SHARES_BEFORE[0]), (12e-6, 1.237)):
        note = sliding_onset(*frames, settled=settled, samples=tuple(samples)).notes[0]
        span = float(note.split("Q_s from the samples of the ")[1].split()[0])
        assert span == pytest.approx(seconds, rel=0.02)
