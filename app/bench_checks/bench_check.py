"""`slipscope check`: tests a bench device by device, then takes a few seconds of data; moves only
what it is allowed to.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import F64
from analysis.options import UNITS, quantity
from app.acquisition.receiver import check_camera
from app.acquisition.stage import unsupervised
from app.acquisition.watchdog import PATIENCE_S, START_S, STEP_PATIENCE_S, Patience
from app.bench_checks.bench_move import move
from app.bench_checks.doctor import Checked, problem
from app.evaluation.setup import pattern_of, sensor_chain
from app.records.bench_view import END_OF_RANGE
from app.records.quantities import counted
from app.settings.certificates import certificates_of
from app.settings.protocol_steps import Approach
from app.settings.sections import Config
from app.system.errors import ConfigError
from drivers.answers import check_answer
from drivers.bench import Bench, block_s
from drivers.errors import DeviceError, DeviceTimeout
from drivers.protocols import (
    Actuator,
    AnyDevice,
    LostFrame,
    SampleBlock,
    TriggerTrain,
)

SECONDS = 2.0  # length of the data that a check reads
HOME_TIMEOUT_S = 120.0
OPEN_S = 60.0  # a device that does not open within it is given up
MAINS_HZ = (50.0, 60.0)
HUM_SHARE, HUM_MN = (
    0.5,
    1.0,
)  # of the noise, and least rms, of a hum that is told: the paper's noise
READ_TIMEOUT_S = 3.0
NOISES = 3  # standard deviations that have to fit in a tolerance


def check(
    config: Config, make: Callable[[], Bench], *, home: bool, move_um: float
) -> Iterator[Checked]:
    """Findings one by one, as they come; the others are checked even if one device fails.

    Parameters
    ----------
    make : callable
        Makes the bench, of settings that are `unpressed`; called again for every further part of
        the check where time passes once only, as in a simulated world and in a recording.
    home : bool
        Whether the stage may search its origin.
    move_um : float
        How far the stage may move, and back, if the forces can be watched; 0: not at all.
    """
    bench = make()
    devices: dict[str, AnyDevice] = {
        "actuator": bench.actuator,
        "camera": bench.camera,
        "forces": bench.forces,
    }
    opened = set()
    for label, device in devices.items():
        finding = _attempt(label, _open, device, within_s=OPEN_S)
        yield finding
        if finding.is_fine:
            opened.add(label)
    if warning := unsupervised(config):
        yield problem("supervisor", warning)
    for path, one in certificates_of(config).items():
        found = f"{path.name}, {one.age('days old')}, due on {one.due}"
        advice = f"repeat `slipscope calibrate {one.what}`" if one.is_due else ""
        yield Checked(f"calibration {one.what}", found, not one.is_due, advice=advice)
        for kind, mine in zip(("forces", "camera", "actuator"), config.sources, strict=True):
            theirs = one.bench.get(kind, mine)
            if theirs != mine and any(key.startswith(f"{kind}.") for key in one.settings):
                what = f"{path.name} is of {kind}.source = {theirs}, this bench has {mine}"
                yield problem(
                    f"calibration {one.what}", what, f"calibrate {one.what} on this bench"
                )
    try:
        pattern_of(config)
    except ConfigError as error:
        yield problem("calibration pattern", str(error), needed=True)
    parts: list[Callable[[Bench], Iterator[Checked]]] = []
    if "actuator" in opened and home:
        parts.append(partial(_homing, config, has_forces="forces" in opened))
    if {"actuator", "forces"} <= opened and move_um:
        parts.append(partial(_moving, config, move_um * UNITS["um"]))
    if {"camera", "forces"} <= opened:
        parts.append(partial(_take_data, config))
    passes_once = bench.world is not None or "replay" in config.sources
    now, later = (parts[:1], parts[1:]) if passes_once else (parts, [])
    try:
        if "actuator" in opened and hasattr(bench.actuator, "make_ready"):
            yield Checked("limits", _limits(config))
        for part in now:
            yield from part(bench)
    finally:
        for label, device in reversed(devices.items()):
            closing = _attempt(label, _close, device, within_s=PATIENCE_S)
            if not closing.is_fine:
                yield closing
    for part in later:
        with make() as another:
            yield from part(another)


def _homing(config: Config, bench: Bench, *, has_forces: bool) -> Iterator[Checked]:
    """The search of the origin; the time of a simulated bench passes as its forces are read."""
    most_s = HOME_TIMEOUT_S + STEP_PATIENCE_S
    if not has_forces:
        yield _attempt("home", _home, bench.actuator, partial(time.sleep, 0.05), within_s=most_s)
        return
    patience = Patience()
    start = partial(bench.forces.start, TriggerTrain(0, config.camera.divisor))
    patience.aside(bench.forces.name, start, START_S)
    try:
        yield _attempt(
            "home",
            _home,
            bench.actuator,
            partial(bench.forces.read, READ_TIMEOUT_S + block_s(bench)),
            within_s=most_s,
        )
    finally:
        patience.aside(bench.forces.name, bench.forces.stop)


def _moving(config: Config, way_m: float, bench: Bench) -> Iterator[Checked]:
    yield _attempt("move", move, config, bench, way_m)


def _limits(config: Config) -> str:
    within = quantity(config.actuator, "travel").replace(", ", " to ")
    below = quantity(config.actuator, "max_velocity")
    return f"before it moves, the controller is limited to {within} and below {below}"


def _attempt(
    label: str, step: Callable[..., str], *arguments: Any, within_s: float = math.inf, who: str = ""
) -> Checked:
    who = who or getattr(arguments[0], "name", "the bench")
    try:
        return Checked(label, Patience().aside(who, partial(step, *arguments), within_s))
    except DeviceError as error:
        return problem(label, str(error), needed=True)


def _open(device: AnyDevice) -> str:
    device.open()
    return f"{device.name}: {device.describe()}"


def _close(device: AnyDevice) -> str:
    device.close()
    return "closed"


def _home(actuator: Actuator, wait: Callable[[], object]) -> str:
    actuator.home()
    _wait_until_still(actuator, HOME_TIMEOUT_S, wait)
    return f"the origin was found, the stage is at {actuator.position_m() * 1e3:.4f} mm"


def _wait_until_still(actuator: Actuator, timeout_s: float, wait: Callable[[], object]) -> None:
    give_up = time.monotonic() + timeout_s
    try:
        while actuator.is_moving():
            if time.monotonic() > give_up:
                raise DeviceTimeout(
                    f"{actuator.name}: it still moves after {timeout_s:.0f} s; it was stopped,"
                    " check the stage"
                )
            wait()
    except BaseException:
        actuator.stop()
        raise


@dataclass
class _Data:
    """The data of these seconds."""

    volts: list[F64] = field(default_factory=list)
    lost_samples: int = 0
    frames: int = 0
    lost: list[str] = field(default_factory=list)
    image: NDArray[np.generic] | None = None
    seconds: float = math.nan


def _take_data(config: Config, bench: Bench) -> Iterator[Checked]:
    """A few seconds of samples and frames, and what they show of the wiring."""
    train = TriggerTrain(0, config.camera.divisor)
    samples = max(round(SECONDS * config.forces.sample_rate), 3 * config.camera.divisor)
    data = _Data()
    within_s = STEP_PATIENCE_S + samples / config.forces.sample_rate
    step = partial(_acquire, config, bench, train, samples, data)
    who = f"{bench.forces.name} or {bench.camera.name}"
    yield _attempt("data", step, within_s=within_s, who=who)
    if data.volts:
        yield from _forces(config, np.concatenate(data.volts), len(data.volts[0]))
    if data.image is not None:
        yield _picture(config, data.image)


def _acquire(config: Config, bench: Bench, train: TriggerTrain, samples: int, data: _Data) -> str:
    check_camera(bench.camera, config)
    bench.camera.start(train)
    bench.forces.start(train)
    began, end = time.monotonic(), 0
    try:
        while end < samples:
            block = bench.forces.read(READ_TIMEOUT_S + block_s(bench))
            end = block.end
            if isinstance(block, SampleBlock):
                data.volts.append(block.volts)
            else:
                data.lost_samples += block.count
            _collect(bench, train, data, 0.0)
        data.seconds = time.monotonic() - began
        due = train.count_before(end - bench.camera.exposure_samples)
        while data.frames + len(data.lost) < due and _collect(bench, train, data, READ_TIMEOUT_S):
            pass
    finally:
        bench.forces.stop()
        bench.camera.stop()
    account = (
        f"{counted(end - data.lost_samples, 'sample')} and {counted(data.frames, 'frame')} of"
        f" {counted(due, 'trigger')} in"
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


def _collect(bench: Bench, train: TriggerTrain, data: _Data, timeout_s: float) -> bool:
    """Take the answers that the camera has; whether there were any."""
    found, rate = False, bench.forces.sample_rate_hz
    while True:
        try:
            answer = bench.camera.read(timeout_s)
        except DeviceTimeout:
            return found
        due, found = data.frames + len(data.lost), True
        newest = [] if data.image is None else [data.image]
        check_answer(bench.camera, answer, due, train, rate, newest)
        if isinstance(answer, LostFrame):
            data.lost.append(answer.reason)
        else:
            data.frames, data.image = data.frames + 1, answer.image
        if timeout_s:
            return True


def _forces(config: Config, volts: F64, block: int) -> Iterator[Checked]:
    """What the sensors read, and whether a contact could settle in their noise.

    A run takes a contact as settled by the mean of each block, which has to stay within
    ``run.settle_tolerance`` (P) and ``run.shear_tolerance`` (Q) of the load. Three standard
    deviations of these means have to fit in there. Recorded forces are what an operator has pressed
    as well, and are not judged.
    """
    newtons, run = sensor_chain(config).forces(volts), config.run
    whole = len(newtons) // block * block
    means = newtons[:whole].reshape(-1, block, 2).mean(axis=1).std(axis=0) * 1e3
    loads = [step.normal_force for step in run.protocol if isinstance(step, Approach)]
    load = min(loads, default=run.normal_force)
    is_recorded = config.forces.source == "replay"
    for label, symbol, tolerance, reading, force, limit, noise in zip(
        ("normal sensor", "shear sensor"),
        "PQ",
        ("settle_tolerance", "shear_tolerance"),
        volts.T,
        newtons.T,
        config.forces.range,
        means,
        strict=True,
    ):
        used = float(np.abs(reading).max()) / limit
        text = (
            f"{reading.mean():+.4f} V, std {reading.std() * 1e3:.2f} mV; {force.mean():+.4f} N, std"
            f" {force.std() * 1e3:.2f} mN"
        )
        most = getattr(run, tolerance) * load * 1e3 / NOISES
        mains, hum = max((_hum(force, hz, config) for hz in MAINS_HZ), key=itemgetter(1))
        if not is_recorded:
            text += f", of the means of {block} samples {noise:.2f} mN (limit {most:.2g} mN)"
            if math.isfinite(hum):
                text += f", at {mains:g} Hz {hum * 1e3:.2f} mN rms"
        advice, is_hum = "", False
        if not np.isfinite(force).all():
            advice = "a reading is not a number: check the sensor and the driver"
        elif used >= END_OF_RANGE:
            advice = f"it is at the end of its range of {limit:g} V: check the sensor, or raise"
            advice += " forces.range"
        elif np.ptp(reading) == 0:
            advice = "it does not change by one step of the converter: is anything connected?"
        elif noise > most and not is_recorded:
            advice = (
                f"too noisy for a contact of {load:g} N to count as settled: {NOISES} standard"
                f" deviations are more than run.{tolerance} of it; let the block hang free and"
                " still, check shields, table and cables, or raise that tolerance"
            )
        elif hum > HUM_SHARE * force.std() and hum * 1e3 > HUM_MN and not is_recorded:
            is_hum = True
            period = round(config.forces.sample_rate / mains)
            advice = (
                f"that is the mains: check shields and grounds; a block of {2 * period} samples"
                " (forces.block) averages it out, an exposure of one period does in each frame"
            )
        yield Checked(label, text, not advice, bool(advice) and not is_hum, advice, symbol)


def _hum(newtons: F64, hz: float, config: Config) -> tuple[float, float]:
    """A frequency of the mains, and the rms of a force at it; NaN where the samples do not reach
    it.
    """
    rate = config.forces.sample_rate
    whole = int(len(newtons) * hz / rate) * rate / hz  # of its periods
    used = newtons[: round(whole)]
    if rate <= 2 * hz or not len(used):
        return hz, math.nan
    turning = np.exp(-2j * math.pi * hz * np.arange(len(used)) / rate)
    return hz, float(math.sqrt(2.0) * abs(np.mean((used - used.mean()) * turning)))


def _picture(config: Config, image: NDArray[np.generic]) -> Checked:
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
    return Checked("picture", text, not advice, False, advice)
