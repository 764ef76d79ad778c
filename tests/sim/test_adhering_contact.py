"""Smooth faces of the simulated world that adhere: closed forms, history, what is refused."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from analysis.settings import Sample
from app.runs.live import make_run, scenario
from app.settings.config import load
from app.settings.hung_weights import pressed_loads
from app.settings.protocol_steps import Approach, Ask, Drive, Hold
from app.system.errors import UserError
from drivers.errors import OutOfLimits
from drivers.sim.adhering_contact import adhering_contact
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

SAMPLE = Sample(young_modulus=3.43e6, poisson=0.5, lens_radius=0.1288)
STIFF = 3.43e6 / 0.75  # E*
W = 0.05
PULL_OFF = -1.5 * math.pi * W * 0.1288


def radius(*loads, adhesion=(W, W)):
    return adhering_contact(loads, adhesion, SAMPLE).radius


def cubed(times):
    """Radius of times pi w R^2/E*: 9/2 where nothing pulls, 9/8 as it parts (Johnson, 5.5)."""
    return (times * math.pi * W * 0.1288**2 / STIFF) ** (1 / 3)


def test_the_faces_touch_under_no_force_and_part_under_the_pull_off():
    assert radius() == 0
    assert radius(0.0) == pytest.approx(cubed(9 / 2), rel=1e-12)
    assert radius(0.3, PULL_OFF * (1 - 1e-12)) == pytest.approx(cubed(9 / 8), rel=1e-5)
    assert radius(0.3, PULL_OFF * 1.001) == 0
    # they do not come together again before they are pressed
    assert radius(0.3, PULL_OFF * 1.001, PULL_OFF / 2) == 0
    assert radius(0.3, PULL_OFF * 1.001, PULL_OFF / 2, 0.0) == pytest.approx(cubed(9 / 2))


def test_the_edge_rests_until_the_force_has_fallen_far_enough():
    """P = 4 E* a^3/(3 R) - sqrt(8 pi w E* a^3), for the w of closing, then for that of opening."""
    both = W, 2 * W
    a = radius(0.3, adhesion=both)
    closing, opening = (
        4 * STIFF * a**3 / (3 * 0.1288) - math.sqrt(8 * math.pi * w * STIFF * a**3) for w in both
    )
    assert closing == pytest.approx(0.3)
    assert radius(0.3, opening + 1e-6, adhesion=both) == a
    assert radius(0.3, opening - 1e-3, adhesion=both) < a
    assert radius(0.3, opening - 1e-3, 0.3, adhesion=both) == pytest.approx(a)


@pytest.mark.parametrize("loads", [(0.3,), (0.3, 0.26), (0.3, -0.01)])
def test_the_pressure_adds_up_to_the_force(loads):
    contact = adhering_contact(loads, (W, 2 * W), SAMPLE)
    # r = a sin t takes the pull at the edge away
    total, _ = quad(
        lambda t: (
            2 * math.pi * contact.radius**2 * math.sin(t) * math.cos(t)
            * float(contact.pressure(contact.radius * math.sin(t)))
        ),
        0, math.pi / 2 - 1e-9,
    )  # fmt: skip
    assert total == pytest.approx(loads[-1], rel=1e-6)
    assert contact.pressure(1.001 * contact.radius) == 0


STEPS = (Approach(normal_force=0.2), Hold(time=2.0), Approach(normal_force=0.1), Hold(time=1.0))


def test_the_simulated_operator_presses_to_one_load_after_the_other():
    # pressed in 1 s, settled in another, held for 2 s, and a second later
    assert pressed_loads(STEPS, 1000, 1.0) == [(0.0, 0.2), (5000.0, 0.1)]
    assert pressed_loads((*STEPS, Drive(travel=1e-5, velocity=5e-6)), 1000, 1.0) == [(0.0, 0.1)]
    assert pressed_loads((STEPS[0], Ask(), *STEPS[2:]), 1000, 1.0) == [(0.0, 0.1)]
    assert pressed_loads(STEPS[:1] * 3, 1000, 1.0) == [(0.0, 0.2)]
    assert pressed_loads((), 1000, 1.0) == []


def test_a_world_goes_through_its_loads_and_is_not_driven():
    config = load(None, ["sim.pressure=jkr", "sim.adhesion=[50, 50]", "camera.width=64",
                         "camera.height=64", "dic.box=20", "sim.force_noise=0", "sim.press_time=1",
                         "run.settle_time=1", *_steps()])  # fmt: skip
    world = World(scenario(config), pace=None)
    world.start()
    assert world.state(0).apparent_radius_m == 0
    readings = world.advance(9000).volts[:, 0]
    newtons = config.forces.sensitivity_normal * config.forces.stiffness_normal
    seen = np.abs(readings - readings[0]) * newtons
    for sample, P in ((900, 0.0), (4000, 0.2), (8500, 0.1)):
        state = world.state(sample)
        assert state.normal_force_n == pytest.approx(P)
        assert seen[sample] == pytest.approx(P, abs=2e-4)
        assert state.apparent_radius_m == pytest.approx(radius(P) if P else 0)
    assert world.state(6400).apparent_radius_m == pytest.approx(
        radius(world.state(6400).normal_force_n)
    )
    with pytest.raises(OutOfLimits, match="adheres or whose load is changed"):
        world.move(1e-5, 5e-6)


def _steps():
    loads = ("{do = 'approach', normal_force = 0.2}", "{do = 'hold', time = 2}",
             "{do = 'approach', normal_force = 0.1}", "{do = 'hold', time = 1}")  # fmt: skip
    return ["run.purpose=calibration", f"run.steps=[{', '.join(loads)}]".replace("'", '"')]


def test_parting_does_not_take_less_work_than_coming_together():
    with pytest.raises(ValueError, match=r"sim\.adhesion: 80 mJ/m2 of closing and 50 of opening"):
        SimSettings(adhesion=(0.08, 0.05))


def test_faces_that_adhere_are_not_driven(tmp_path):
    with pytest.raises(UserError, match=r"faces that adhere .* are not driven"):
        make_run(load(None, ["sim.pressure=jkr", "run.steps=[]"]), tmp_path / "a.h5", pace=None)
