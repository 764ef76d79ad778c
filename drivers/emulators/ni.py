"""The real driver of NI boards on an emulated one, in this process, through NI's own package and
its network protocol.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivers.clock import SampleClock
from drivers.daq.ni_daq import NiForces
from drivers.daq.ni_errors import need
from drivers.settings import ForceSettings
from drivers.sim.world import World

if TYPE_CHECKING:
    from drivers.emulators.ni_server import NiServer


class EmulatedNiForces(NiForces):
    """`NiForces`, together with the server and its emulated board while it is open."""

    server: NiServer | None = None

    def __init__(self, settings: ForceSettings, clock: SampleClock, world: World) -> None:
        super().__init__(settings, clock)
        self._world = world

    def _connect(self) -> None:
        need(self.name, "grpc")
        from drivers.emulators.ni_server import NiServer

        s = self._settings
        self.server = NiServer(
            self._world,
            device=s.device,
            sensors=(*s.channels, *(found.channel for found in s.auxiliary_channels)),
            exposure_terminal=s.exposure_terminal,
        )
        self._settings = replace(s, server=self.server.address, certificate="")
        super()._connect()

    def close(self) -> None:
        """Let go of the board, and end the server."""
        try:
            super().close()
        finally:
            server, self.server = self.server, None
            if server is not None:
                server.close()
