"""An emulated PCI-6251: tasks, a sample clock, buffers that overflow, a pulse train and a counter,
in front of the simulated world.

It does exactly what a client's tasks say: a trigger train of a wrong period, a counter on a wrong
terminal or a task that starts too late shows in the data.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from analysis.arrays import Array, Bool
from drivers.errors import DeviceFault
from drivers.protocols import TriggerTrain
from drivers.sim.world import World

PRODUCT, SERIAL_NUMBER = "PCI-6251", 0x5119C0DE
TIMEBASE_HZ = 20_000_000
FASTEST_HZ = 500_000  # two channels share 1 MS/s
TICK_S = 0.01  # step of the wall clock in which a paced board takes its samples
FOREVER_S = threading.TIMEOUT_MAX
# positions that a read can be relative to, beside the current one
FIRST_SAMPLE, MOST_RECENT = 10424, 10428


class NiError(Exception):
    """An error of NI-DAQmx, with its number."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(eq=False)
class BoardTask:
    """A task of a client: channels of one kind, their clock, their buffer, where to read in it."""

    name: str
    kind: str = ""  # "ai", "ci", "co" or "do"
    channels: list[str] = field(default_factory=list)
    limits_v: list[float] = field(default_factory=list)
    rate_hz: float = 0.0
    clock: str = ""
    buffer: int = 0
    overwrites: bool = False
    relative_to: int = 0
    offset: int = 0
    position: int = 0
    began: int = 0  # the board's sample that is the first of this task
    lost: int = 0  # the fault has overwritten everything before this sample
    is_full: bool = False  # after that fault: it reports a full buffer once
    terminal: str = ""
    counts_falling: bool = False
    start_trigger: str = ""
    ticks: tuple[int, int] = (0, 0)  # before the first pulse, between two
    pattern: Bool | None = None
    is_running: bool = False


