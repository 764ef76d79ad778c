"""The law of friction from runs whose truth is solved on annuli, under a smooth and a rough
pressure, which the estimate does not know.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from friction import elasto_plastic_world as grid, rough_world as world

from analysis.contact.rings import Rings
from analysis.friction.joint import joint_law
from analysis.friction.law_of_fields import friction_law
from analysis.friction.local_law import DRAWS, LocalLaw, fit_local_law
from analysis.friction.pressure import check_pressure
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from analysis.mechanics.relaxation import Relaxation
from app.records.quantities import doubts

ROUGH, SMOOTH = world.H, 0.0
NOISE = 40e-9  # metres, of a box
FEW = 6  # draws, where the uncertainties are not the subject, or those of many runs together


@cache
def inversion(P: float) -> AxisymmetricInversion:
    """As a run has it whose settings give a modulus that is a tenth too large."""
    E = 1.1 * world.E
    return grid.inversion(hertz.contact_radius(P, E, world.NU, world.R), E)


def rings_of(run, ux, sd):
    return [Rings(run.radius, u, e, run.count) for u, e in zip(ux, sd, strict=True)]


def measured(P, h, seed, noise=NOISE, end=1.5):
    """A run of 40 frames, and what a bench sees of it."""
    run = world.drive(P, 40, h, end=end)
    ux, sd, Q = run.measured(noise, seed)
    return run, rings_of(run, ux, sd), Q


@cache
def found(P, h, seed=3, noise=NOISE, draws=DRAWS):
    run, rings, Q = measured(P, h, seed, noise)
    return run, fit_local_law(rings, P, Q, inversion(P), draws=draws)


@pytest.mark.parametrize(
    ("P", "h"),
    [
        (0.1, ROUGH),
        pytest.param(0.5, SMOOTH, marks=pytest.mark.slow),
        pytest.param(1.4, ROUGH, marks=pytest.mark.slow),
    ],
)
def test_the_law_and_the_pressure_are_found_whatever_the_pressure_is(P, h):
    run, law = found(P, h)
    assert law.mu == pytest.approx(world.MU, rel=0.01)
    assert pytest.approx(world.L, rel=0.025) == law.L
    assert pytest.approx(world.E, rel=0.012) == law.E
    assert abs(law.mu - world.MU) < 4 * law.mu_sd < 0.04
    assert abs(law.L - world.L) < 4 * law.L_sd < 0.1 * world.L
    assert abs(law.E - world.E) < 4 * law.E_sd < 0.03 * world.E
    assert law.h == pytest.approx(law.L * 2 / 3)
    truth = run.world.pressure(law.radius)
    # no ring resolves where Hertz's pressure ends
    told = np.abs(law.radius - run.world.reach) > 2 * grid.PITCH
    assert np.abs(law.pressure - truth)[told].max() < 0.05 * truth.max()
    assert law.reduced_chi2 < 4


@pytest.mark.parametrize("h", [SMOOTH, ROUGH])
def test_the_law_has_no_bias_without_noise(h):
    _, law = found(0.5, h, seed=1, noise=1e-9, draws=FEW)
    np.testing.assert_allclose([law.mu, law.E], [world.MU, world.E], rtol=2e-3)
    assert pytest.approx(world.L, rel=5e-3) == law.L


@pytest.mark.parametrize("change", [-0.05, 0.05])
def test_a_load_that_changes_while_it_is_sheared_leaves_the_law_what_it_is(change):
    """P falls or rises by 5 % half-way to sliding, and with it the radius and the pressure of a
    sphere, as its cube root: that the pressure was in proportion put L off by four uncertainties.
    """
    P, base = 0.5, world.drive(0.5, 40, SMOOTH, end=1.5)
    D = np.array([state.D for state in base.states])
    loads = P * np.where(0.5 * base.world.full > D, 1 - change / 2, 1 + change / 2)
    worlds = {p: world.World(p, *world.hertz_pressure(p)).run(D) for p in np.unique(loads)}
    states = [worlds[p][i] for i, p in enumerate(loads)]
    ux = np.array([state.rings().mean for state in states])
    run = replace(base, states=states, ux=ux, Q=np.array([state.Q for state in states]))
    u, sd, Q = run.measured(NOISE, 1)
    law = fit_local_law(rings_of(run, u, sd), loads, Q, inversion(P), draws=FEW)
    assert abs(law.L - world.L) < 2.5 * law.L_sd < 0.02 * world.L
    assert abs(law.mu - world.MU) < 2.5 * law.mu_sd
    assert abs(law.E - world.E) < 2.5 * law.E_sd
    assert law.reduced_chi2 < 2.0


def test_what_is_stated_covers_the_truth():
    """Nine runs at 0.1 N, where noise is largest: about two thirds lie within one uncertainty."""
    laws = [found(0.1, ROUGH, seed, draws=FEW)[1] for seed in range(9)]
    for name, truth in (("mu", world.MU), ("L", world.L), ("E", world.E)):
        off = np.array([(getattr(law, name) - truth) / getattr(law, f"{name}_sd") for law in laws])
        assert np.sqrt(np.mean(off**2)) < 1.8
        assert np.sqrt(np.mean(off**2)) > 0.4


@pytest.mark.parametrize("tau", [1.0, 20.0])
def test_a_block_that_relaxes_has_the_law_of_an_elastic_one(tau):
    """Frames every 0.25 s of a drive of 10 s, without noise: the law as exact as elsewhere where
    the relaxation is known, and off where it is not.
    """
    g, truth = 0.15, world.rough(0.1)
    times = 0.25 * np.arange(1, 41)
    states = truth.relaxing(times, 1.5 * truth.full / 10.0, g, tau)
    rings = [state.rings() for state in states]
    rings = [replace(one, standard_error=np.full_like(one.mean, 1e-9)) for one in rings]
    Q = [state.Q for state in states]
    known = {"time": times, "relaxation": Relaxation(g, tau)}
    law = fit_local_law(rings, 0.1, Q, inversion(0.1), draws=FEW, Q_sd=1e-6, **known)
    np.testing.assert_allclose([law.mu, law.E], [world.MU, world.E], rtol=3e-3)
    assert pytest.approx(world.L, rel=0.02) == law.L
    blind = fit_local_law(rings, 0.1, Q, inversion(0.1), draws=FEW, Q_sd=1e-6)
    assert abs(blind.L / world.L - 1) > 0.05
    assert abs(blind.E / world.E - 1) > (0.005 if tau < 10 else 0.05)


def test_a_block_that_relaxes_needs_the_times_of_its_frames():
    _, rings, Q = measured(0.5, ROUGH, 3)
    with pytest.raises(ValueError, match="times of its frames that do not rise from 0"):
        fit_local_law(rings, 0.5, Q, inversion(0.5), relaxation=Relaxation(0.1, 3.0))


def test_fields_of_half_of_the_contact_are_told() -> None:
    """E of such fields is off by several of its uncertainties."""
    x, y = 1e-4 * np.arange(-35, 36), 1e-4 * np.arange(-30, 31)
    Q = world.MU * 0.5 * np.linspace(0.02, 1 - 1e-9, 16)
    a = hertz.contact_radius(0.5, world.E, world.NU, world.R)
    block = {"E": world.E, "nu": world.NU, "R": world.R}
    ux = np.array(
        [80e-6 - cattaneo_mindlin.field(x, y, q, world.MU, 0.5, a, world.E, world.NU)[1] for q in Q]
    )
    ux += np.random.default_rng(2).normal(0, 2e-8, ux.shape)
    whole, half = (friction_law(x[n:], y, ux[:, :, n:], 0.5, Q, **block, draws=0) for n in (0, 31))
    assert not any("does not cover the contact" in note for note in whole.notes)
    assert any("in 16 of 16 frames the field does not cover" in note for note in half.notes)
    for wrong in (ux[0], ux[:, 1:]):
        with pytest.raises(ValueError, match=r"give one field after the other, \(nt, ny, nx\)"):
            friction_law(x, y, wrong, 0.5, Q, **block)


def test_forces_and_moduli_a_thousandth_as_large_give_the_same_law():
    """With the noise of Q, which the modulus rests on."""
    _, rings, Q = measured(0.5, ROUGH, 3)
    known, small = inversion(0.5), 2.0**-10
    a = hertz.contact_radius(0.5, known.E, world.NU, world.R)
    soft = grid.inversion(a, small * known.E)
    whole = fit_local_law(rings, 0.5, Q, known, Q_sd=2e-4, draws=FEW)
    part = fit_local_law(rings, 0.5 * small, Q * small, soft, Q_sd=2e-4 * small, draws=FEW)
    for name, by in (("mu", 1), ("L", 1), ("L_sd", 1), ("E", small), ("E_sd", small)):
        assert getattr(part, name) == pytest.approx(by * getattr(whole, name), rel=1e-6)


@pytest.mark.parametrize("factor", [0.97, 1.04])
def test_a_wrong_shear_force_is_told(factor):
    """The traction alone cannot tell it, the width of the pressure can."""
    _, rings, Q = measured(0.5, ROUGH, 3)
    law = fit_local_law(rings, 0.5, factor * Q, inversion(0.5), draws=FEW)
    check = check_pressure(law, 0.5, world.NU, world.R, world.H)
    assert check.ratio == pytest.approx(factor, abs=0.008)
    assert "do not agree" in check.notes[0]
    assert not check_pressure(
        found(0.5, ROUGH, draws=FEW)[1], 0.5, world.NU, world.R, world.H
    ).notes


@pytest.mark.parametrize("P", [0.1, 1.4])
def test_the_pressure_of_a_rough_contact_is_not_that_of_a_smooth_one(P):
    check = check_pressure(found(P, ROUGH)[1], P, world.NU, world.R, world.H)
    assert check.hertz_chi2 > 100 * check.rough_chi2
    assert pytest.approx(world.E, rel=0.01) == check.E


def test_the_pressure_of_a_smooth_contact_is_not_that_of_a_rough_one():
    P = 1.4  # where the two differ least
    check = check_pressure(found(P, SMOOTH, draws=FEW)[1], P, world.NU, world.R, world.H)
    assert check.rough_chi2 > 20 * check.hertz_chi2


def test_outliers_gaps_and_a_force_that_drifts_do_not_matter():
    run = world.drive(0.5, 40, ROUGH, end=1.5)
    ux, sd, Q = run.measured(NOISE, 4)
    ux[np.random.default_rng(0).random(ux.shape) < 0.01] += 5e-6
    ux[5], ux[:, 30] = np.nan, np.nan
    P = 0.5 * np.linspace(0.99, 1.01, len(Q))
    law = fit_local_law(rings_of(run, ux, sd), P, Q * P / 0.5, inversion(0.5), draws=FEW)
    assert law.mu == pytest.approx(world.MU, rel=0.005)
    assert pytest.approx(world.L, rel=0.05) == law.L
    assert np.flatnonzero(np.isnan(law.D)).tolist() == [5]


def test_a_frame_may_show_a_ring_more_than_the_first() -> None:
    P = 0.5
    _, rings, Q = measured(P, ROUGH, seed=3)
    one = rings[0]
    first = Rings(one.radius[:-1], one.mean[:-1], one.standard_error[:-1], one.count[:-1])
    law = fit_local_law([first, *rings[1:]], P, Q, inversion(P), draws=FEW)
    assert pytest.approx(found(P, ROUGH, draws=FEW)[1].L, rel=0.01) == law.L


def test_another_law_is_told_by_its_misfit():
    run = world.drive(0.5, 40, ROUGH, end=1.5, law=world.hyperbolic_tangent)
    ux, sd, Q = run.measured(NOISE, 6)
    law = fit_local_law(rings_of(run, ux, sd), 0.5, Q, inversion(0.5), draws=FEW)
    assert law.reduced_chi2 > 4
    assert "does not follow mu p (1 - exp(-s/(mu L)))" in law.notes[1]
    assert doubts(law.notes) == [law.notes[1]]


def test_what_cannot_be_told_is_not():
    _, rings, Q = measured(0.5, ROUGH, 5)
    nothing = [replace(one, mean=np.full_like(one.mean, np.nan)) for one in rings]
    backwards = [replace(one, mean=-one.mean) for one in rings]
    early = Q < 0.75 * world.MU * 0.5
    cases = {
        "11 frames": (rings[:11], 0.5, Q[:11]),
        "0 frames": (nothing, 0.5, Q),
        "with a noise of": (rings, 0.5, 0 * Q),
        "without contact": (rings, 0.0, Q),
        "check its sign": (rings, 0.5, np.where(Q > 0.4, -Q, Q)),
        "drive further": ([r for r, e in zip(rings, early, strict=True) if e], 0.5, Q[early]),
        "stands out of the noise": (backwards, 0.5, Q),
    }
    for words, (given, P, force) in cases.items():
        law = fit_local_law(given, P, force, inversion(0.5), draws=FEW)
        assert np.isnan([law.mu, law.L, law.E, law.h]).all(), words
        assert words in law.notes[0], law.notes


def test_an_interface_too_stiff_to_be_told_is_said_to_be_so():
    """Cattaneo and Mindlin's displacements, in closed form."""
    P, mu, a = 0.5, 0.93, hertz.contact_radius(0.5, world.E, world.NU, world.R)
    op = inversion(P)
    r = op.radius[:58]
    forces = mu * P * np.append(np.linspace(0.02, 0.98, 40), np.ones(12))
    args = mu, P, a, world.E, world.NU
    g = np.array([cattaneo_mindlin.radial_displacement(r, Q, *args)[0] for Q in forces])
    D = cattaneo_mindlin.shift(forces, *args) + np.append(np.zeros(40), np.arange(12) * 1e-6)
    ux = D[:, None] - g + np.random.default_rng(2).normal(0, 3e-9, g.shape)
    count = op.points[:58].round().astype(int)
    rings = [Rings(r, row, np.full(58, 3e-9), count) for row in ux]
    law = fit_local_law(rings, P, forces, op, Q_sd=1e-4)
    assert not law.L > 0.1e-6


