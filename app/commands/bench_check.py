"""`slipscope check`: tests a bench device by device, then takes a few seconds of data; moves only
what it is allowed to.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.options import UNITS, quantity
from app.commands.bench_move import move
from app.commands.doctor import Finding, problem
from app.engine.setup import sensor_chain
from app.settings import Config
from drivers.bench import Bench
from drivers.errors import DeviceError, DeviceTimeout
from drivers.protocols import (
    Actuator,
    Camera,
    ForceSource,
    Frame,
    LostFrame,
    MadeReady,
    SampleBlock,
    TriggerTrain,
)

Device = Actuator | Camera | ForceSource

SECONDS = 2.0  # of data
HOME_TIMEOUT_S = 120.0
READ_TIMEOUT_S = 3.0


def check(config: Config, bench: Bench, *, home: bool, move_um: float) -> Iterator[Finding]:
    """Findings one by one, as they come; the others are checked even if one device fails.

    Parameters
    ----------
    home : bool
        Whether the stage may search its origin.
    move_um : float
        How far the stage may move, and back, if the forces can be watched; 0: not at all.
    """
    devices: dict[str, Device] = {
        "actuator": bench.actuator,
        "camera": bench.camera,
        "forces": bench.forces,
    }
    opened = []
    for label, device in devices.items():
        finding = _attempt(label, _open, device)
        yield finding
        if finding.is_fine:
            opened.append(label)
    try:
        if "actuator" in opened and isinstance(bench.actuator, MadeReady):
            yield Finding("limits", _limits(config))
        if "actuator" in opened and home:
            yield _attempt("home", _home, bench.actuator)
        if {"actuator", "forces"} <= set(opened) and move_um:
            yield _attempt("move", move, config, bench, move_um * UNITS["um"])
        is_over = bool(move_um) and bench.world is not None  # a world runs only once
        if {"camera", "forces"} <= set(opened) and not is_over:
            yield from _take_data(config, bench)
    finally:
        for label, device in reversed(devices.items()):
            closing = _attempt(label, _close, device)
            if not closing.is_fine:
                yield closing


def _limits(config: Config) -> str:
    within = quantity(config.actuator, "travel").replace(", ", " to ")
    below = quantity(config.actuator, "max_velocity")
    return f"before it moves, the controller is told to stay within {within} and below {below}"


def _attempt(label: str, step: Callable[..., str], *arguments: Any) -> Finding:
    try:
        return Finding(label, step(*arguments))
    except DeviceError as error:
        return problem(label, str(error), needed=True)


def _open(device: Device) -> str:
    device.open()
    return f"{device.name}: {device.describe()}"


def _close(device: Device) -> str:
    device.close()
    return "closed"


def _home(actuator: Actuator) -> str:
    actuator.home()
    _wait_until_still(actuator, HOME_TIMEOUT_S)
    return f"the origin was found, the stage is at {actuator.position_m() * 1e3:.4f} mm"


def _wait_until_still(actuator: Actuator, timeout_s: float) -> None:
    give_up = time.monotonic() + timeout_s
    try:
        while actuator.is_moving():
            if time.monotonic() > give_up:
                raise DeviceTimeout(
                    f"{actuator.name}: it still moves after {timeout_s:.0f} s; it was stopped,"
                    " check the stage"
                )
            time.sleep(0.05)
    except BaseException:
        actuator.stop()
        raise


@dataclass
class _Data:
    """The data of these seconds."""

    volts: list[NDArray[np.float64]] = field(default_factory=list)
    lost_samples: int = 0
    frames: int = 0
    lost: list[str] = field(default_factory=list)
    image: NDArray[np.generic] | None = None
    seconds: float = math.nan


def _take_data(config: Config, bench: Bench) -> Iterator[Finding]:
    """A few seconds of samples and frames, and what they show of the wiring."""
    train = TriggerTrain(0, config.camera.divisor)
    samples = max(round(SECONDS * config.forces.sample_rate), 3 * config.camera.divisor)
    data = _Data()
    yield _attempt("data", _acquire, bench, train, samples, data)
    if data.volts:
        yield from _forces(config, np.concatenate(data.volts))
    if data.image is not None:
        yield _picture(config, data.image)


def _acquire(bench: Bench, train: TriggerTrain, samples: int, data: _Data) -> str:
    bench.camera.start(train)
    bench.forces.start(train)
    began, end = time.monotonic(), 0
    try:
        while end < samples:
            block = bench.forces.read(READ_TIMEOUT_S)
            end = block.end
            if isinstance(block, SampleBlock):
                data.volts.append(block.volts)
            else:
                data.lost_samples += block.count
            _collect(bench, data, 0.0)
        data.seconds = time.monotonic() - began
        due = train.count_before(end - bench.camera.exposure_samples)
        while data.frames + len(data.lost) < due and _collect(bench, data, READ_TIMEOUT_S):
            pass
    finally:
        bench.forces.stop()
        bench.camera.stop()
    account = (
        f"{end - data.lost_samples} samples and {data.frames} frames of {due} triggers in"
        f" {data.seconds:.1f} s"
    )
    problems = [f"{data.lost_samples} samples were lost"] if data.lost_samples else []
    if data.frames < due:
        problems.append(
            data.lost[0] if data.lost else "the camera did not answer triggers; check its line"
        )
    if problems:
        raise DeviceError(f"{account}: {'; '.join(problems)}")
    return account


def _collect(bench: Bench, data: _Data, timeout_s: float) -> bool:
    """Take the answers that the camera has; whether there were any."""
    found = False
    while True:
        try:
            answer = bench.camera.read(timeout_s)
        except DeviceTimeout:
            return found
        found = True
        if isinstance(answer, LostFrame):
            data.lost.append(answer.reason)
        elif isinstance(answer, Frame):
            data.frames, data.image = data.frames + 1, answer.image
        if timeout_s:
            return True


def _forces(config: Config, volts: NDArray[np.float64]) -> Iterator[Finding]:
    newtons = sensor_chain(config).forces(volts)
    for i, (label, symbol) in enumerate((("normal sensor", "P"), ("shear sensor", "Q"))):
        reading, limit = volts[:, i], config.forces.range[i]
        used = float(np.abs(reading).max()) / limit
        force, unsteady = newtons[:, i].mean(), newtons[:, i].std() * 1e3
        text = (
            f"{reading.mean():+.4f} V, std {reading.std() * 1e3:.2f} mV; {force:+.4f} N, std"
            f" {unsteady:.2f} mN"
        )
        advice = ""
        if used >= 0.98:
            advice = f"it is at the end of its range of {limit:g} V: check the sensor, or raise"
            advice += " forces.range"
        elif np.ptp(reading) == 0:
            advice = "it does not change by one step of the converter: is anything connected?"
        yield Finding(label, text, not advice, bool(advice), advice, symbol)


def _picture(config: Config, image: NDArray[np.generic]) -> Finding:
    grey = image.astype(np.float64)
    full = config.camera.full_scale
    bright, dark = float((grey >= full).mean()), float((grey == 0).mean())
    text = (
        f"grey levels {grey.mean():.0f} on average, contrast {grey.std():.1f}, {bright:.2%} at full"
        f" scale, {dark:.2%} at zero"
    )
    advice = ""
    if bright > 0.02:
        advice = "too bright: shorten camera.exposure, or dim the light"
    elif grey.std() < config.dic.min_contrast * full / 255:
        advice = "no contrast to correlate: check light, focus and lens cap"
    return Finding("picture", text, not advice, False, advice)