class Board:
    """The board; its methods are called from any thread.

    Parameters
    ----------
    world : World
        Moves the sensors and the camera; its time passes with the board's samples.
    device : str
        Name of the board.
    sensors : tuple of str
        Inputs that the normal and the shear sensor and the world's further channels are wired to;
        the others are at 0 V.
    exposure_terminal : str
        Terminal that the camera's exposure output is wired to.
    when_gone : callable, optional
        Called once when a fault makes the board disappear.
    renew : callable, optional
        Makes the world of the next run after one has ended; without it there is only one run.
    """

    def __init__(
        self,
        world: World,
        *,
        device: str = "Dev1",
        sensors: tuple[str, ...] = ("ai0", "ai1"),
        exposure_terminal: str = "PFI3",
        when_gone: Callable[[], Any] = lambda: None,
        renew: Callable[[], World] | None = None,
    ) -> None:
        self.device = device
        lines = (f"port0/line{i}" for i in range(8))
        self.channels = {*(f"ai{i}" for i in range(16)), "ctr0", "ctr1", *lines}
        self.is_gone = False
        self._world, self._sensors, self._exposures = world, sensors, exposure_terminal
        self._when_gone, self._renew = when_gone, renew
        self._changed = threading.Condition(threading.RLock())
        self._generating = threading.Lock()
        self._owners: dict[str, BoardTask] = {}  # of inputs, counters and lines
        self._tasks: list[BoardTask] = []
        self._levels: dict[str, bool] = {}  # of lines, as their last task has left them
        self._width = 2 + len(world.scenario.forces.auxiliary_channels)
        self._ring = np.zeros((1, self._width))
        self._total = 0
        self._thread: threading.Thread | None = None
        faults = world.faults.all
        self._holes = [
            (round(f.at), round(f.at + f.amount)) for f in faults if f.kind == "daq-overflow"
        ]
        self._end = min((round(f.at) for f in faults if f.kind == "daq-gone"), default=None)

    # ------------------------------------------------------------------ tasks

    def channel(self, name: str) -> str:
        """The board's own name of a physical channel, "Dev1/ai0" -> "ai0"."""
        device, _, channel = name.lstrip("/").partition("/")
        if device.lower() != self.device.lower():
            raise NiError(-200220, f"Device identifier is invalid.\nDevice Specified: {device}")
        if channel not in self.channels:
            text = "Physical channel specified does not exist on this device."
            raise NiError(-200170, f"{text}\nPhysical Channel Name: {name}")
        return channel

    def check(self) -> None:
        """Raise an error once the board is gone."""
        if self.is_gone:
            text = "Device cannot be accessed. The device is no longer present in the system."
            raise NiError(-201003, f"{text}\nDevice: {self.device}")

    def add(self, task: BoardTask, kind: str, name: str) -> None:
        """Add a channel to a task, whose channels must all be of one kind."""
        channel = self.channel(name)
        prefix = {"ai": "ai", "do": "port"}.get(kind, "ctr")
        if task.kind not in ("", kind) or not channel.startswith(prefix):
            text = "Physical channel specified is not for this kind of task."
            raise NiError(-200170, f"{text}\nPhysical Channel Name: {name}")
        task.kind = kind
        task.channels.append(channel)

    def set_clock(self, task: BoardTask, rate_hz: float, clock: str, samples: int) -> None:
        """Set sample clock and buffer of a task."""
        if not 0 < rate_hz <= FASTEST_HZ:
            text = "Requested value is not a supported value for this property"
            raise NiError(-200077, f"{text}: {rate_hz:g} of at most {FASTEST_HZ} Hz.")
        task.rate_hz, task.clock = TIMEBASE_HZ / round(TIMEBASE_HZ / rate_hz), clock
        task.buffer = samples

    def claim(self, task: BoardTask) -> None:
        """Reserve the resources that a task needs."""
        with self._changed:
            for resource in {"ai" if task.kind == "ai" else channel for channel in task.channels}:
                if self._owners.setdefault(resource, task) is not task:
                    code = -200587 if task.kind == "do" else -50103
                    text = (
                        "The specified resource is reserved. The operation could not be completed."
                    )
                    raise NiError(code, f"{text}\nResource: {resource}")

    def start(self, task: BoardTask) -> None:
        """Start a task; outputs and counters wait for the start of the samples."""
        self.claim(task)
        with self._changed:
            if task.kind == "ai":
                rate = self._world.scenario.forces.sample_rate
                if task.rate_hz != rate:
                    text = f"{task.rate_hz:g} Hz, the simulated bench has {rate:g} Hz"
                    raise NiError(-200077, f"Requested value is not supported: {text}.")
                train = self._train()
                self._ring = np.zeros((max(task.buffer, 1), self._width))
                try:
                    self._world.start(train)
                except DeviceFault as error:
                    raise NiError(-50101, str(error)) from None
            task.is_running, task.position, task.lost, task.began = True, 0, 0, self._total
            self._tasks.append(task)
            if task.kind == "ai" and self._world.pace is not None:
                thread = threading.Thread(target=self._run, name="emulated board", daemon=True)
                self._thread = thread
                thread.start()

    def _train(self) -> TriggerTrain | None:
        """The pulses that the armed outputs send once the samples start."""
        for task in self._tasks:
            if task.kind == "co" and task.start_trigger == f"/{self.device}/ai/StartTrigger":
                per_sample = TIMEBASE_HZ / self._world.scenario.forces.sample_rate
                first, divisor = (ticks / per_sample for ticks in task.ticks)
                if not (first.is_integer() and divisor.is_integer()):
                    text = f"pulses of {task.ticks[1]} ticks do not fall on samples"
                    raise NiError(-200077, f"Requested value is not supported: {text}.")
                return TriggerTrain(int(first), int(divisor))
            is_clocked = task.clock == f"/{self.device}/ai/SampleClock"
            if task.kind == "do" and is_clocked and task.pattern is not None:
                line = np.tile(task.pattern, 3)
                before = np.insert(line[:-1], 0, self._levels.get(task.channels[0], False))
                rises = np.flatnonzero(line & ~before)
                if set(np.diff(rises)) == {len(task.pattern)}:
                    return TriggerTrain(int(rises[0]), len(task.pattern))
        return None

    def stop(self, task: BoardTask) -> None:
        """Stop a task, whose resources stay reserved; if it is that of the samples, everything
        stops.
        """
        with self._changed:
            was_running, task.is_running = task.is_running, False
            n = self._total - task.began if task.clock else 1  # without a clock: a single value
            if was_running and task.pattern is not None and n:
                self._levels[task.channels[0]] = task.pattern[(n - 1) % len(task.pattern)]
            self._tasks = [other for other in self._tasks if other is not task]
            thread = self._thread if task.kind == "ai" else None
            self._changed.notify_all()
        if task.kind == "ai" and was_running:
            self._world.stop()
            if thread is not None:
                thread.join()
            if self._renew is not None and not self.is_gone:
                self._world, self._total = self._renew(), 0

    def clear(self, task: BoardTask) -> None:
        """Stop a task and release its resources."""
        self.stop(task)
        with self._changed:
            self._owners = {
                resource: owner for resource, owner in self._owners.items() if owner is not task
            }

    def unplug(self) -> None:
        """Remove the board."""
        with self._changed:
            self.is_gone = True
            self._changed.notify_all()
        if self._world.phase == "running":
            self._world.stop()

    def close(self) -> None:
        """Stop everything."""
        for task in tuple(self._tasks):
            self.stop(task)
        if self._thread is not None:
            self._thread.join()

    # ------------------------------------------------------------------ samples

    def _run(self) -> None:
        tick = max(
            1, int(TICK_S * self._world.scenario.forces.sample_rate * (self._world.pace or 1.0))
        )
        while self._world.phase == "running":
            self._generate(tick, 1.0)

    def _generate(self, n: int, timeout_s: float) -> bool:
        """Let up to `n` samples pass; whether any have passed."""
        n = min(n, len(self._ring))
        if self._end is not None and self._total + n > self._end:
            n = self._end - self._total
            if n == 0:
                self._when_gone()
                self.unplug()
                return False
        if not self._world.wait_for_turn(n, timeout_s):
            return False
        block = self._world.advance(n)
        with self._changed:
            parts = [block.volts] if block.auxiliary is None else [block.volts, block.auxiliary]
            rows = np.arange(block.first, block.end) % len(self._ring)
            self._ring[rows] = np.column_stack(parts)
            self._total = block.end
            self._changed.notify_all()
        return True

    def _wait(self, sample: int, timeout_s: float, task: BoardTask) -> None:
        """Wait until that sample has been taken or can no longer come, or for that long."""
        if self._world.pace is not None:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._total >= sample or self.is_gone or not task.is_running, timeout_s
                )
            return
        give_up = time.monotonic() + timeout_s
        with self._generating:
            while self._total < sample and self._generate(
                sample - self._total, give_up - time.monotonic()
            ):
                pass

    def total(self, task: BoardTask) -> int:
        """Samples that a task has taken since its start; once after an overflow by a fault, the
        number that it would be after an overflow by late reading.
        """
        was_full, task.is_full = task.is_full, False
        return task.lost + task.buffer if was_full else self._total - task.began

    def read(self, task: BoardTask, n: int, timeout_s: float) -> Array:
        """The next `n` samples of a task, or as many as came in time, shape (channels, samples)."""
        first = task.offset + {FIRST_SAMPLE: 0, MOST_RECENT: self._total - task.began}.get(
            task.relative_to, task.position
        )
        start = task.began + first
        hole = next((hole for hole in self._holes if start < hole[1] and hole[0] < start + n), None)
        patience_s = timeout_s if 0 <= timeout_s < FOREVER_S else FOREVER_S
        self._wait(hole[1] if hole else start + n, patience_s, task)
        with self._changed:
            self.check()
            if not task.is_running:
                text = "The specified operation did not complete successfully"
                raise NiError(-88710, f"{text}, because the task was aborted.")
            if hole and self._total >= hole[1]:
                task.position, task.lost, task.is_full = first, hole[1] - task.began, True
            if first < max(task.lost, self._total - task.began - task.buffer):
                task.position = first
                code = -200279 if task.overwrites else -200222
                text = "The application is not able to keep up with the hardware acquisition."
                raise NiError(code, text)
            came = 0 if hole else max(0, min(n, self._total - start))
            task.position = first + came
            if task.kind == "ci":
                return self._counts(task, start, came)
            rows = self._ring[np.arange(start, start + came) % len(self._ring)]
            wired = [
                rows[:, self._sensors.index(c)] if c in self._sensors else np.zeros(came)
                for c in task.channels
            ]
            limited = zip(wired, task.limits_v, strict=True)
            return np.array([np.clip(volts, -limit, limit) for volts, limit in limited])

    def _counts(self, task: BoardTask, start: int, n: int) -> Array:
        is_wired = (
            task.terminal == f"/{self.device}/{self._exposures}"
            and task.clock == f"/{self.device}/ai/SampleClock"
        )
        if not (is_wired and n):
            return np.zeros((1, n), np.uint32)
        world = self._world
        is_inverted = world.faults.since("exposure-inverted", math.inf) is not None
        counts = world.exposure_counts(start, n)
        if task.counts_falling != is_inverted:  # the edge of an exposure's end
            late = world.scenario.exposure_samples
            ends = np.arange(start - late, start + n - late)
            counts = np.searchsorted(world.begun, ends, side="right")
        return np.asarray(counts[None] % 2**32, np.uint32)
