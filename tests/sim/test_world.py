"""The simulated world: its loading curve, its noise, its truth, each against an evaluation of its
own.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import brentq
from worlds import scenario

from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.half_space import SurfaceGreen
from drivers.errors import OutOfLimits
from drivers.sim.scenario import PRESS_SHIFT_PX
from drivers.sim.world import World

BASE = scenario(press_time=0.2, press_samples=300, width=320, height=240, pixel=35.2e-6)
SETTLED, START = 500, 600


def driven(distance_m=190e-6, velocity=100e-6, **changes):
    """A world whose stage began to drive at sample 600, at rest since a while where the drive is
    complete.
    """
    world = World(scenario(BASE, **{"slow_actuator": False, **changes}), pace=None)
    world.advance(START)
    world.move(distance_m, velocity)
    world.advance(int(distance_m / velocity * 1100) + 200)
    return world


def constants(s):
    a = hertz.contact_radius(
        s.normal_force, s.sample.young_modulus, s.sample.poisson, s.sample.lens_radius
    )
    limit = s.sim.friction * s.normal_force
    shear_modulus = s.sample.young_modulus / (2 * (1 + s.sample.poisson))
    compliance = 1 / s.forces.stiffness_shear + s.sample.lens_compliance
    delta_max = 3 * limit * (2 - s.sample.poisson) / (16 * shear_modulus * a)
    return a, limit, shear_modulus, compliance, delta_max


@pytest.mark.parametrize("normal_force", [0.1, 0.5, 1.4])
def test_initial_slope_is_cantilever_lens_and_contact_in_series(normal_force):
    world = driven(normal_force=normal_force, velocity=1e-6, distance_m=1e-7)
    s = world.scenario
    a, _, shear_modulus, compliance, _ = constants(s)
    state = world.state(START + 10)
    assert state.shear_force_n / state.stage_m == pytest.approx(
        1 / (compliance + (2 - s.sample.poisson) / (8 * shear_modulus * a)), rel=1e-3
    )


@pytest.mark.parametrize("normal_force", [0.1, 0.5, 1.4])
def test_sliding_plateau_and_onset(normal_force):
    world = driven(normal_force=normal_force, distance_m=400e-6)
    s = world.scenario
    _, limit, _, compliance, delta_max = constants(s)
    onset = START + (delta_max + limit * compliance) / 100e-6 * s.forces.sample_rate
    assert world.onset_sample() == int(np.ceil(onset))
    before, after = world.state(world.onset_sample() - 1), world.state(world.onset_sample())
    assert before.shear_force_n < limit
    assert before.stick_radius_m > 0
    assert (after.shear_force_n, after.stick_radius_m) == (limit, 0)
    end = world.state(world.now)
    assert end.shear_force_n == limit
    assert end.block_m - after.block_m == pytest.approx(end.stage_m - after.stage_m, rel=1e-12)


def test_no_onset_before_there_is_one():
    world = driven(distance_m=60e-6)
    assert world.onset_sample() is None
    assert world.truth(world.now).onset_sample is None
    assert driven().truth(START).mu_s == 0.93


def test_the_stage_the_cantilever_and_the_contact_add_up():
    """Between onset of the drive and sliding, Q is where a root finder puts it."""
    world = driven()
    s = world.scenario
    a, limit, _, compliance, delta_max = constants(s)
    for sample in range(START + 50, world.onset_sample(), 97):
        state = world.state(sample)
        travel = (sample - START) * 1e-7

        def excess(Q, travel=travel):
            return delta_max * (1 - (1 - Q / limit) ** (2 / 3)) + Q * compliance - travel

        assert state.shear_force_n == pytest.approx(brentq(excess, 0, limit, xtol=1e-15), rel=1e-9)
        assert state.stick_radius_m == pytest.approx(
            a * (1 - state.shear_force_n / limit) ** (1 / 3), rel=1e-9
        )
        assert state.block_m == pytest.approx(
            travel - state.shear_force_n / s.forces.stiffness_shear, rel=1e-12
        )
        assert state.lens_m == s.sample.lens_compliance * state.shear_force_n
        assert state.lens_centre_m[0] - state.lens_m == pytest.approx(
            s.contact_centre_px[0] * s.camera.pixel, rel=1e-14
        )
        g0, g2 = state.radial(np.linspace(0, state.stick_radius_m, 5))
        # the stick zone moves with the lens
        np.testing.assert_allclose(state.block_m - g0, state.lens_m, rtol=0, atol=1e-14)
        np.testing.assert_allclose(g2, 0, atol=1e-18)


def test_pressing_is_smooth_and_ends_at_the_normal_force():
    world = driven()
    s = world.scenario
    states = [world.state(i) for i in range(150, SETTLED + 20)]
    P = np.array([state.normal_force_n for state in states])
    assert (P[:50] == 0).all()
    assert (P[SETTLED - 150 :] == s.normal_force).all()
    assert (np.diff(P) >= 0).all()
    assert np.abs(np.diff(P, 2)).max() < 1e-4
    assert states[0].apparent_radius_m == states[0].hertz_radius_m == 0
    assert states[-1].apparent_radius_m == pytest.approx(
        constants(s)[0] + np.sqrt(s.sample.lens_radius * s.sample.roughness)
    )
    np.testing.assert_allclose(np.array(states[-1].rigid_m) / s.camera.pixel, PRESS_SHIFT_PX)
    np.testing.assert_array_equal(states[0].radial([0.0, 1e-3]), 0)


@pytest.mark.parametrize(
    ("normal_force", "asked_5_gives"), [(0.1, 4.9), (0.75, 4.83), (1.4, 4.76), (3.0, 4.76)]
)
def test_the_stage_is_as_slow_as_the_papers(normal_force, asked_5_gives):
    world = driven(normal_force=normal_force, slow_actuator=True, velocity=5e-6, distance_m=20e-6)
    assert world.state(START + 2000).stage_m == pytest.approx(2 * asked_5_gives * 1e-6, rel=1e-12)


def test_before_contact_the_block_follows_the_stage():
    world = World(scenario(BASE, slow_actuator=False), pace=None)
    world.move(10e-6, 100e-6)
    world.advance(600)
    assert world.state(50).rigid_m == (pytest.approx(5e-6), 0)
    assert world.state(600).rigid_m[0] == pytest.approx(10e-6 + 3.3 * world.scenario.camera.pixel)
    assert world.state(600).shear_force_n == world.state(600).block_m == 0


def test_a_move_back_in_contact_is_refused_and_changes_nothing():
    world = driven(distance_m=50e-6)
    stage = world.stage_m()
    with pytest.raises(OutOfLimits, match="move back by 20 um"):
        world.move(30e-6, 1e-6)
    world.advance(100)
    assert world.stage_m() == stage


def test_a_move_that_lasts_into_the_pressing_is_refused():
    world = World(BASE, pace=None)
    world.advance(100)
    with pytest.raises(OutOfLimits, match="pressing"):
        world.move(20e-6, 100e-6)
    world.move(5e-6, 100e-6)
    world.advance(200)
    with pytest.raises(OutOfLimits, match="pressing"):
        world.move(6e-6, 1e-3)
    world.move(5e-6, 1e-3)  # it stands there
    world.advance(200)
    world.move(6e-6, 100e-6)


def run_in_blocks(sizes, seed=3):
    world = World(scenario(BASE, seed=seed), pace=None)
    volts = [world.advance(START).volts]
    world.move(190e-6, 100e-6)
    volts += [world.advance(n).volts for n in sizes]
    return np.concatenate(volts)


WHOLE = run_in_blocks([1700])


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=12))
def test_the_readings_do_not_depend_on_the_block_size(sizes):
    volts = run_in_blocks(sizes)
    n = min(len(volts), len(WHOLE))
    np.testing.assert_array_equal(volts[:n], WHOLE[:n])


def test_another_seed_gives_other_noise():
    assert (run_in_blocks([100], seed=4) != WHOLE[: START + 100]).any()


def test_readings_are_the_coupled_forces_with_white_noise_on_the_boards_steps():
    world = driven(zero=(0.11, -0.07), distance_m=80e-6)
    s = world.scenario
    again = World(s, pace=None)
    volts = np.concatenate(
        [again.advance(START).volts, (again.move(80e-6, 100e-6), again.advance(1000).volts)[1]]
    )
    forces = np.array(
        [(t.normal_force_n, t.shear_force_n) for t in map(world.state, range(len(volts)))]
    )
    readings = (volts - s.forces.zero) * np.multiply(s.forces.stiffness, s.forces.sensitivity)
    noise = readings - forces @ np.array(s.forces.coupling).T
    np.testing.assert_allclose(noise.std(axis=0), 1e-3, rtol=0.08)
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=1e-4)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.1
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.1
    codes = volts / (20 / 65536)
    np.testing.assert_array_equal(codes, np.rint(codes))


def test_readings_saturate_at_the_boards_range():
    volts = driven(normal_force=3.0, zero=(0.0, -20.0)).advance(10).volts
    np.testing.assert_array_equal(volts, [[10 - 20 / 65536, -10.0]] * 10)


@pytest.mark.parametrize(("poisson", "angle"), [(0.3, 0.0), (0.5, 0.0), (0.5, 0.17)])
def test_truth_in_pixels_against_material_points_found_one_by_one(poisson, angle):
    drift = (0.4, -1.1) if angle else (0.0, 0.0)
    world = driven(poisson=poisson, lens_compliance=5e-6, drive_angle=angle, image_drift=drift)
    s = world.scenario
    reference, sample = START + 300, START + 1300

    def material(x, y, state):
        there = (x - state.lens_centre_m[0] + 1j * (y - state.lens_centre_m[1])) * np.exp(
            -1j * angle
        )  # as seen along the drive
        gx, gy = cattaneo_mindlin.displacement(
            there.real,
            there.imag,
            state.shear_force_n,
            s.sim.friction,
            s.normal_force,
            state.hertz_radius_m,
            s.sample.young_modulus,
            s.sample.poisson,
        )
        g = (gx + 1j * gy) * np.exp(1j * angle)
        return x - state.rigid_m[0] + g.real, y - state.rigid_m[1] + g.imag

    x, y = np.meshgrid(np.linspace(2, 317, 12), np.linspace(3, 236, 9))
    ux, uy = world.truth(sample).displacement_px(x, y, reference)
    seen = material((x + ux) * s.camera.pixel, (y + uy) * s.camera.pixel, world.state(sample))
    was = material(x * s.camera.pixel, y * s.camera.pixel, world.state(reference))
    np.testing.assert_allclose(seen, was, rtol=0, atol=1e-13)
    assert ux.max() - ux.min() > 0.5
    assert np.abs(uy).max() > 0.02
    centre = np.array(world.state(sample).lens_centre_m) - np.array(
        world.state(reference).lens_centre_m
    )
    shear = world.state(sample).shear_force_n - world.state(reference).shear_force_n
    # 1000 samples at 1 kHz
    moved = (
        5e-6 * shear * np.array([np.cos(angle), np.sin(angle)]) + np.array(drift) * s.camera.pixel
    )
    np.testing.assert_allclose(centre, moved, rtol=1e-9, atol=1e-15)


def test_a_drifting_stage_drives_the_contact_without_saying_so():
    still, drifting = driven(distance_m=50e-6), driven(distance_m=50e-6, stage_drift=1e-6)
    sample = START + 400
    assert drifting.state(sample).stage_m == still.state(sample).stage_m
    compliance = constants(still.scenario)[3]
    for world in (still, drifting):
        state = world.state(sample)
        drift = world.scenario.sim.stage_drift * (sample - SETTLED) / 1000
        Q = state.shear_force_n
        shift = cattaneo_mindlin.shift(Q, 0.93, 0.5, state.hertz_radius_m, 3.43e6, 0.5)
        assert shift + compliance * Q == pytest.approx(state.stage_m + drift, rel=1e-9)


def test_friction_decays_with_the_normal_force_as_asked():
    world = driven(normal_force=0.5, friction=0.9, friction_decay=0.1, distance_m=400e-6)
    assert world.state(world.now).shear_force_n == pytest.approx(0.5 * 0.9 * 0.5**-0.1, rel=1e-12)
    assert world.truth(world.now).mu_s == pytest.approx(0.9 * 0.5**-0.1, rel=1e-12)


def test_a_driven_block_moves_as_a_whole_far_away_and_by_the_slip_at_the_centre():
    world = driven(distance_m=400e-6)
    s = world.scenario
    _, limit, _, _, delta_max = constants(s)
    state = world.state(world.now)
    truth = world.truth(world.now)
    far, _ = truth.displacement_px(1e6, 3.0, START)
    assert far * s.camera.pixel == pytest.approx(
        400e-6 - limit / s.forces.stiffness_shear, rel=1e-4
    )
    g0, _ = state.radial(0.0)
    assert g0 == pytest.approx(delta_max)


def test_the_past_stays_as_it_was():
    world = World(BASE, pace=None)
    world.advance(START)
    world.move(190e-6, 100e-6)
    world.advance(300)
    then = [world.state(i) for i in range(0, world.now + 1, 25)]
    world.halt()
    world.advance(200)
    world.move(190e-6, 20e-6)
    world.advance(200)
    assert [world.state(i) for i in range(0, 901, 25)] == then
    assert world.state(1100).stage_m == then[-1].stage_m


def test_the_future_is_not_known():
    world = World(BASE, pace=None)
    with pytest.raises(ValueError, match="knows 0 to 0"):
        world.state(1)


@pytest.mark.parametrize("pace", [0, -1.0, float("nan"), float("inf")])
def test_a_pace_must_be_a_positive_number(pace):
    with pytest.raises(ValueError, match="pace"):
        World(BASE, pace=pace)


@pytest.mark.parametrize("thickness", [0.0, 15e-3])
def test_the_elasto_plastic_world_obeys_its_law_at_every_point(thickness):
    """Traction and surface displacement of the world, put into the law and into the operator of the
    block's surface.
    """
    world = driven(law="elasto-plastic", thickness=thickness, distance_m=300e-6)
    s = world.scenario
    a, limit, *_ = constants(s)
    for travel in (20e-6, 60e-6, 250e-6):
        state = world.state(START + round(travel / 1e-7))
        r = np.linspace(0, a, 40)[:-1]
        slip = state.block_m - state.lens_m - state.radial(r)[0]
        p = hertz.pressure(r, s.normal_force, a)
        np.testing.assert_allclose(
            state.traction(r), 0.93 * p * -np.expm1(-slip / (0.93 * 0.8e-6)), rtol=1e-6
        )
        rings = (np.arange(4000) + 0.5) * a / 4000
        force = (state.traction(rings) * 2 * np.pi * rings).sum() * a / 4000
        assert force == pytest.approx(state.shear_force_n, rel=1e-4)
        assert state.block_m + state.shear_force_n / s.forces.stiffness_shear == pytest.approx(
            travel, rel=1e-9
        )
        pitch = 2.4 * a / 121
        x, y = np.meshgrid(*2 * [(np.arange(121) - 60) * pitch])
        parts = [(k - 1) / 3 * pitch for k in range(3)]
        sigma = np.mean(
            [state.traction(np.hypot(x + dx, y + dy)) for dx in parts for dy in parts], axis=0
        )
        u = SurfaceGreen(
            (121, 121),
            pitch,
            s.sample.young_modulus,
            s.sample.poisson,
            thickness=thickness or np.inf,
        ).apply(sigma)
        gx = state.surface(x + state.lens_centre_m[0], y + state.lens_centre_m[1])[0]
        np.testing.assert_allclose(u, gx, atol=2e-3 * gx.max())
    assert state.shear_force_n == pytest.approx(limit, rel=1e-9)
    # where the line through the centre's slip in steady sliding begins
    begins = START + (travel - (state.block_m - state.lens_m - state.radial(0.0)[0])) / 1e-7
    assert world.onset_sample() == pytest.approx(begins, abs=1)
    assert world.truth(world.now).mu_s == pytest.approx(
        world.state(world.onset_sample()).shear_force_n / 0.5, abs=3e-4
    )  # a sample late
    assert world.truth(world.now).mu_s < 0.925


def test_a_finite_thickness_needs_a_law_that_has_it():
    with pytest.raises(ValueError, match="finite thickness"):
        World(scenario(BASE, thickness=15e-3))
    with pytest.raises(ValueError, match=r"law must be .* found 'viscous'"):
        scenario(BASE, law="viscous")


def write_law(path, slip_m, share):
    lines = [f"{a * 1e6!r},{b!r}\n" for a, b in zip(slip_m, share, strict=True)]
    path.write_text("".join(lines))
    return str(path)


def test_a_tabulated_law_is_obeyed_as_well(tmp_path):
    slip = np.linspace(0, 12e-6, 400)
    # saturates differently from an exponential
    share = slip / 1.2e-6 / (1 + slip / 1.2e-6) * (1 + 0.1)
    share = np.minimum(share, 1.0)
    share[-1] = 1.0
    table = write_law(tmp_path / "law.csv", slip.tolist(), share.tolist())
    world = driven(law="table", law_table=table, distance_m=300e-6)
    s = world.scenario
    a, limit, *_ = constants(s)
    for travel in (30e-6, 70e-6, 250e-6):
        state = world.state(START + round(travel / 1e-7))
        r = np.linspace(0, a, 30)[:-1]
        found = state.block_m - state.lens_m - state.radial(r)[0]
        expected = 0.93 * hertz.pressure(r, s.normal_force, a) * np.interp(found, slip, share)
        np.testing.assert_allclose(
            state.traction(r), expected, rtol=5e-3, atol=1e-3 * expected.max()
        )
        rings = (np.arange(2000) + 0.5) * a / 2000
        assert (state.traction(rings) * 2 * np.pi * rings).sum() * a / 2000 == pytest.approx(
            state.shear_force_n, rel=1e-3
        )
    assert state.shear_force_n == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize(
    "table",
    [
        ((0, 0),),
        ((0, 0.1), (1e-6, 1)),
        ((0, 0), (1e-6, 0.9)),
        ((0, 0), (1e-6, 0.6), (2e-6, 0.5), (3e-6, 1)),
    ],
)
def test_a_table_that_is_no_law_is_refused(table, tmp_path):
    path = write_law(tmp_path / "law.csv", *zip(*table, strict=True))
    with pytest.raises(ValueError, match="rise from 0"):
        World(scenario(BASE, law="table", law_table=path))


def test_an_empty_table_is_refused(tmp_path):
    path = write_law(tmp_path / "law.csv", (), ())
    with pytest.raises(ValueError, match="no data"):
        World(scenario(BASE, law="table", law_table=path))
