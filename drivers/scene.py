"""What the devices of one bench share: the sample clock, and one simulated world for all that are not real."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from drivers.clock import SampleClock

if TYPE_CHECKING:
    from drivers.sim.settings import WorldSettings
    from drivers.sim.world import World


class Scene:
    """Handed to every driver when it is made.

    Parameters
    ----------
    settings : WorldSettings, optional
        What the simulated world is made of.
    pace : float or None
        Simulated seconds per second of the wall clock; None: as fast as it is read.

    Attributes
    ----------
    clock : SampleClock
        Fed by the bench with every block of forces that is read.
    """

    def __init__(self, settings: WorldSettings | None = None, pace: float | None = 1.0) -> None:
        self.clock = SampleClock()
        self.pace = pace
        self._settings = settings

    @cached_property
    def world(self) -> World:
        """The simulated world, made when the first device asks for it: a bench of real devices has none."""
        from drivers.sim.world import World, WorldSettings

        return World(self._settings or WorldSettings(), self.pace)
