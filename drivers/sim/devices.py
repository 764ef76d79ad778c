"""The three simulated devices: force source, camera and actuator, all in one simulated world."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from analysis.arrays import U8
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, OutOfLimits
from drivers.motion import check_target, check_velocity
from drivers.protocols import Frame, LostFrame, LostSamples, SampleBlock, TriggerTrain
from drivers.sim.row_times import states_shown
from drivers.sim.scenario import ADC_BITS
from drivers.sim.truth import TrueState
from drivers.sim.world import World

ENCODER_M = 0.035e-6
TRAVEL_M = 25e-3
CAMERA_ON_S = 1000.0  # before sample 0: its clock counts from then
HOME_VELOCITY_M_S = 0.5e-3
_FIRST_COUNT = round(TRAVEL_M / 2 / ENCODER_M)


class SimForces:
    """The simulated DAQ board: noisy, coupled, quantised voltages.

    Time passes in the world only when the board is read.
    """

    name = "simulated forces"

    def __init__(self, world: World) -> None:
        self._world = world
        self._is_open = False
        settings = world.scenario.forces
        self.sample_rate_hz = float(settings.sample_rate)
        self.block_samples = settings.block
        self.counts_exposures = bool(settings.exposure_counter)

    def open(self) -> None:
        """Claim the board."""
        if fault := self._world.faults.needs_emulated("forces"):
            raise DeviceError(
                f"{self.name}: they come from no server; choose an emulated board for the fault"
                f" '{fault}'"
            )
        self._is_open = True

    def describe(self) -> str:
        """Rate and resolution."""
        return f"two sensors at {self.sample_rate_hz:g} Hz, {ADC_BITS} bit"

    def start(self, train: TriggerTrain) -> None:
        """Start sampling at sample 0 and the trigger train with it."""
        _check(self._is_open, self.name)
        self._world.start(train)

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block, once pace and camera allow it; see `ForceSource.read`."""
        _check(self._is_open, self.name)
        world, faults = self._world, self._world.faults
        if faults.since("daq-gone", world.now + self.block_samples):
            raise DeviceFault(
                f"{self.name}: the board no longer answers at sample {world.now}; check its cable"
                " and start again"
            )
        end = world.now + self.block_samples
        overflows = (f for f in faults.all if f.kind == "daq-overflow" and world.now <= f.at < end)
        overflow, n = next(overflows, None), self.block_samples
        if overflow is not None:  # the samples before it, then the gap
            n = round(overflow.at) - world.now or round(overflow.amount)
        if not world.wait_for_turn(n, timeout_s):
            if world.phase != "running":
                raise DeviceFault(
                    f"{self.name}: there are no samples, the board is {world.phase}; read between"
                    " start and stop"
                )
            raise DeviceTimeout(
                f"{self.name}: {n} samples did not come within {timeout_s:g} s, the pace or unread"
                " frames hold them back; read the camera, or wait longer"
            )
        block = world.advance(n)
        if overflow is None or block.first != overflow.at:
            return block
        reason = "samples were overwritten before they were read; the computer is too busy"
        return LostSamples(block.first, n, f"{self.name}: {reason}")

    def backlog(self) -> int:
        """Always 0: time passes only when samples are read."""
        return 0

    def stop(self) -> None:
        """End the samples and the triggers."""
        if self._world.phase == "running":
            self._world.stop()

    def close(self) -> None:
        """Stop, and let go of the board."""
        self.stop()
        self._is_open = False


