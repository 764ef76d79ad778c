"""NI drivers and emulated boards, each in a world of its own, and what tests do to them."""

import contextlib

import grpc
import numpy as np
from worlds import TINY, scenario

from drivers.clock import SampleClock
from drivers.daq.ni_daq import NiForces
from drivers.emulators.ni import EmulatedNiForces
from drivers.emulators.ni_server import NiServer
from drivers.protocols import SampleBlock
from drivers.settings import ForceSettings
from drivers.sim.world import World

PATIENT = {"answer_time": 20.0}  # a busy computer may be late
QUICK = scenario(**TINY, press_time=0.1, press_samples=100)


class TlsServer(NiServer):
    """A server whose connections are encrypted, with private key and certificate (PEM)."""

    def __init__(self, world, tls, **board):
        self._tls = tls
        super().__init__(world, **board)

    def _bind(self, where):
        return self._server.add_secure_port(where, grpc.ssl_server_credentials([self._tls]))


class NiBench(contextlib.ExitStack):
    """Makes drivers that are not yet open, and servers; closes them at its end."""

    def emulated(self, *faults, pace=None, **settings):
        """A driver with the board that it emulates; `world` is what that looks at."""
        settings = PATIENT | settings
        rate = settings.get("sample_rate", 1000)
        here = scenario(QUICK, faults=faults, press_time=100 / rate, **settings)
        world = World(here, pace)
        forces = EmulatedNiForces(here.forces, SampleClock(float(rate)), world)
        forces.world = world
        self.callback(forces.close)
        return forces

    def serve(self, pace=None, **options):
        """A server with an emulated board; `world` is what it looks at."""
        world = World(QUICK, pace)
        kind = TlsServer if "tls" in options else NiServer
        server = kind(world, renew=lambda: World(QUICK, pace), **options)
        server.world = world
        self.callback(server.close)
        return server

    def connect(self, address, rate=1000.0, **settings):
        """A driver for a server."""
        forces = NiForces(ForceSettings(server=address, **(PATIENT | settings)), SampleClock(rate))
        self.callback(forces.close)
        return forces


def pieces(forces, samples, now=0):
    """All that is read from sample `now` up to another, checked to follow one another."""
    read = []
    while now < samples:
        read.append(forces.read(20.0))
        assert read[-1].first == now
        now = read[-1].end
        assert now > read[-1].first
    return read


def reference(n, **settings):
    """What a second, identical world gives."""
    return World(scenario(QUICK, **settings), None).advance(n).volts


def check_samples(read):
    """All blocks hold what belongs to their numbers."""
    truth = reference(read[-1].end)
    for block in read:
        if isinstance(block, SampleBlock):
            np.testing.assert_array_equal(block.volts, truth[block.first : block.end])