def test_hum_that_has_one_phase_in_all_frames_does_not_change_the_friction():
    """At 5 frames/s hum of 50 Hz is the same in all frames: mu was wrong by several uncertainties,
    which their scatter does not show.
    """
    run, rings, _ = measured(0.1, ROUGH, 3)
    time, noise = 1 + 0.2 * np.arange(len(rings)), np.random.default_rng(5)
    Q = run.Q + 0.8e-3 + noise.normal(0, 3e-4, len(rings))  # hum of 1 mN rms, over an exposure
    at = np.arange(0, time[-1], 1e-3)
    read = np.interp(at, time, run.Q) + math.sqrt(2) * 1e-3 * np.cos(2 * np.pi * 50 * at)
    samples = at, read, np.full(len(at), 0.1)
    args = rings, 0.1, Q, inversion(0.1)
    known = {"draws": FEW, "Q_sd": 3e-4, "time": time}
    by_frames = fit_local_law(*args, **known)
    law = fit_local_law(*args, **known, samples=samples)
    assert by_frames.mu - world.MU > 4 * by_frames.mu_sd
    assert abs(law.mu - world.MU) < 2 * law.mu_sd + 1e-3
    assert law.mu * law.L == pytest.approx(by_frames.mu * by_frames.L)  # what is measured over slip
    np.testing.assert_allclose(law.mu * law.pressure, by_frames.mu * by_frames.pressure)
    single = fit_local_law(*args, draws=0, Q_sd=3e-4, time=time, samples=samples)
    assert (single.mu, single.pressure[0]) == (law.mu, law.pressure[0])
    # of a fifth of the samples nothing is told
    few = (samples[0], np.where(at % 1 < 0.2, samples[1], np.nan), samples[2])
    assert fit_local_law(*args, draws=0, time=time, samples=few).mu == by_frames.mu