def corrupt(image: U8) -> None:
    """Fill the lower half of an image with noise, as a bad cable does."""
    half = image[image.shape[0] // 2 :]
    half[:] = np.random.default_rng(0).integers(0, 256, half.shape, np.uint8)


class ImageSource(Protocol):
    """Draws the image of a state of the world."""

    def image(self, state: TrueState, frame_index: int, *later: TrueState) -> U8:
        """The image, shape (rows, columns); see `states_shown` for the later states."""
        ...

    def adjust(self, exposure_s: float, gain_db: float) -> None:
        """Draw images of another exposure and gain (dB, not below 0) from now on."""
        ...


class SimCamera:
    """The simulated camera: one frame per trigger, of the world at the middle of the exposure of
    each row.

    Parameters
    ----------
    world : World
    renderer : ImageSource, optional
        Draws the images; by default the rough interface of `drivers.sim.images`, which `open`
        makes.
    """

    name = "simulated camera"
    draws = True  # it takes the processor that a camera does not
    is_drawing = False  # now, which takes long on a computer that does much else

    def __init__(self, world: World, renderer: ImageSource | None = None) -> None:
        self._world = world
        self._renderer = renderer
        self._is_open = False
        self._train: TriggerTrain | None = None
        self._next = 0
        self.shape = world.scenario.camera.shape
        self.dtype: np.dtype[Any] = np.dtype(np.uint8)
        self.exposure_samples = world.scenario.exposure_samples

    def open(self) -> None:
        """Make the interface that the camera sees."""
        if self._renderer is None:
            from drivers.sim.images import Renderer

            self._renderer = Renderer(self._world.scenario)
        self._is_open = True

    def describe(self) -> str:
        """Size and renderer of the images."""
        rows, columns = self.shape
        return (
            f"{columns} x {rows}, 8 bit, images of the simulated interface"
            f" ({self._world.scenario.sim.renderer} renderer)"
        )

    def adjust(self, exposure_s: float, gain_db: float) -> None:
        """See `drivers.protocols.AdjustableCamera.adjust`."""
        _check(self._is_open, self.name)
        assert self._renderer is not None
        self._renderer.adjust(exposure_s, gain_db)

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; `OutOfLimits` if one would come during the exposure of another."""
        _check(self._is_open, self.name)
        if train.divisor < self.exposure_samples:
            raise OutOfLimits(
                f"{self.name}: a trigger every {train.divisor} samples was requested, the exposure"
                f" takes {self.exposure_samples}; use a larger divisor or a shorter exposure"
            )
        self._train, self._next = train, 0
        self._world.watch(train)

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The frame of the next trigger, or why it has none, once its exposure is over; see
        `drivers.protocols.Camera.read`.
        """
        world, train, index = self._world, self._train, self._next
        _check(train is not None, self.name, "start it first")
        assert train is not None
        exposed = world.exposure_of(index)
        begun = train.sample(index) if exposed is None else exposed
        end = begun + world.scenario.frame_samples
        world.wait_for(
            lambda: world.now >= end or world.phase == "stopped" or self._train is None, timeout_s
        )
        if world.now < end or self._train is None:
            why = f"{timeout_s:g} s" if world.phase != "stopped" else "the end of the samples"
            raise DeviceTimeout(
                f"{self.name}: frame {index} was not exposed by {why} (sample {world.now} of"
                f" {end}); wait longer, or end here"
            )
        if world.faults.since("camera-gone", index):
            raise DeviceFault(
                f"{self.name}: it was unplugged at trigger {index}; check its cable and start again"
            )
        answer = self._answer(index, train.sample(index), exposed)
        self._next = index + 1
        world.frame_was_read()
        return answer

    def _answer(self, index: int, sample: int, exposed: int | None) -> Frame | LostFrame:
        """The image of a trigger whose exposure is over, or why there is none."""
        world = self._world
        if exposed is None:
            return LostFrame(
                index, sample, f"{self.name}: missed trigger, the camera did not expose"
            )
        if world.faults.hits("lost-frame", index):
            return LostFrame(
                index, exposed, f"{self.name}: the image was exposed and lost on its way"
            )
        assert self._renderer is not None
        self.is_drawing = True
        first, *later = states_shown(world, exposed)
        image = self._renderer.image(first, index, *later)
        self.is_drawing = False
        if world.faults.hits("corrupt-frame", index):
            corrupt(image)
        image.setflags(write=False)
        scenario = world.scenario
        began = exposed if scenario.forces.exposure_counter else sample
        since_start = exposed / scenario.forces.sample_rate * (1 + scenario.sim.camera_clock)
        stamp_s = CAMERA_ON_S + round(since_start, 6)
        return Frame(index, began, image, stamp_s=stamp_s)

    def stop(self) -> None:
        """Stop waiting for triggers; a waiting `read` ends with `DeviceTimeout`."""
        self._train = None
        self._world.watch(None)

    def close(self) -> None:
        """Stop, and let go of the camera."""
        self.stop()
        self._is_open = False


def place_m(world: World) -> float:
    """Position of the stage that its encoder reads now."""
    return (_FIRST_COUNT + round(world.stage_m() / ENCODER_M)) * ENCODER_M


def drive(world: World, position_m: float, velocity_m_s: float) -> None:
    """Send the stage to a position; raises `OutOfLimits` if the world does not model the move."""
    if math.isclose(position_m, place_m(world), rel_tol=0, abs_tol=ENCODER_M / 2):
        world.halt()
    else:
        world.move(position_m - _FIRST_COUNT * ENCODER_M, velocity_m_s)


class SimActuator:
    """The simulated stage: bounded moves, slightly slower than the nominal velocity, and an encoder
    of 35 nm.
    """

    name = "simulated actuator"
    travel_limits_m = (0.0, TRAVEL_M)
    velocity_limit_m_s = 1e-3
    can_change_velocity = True

    def __init__(self, world: World) -> None:
        self._world = world
        self._is_open = False
        self._velocity = 0.1e-3

    def open(self) -> None:
        """Claim the stage, which stands in the middle of its travel."""
        if fault := self._world.faults.needs_emulated("actuator"):
            raise DeviceError(
                f"{self.name}: it has no line that could be noisy and no controller; choose an"
                f" emulated actuator for the fault '{fault}'"
            )
        self._is_open = True

    def describe(self) -> str:
        """Travel, encoder and position."""
        return (
            f"travel {self.travel_limits_m[1] * 1e3:g} mm, encoder {ENCODER_M * 1e9:g} nm, at"
            f" {self.position_m() * 1e3:.4f} mm"
        )

    def home(self) -> None:
        """Go to the origin at 0.5 mm/s; refused in contact."""
        self._check_line()
        self._world.move(-_FIRST_COUNT * ENCODER_M, HOME_VELOCITY_M_S)

    def set_velocity(self, velocity_m_s: float) -> None:
        """Set the speed of later moves; `OutOfLimits` above 1 mm/s."""
        self._check_line()
        check_velocity(self.name, velocity_m_s, self.velocity_limit_m_s)
        self._velocity = velocity_m_s

    def move_to(self, position_m: float) -> None:
        """Start a bounded move; `OutOfLimits` beyond 0 to 25 mm, or if the world does not model the
        move (backwards in contact).
        """
        self._check_line()
        check_target(self.name, position_m, self.travel_limits_m)
        drive(self._world, position_m, self._velocity)

    def position_m(self) -> float:
        """Position that the encoder reads now."""
        self._check_line()
        return place_m(self._world)

    def is_moving(self) -> bool:
        """Whether a move is under way."""
        self._check_line()
        obstacle = self._world.obstacle()
        if obstacle is not None and obstacle.kind == "end-of-run":
            raise DeviceFault(
                f"{self.name}: the stage met its end switch after {obstacle.at:g} um; drive it"
                " back, and start where it has room"
            )
        return self._world.is_moving()

    def stop(self) -> None:
        """End any motion at this sample."""
        if self._is_open:
            self._check_line()
        self._world.halt()

    def close(self) -> None:
        """Stop any motion, then let go of the stage."""
        if self._is_open and not self._is_cut():
            self._world.halt()
        self._is_open = False

    def _is_cut(self) -> bool:
        return self._world.faults.since("unplugged", self._world.now) is not None

    def _check_line(self) -> None:
        _check(self._is_open, self.name)
        if self._is_cut():
            raise DeviceFault(
                f"{self.name}: the line is dead, and the stage ends its move by itself; check the"
                " cable"
            )


def _check(is_ready: bool, name: str, remedy: str = "open it first") -> None:
    if not is_ready:
        raise DeviceFault(f"{name}: it is not ready; {remedy}")
