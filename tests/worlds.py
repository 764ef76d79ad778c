"""Scenarios of simulated worlds, in few words, and worlds in contact."""

from dataclasses import fields, replace

import numpy as np

from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

SECTIONS = ("sim", "sample", "forces", "camera")
SMOOTH = Scenario(sim=SimSettings(law="cattaneo-mindlin", pressure="hertz"))  # has closed forms
QUIET = Scenario(
    sim=SimSettings(press_time=0.0, force_noise=0.0, pressure="hertz"), press_samples=1
)  # pressed at once
TINY = {"width": 64, "height": 64}  # for cameras whose pictures nobody looks at


def scenario(base=SMOOTH, **changes):
    """A scenario with some settings changed, named as in the settings file, in SI units; a name
    that several sections have goes to the first of `SECTIONS`.
    """
    own = {f.name for f in fields(Scenario)} - set(SECTIONS)
    parts = {name: {} for name in SECTIONS}
    direct = {}
    for key, value in changes.items():
        if key in own:
            direct[key] = value
        else:
            part = next(n for n in SECTIONS if hasattr(getattr(base, n), key))
            parts[part][key] = value
    sections = {name: replace(getattr(base, name), **kw) for name, kw in parts.items()}
    return replace(base, **sections, **direct)


def pressed(**changes):
    """A world in contact, 10 samples after its start, whose forces have no noise."""
    world = World(scenario(QUIET, **changes), None)
    world.start()
    world.advance(10)
    return world


def carried_n(state):
    """The force that the traction of a state carries."""
    r = np.linspace(0, state.hertz_radius_m, 4001)
    return np.trapezoid(2 * np.pi * r * state.traction(r), r)
