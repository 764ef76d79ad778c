"""Runs that stick for ever, slide from the start, turn back, lose frames, or last for days."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import astuple, replace

import numpy as np
import pytest
from numpy.testing import assert_equal
from plain_speckle import Speckle

from analysis.contact.rings import Rings, central_value, ring_means
from analysis.friction.cycles import branches, interface_stiffness, precursor_slip
from analysis.friction.joint import joint_law
from analysis.friction.largest_stress import stress_peak
from analysis.friction.local_law import LocalLaw, fit_local_law
from analysis.friction.modulus import balance_modulus
from analysis.friction.onset import sliding_onset
from analysis.friction.pressure import check_pressure
from analysis.friction.stick import fit_stick_radius
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.settings import StressSettings
from app.evaluation.history import KEPT_SECONDS, MOST_MEANS, History
from app.evaluation.pipeline import Pipeline
from app.evaluation.series import MOST_RINGS, Series
from app.evaluation.tractions import Tractions
from app.records.record_types import Conditions, Phase, RingProfile, Snapshot, Traction
from app.settings.sections import Config

P, E, NU, R = 0.5, 3.43e6, 0.5, 128.8e-3
A = hertz.contact_radius(P, E, NU, R)
T = np.arange(480) / 8
SPEED = 5e-6
LOAD = 0.4 * -np.expm1(-T / 8)
RADII = np.arange(40) * 1e-4 + 5e-5
PITCH = Config().dic.step * Config().camera.pixel


def noise(sd: float, n: int = len(T), seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sd, n)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("sticks for ever", "drive further"),
        ("slides from the start", "the onset was not seen"),
        ("goes backwards", "drive further"),
        ("did not move", "drive further"),
        ("has no contact", "without contact"),
        ("was not measured", "were measured"),
        ("stands in time", "do not increase"),
    ],
)
def test_a_run_without_an_onset_has_no_number_and_says_why(kind: str, why: str, seed: int) -> None:
    u = {
        "slides from the start": SPEED * T,
        "goes backwards": -SPEED * np.maximum(0, T - 30),
        "was not measured": np.full(len(T), math.nan),
        "did not move": np.full(len(T), 1e-5),
    }.get(kind, np.zeros(len(T)))
    u = u + (noise(1e-8, seed=seed) if kind != "did not move" else 0.0)
    normal = 0.0 if kind == "has no contact" else P
    t = np.repeat(T[::2], 2) if kind == "stands in time" else T
    # the shear force is there at once where it slides from the start
    shear = np.full(len(T), 0.4) if kind == "slides from the start" else LOAD
    found = sliding_onset(t, u, shear, normal)
    assert math.isnan(found.time)
    assert math.isnan(found.mu_s)
    assert why in found.notes[0]


@pytest.mark.parametrize("lost", ["seconds about the onset", "every second frame", "the last half"])
def test_frames_that_are_missing_move_the_onset_by_no_more_than_is_stated(lost: str) -> None:
    u = np.maximum(0, SPEED * (T - 20)) + noise(2e-8)
    gone = {
        "seconds about the onset": (T > 17) & (T < 23),
        "every second frame": np.arange(len(T)) % 2 == 1,
        "the last half": T > 40,
    }[lost]
    found = sliding_onset(T, np.where(gone, np.nan, u), np.minimum(0.02 * T, 0.4), P)
    assert found.time == pytest.approx(20, abs=5 * found.time_sd)
    assert found.time_sd < 0.05
    # Q bends at the onset: without frames there, a line through the next ones cuts the corner
    assert found.static_force == pytest.approx(0.4, abs=0.04 if "onset" in lost else 0.01)


@pytest.mark.slow
def test_the_onset_of_a_run_of_days_is_found_among_a_million_frames() -> None:
    t = np.arange(1_000_000) / 8
    u = np.maximum(0, SPEED * (t - 30_000)) + noise(2e-8, len(t))
    found = sliding_onset(t, u, np.minimum(t / 30_000, 1) * 0.4, P)
    assert found.time == pytest.approx(30_000, abs=5 * found.time_sd)
    assert found.mu_s == pytest.approx(0.8, rel=1e-4)


def test_a_balance_without_scatter_and_one_of_noise_alone() -> None:
    force = np.linspace(0, 0.4, 100)
    exact = balance_modulus(force / 2, np.full(100, 1e-3), force, E)
    assert pytest.approx(2 * E) == exact.E
    for integral in (noise(1.0, 100), np.zeros(100), np.full(100, 0.3)):
        found = balance_modulus(integral, np.full(100, 1e-3), force, E)
        assert math.isnan(found.E)
        assert found.notes


def test_a_largest_stress_is_found_in_one_of_two_hundred_profiles_of_noise_at_most() -> None:
    found = [
        stress_peak(RADII, noise(1.0, 40, seed), np.ones(40), reach=3e-4) for seed in range(800)
    ]
    assert sum(math.isfinite(peak.radius) for peak in found) <= 4
    clear = 10 * np.exp(-(((RADII - 2e-3) / 6e-4) ** 2)) + noise(1.0, 40)
    peak = stress_peak(RADII, clear, np.ones(40), reach=3e-4)
    assert peak.radius == pytest.approx(2e-3, abs=4 * peak.radius_sd)


@pytest.mark.parametrize("hertz_radius", [0.0, -1.0, math.nan, math.inf, 1e-12])
def test_a_stick_radius_in_no_contact_is_none(hertz_radius: float) -> None:
    u = np.maximum(0, RADII - 1e-3)
    assert math.isnan(fit_stick_radius(RADII, u, np.full(40, 1e-9), hertz_radius).stick_radius)


def test_a_stick_radius_in_pure_noise_is_none() -> None:
    for seed in range(20):
        u = 1e-5 + noise(1e-8, 40, seed)
        assert math.isnan(fit_stick_radius(RADII, u, np.full(40, 1e-8), 2e-3).stick_radius)


def test_rings_of_nothing_and_of_places_that_are_none() -> None:
    assert len(ring_means([], [], 1e-4, theta=[]).mean) == 0
    wild = np.array([-1.0, np.nan, np.inf, -np.inf, 2.5e-4, 3.5e-4])
    values = np.array([1.0, 1.0, 1.0, 1.0, np.nan, 7.0])
    for theta in (None, np.zeros(6)):
        rings = ring_means(wild, values, 1e-4, 1e-3, theta=theta)
        assert rings.count.tolist() == [0, 0, 0, 1, 0, 0, 0, 0, 0]
        assert rings.mean[3] == 7.0
    for width, r_max in ((0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (1e-4, math.nan), (1e-4, -1.0)):
        with pytest.raises(ValueError, match="rings: a width of"):
            ring_means(RADII, RADII, width, r_max)
    assert np.isnan(central_value(RADII, RADII, RADII * np.nan, 1e-3)).all()


@pytest.fixture(scope="module")
def inversion() -> AxisymmetricInversion:
    pitch = A / 12
    at = pitch * np.arange(-28, 29)
    return AxisymmetricInversion(*np.meshgrid(at, at), pitch, 1.3 * A, E, NU, edge=A)


def rings_of(inversion: AxisymmetricInversion, u: np.ndarray, sd: float = 1e-8) -> Rings:
    return Rings(inversion.radius, u, np.full(len(u), sd), inversion.points.round().astype(int))


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("noise", "local law: "),
        ("no force", "the shear force reached 0 N at most"),
        ("lifted", "without contact there is no friction"),
        ("pulled", "the shear force reached"),
        ("no frames", "0 frames could be inverted"),
        ("forces without frames", "0 frames could be inverted"),
        ("frames without forces", "0 frames could be inverted"),
        ("slides from the start", "local law: "),
    ],
)
def test_a_run_that_does_not_tell_the_law_says_why(
    inversion: AxisymmetricInversion, kind: str, why: str
) -> None:
    n, points = 40, len(inversion.radius)
    u = [noise(1e-8, points, seed) + 1e-7 * seed for seed in range(n)]
    Q = np.linspace(0, 0.4, n)
    if kind == "slides from the start":
        Q[:] = 0.4
    if kind == "forces without frames":
        u = [np.full(points, math.nan)] * n
    sign = {"no force": 0.0, "pulled": -1.0, "frames without forces": math.nan}.get(kind, 1.0)
    normal = np.full(n, -0.1 if kind == "lifted" else P)
    frames = 0 if kind == "no frames" else n
    found = fit_local_law(
        [rings_of(inversion, one) for one in u[:frames]],
        normal[:frames],
        sign * Q[:frames],
        inversion,
        draws=4,
    )
    assert math.isnan(found.L)
    assert math.isnan(found.mu)
    assert why in found.notes[0]


def law(mu: float = 0.9, L: float = 1e-6, modulus: float = E, sd: float = 0.01) -> LocalLaw:
    return LocalLaw(mu=mu, mu_sd=sd * mu, L=L, L_sd=sd * L, E=modulus, E_sd=sd * modulus)


def test_loads_that_are_one_load_have_no_exponent_and_laws_that_are_none_are_left_out() -> None:
    for loads in ([0.5] * 3, [0.5, 0.5 * (1 + 1e-15), 0.5]):
        found = joint_law([law(), law(), law()], loads)
        assert found.L.value == pytest.approx(1e-6)
        assert math.isnan(found.decay)
    spoiled = [law(mu=-1.0), law(modulus=math.nan), law(sd=math.nan), law(L=0.0), law(), law()]
    found = joint_law(spoiled, [1, 1, 1, 1, 0.5, 1])
    assert found.E.value == pytest.approx(E)
    assert math.isnan(joint_law([law(), law()], [math.inf, 0.5]).E.value)
    wide = joint_law([law(mu=0.9 * p**-0.05) for p in (1e-6, 1, 100)], [1e-6, 1, 100])
    assert wide.decay == pytest.approx(0.05)


def test_a_pressure_that_is_none_is_not_compared() -> None:
    r = RADII[:20]
    p = hertz.pressure(r, P, A)
    for pressure, force, points in ((p, 0.0, 20), (0 * p, P, 20), (-p, P, 20), (p, P, 1)):
        of = LocalLaw(
            mu=0.9,
            L=1e-6,
            E=E,
            E_sd=1e4,
            radius=r[:points],
            pressure=pressure[:points],
            pressure_sd=np.full(points, 100.0),
        )
        found = check_pressure(of, force, NU, R, 1e-6)
        assert math.isnan(found.ratio)
        assert found.notes


def test_a_stage_that_stands_still_or_is_not_read_has_one_branch_and_no_slip() -> None:
    assert branches([], least=1e-6) == []
    assert branches([0.0] * 20, least=1e-6) == [slice(0, 20, None)]
    there_and_back = [*range(20), *range(20, 0, -1)]
    assert len(branches(there_and_back, least=1)) == 2
    assert np.isnan(precursor_slip([1, 2, 3], np.zeros((3, 2)), math.nan)).all()
    still = np.zeros((5, 3))
    assert np.isnan(interface_stiffness(still, still, still + 1, 1e-6)).all()


def test_a_history_of_a_million_samples_keeps_a_minute_and_a_plot() -> None:
    history = History(1000.0, 5)
    history.begin(Phase.BACKGROUND, 0)
    history.begin(Phase.DRIVE, 500_000)
    for first in range(0, 1_000_000, 50):
        n = np.arange(first, first + 50, dtype=np.float64)
        history.append(first, np.column_stack([n, -n]), 5e-9 * first, first + 50)
    newest = history.conditions(999_995)
    assert newest.normal_force_n == 999_997
    assert newest.time_s == pytest.approx(499.9975)
    oldest = history.conditions(1_000_000 - int(KEPT_SECONDS * 1000))
    assert oldest.shear_force_n == -940_002
    with pytest.raises(RuntimeError, match="60000 are kept"):
        history.conditions(1_000_000 - int(KEPT_SECONDS * 1000) - 1)
    samples, normal, _ = history.block_means(MOST_MEANS)
    assert 1000 <= len(samples) <= MOST_MEANS
    np.testing.assert_array_equal(normal, samples - 0.5)


@pytest.mark.parametrize("beyond", [-4, -1, 0, 100, 50_000])
def test_a_frame_beyond_the_last_forces_has_none_not_those_of_a_minute_before(beyond: int) -> None:
    history = History(1000.0, 5)
    history.begin(Phase.DRIVE, 0)
    history.append(0, np.ones((100_000, 2)), 0.0, 100_000)
    assert history.conditions(99_995).normal_force_n == 1
    after = history.conditions(100_000 + beyond)
    assert math.isnan(after.normal_force_n)
    assert math.isnan(after.shear_force_n)


def test_samples_that_were_lost_are_no_force() -> None:
    history = History(100.0, 4)
    history.begin(Phase.DRIVE, 0)
    history.append(0, np.ones((100, 2)), 0.0, 100)
    history.append(100, np.full((20_000, 2), math.nan), 0.0, 20_100)  # more than is kept
    history.append(20_100, np.ones((100, 2)), 0.0, 20_200)
    assert math.isnan(history.conditions(20_098).normal_force_n)
    assert history.conditions(20_100).normal_force_n == 1


@pytest.mark.slow
def test_the_results_of_a_hundred_thousand_frames_stay_small() -> None:
    series = Series()
    ring = RingProfile(*np.zeros((3, 5)))
    now = Conditions(Phase.DRIVE, 1.0, 0.5, 0.1, 0.0)
    traction = Traction(*[1.0] * 6)
    for n in range(100_000):
        series.append(Snapshot(n, 125 * n, now, rings=ring, traction=traction))
    assert len(series) == 100_000
    newest = series.since(99_998)
    assert [snapshot.frame for snapshot in newest] == [99_998, 99_999]
    kept = [s.frame for s in series.since(0) if s.rings is not None]
    assert MOST_RINGS / 2 <= len(kept) <= MOST_RINGS + 1
    steps = Counter(np.diff(kept[:-1]).tolist())
    assert len(steps) == 1  # evenly over the run


def test_live_fields_that_did_not_converge_are_counted_and_pure_noise_is_no_doubt() -> None:
    settings = Config(stress=StressSettings(field=True))
    x, y = np.meshgrid(PITCH * np.arange(-70, 71), PITCH * np.arange(-55, 56))
    tractions, sd = Tractions(settings, x, y, A), np.full(x.shape, 2e-8)
    moved, _ = cattaneo_mindlin.displacement(x, y, 0.3, 0.93, P, A, E, NU)
    rng = np.random.default_rng(0)
    for _ in range(3):
        u = rng.normal(0, 2e-8, x.shape)
        assert tractions.field(u, sd) is not None
        tractions.of(ring_means(np.hypot(x, y), u, PITCH, theta=np.arctan2(y, x)))
    assert tractions.notes() == []
    assert tractions.field(1e-5 - moved + u, sd) is not None
    assert tractions.field(np.full(x.shape, np.nan), sd) is None
    notes = " ".join(tractions.notes())
    assert "in 1 of 4 frames it had not converged after 5 iterations" in notes
    assert "1 frames have none" in notes


@pytest.mark.parametrize("size", [1, 7, 4000])
def test_forces_in_blocks_of_any_size_are_the_same_forces(size: int) -> None:
    forces = np.random.default_rng(0).normal(size=(4000, 2))
    seen = []
    for block in (size, 50):
        history = History(100.0, 4)
        history.begin(Phase.DRIVE, 0)
        for first in range(0, len(forces), block):
            part = forces[first : first + block]
            history.append(first, part, 0.0, first + len(part))
        seen.append([astuple(history.conditions(sample)) for sample in range(0, 3996, 13)])
    assert_equal(*seen)  # where nan is nan


SPECKLE = Speckle((300, 400))
STILL = SPECKLE.image(noise=1)


def pictures(kind: str, n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    if kind == "black":
        return [np.zeros_like(STILL)] * n
    if kind == "noise":
        return [rng.integers(0, 256, STILL.shape).astype(np.uint8) for _ in range(n)]
    if kind == "slides from the start":
        return [SPECKLE.image(0.3 * k, noise=1, seed=k) for k in range(n)]
    if kind == "jumps":
        return [SPECKLE.image(50.0 * (k % 2), noise=1, seed=k) for k in range(n)]
    return [SPECKLE.image(noise=1, seed=k) for k in range(n)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "normal", "shear"),
    [
        ("still", 1e-6, 0.01),
        ("still", 100.0, 0.01),
        ("still", -0.5, 0.01),
        ("still", 0.0, 0.01),
        ("still", math.nan, 0.01),
        ("still", P, math.nan),
        ("still", P, -0.01),
        ("black", P, 0.01),
        ("noise", P, 0.01),
        ("slides from the start", P, 0.01),
        ("jumps", P, 0.01),
    ],
)
def test_a_whole_run_that_shows_no_contact_has_no_result_and_says_why(
    kind: str, normal: float, shear: float
) -> None:
    camera = replace(Config().camera, width=400, height=300, pixel=16e-6)
    pipeline, snapshots = Pipeline(replace(Config(), camera=camera)), []
    phases = [Phase.BACKGROUND, Phase.REFERENCE] + [Phase.DRIVE] * 28
    images = [STILL, STILL, *pictures(kind, 28)]
    for n, (phase, image) in enumerate(zip(phases, images, strict=True)):
        t = (n - 2) / 8 if phase is Phase.DRIVE else math.nan
        force = shear * t if phase is Phase.DRIVE else 0.0
        now = Conditions(phase, t, normal, force, 1e-6 * n)
        snapshots.append(pipeline.step(n, 125 * n, image, now))
    pipeline.close()
    summary = pipeline.summary(snapshots)
    for result in ("onset_time_s", "mu_s", "law_mu", "law_length_m", "young_modulus_pa"):
        assert math.isnan(getattr(summary, result)), result
    assert math.isnan(summary.apparent_radius_m)
    assert all(snapshot.stick is None for snapshot in snapshots)
    assert any("micro-contacts" in note for note in summary.notes)
    assert any(note.startswith("onset: ") for note in summary.notes)
    assert not any("failed" in note for note in summary.notes)
