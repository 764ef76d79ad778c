"""Onset of sliding on a Cattaneo-Mindlin contact in series with a cantilever, whose onset is known
in closed form.
"""

import numpy as np
import pytest

from analysis.friction.onset import sliding_onset
from analysis.robust import serial_sum

E, NU, R, MU = 3.43e6, 0.5, 0.1288, 0.93
K_T, LENS, V = 9579.0, 0.68e-6, 4.85e-6
NOISE_U, NOISE_F = 2e-8, 3e-4


def _run(normal, end, rate=8.0, rounding=0.0):
    """time, central u_x, Q of a drive, without noise, and t_s; `rounding` (m) is an elastic length
    of the interface.
    """
    a = (3 * normal * R * (1 - NU**2) / (4 * E)) ** (1 / 3)
    shift = 3 * MU * normal * (2 - NU) * 2 * (1 + NU) / (16 * E * a)
    share = np.linspace(0, 1, 100001)
    drive = shift * (1 - (1 - share) ** (2 / 3)) + MU * normal * share * (1 / K_T + LENS)
    t = (np.arange(int(end * rate)) + 0.5) / rate
    ts = drive[-1] / V
    beyond = V * (t - ts)
    u = rounding * np.logaddexp(0, beyond / rounding) if rounding else np.maximum(beyond, 0)
    return t, u, MU * normal * np.interp(V * t, drive, share), ts


def _noisy(run, normal, seed):
    t, u, q, _ = run
    rng = np.random.default_rng(seed)
    return sliding_onset(
        t,
        u + rng.normal(0, NOISE_U, t.size),
        q + rng.normal(0, NOISE_F, t.size),
        normal + rng.normal(0, NOISE_F, t.size),
    )


@pytest.mark.parametrize(
    ("normal", "end", "rate"), [(0.1, 12, 8.0), (0.5, 26, 8.0), (0.5, 38, 8.0), (1.4, 75, 4.0)]
)
@pytest.mark.parametrize("rounding", [0.0, 0.8e-6])
def test_onset_of_a_cattaneo_mindlin_contact(normal, end, rate, rounding):
    run = _run(normal, end, rate, rounding)
    found = [_noisy(run, normal, seed) for seed in range(40)]
    ts, qs = np.array([o.time for o in found]), np.array([o.static_force for o in found])
    assert abs(ts.mean() - run[3]) < 0.005
    assert ts.std() < 0.01
    assert abs(qs.mean() / (MU * normal) - 1) < 0.0025
    assert abs(np.mean([o.mu_s for o in found]) / MU - 1) < 0.0025
    assert abs(np.mean([o.mu_d for o in found]) / MU - 1) < 0.001
    assert abs(np.mean([o.velocity for o in found]) / V - 1) < 0.001
    assert all(o.mu_d_range[0] < o.mu_d < o.mu_d_range[1] for o in found)
    assert all(o.window[0] > run[3] for o in found)


def test_stated_uncertainties():
    run = _run(0.5, 26)
    found = [_noisy(run, 0.5, seed) for seed in range(200)]
    time = np.array([(o.time - run[3]) / o.time_sd for o in found])
    velocity = np.array([(o.velocity - V) / o.velocity_sd for o in found])
    assert 0.6 < np.mean(np.abs(time) < 1) < 0.8
    assert 0.6 < np.mean(np.abs(velocity) < 1) < 0.8
    # 0.04 % of bias from the bend of Q at t_s apart
    force = np.array([o.static_force for o in found])
    assert 0.7 < force.std() / np.median([o.static_force_sd for o in found]) < 1.4


def _pull(found, name, true):
    """Root mean square of the error over the standard uncertainty that is stated."""
    error = np.array([getattr(one, name) - true for one in found])
    return float(np.sqrt(np.mean((error / [getattr(one, f"{name}_sd") for one in found]) ** 2)))


def test_every_stated_uncertainty_is_the_scatter():
    """Q rises beyond t_s, so that Q_s is as uncertain as t_s makes it, P is as noisy as Q, and the
    reference image has the noise of any frame.
    """
    t, ts, normal = (np.arange(160) + 0.5) / 8.0, 9.0, 0.5
    u, q = V * np.maximum(t - ts, 0.0), 0.036 * np.minimum(t, 10.5)
    rng, found = np.random.default_rng(3), []
    for _ in range(150):
        image = 2e-7 * (rng.normal(size=t.size) + rng.normal())
        force, load = 1e-3 * rng.normal(size=t.size), 2e-2 * rng.normal(size=t.size)
        found.append(sliding_onset(t, u + image, q + force, normal + load, shared_sd=2e-7))
    for name, true in (("time", ts), ("static_force", 0.036 * ts), ("mu_s", 0.036 * ts / normal)):
        assert 0.8 < _pull(found, name, true) < 1.25, name
    t, u, q, _ = run = _run(normal, 38)
    found = [_noisy(run, normal, seed) for seed in range(150)]
    for name, true in (("velocity", V), ("mu_d", MU)):
        assert 0.8 < _pull(found, name, true) < 1.25, name


