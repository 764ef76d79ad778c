"""What the devices of one bench share: the sample clock, and one simulated world for all that are
not real.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from drivers.clock import SampleClock
from drivers.errors import DeviceNotFound

if TYPE_CHECKING:
    from drivers.sim.settings import WorldSettings
    from drivers.sim.world import World
    from drivers.stored import Recording


class Scene:
    """Handed to every driver when it is made.

    Parameters
    ----------
    settings : WorldSettings, optional
        What the simulated world is made of.
    pace : float or None
        Simulated seconds per second of the wall clock; None: as fast as it is read.
    recording : Recording, optional
        What the stored devices play.

    Attributes
    ----------
    clock : SampleClock
        Fed by the bench with every block of forces that is read.
    """

    def __init__(
        self,
        settings: WorldSettings | None = None,
        pace: float | None = 1.0,
        recording: Recording | None = None,
    ) -> None:
        self.clock = SampleClock()
        self.pace = pace
        self._settings = settings
        self._recording = recording

    @property
    def recording(self) -> Recording:
        """The recorded experiment that the stored devices play.

        Raises
        ------
        DeviceNotFound
            None was given.
        """
        if self._recording is None:
            raise DeviceNotFound(
                "stored devices: a recorded experiment was asked, none is named; set replay.session"
                " to its file"
            )
        return self._recording

    @cached_property
    def world(self) -> World:
        """The simulated world, made when the first device asks for it: a bench of real devices has
        none.
        """
        from drivers.sim.world import World, WorldSettings

        return World(self._settings or WorldSettings(), self.pace)
