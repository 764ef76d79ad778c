"""What makes one bench of any mix of devices: the sample clock that cameras look at, and a
simulated world that keeps up with what is real.

Exactly one party lets the simulated world's time pass: the simulated forces, the emulated board,
or, beside a real board, `ClockedForces`. Where the actuator is real and anything else is not, the
world's stage goes where the real one goes (`FollowedActuator`).
"""

from __future__ import annotations

from drivers.protocols import Actuator, Camera, ForceSource, LostSamples, SampleBlock, TriggerTrain
from drivers.scene import Scene

# force sources in which the world's time passes by itself
OWN_THE_TIME = frozenset({"sim", "nidaqmx-emulated"})
# actuators that move the world's stage themselves
OWN_THE_STAGE = frozenset({"sim", "smc100-emulated", "conex-cc-emulated"})


def connected(
    devices: tuple[ForceSource, Camera, Actuator], names: tuple[str, str, str], scene: Scene
) -> tuple[ForceSource, Camera, Actuator]:
    """The three devices, wrapped where one of them must be told what another one does; `names` are
    those of their drivers.
    """
    forces, camera, actuator = devices
    has_world = any(name == "sim" or name.endswith("-emulated") for name in names)
    leads = has_world and names[0] not in OWN_THE_TIME
    follows = has_world and names[2] not in OWN_THE_STAGE
    # where the stage is, it is at the last sample read
    in_read_time = names[2] == "replay" or (leads and names[2] in OWN_THE_STAGE)
    return (
        ClockedForces(forces, scene, leads=leads, stage_in_read_time=in_read_time),
        camera,
        FollowedActuator(actuator, scene) if follows else actuator,
    )


class ClockedForces:
    """A force source that tells the scene's clock of every block that is read; `leads`: the world's
    time passes with it too.
    """

    def __init__(
        self, forces: ForceSource, scene: Scene, *, leads: bool, stage_in_read_time: bool = False
    ) -> None:
        self.device = forces
        self.name = forces.name
        self.sample_rate_hz = forces.sample_rate_hz
        self.block_samples = forces.block_samples
        self.counts_exposures = forces.counts_exposures
        self._scene = scene
        self._leads = leads
        self._stage_in_read_time = stage_in_read_time

    def open(self) -> None:
        """See `drivers.protocols.ForceSource`, as for all methods here."""
        self.device.open()

    def describe(self) -> str:
        """What the device says of itself."""
        return self.device.describe()

    def start(self, train: TriggerTrain) -> None:
        """Start the device, and with it the clock."""
        self._scene.clock.start(counts_exposures=self.counts_exposures)
        if self._leads:
            self._scene.world.start(train)
        self.device.start(train)

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block; the clock is told before it is handed over."""
        block = self.device.read(timeout_s)
        if self._leads:
            self._scene.world.advance(block.end - self._scene.world.now)
        if isinstance(block, SampleBlock):
            self._scene.clock.advance(block.end, block.exposures)
        elif (
            not self.counts_exposures
        ):  # else what was exposed in the gap is known with the next block
            self._scene.clock.advance(block.end)
        return block

    def backlog(self) -> int:
        """Samples of the device that wait to be read; none where the stage knows no later time than
        that of the last one read.
        """
        return 0 if self._stage_in_read_time else self.device.backlog()

    def stop(self) -> None:
        """Stop the device, and with it the clock."""
        self.device.stop()
        self._end()

    def close(self) -> None:
        """Stop the clock, let go of the device."""
        try:
            self.device.close()
        finally:
            self._end()

    def _end(self) -> None:
        self._scene.clock.stop()
        if self._leads and self._scene.world.phase == "running":
            self._scene.world.stop()


class FollowedActuator:
    """A real actuator beside a simulated world, whose stage is put where each reading of the
    position says.
    """

    def __init__(self, actuator: Actuator, scene: Scene) -> None:
        self.device = actuator
        self.name = actuator.name
        self._scene = scene
        self._start_m: float | None = None

    @property
    def travel_limits_m(self) -> tuple[float, float]:
        """Travel of the device, known once it is open."""
        return self.device.travel_limits_m

    @property
    def velocity_limit_m_s(self) -> float:
        """Limit of the device, known once it is open."""
        return self.device.velocity_limit_m_s

    def open(self) -> None:
        """See `drivers.protocols.Actuator`, as for all methods here."""
        self.device.open()

    def describe(self) -> str:
        """What the device says of itself."""
        return self.device.describe()

    def home(self) -> None:
        """Find the origin."""
        self.device.home()

    def set_velocity(self, velocity_m_s: float) -> None:
        """Speed of the moves to come."""
        self.device.set_velocity(velocity_m_s)

    def move_to(self, position_m: float) -> None:
        """Start a bounded move."""
        self.device.move_to(position_m)

    def position_m(self) -> float:
        """Where the device is; the world's stage goes there too."""
        here = self.device.position_m()
        if self._start_m is None:
            self._start_m = here
        self._scene.world.follow(here - self._start_m)
        return here

    def is_moving(self) -> bool:
        """Whether the device moves."""
        return self.device.is_moving()

    def stop(self) -> None:
        """End any motion now."""
        self.device.stop()

    def close(self) -> None:
        """Stop, and let go of the device."""
        self.device.close()