@pytest.mark.parametrize("shaken", [4, 20])
def test_one_shaken_picture_of_the_loading_does_not_begin_the_sliding(shaken):
    """All of the loading after it counted as sliding, for mu and for L."""
    run, rings, Q = measured(0.5, ROUGH, 3)
    time = 0.5 * np.arange(len(rings))
    at = np.arange(0, time[-1], 1e-3)
    samples = at, np.interp(at, time, run.Q), np.full(len(at), 0.5)
    sound = fit_local_law(rings, 0.5, Q, inversion(0.5), draws=FEW, time=time, samples=samples)
    rings[shaken] = replace(rings[shaken], mean=rings[shaken].mean + 10e-6)
    law = fit_local_law(rings, 0.5, Q, inversion(0.5), draws=FEW, time=time, samples=samples)
    assert law.mu == pytest.approx(sound.mu, abs=1e-4)
    assert pytest.approx(sound.L, rel=0.02) == law.L
    assert "mu from samples" in law.notes[0]
    (bare,) = fit_local_law(rings, 0.5, Q, inversion(0.5), draws=FEW).notes[:1]
    assert bare.endswith("mu from frames")


def test_several_loads_have_one_interface():
    loads = np.array([0.1, 0.5, 1.4])
    laws = [found(P, ROUGH)[1] for P in loads.tolist()]
    joint = joint_law(laws, loads)
    assert joint.E.value == pytest.approx(world.E, rel=0.003)
    assert joint.L.value == pytest.approx(world.L, rel=0.01)
    assert joint.mu.value == pytest.approx(world.MU, rel=0.003)
    assert abs(joint.decay) < 4 * joint.decay_sd < 0.02
    assert not joint.notes
    falling = [replace(law, mu=law.mu * P**-0.1) for law, P in zip(laws, loads, strict=True)]
    assert joint_law(falling, loads).decay == pytest.approx(0.1, abs=0.01)
    harder = [*laws[:2], replace(laws[2], E=1.1 * laws[2].E)]
    assert "E differs from load to load" in joint_law(harder, loads).notes[0]
    assert "runs with a law: 1;" in joint_law([laws[0], LocalLaw()], loads[:2]).notes[0]


@pytest.mark.parametrize(
    ("pitch", "doubt"), [(0.07e-3, 0.0027), (0.14e-3, 0.011), (0.28e-3, 0.044)]
)
def test_wide_rings_tell_the_length_less_well(pitch, doubt):
    """Fields of single points, without boxes."""
    contact = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=0.1288, mu=0.9, L=0.8e-6)
    loading, r = AxisymmetricLoading(contact, modes=40), np.linspace(0, 6.5e-3, 2000)
    states = [loading.driven(D) for D in np.linspace(1e-6, 80e-6, 40)]
    n = round(3.5e-3 / pitch)
    x, rng = pitch * np.arange(-n, n + 1), np.random.default_rng(1)
    at = np.hypot(*np.meshgrid(x, x))
    fields = np.stack([np.interp(at, r, s.D - s.displacement(r)[0]) for s in states])
    fields += 20e-9 * rng.standard_normal(fields.shape)
    law = friction_law(x, x, fields, 0.5, [s.Q for s in states], E=3.2e6, nu=0.5, R=0.1288)
    assert abs(law.L - contact.L) < 2 * law.L_sd
    assert doubt < law.L_sd / law.L < 2.5 * doubt
