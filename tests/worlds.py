"""Scenarios of simulated worlds, in few words."""

from dataclasses import fields, replace

from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings

SECTIONS = ("sim", "sample", "forces", "camera")
SMOOTH = Scenario(sim=SimSettings(law="cattaneo-mindlin", pressure="hertz"))  # has closed forms
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
