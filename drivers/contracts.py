"""What every driver of a kind must do, real, emulated, simulated or recorded, as functions that try
one device; `slipscope check-driver` runs them on a driver of your own.

Each contract is given a device that is open, if it says no other state, and what it needs to try
it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.answers import is_backlog, wrong_samples
from drivers.contract import (
    CONTRACTS,
    NEW,
    PATIENCE_S,
    STARTED,
    TRAIN,
    BrokenContract,
    Contract,
    NotTried,
    WrongScale,
    contract,
    has_all_of,
    is_text,
    refused,
    that,
)
from drivers.contracts_actuator import cut_line
from drivers.errors import DeviceError, DeviceTimeout
from drivers.protocols import AnyDevice, Camera, ForceSource, Frame, LostFrame

__all__ = [
    "CONTRACTS",
    "TRAIN",
    "BrokenContract",
    "Contract",
    "NotTried",
    "WrongScale",
    "cut_line",
]

# ---------------------------------------------------------------------- force sources


@contract("forces", given=NEW)
def _it_is_a_force_source(forces: Any) -> None:
    has_all_of(forces, ForceSource)
    that(forces.sample_rate_hz > 0, f"sample_rate_hz = {forces.sample_rate_hz}")
    that(forces.block_samples >= 1, f"block_samples = {forces.block_samples}")


@contract("forces", given=STARTED)
def _blocks_follow_each_other_from_sample_0_without_gap(forces: ForceSource) -> None:
    expected, counted = 0, 0 if forces.counts_exposures else None
    for _ in range(5):
        block: Any = forces.read(PATIENCE_S)
        found = wrong_samples(block, expected, counted)
        that(not found, f"sample {expected} was due, {found} came")
        shape, n = block.volts.shape, forces.block_samples
        that(shape == (n, 2), f"volts of shape {shape} came instead of ({n}, 2)")
        that(block.volts.dtype == np.float64, f"volts are {block.volts.dtype}, not float64")
        that(np.isfinite(block.volts).all(), "some volts are not finite")
        that(is_backlog(waiting := forces.backlog()), f"the backlog is {waiting!r}")
        expected = block.end
        counted = int(block.exposures[-1]) if forces.counts_exposures else None


@contract("forces", given=STARTED)
def _the_receiver_owns_the_block(forces: ForceSource) -> None:
    first: Any = forces.read(PATIENCE_S)
    kept = first.volts.copy()
    second: Any = forces.read(PATIENCE_S)
    second.volts[:] = 0
    that(np.array_equal(first.volts, kept), "a block changed when the next one was written to")


def _refuses_until_ready(device: ForceSource | Camera) -> None:
    with refused(DeviceError, "start() before open()"):
        device.start(TRAIN)
    device.open()
    with refused(DeviceError, "read() before start()"):
        device.read(0.01)


def _refuses_once_closed(device: ForceSource | Camera) -> None:
    device.close()
    with refused(DeviceError, "read() after close()"):
        device.read(0.01)


@contract("forces", given=NEW)
def _samples_out_of_order_are_a_device_error(forces: ForceSource) -> None:
    _refuses_until_ready(forces)
    forces.start(TRAIN)
    forces.stop()
    with refused(DeviceError, "read() after stop()"):
        forces.read(0.01)
    _refuses_once_closed(forces)


# ---------------------------------------------------------------------- cameras

Until = Callable[[int], None]
End = Callable[[], None]


@contract("camera", given=NEW)
def _it_is_a_camera(camera: Any) -> None:
    has_all_of(camera, Camera)
    that(camera.exposure_samples >= 1, f"exposure_samples = {camera.exposure_samples}")


@contract("camera", given=STARTED)
def _one_frame_per_trigger_in_order(camera: Camera, run_until: Until) -> None:
    for index in range(4):
        sample = TRAIN.sample(index)
        run_until(sample + camera.exposure_samples)
        frame = _frame(camera)
        found = f"frame {frame.index} of sample {frame.sample}"
        that((frame.index, frame.sample) == (index, sample), f"{found} came for trigger {index}")


@contract("camera", given=STARTED)
def _a_frame_says_which_triggers_it_may_be_of(camera: Camera, run_until: Until) -> None:
    """A camera that the board does not trigger (`is_triggered` is False) is never certain, and says
    so in `describe` as well.
    """
    is_triggered = getattr(camera, "is_triggered", True)
    for index in range(3):
        run_until(TRAIN.sample(index) + camera.exposure_samples)
        frame = _frame(camera)
        claims = f"frame {index} claims to be one of {frame.first} to {frame.last}"
        that(frame.first <= index <= frame.last, claims)
        is_told = is_triggered or not frame.is_certain
        that(is_told, f"frame {index} is certain, which it cannot be")
    that(
        is_triggered or "uncertain" in camera.describe(),
        "its describe() does not say 'uncertain', although no board triggers it",
    )


@contract("camera", given=STARTED)
def _frames_wait_to_be_read(camera: Camera, run_until: Until) -> None:
    run_until(TRAIN.sample(2) + camera.exposure_samples)
    answers = [camera.read(PATIENCE_S) for _ in range(3)]
    that(all(isinstance(a, Frame | LostFrame) for a in answers), f"{answers} came")
    found = [answer.index for answer in answers]
    that(found == [0, 1, 2], f"frames {found} came instead of 0, 1, 2")


@contract("camera", given=STARTED)
def _the_image_is_read_only_and_stays_as_it_is(camera: Camera, run_until: Until) -> None:
    run_until(TRAIN.sample(1) + camera.exposure_samples)
    image = _frame(camera).image
    found = f"{image.dtype} image of shape {image.shape}"
    that((image.shape, image.dtype) == (camera.shape, camera.dtype), f"a {found} came")
    that(not image.flags.writeable, "the image can be written to")
    kept = image.copy()
    camera.read(PATIENCE_S)
    that(np.array_equal(image, kept), "an image changed when the next one was read")


@contract("camera", given=STARTED)
def _a_trigger_that_has_not_come_is_a_timeout_and_may_still_come(
    camera: Camera, run_until: Until
) -> None:
    with refused(DeviceTimeout, "read() before the first trigger"):
        camera.read(0.01)
    run_until(TRAIN.sample(0) + camera.exposure_samples)
    index = camera.read(PATIENCE_S).index
    that(index == 0, f"frame {index} came first")
    with refused(DeviceTimeout, "read() before the next trigger"):
        camera.read(0.01)


@contract("camera", given=STARTED)
def _what_was_exposed_when_the_clock_ended_can_still_be_read(
    camera: Camera, run_until: Until, end_clock: End
) -> None:
    run_until(TRAIN.sample(1) + camera.exposure_samples)
    end_clock()
    found = [camera.read(PATIENCE_S).index for _ in range(2)]
    that(found == [0, 1], f"frames {found} came instead of 0, 1")
    with refused(DeviceTimeout, "read() after the last trigger"):
        camera.read(0.5)


@contract("camera", given=NEW)
def _frames_out_of_order_are_a_device_error(camera: Camera) -> None:
    _refuses_until_ready(camera)
    _refuses_once_closed(camera)


def _frame(camera: Camera) -> Frame:
    answer = camera.read(PATIENCE_S)
    if isinstance(answer, LostFrame):
        raise BrokenContract(f"frame {answer.index} was lost: {answer.reason}")
    return answer


# ---------------------------------------------------------------------- all devices


@contract("forces", "camera", given=NEW)
def _stop_and_close_may_come_at_any_time_and_twice(device: ForceSource | Camera) -> None:
    device.close()
    device.open()
    device.stop()
    device.start(TRAIN)
    device.stop()
    device.stop()
    device.close()
    device.close()


@contract("forces", "camera", "actuator")
def _it_says_what_it_is(device: AnyDevice) -> None:
    is_text("describe()", device.describe())