def _slow(rng, shape, correlation):
    """Errors of unit variance, each of which keeps a share of the one before."""
    out = rng.normal(size=shape)
    for i in range(1, shape[0]):
        out[i] = correlation * out[i - 1] + np.sqrt(1 - correlation**2) * out[i]
    return out


@pytest.mark.parametrize(
    ("correlation", "known"), [(0.0, 1.0), (0.5, 1.0), (0.8, 1.0), (0.0, 0.5), (0.5, 0.5)]
)
def test_uncertainty_of_a_drive_whose_reference_and_slow_errors_count(correlation, known):
    """The reference has the noise of any frame, of which only a part may be known, and errors of
    successive frames and forces may be alike.
    """
    t, u, q, ts = _run(0.3, 19, rate=5.0, rounding=0.8e-6)
    rng = np.random.default_rng(7)
    off, force = [], []
    for _ in range(120):
        image = NOISE_U * (_slow(rng, t.shape, correlation) + rng.normal())
        noise = NOISE_F * _slow(rng, t.shape, correlation)
        onset = sliding_onset(t, u + image, q + noise, 0.3, shared_sd=known * NOISE_U, settled=6e-6)
        off.append((onset.time - ts) / onset.time_sd)
        force.append((onset.mu_d - MU) / onset.mu_d_sd)
    off, force = np.abs(off), np.abs(force)
    assert 0.56 < np.mean(off < 1) < 0.81
    assert np.mean(off < 2) > 0.90
    assert np.mean(force < 2) > 0.80


def test_errors_that_come_back_every_pixel_do_not_shorten_the_window():
    t, u, q, ts = _run(0.5, 38)
    wavy = u + 5e-8 * np.sin(2 * np.pi * u / 7.04e-6) * (u > 0)
    for seed in range(20):
        onset = _noisy((t, wavy, q, ts), 0.5, seed)
        assert abs(onset.time - ts) < 0.01
        assert onset.window[0] < ts + 3.8


@pytest.mark.parametrize("end", [4, 10, 15, 19, 20.5, 21.5])
@pytest.mark.parametrize("rounding", [0.0, 0.8e-6])
def test_a_run_that_did_not_reach_sliding_says_so(end, rounding):
    run = _run(0.5, end, rounding=rounding)
    for seed in range(5):
        onset = _noisy(run, 0.5, seed)
        assert np.isnan(
            [onset.time, onset.static_force, onset.mu_s, onset.mu_d, *onset.mu_d_range]
        ).all()
        assert "drive further" in onset.notes[0]


def test_too_few_frames_and_no_contact():
    t, u, q, _ = _run(0.5, 26)
    assert "23 frames" in sliding_onset(t[:23], u[:23], q[:23], 0.5).notes[0]
    assert "0 frames" in sliding_onset([], [], [], []).notes[0]
    normal = np.full(t.size, 0.5)
    normal[40] = -0.01
    assert "falls to -0.01 N" in sliding_onset(t, u, q, normal).notes[0]


def test_frames_that_are_lost_are_ignored():
    t, u, q, _ = _run(0.5, 26)
    u = u + np.random.default_rng(0).normal(0, NOISE_U, t.size)
    kept = np.ones(t.size, bool)
    kept[[3, 100, 180]] = False
    holes = u.copy()
    holes[~kept] = np.nan
    assert sliding_onset(t, holes, q, 0.5) == sliding_onset(
        t[kept], u[kept], q[kept], np.full(kept.sum(), 0.5)
    )


def test_static_and_dynamic_friction_differ_where_the_force_drops():
    t, u, q, ts = _run(0.5, 38)
    q = np.where(t > ts + 0.3, 0.9 * q, q)
    onset = sliding_onset(t, u + np.random.default_rng(1).normal(0, NOISE_U, t.size), q, 0.5)
    np.testing.assert_allclose(onset.mu_s, MU, rtol=2e-3)
    np.testing.assert_allclose(onset.mu_d, 0.9 * MU, rtol=5e-3)
    np.testing.assert_allclose(onset.mu_d_range, (0.9 * MU, MU), rtol=2e-3)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.95])
@pytest.mark.parametrize("count", [1, 2, 57])
def test_errors_that_fade_add_up_as_their_covariance_says(count, correlation):
    weights, apart = np.random.default_rng(2).normal(size=count), np.arange(count)
    covariance = correlation ** np.abs(apart[:, None] - apart)
    assert serial_sum(weights, correlation) == pytest.approx(weights @ covariance @ weights, 1e-12)
