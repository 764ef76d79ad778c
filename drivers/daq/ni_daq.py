"""A board of National Instruments (PCI-6251 and its relatives), in this computer or another one,
through NI's own `nidaqmx`.

One oscillator times everything: the samples, the camera's trigger pulses (of a counter in ticks of
the board's 20 MHz, started with the samples, or of a digital line that the samples clock), and the
samples of the counter of the camera's exposures. Samples are always read by their number since the
start, so that neither a time-out nor an overflow can shift those that follow.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import I64
from drivers.clock import SampleClock
from drivers.daq.ni_errors import GONE, NOT_YET, OVERWRITTEN, need, sentence
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import Found, LostSamples, SampleBlock, TriggerTrain
from drivers.settings import ForceSettings

TIMEBASE_HZ = 20_000_000
WAIT_S = 0.1  # longest single read: `stop` waits so long for one to end
LAST_SAMPLE = 2**31 - 1  # 24 days at 1 kHz
MOST_TICKS = 2**31 - 1  # what NI's library takes for a part of a pulse
WIRINGS = {"differential": "DIFF", "rse": "RSE", "nrse": "NRSE"}


def find() -> list[Found]:
    """The boards that NI's driver lists on this computer.

    Raises
    ------
    DeviceNotFound
        NI's package or driver is not installed.
    """
    need("NI boards", "nidaqmx")
    from nidaqmx.errors import Error
    from nidaqmx.system import System

    try:
        return [Found(board.name, _model(board)) for board in System.local().devices]
    except Error as error:
        raise sentence("NI boards", "a list of those in this computer", error) from error


def _model(board: Any) -> str:
    return f"NI {board.product_type}, " + (
        "simulated" if board.is_simulated else f"serial number {board.serial_num:X}"
    )


class NiForces:
    """Two sensors on a board of National Instruments, and the camera's triggers.

    A camera begins to expose some microseconds after its trigger, so that the exposure is first
    counted on the sample after it.
    """

    def __init__(self, settings: ForceSettings, clock: SampleClock) -> None:
        self.name = f"NI board '{settings.device}'"
        self.sample_rate_hz = clock.sample_rate_hz
        self.block_samples = settings.block
        self.counts_exposures = bool(settings.exposure_counter)
        self._settings = settings
        self._lock = threading.Lock()  # one thread at a time talks to the library
        self._is_running = self._is_gone = False
        self._description = "not open"
        self._channel: Any = None  # to the server
        self._remote: dict[str, Any] = {}  # arguments with which NI's objects use the server
        self._inputs: list[Any] = []  # tasks: the two sensors, then the counter of exposures
        self._trigger: Any = None
        self._next = self._margin = self._count = 0
        self._waiting = 0  # samples at the last call of `backlog`: they are read in one block

    # ------------------------------------------------------------------ open and close

    def open(self) -> None:
        """Claim inputs and counters, and check that the board has what the settings say.

        Raises
        ------
        DeviceNotFound
            Package, driver, server, board or channel is not there.
        OutOfLimits
            The board does not have the rate or the range.
        DeviceFault
            Another program uses the board.
        """
        need(self.name, "nidaqmx")
        self.close()
        self._is_gone = False
        try:
            self._connect()
            self._describe()
            self._open_sensors()
            if self.counts_exposures:
                self._open_counter()
            with self._ni("the trigger output"):
                self._make_trigger(TriggerTrain(0, 2)).close()  # only to check that it is free
            self._lower()
        except BaseException:
            self._is_gone = True  # closing need not report the same problem again
            self.close()
            raise

    def _connect(self) -> None:
        server, certificate = self._settings.server, self._settings.certificate
        if not server:
            return
        need(self.name, "grpc")
        from nidaqmx import GrpcSessionOptions

        from drivers.daq.ni_channel import connect

        try:
            trusted = Path(certificate).read_bytes() if certificate else None
        except OSError as error:
            raise DeviceNotFound(
                f"{self.name}: the certificate {certificate} cannot be read"
                f" ({error.strerror}); correct `certificate`"
            ) from None
        self._channel, calls = connect(server, trusted, self._settings.answer_time)
        self._remote = {"grpc_options": GrpcSessionOptions(calls, "")}

    def _describe(self) -> None:
        from nidaqmx.system import Device

        s = self._settings
        with self._ni(f"'{s.device}'"):
            model = _model(Device(s.device, **self._remote))
        server = f" on {s.server}" * bool(s.server)
        inputs = f"{s.channels[0]} and {s.channels[1]}, {s.wiring}, at {self.sample_rate_hz:g} Hz"
        further = [f"{a.name} on {a.channel}" for a in s.auxiliary_channels]
        inputs += f", {', '.join(further)}" * bool(further)
        counter = s.trigger_counter + f" at {s.trigger_terminal}" * bool(s.trigger_terminal)
        trigger = s.trigger_line if s.trigger == "digital" else counter
        counted = f", exposures counted by {s.exposure_counter} at {s.exposure_terminal}"
        counted *= self.counts_exposures
        self._description = f"{model}{server}: {inputs}; triggers from {trigger}{counted}"

    def _open_sensors(self) -> None:
        from nidaqmx.constants import TerminalConfiguration

        s = self._settings
        wiring = TerminalConfiguration[WIRINGS[s.wiring]]
        inputs = dict(zip(s.channels, s.range, strict=True))
        inputs |= {found.channel: found.range_v for found in s.auxiliary_channels}
        with (
            self._ni(f"{' and '.join(inputs)} at {self.sample_rate_hz:g} Hz"),
            self._task() as task,
        ):
            for channel, limit in inputs.items():
                task.ai_channels.add_ai_voltage_chan(
                    f"{s.device}/{channel}", terminal_config=wiring, min_val=-limit, max_val=limit
                )
            self._sample(task, "")
            rate = task.timing.samp_clk_rate
            if not (
                math.isclose(rate, self.sample_rate_hz, rel_tol=1e-9)
                and (TIMEBASE_HZ / self.sample_rate_hz).is_integer()
            ):
                raise OutOfLimits(
                    f"{self.name}: {self.sample_rate_hz:.10g} Hz was requested, the nearest that"
                    f" the board has is {rate:.10g} Hz; use a sample rate that divides 20 MHz"
                )
        self._inputs.append(task)

    def _open_counter(self) -> None:
        from nidaqmx.constants import Edge

        s = self._settings
        with (
            self._ni(f"{s.exposure_counter} to count at {s.exposure_terminal}"),
            self._task() as task,
        ):
            channel = task.ci_channels.add_ci_count_edges_chan(
                f"{s.device}/{s.exposure_counter}", edge=Edge[s.exposure_edge.upper()]
            )
            channel.ci_count_edges_term = f"/{s.device}/{s.exposure_terminal}"
            self._sample(task, f"/{s.device}/ai/SampleClock")
        self._inputs.append(task)

    def _sample(self, task: Any, clock: str) -> None:
        """Let a task sample without end, into a buffer that is read by number and that drops its
        oldest samples if it is not read in time.
        """
        from nidaqmx.constants import AcquisitionType, OverwriteMode, ReadRelativeTo, TaskMode

        size = max(2 * self.block_samples, math.ceil(self._settings.buffer * self.sample_rate_hz))
        task.timing.cfg_samp_clk_timing(
            self.sample_rate_hz, clock, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=size
        )
        task.in_stream.input_buf_size = size
        task.in_stream.overwrite = OverwriteMode.OVERWRITE_UNREAD_SAMPLES
        task.in_stream.relative_to = ReadRelativeTo.FIRST_SAMPLE
        task.control(TaskMode.TASK_COMMIT)

    def _make_trigger(self, train: TriggerTrain) -> Any:
        """The task, not yet started, that sends this train from the first sample on."""
        from nidaqmx.constants import AcquisitionType, TaskMode

        s = self._settings
        is_line = s.trigger == "digital"
        first, divisor, high = train.first, train.divisor, train.divisor // 2
        if divisor < 2 or first < 0 or (is_line and first >= divisor):
            limits = "a trigger needs 2 samples and cannot come before sample 0"
            limits += ", a digital line begins within its first period" * is_line
            raise OutOfLimits(
                f"{self.name}: a trigger every {divisor} samples from {first} on was requested;"
                f" {limits}"
            )
        with self._task() as task:
            if is_line:
                task.do_channels.add_do_chan(f"{s.device}/{s.trigger_line}")
                rate, clock = self.sample_rate_hz, f"/{s.device}/ai/SampleClock"
                endless = {"sample_mode": AcquisitionType.CONTINUOUS, "samps_per_chan": divisor}
                task.timing.cfg_samp_clk_timing(rate, clock, **endless)
                pattern = [(sample - first) % divisor < high for sample in range(divisor)]
                task.write(pattern, auto_start=False)
            else:
                ticks = int(TIMEBASE_HZ / self.sample_rate_hz)
                times = {
                    "initial_delay": ticks * first,
                    "high_ticks": ticks * high,
                    "low_ticks": ticks * (divisor - high),
                }
                if max(times.values()) > MOST_TICKS:
                    raise OutOfLimits(
                        f"{self.name}: a trigger every {divisor} samples from {first} on was"
                        f" requested, a part of a pulse takes {MOST_TICKS / TIMEBASE_HZ:.0f} s at"
                        " most; use a smaller divisor, or forces.trigger = 'digital'"
                    )
                counters, timebase = task.co_channels, f"/{s.device}/20MHzTimebase"
                channel = counters.add_co_pulse_chan_ticks(
                    f"{s.device}/{s.trigger_counter}", timebase, **times
                )
                if s.trigger_terminal:
                    channel.co_pulse_term = f"/{s.device}/{s.trigger_terminal}"
                task.timing.cfg_implicit_timing(sample_mode=AcquisitionType.CONTINUOUS)
                task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{s.device}/ai/StartTrigger")
            task.control(TaskMode.TASK_RESERVE)
        return task

    @contextmanager
    def _task(self) -> Iterator[Any]:
        """A new task, closed again if setting it up fails."""
        from nidaqmx import Task
        from nidaqmx.errors import Error

        task = Task(**self._remote)
        try:
            yield task
        except BaseException:
            with suppress(Error):  # the first error is the one to report
                task.close()
            raise

    def describe(self) -> str:
        """Model and serial number, channels, rate, terminals of triggers and exposures."""
        return self._description

    def close(self) -> None:
        """Stop, and let go of the board."""
        try:
            self.stop()
        finally:
            with self._lock:
                try:
                    self._each(self._inputs, "close")
                finally:
                    channel, self._channel, self._remote, self._inputs = self._channel, None, {}, []
                    if channel is not None:
                        channel.close()

    # ------------------------------------------------------------------ a run

    def start(self, train: TriggerTrain) -> None:
        """Start the samples and the triggers on one edge; see
        `drivers.protocols.ForceSource.start`.
        """
        with self._lock:
            if not self._inputs or self._trigger or self._is_gone:
                raise DeviceFault(
                    f"{self.name}: it cannot start, it is not open, or runs already, or is gone;"
                    " open it, or stop it first"
                )
            self._next = self._margin = self._count = self._waiting = 0
            try:
                with self._ni("a start"):
                    self._trigger = self._make_trigger(train)
                    # the sensors last: their start triggers the others
                    for task in (self._trigger, *reversed(self._inputs)):
                        task.start()
            except BaseException:
                with suppress(DeviceError):  # the first error is the one to report
                    self._halt()
                raise
            self._is_running = True

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block, or the gap if samples were overwritten before they were read; see
        `drivers.protocols.ForceSource.read`.
        """
        give_up = time.monotonic() + timeout_s
        while True:
            with self._lock:
                if not self._is_running:
                    raise DeviceFault(
                        f"{self.name}: there are no samples, the board is stopped or gone; read"
                        " between start and stop"
                    )
                with self._ni(f"sample {self._next}"):
                    block = self._next_block(max(0.0, min(WAIT_S, give_up - time.monotonic())))
            if block is not None:
                return block
            if time.monotonic() >= give_up:
                raise DeviceTimeout(
                    f"{self.name}: {self.block_samples} samples from {self._next} on have not all"
                    f" come within {timeout_s:g} s, none is lost; read again, or wait longer than a"
                    " block lasts"
                )

    def _next_block(self, wait_s: float) -> SampleBlock | LostSamples | None:
        """The next block or gap; None if not all of it is there yet."""
        from nidaqmx.errors import DaqError
        from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader

        first, n = self._next, max(self.block_samples, min(self._waiting, int(self.sample_rate_hz)))
        self._waiting = 0
        if first + n > LAST_SAMPLE:
            raise OutOfLimits(
                f"{self.name}: sample {first} cannot be read, NI's library reads by number up to"
                f" {LAST_SAMPLE}; start a new run"
            )
        further = len(self._settings.auxiliary)
        volts, counts = np.empty((2 + further, n)), np.empty(n, np.uint32)
        kinds = zip((AnalogMultiChannelReader, CounterReader), self._inputs, strict=False)
        readers = [kind(task.in_stream) for kind, task in kinds]
        try:
            for reader, task in zip(readers, self._inputs, strict=True):
                reader.verify_array_shape = False  # which takes a further call to the board
                task.in_stream.offset = first
            readers[0].read_many_sample(volts, n, wait_s)
            if self.counts_exposures:
                readers[1].read_many_sample_uint32(counts, n, wait_s)
        except DaqError as error:
            if error.error_code == NOT_YET:
                return None
            if error.error_code in OVERWRITTEN:
                return self._gap()
            raise
        self._next, self._margin = first + n, 0
        return SampleBlock(
            first,
            np.ascontiguousarray(volts[:2].T),
            self._unwrapped(counts) if self.counts_exposures else None,
            np.ascontiguousarray(volts[2:].T) if further else None,
        )

    def _gap(self) -> LostSamples:
        """The gap from the next sample to the oldest in the buffer, and further each time that this
        one is overwritten as well before it is read.
        """
        stream, first = self._inputs[0].in_stream, self._next
        oldest = stream.total_samp_per_chan_acquired - stream.input_buf_size
        self._next = max(oldest, first + 1) + self._margin
        self._margin = 2 * self._margin or self.block_samples
        reason = (
            f"{self.name}: samples were overwritten before they were read; end other programs on"
            " this computer, or raise `buffer`"
        )
        return LostSamples(first, self._next - first, reason)

    def _unwrapped(self, counts: NDArray[np.uint32]) -> I64:
        """The counts without the wrap-around of the 32-bit counter."""
        steps = np.diff(counts, prepend=np.uint32(self._count % 2**32))
        total = self._count + np.cumsum(steps, dtype=np.int64)
        self._count = int(total[-1])
        return total

    def backlog(self) -> int:
        """Number of samples in the buffer of NI's library."""
        with self._lock:
            if not self._is_running:
                return 0
            with self._ni("the number of the newest sample"):
                self._waiting = max(
                    0, int(self._inputs[0].in_stream.total_samp_per_chan_acquired) - self._next
                )
                return self._waiting

    def stop(self) -> None:
        """End the triggers and the samples, in that order.

        May be called twice, and from any thread.
        """
        self._is_running = False  # a read that waits gives way
        with self._lock:
            self._halt()

    def _halt(self) -> None:
        trigger, self._trigger = self._trigger, None
        if trigger is not None:
            try:
                self._each([trigger, *self._inputs], "stop")
            finally:
                self._each([trigger], "close")
            if not self._is_gone:
                self._lower()

    def _lower(self) -> None:
        """Leave a digital line low: it keeps its level, and the first trigger is an edge."""
        s = self._settings
        if s.trigger == "digital":
            with self._ni(f"a low level of {s.trigger_line}"), self._task() as task:
                task.do_channels.add_do_chan(f"{s.device}/{s.trigger_line}")
                task.write(False, auto_start=True)
                task.close()

    def _each(self, tasks: list[Any], action: str) -> None:
        """Stop or close all tasks, even if one fails; a board that is known to be gone need not
        answer.
        """
        problems: list[DeviceError] = []
        for task in tasks:
            was_gone = self._is_gone
            try:
                with self._ni(f"to {action}"):
                    getattr(task, action)()
            except DeviceError as error:
                problems += [] if was_gone else [error]
        if problems:
            raise problems[0]

    @contextmanager
    def _ni(self, asked: str) -> Iterator[None]:
        """Turn errors of NI's library into device errors, and note it if the board is gone."""
        from nidaqmx.errors import DaqError, Error

        try:
            yield
        except Error as error:
            code = getattr(error, "error_code", None)
            no_answer = self._remote and not isinstance(error, DaqError)
            if no_answer or code in GONE:
                self._is_gone, self._is_running = True, False
            if not no_answer:
                there = f" (there are: {self._boards()})" if code == -200220 else ""
                raise sentence(self.name, asked + there, error) from error
            details = getattr(error.__context__, "details", None)
            kind = DeviceFault if self._inputs else DeviceNotFound
            self._trigger, self._inputs = None, []  # no server is left to close them
            raise kind(
                f"{self.name}: {asked} was requested, the server {self._settings.server} does not"
                f" answer ({details() if details else error}); check that NI's gRPC device server"
                " runs there, and check address, certificate and firewall"
            ) from error

    def _boards(self) -> str:
        from nidaqmx.errors import Error
        from nidaqmx.system import System

        with suppress(Error):  # the list is only an addition to another error
            return ", ".join(System(**self._remote).devices.device_names) or "none"
        return "unknown"
