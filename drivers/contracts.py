"""What every driver of a kind must do, real, emulated, simulated or recorded, as functions that try
one device; `slipscope check-driver` runs them on a driver of your own.

Each contract is given a device that is neither open nor started, and what it needs to try it.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.errors import DeviceError, DeviceTimeout, OutOfLimits
from drivers.protocols import Actuator, Camera, ForceSource, Frame, LostFrame, TriggerTrain

TRAIN = TriggerTrain(first=0, divisor=100)
PATIENCE_S = 5.0


class BrokenContract(Exception):
    """A driver does not do what it must; the message says what was found instead."""


@dataclass(frozen=True, slots=True)
class Contract:
    """One thing that every driver of a kind must do.

    Attributes
    ----------
    kind : str
        "forces", "camera" or "actuator".
    name : str
        What it must do, with underscores.
    moves : bool
        Whether a stage moves, by up to 1 mm, for which there must be room both ways.
    """

    kind: str
    name: str
    moves: bool
    function: Callable[..., None]

    def __str__(self) -> str:
        return self.name.replace("_", " ")

    def check(self, device: Any, **means: Any) -> None:
        """Try a device; it is closed again only where the contract is kept.

        Parameters
        ----------
        means : callables
            For a camera ``run_until(sample)``, which starts the clock and lets it pass up to there,
            and ``end_clock()``; for an actuator ``pass_time(seconds)``.

        Raises
        ------
        BrokenContract
            It does something else; any other error is the driver's own.
        """
        self.function(device, **{name: means[name] for name in self.needs})

    @property
    def needs(self) -> list[str]:
        """Names of the means that it needs."""
        return list(inspect.signature(self.function).parameters)[1:]


CONTRACTS: dict[str, list[Contract]] = {"forces": [], "camera": [], "actuator": []}


def _contract(*kinds: str, moves: bool = False) -> Callable[[Callable[..., None]], None]:
    def add(function: Callable[..., None]) -> None:
        for kind in kinds:
            CONTRACTS[kind].append(Contract(kind, function.__name__[1:], moves, function))

    return add


def _that(is_so: Any, found: str) -> None:
    if not is_so:
        raise BrokenContract(found)


@contextmanager
def _refused(kind: type[DeviceError], what: str) -> Iterator[None]:
    try:
        yield
    except kind:
        return
    raise BrokenContract(f"{what} was not refused with {kind.__name__}")


# ---------------------------------------------------------------------- force sources


@_contract("forces")
def _it_is_a_force_source(forces: Any) -> None:
    _that(isinstance(forces, ForceSource), _missing(forces, ForceSource))
    _that(forces.name, "its name is empty")
    _that(forces.sample_rate_hz > 0, f"sample_rate_hz = {forces.sample_rate_hz}")
    _that(forces.block_samples >= 1, f"block_samples = {forces.block_samples}")


@_contract("forces")
def _blocks_follow_each_other_from_sample_0_without_gap(forces: ForceSource) -> None:
    forces.open()
    forces.start(TRAIN)
    expected = 0
    for _ in range(5):
        block: Any = forces.read(PATIENCE_S)
        _that(block.first == expected, f"sample {expected} was due, {block.first} came")
        shape, n = block.volts.shape, forces.block_samples
        _that(shape == (n, 2), f"volts of shape {shape} came instead of ({n}, 2)")
        _that(block.volts.dtype == np.float64, f"volts are {block.volts.dtype}, not float64")
        _that(np.isfinite(block.volts).all(), "some volts are not finite")
        _that(forces.backlog() >= 0, f"the backlog is {forces.backlog()}")
        expected = block.end
    forces.close()


@_contract("forces")
def _the_receiver_owns_the_block(forces: ForceSource) -> None:
    forces.open()
    forces.start(TRAIN)
    first: Any = forces.read(PATIENCE_S)
    kept = first.volts.copy()
    second: Any = forces.read(PATIENCE_S)
    second.volts[:] = 0
    _that(np.array_equal(first.volts, kept), "a block changed when the next one was written to")
    forces.close()


@_contract("forces")
def _samples_out_of_order_are_a_device_error(forces: ForceSource) -> None:
    with _refused(DeviceError, "start() before open()"):
        forces.start(TRAIN)
    forces.open()
    with _refused(DeviceError, "read() before start()"):
        forces.read(0.01)
    forces.start(TRAIN)
    forces.stop()
    with _refused(DeviceError, "read() after stop()"):
        forces.read(0.01)
    forces.close()
    with _refused(DeviceError, "read() after close()"):
        forces.read(0.01)


# ---------------------------------------------------------------------- cameras

Until = Callable[[int], None]
End = Callable[[], None]


@_contract("camera")
def _it_is_a_camera(camera: Any) -> None:
    _that(isinstance(camera, Camera), _missing(camera, Camera))
    _that(camera.name, "its name is empty")
    _that(camera.exposure_samples >= 1, f"exposure_samples = {camera.exposure_samples}")


@_contract("camera")
def _one_frame_per_trigger_in_order(camera: Camera, run_until: Until) -> None:
    camera.open()
    camera.start(TRAIN)
    for index in range(4):
        sample = TRAIN.sample(index)
        run_until(sample + camera.exposure_samples)
        frame = _frame(camera)
        found = f"frame {frame.index} of sample {frame.sample}"
        _that((frame.index, frame.sample) == (index, sample), f"{found} came for trigger {index}")
    camera.close()


@_contract("camera")
def _a_frame_says_which_triggers_it_may_be_of(camera: Camera, run_until: Until) -> None:
    """A camera that the board does not trigger (`is_triggered` is False) is never certain, and says
    so in `describe` as well.
    """
    is_triggered = getattr(camera, "is_triggered", True)
    camera.open()
    camera.start(TRAIN)
    for index in range(3):
        run_until(TRAIN.sample(index) + camera.exposure_samples)
        frame = _frame(camera)
        first, last = (index if n is None else n for n in (frame.first, frame.last))
        _that(first <= index <= last, f"frame {index} claims to be one of {first} to {last}")
        _that(is_triggered or first < last, f"frame {index} is certain, which it can not be")
    _that(
        is_triggered or "uncertain" in camera.describe(),
        "its describe() does not say 'uncertain', although no board triggers it",
    )
    camera.close()


@_contract("camera")
def _frames_wait_to_be_read(camera: Camera, run_until: Until) -> None:
    camera.open()
    camera.start(TRAIN)
    run_until(TRAIN.sample(2) + camera.exposure_samples)
    answers = [camera.read(PATIENCE_S) for _ in range(3)]
    _that(all(isinstance(a, Frame | LostFrame) for a in answers), f"{answers} came")
    found = [answer.index for answer in answers]
    _that(found == [0, 1, 2], f"frames {found} came instead of 0, 1, 2")
    camera.close()


@_contract("camera")
def _the_image_is_read_only_and_stays_as_it_is(camera: Camera, run_until: Until) -> None:
    camera.open()
    camera.start(TRAIN)
    run_until(TRAIN.sample(1) + camera.exposure_samples)
    image = _frame(camera).image
    found = f"{image.dtype} image of shape {image.shape}"
    _that((image.shape, image.dtype) == (camera.shape, camera.dtype), f"a {found} came")
    _that(not image.flags.writeable, "the image can be written to")
    kept = image.copy()
    camera.read(PATIENCE_S)
    _that(np.array_equal(image, kept), "an image changed when the next one was read")
    camera.close()


@_contract("camera")
def _a_trigger_that_has_not_come_is_a_timeout_and_may_still_come(
    camera: Camera, run_until: Until
) -> None:
    camera.open()
    camera.start(TRAIN)
    with _refused(DeviceTimeout, "read() before the first trigger"):
        camera.read(0.01)
    run_until(TRAIN.sample(0) + camera.exposure_samples)
    index = camera.read(PATIENCE_S).index
    _that(index == 0, f"frame {index} came first")
    with _refused(DeviceTimeout, "read() before the next trigger"):
        camera.read(0.01)
    camera.close()


@_contract("camera")
def _what_was_exposed_when_the_clock_ended_can_still_be_read(
    camera: Camera, run_until: Until, end_clock: End
) -> None:
    camera.open()
    camera.start(TRAIN)
    run_until(TRAIN.sample(1) + camera.exposure_samples)
    end_clock()
    found = [camera.read(PATIENCE_S).index for _ in range(2)]
    _that(found == [0, 1], f"frames {found} came instead of 0, 1")
    with _refused(DeviceTimeout, "read() after the last trigger"):
        camera.read(0.5)
    camera.close()


@_contract("camera")
def _frames_out_of_order_are_a_device_error(camera: Camera) -> None:
    with _refused(DeviceError, "start() before open()"):
        camera.start(TRAIN)
    camera.open()
    with _refused(DeviceError, "read() before start()"):
        camera.read(0.01)
    camera.close()
    with _refused(DeviceError, "read() after close()"):
        camera.read(0.01)


def _frame(camera: Camera) -> Frame:
    answer = camera.read(PATIENCE_S)
    if isinstance(answer, LostFrame):
        raise BrokenContract(f"frame {answer.index} was lost: {answer.reason}")
    return answer


# ---------------------------------------------------------------------- actuators

Pass = Callable[[float], None]


@_contract("actuator")
def _it_is_an_actuator(actuator: Any) -> None:
    _that(isinstance(actuator, Actuator), _missing(actuator, Actuator))
    _that(actuator.name, "its name is empty")
    low, high = actuator.travel_limits_m
    _that(low < high, f"its travel is from {low} to {high} m")
    _that(actuator.velocity_limit_m_s > 0, f"velocity_limit_m_s = {actuator.velocity_limit_m_s}")


@_contract("actuator", moves=True)
def _a_move_ends_by_itself_at_its_target(actuator: Actuator, pass_time: Pass) -> None:
    actuator.open()
    start = actuator.position_m()
    _that(not actuator.is_moving(), "it moves as soon as it is open")
    for target in (start + 200e-6, start - 100e-6):
        actuator.set_velocity(100e-6)
        actuator.move_to(target)
        _that(actuator.is_moving(), "it does not move after move_to()")
        pass_time(0.5)
        _that(actuator.is_moving(), "a move of 2 s or more ended within 0.5 s")
        pass_time(5.0)
        _that(not actuator.is_moving(), "a move of 3 s or less did not end within 5.5 s")
        _is_at(actuator, target, 1e-6)
    actuator.close()


@_contract("actuator", moves=True)
def _it_moves_at_about_the_velocity_asked(actuator: Actuator, pass_time: Pass) -> None:
    actuator.open()
    start = actuator.position_m()
    actuator.set_velocity(50e-6)
    actuator.move_to(start + 1e-3)
    pass_time(2.0)
    _is_at(actuator, start + 100e-6, 10e-6)
    actuator.close()


@_contract("actuator", moves=True)
def _stop_ends_the_motion_now(actuator: Actuator, pass_time: Pass) -> None:
    actuator.open()
    actuator.stop()
    start = actuator.position_m()
    actuator.set_velocity(100e-6)
    actuator.move_to(start + 1e-3)
    pass_time(1.0)
    actuator.stop()
    actuator.stop()
    stopped = actuator.position_m()
    _that(start < stopped < start + 1e-3, f"it stopped after {(stopped - start) * 1e6:.1f} um")
    pass_time(1.0)
    _that(not actuator.is_moving(), "it moves 1 s after stop()")
    _is_at(actuator, stopped, 1e-6)
    actuator.close()


@_contract("actuator", moves=True)
def _what_is_out_of_limits_changes_nothing(actuator: Actuator, pass_time: Pass) -> None:
    actuator.open()
    low, high = actuator.travel_limits_m
    start = actuator.position_m()
    for target in (low - 1e-3, high + 1e-3, math.nan):
        with _refused(OutOfLimits, f"a move to {target * 1e3:g} mm"):
            actuator.move_to(target)
        _that(not actuator.is_moving(), f"it moves after a refused move to {target * 1e3:g} mm")
    actuator.set_velocity(100e-6)
    for velocity in (0.0, -1e-6, 2 * actuator.velocity_limit_m_s, math.nan):
        with _refused(OutOfLimits, f"a velocity of {velocity * 1e6:g} um/s"):
            actuator.set_velocity(velocity)
    actuator.move_to(start + 100e-6)
    pass_time(0.5)
    _is_at(actuator, start + 50e-6, 5e-6)
    actuator.close()


@_contract("actuator")
def _moves_out_of_order_are_a_device_error(actuator: Actuator) -> None:
    with _refused(DeviceError, "move_to() before open()"):
        actuator.move_to(0.0)
    with _refused(DeviceError, "set_velocity() before open()"):
        actuator.set_velocity(1e-6)
    with _refused(DeviceError, "position_m() before open()"):
        actuator.position_m()


@_contract("actuator", moves=True)
def _close_stops_and_may_come_at_any_time_and_twice(actuator: Actuator, pass_time: Pass) -> None:
    actuator.close()
    actuator.open()
    start = actuator.position_m()
    actuator.move_to(start + 1e-3)
    actuator.close()
    actuator.close()
    pass_time(1.0)
    actuator.open()
    _is_at(actuator, start, 1e-6)
    actuator.close()


def _is_at(actuator: Actuator, expected_m: float, tolerance_m: float) -> None:
    off_m = actuator.position_m() - expected_m
    _that(abs(off_m) <= tolerance_m, f"it is {off_m * 1e6:+.2f} um off where it should be")


# ---------------------------------------------------------------------- all devices


@_contract("forces", "camera")
def _stop_and_close_may_come_at_any_time_and_twice(device: ForceSource | Camera) -> None:
    device.close()
    device.open()
    device.stop()
    device.start(TRAIN)
    device.stop()
    device.stop()
    device.close()
    device.close()


@_contract("forces", "camera", "actuator")
def _it_says_what_it_is(device: ForceSource | Camera | Actuator) -> None:
    device.open()
    _that(device.describe(), "describe() is empty")
    device.close()


def _missing(device: object, protocol: type) -> str:
    """What a device lacks of a protocol."""
    wanted = {name for name in dir(protocol) if not name.startswith("_")}
    wanted |= set(protocol.__annotations__)
    lacks = sorted(name for name in wanted if not hasattr(device, name))
    return f"it has no {', '.join(lacks)}"
