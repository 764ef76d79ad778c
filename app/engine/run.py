"""One live run: four threads from the devices to the disk and the analysis, and a stop that comes first.

control   reads the force blocks, decides the phases, commands the actuator, watches the limits
camera    reads every trigger's fate; to the recorder without loss, to the analysis newest first
analysis  one `Pipeline` step per frame
recorder  everything to the session, flushed at least twice a second

States: idle -> armed -> running -> stopping -> done | failed. Whatever happens, in whichever thread, the actuator is stopped first,
what was measured reaches the disk, and the run ends in a named state with a reason.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import psutil
from numpy.typing import NDArray

from app.config import Config, exposure_samples
from app.engine.channels import LatestChannel
from app.engine.experiment import Experiment, ExperimentFailed, Measured
from app.engine.history import History
from app.engine.pipeline import Pipeline, sensor_chain, summarise
from app.engine.recorder import Recorder, RecorderFull, SessionSink
from app.results import ContactResult, Counts, Event, Health, Outcome, Phase, Snapshot, without_fields
from drivers.errors import DeviceError, DeviceTimeout
from drivers.protocols import Actuator, Camera, ForceSource, Frame, LostFrame, SampleBlock, TriggerTrain

READ_TIMEOUT_S = 2.0
FREE_RUNNING_READS = 30
POLL_S = 0.1
CAMERA_PATIENCE_S = 3.0  # without an answer to a trigger, then the camera is given up
REFERENCE_WAIT_S = 30.0  # at rest, nothing moves: the reference may take its time
UNHURRIED_DEPTH = 8  # frames kept for the analysis before the drive, when none should be skipped


class BenchDevices(Protocol):
    """A bench as the engine sees it: three devices, opened and closed together."""

    @property
    def forces(self) -> ForceSource: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def actuator(self) -> Actuator: ...

    def open(self) -> None: ...
    def close(self) -> None: ...


CreateSink = Callable[[tuple[int, int], np.dtype[Any], NDArray[np.float64], NDArray[np.float64]], SessionSink]


def sentence(who: str, error: Exception) -> str:
    """The reason a run ends with: what was meant for people as it is, anything else with its kind."""
    if isinstance(error, DeviceError | ExperimentFailed | RecorderFull):
        return str(error)
    return f"{who}: {type(error).__name__}: {error}"


class Run:
    """One loading experiment on one bench, recorded and analysed as it goes.

    Parameters
    ----------
    config : Config
    bench : BenchDevices
        Opened by the run, closed by the run.
    create_sink : callable
        Makes the session once the bench is open; called with the camera's frame shape and dtype and the DIC grid (x_px, y_px).
    free_running : bool
        True where the sources wait for us (simulation at full speed): then nothing is skipped and no queue can run full.
    title : str
        Name of the bench, for people.
    output : Path
        Where the session goes.
    """

    def __init__(
        self, config: Config, bench: BenchDevices, create_sink: CreateSink, *, free_running: bool, title: str, output: Path
    ) -> None:
        self.config = config
        self.title = title
        self.output = output
        self.pixel_m = config.camera.pixel * 1e-6
        self.sample_rate_hz = float(config.forces.sample_rate)
        self._bench = bench
        self._create_sink = create_sink
        self._free_running = free_running
        self._train = TriggerTrain(first=0, divisor=config.camera.divisor)
        self._exposure = exposure_samples(config)
        self._chain = sensor_chain(config)
        self._pipeline = Pipeline(config, (config.camera.height, config.camera.width))
        self.grid_x_px, self.grid_y_px = self._pipeline.grid.x_px, self._pipeline.grid.y_px
        self._experiment = Experiment(config)
        self._history = History(self.sample_rate_hz, self._exposure)
        self._to_analysis: LatestChannel[Frame] = LatestChannel(UNHURRIED_DEPTH, sender_waits=free_running)
        self._recorder: Recorder | None = None
        self._start_m = 0.0
        self._lock = threading.Lock()
        self._state, self._reason, self._failed = "idle", "", False
        self._stop, self._ended, self._reference_taken = threading.Event(), threading.Event(), threading.Event()
        self._final_sample: int | None = None
        self._received = self._lost = self._analysed = 0
        self._awaited = (0, 0.0)  # the trigger whose answer is awaited, and since when (wall clock)
        self._snapshots: list[Snapshot] = []
        self._latest_image: NDArray[Any] | None = None
        self._outcome: Outcome | None = None
        self._progress = 0.0

    # ------------------------------------------------------------------ what others may call, from any thread

    def start(self) -> None:
        """Open the bench and begin; returns at once."""
        with self._lock:
            if self._state != "idle":
                raise RuntimeError(f"run: start was asked, but the run is {self._state}; make a new run")
            self._state = "armed"
        self._spawn("control", self._control)

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """The outcome once the run has ended, None if it has not after `timeout` seconds."""
        self._ended.wait(timeout)
        return self._outcome

    def request_stop(self, reason: str) -> None:
        """End the run in good order: the actuator stops now, what was measured is kept, the state is "done"."""
        self._stop_with(reason, failed=False)

    def stop_motion(self) -> None:
        """Stop the actuator in the calling thread, then end the run."""
        self.request_stop("STOP MOTION was pressed")

    def outcome(self) -> Outcome | None:
        """How the run ended; None while it has not."""
        return self._outcome

    def contact(self) -> ContactResult | None:
        """The apparent contact, once the reference was taken."""
        return self._pipeline.contact

    def latest_image(self) -> NDArray[Any] | None:
        """The newest frame's image, not to be written to."""
        return self._latest_image

    def snapshots_since(self, n: int) -> list[Snapshot]:
        """The snapshots after the first `n`; only the newest one still holds its fields."""
        return self._snapshots[n:]

    def force_history(self, n: int) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """About `n` points of the whole run: samples, P and Q in newtons."""
        return self._history.block_means(n)

    def health(self) -> Health:
        """State, counts, queue and disk at this moment."""
        try:
            disk_free = shutil.disk_usage(self.output.parent).free
        except OSError:
            disk_free = 0
        under_way = self._state in ("running", "stopping")
        return Health(
            state=self._state,
            reason=self._reason or (self._experiment.advice if under_way else ""),
            phase=str(self._experiment.phase) if under_way else "",
            counts=self._count(),
            queue_fill=self._recorder.fill if self._recorder else 0.0,
            queue_seconds=self.config.recording.queue,
            disk_free_bytes=disk_free,
            sample=self._history.end,
            progress=1.0 if self._outcome else self._progress,
        )

    # ------------------------------------------------------------------ stopping

    def _stop_with(self, reason: str, *, failed: bool) -> None:
        """Name the end, then stop the actuator, before anything else is done. The first reason stays; a failure outranks an orderly end."""
        self._note_end(reason, failed=failed)
        if self._state in ("running", "stopping"):
            try:
                self._bench.actuator.stop()
            except Exception as error:  # the run must end whatever the actuator says
                self._note_end(f"the actuator did not confirm its stop: {error}", failed=True)

    def _note_end(self, reason: str, *, failed: bool) -> None:
        with self._lock:
            if self._outcome is None and not self._stop.is_set():
                self._reason, self._failed = reason, failed
            elif self._outcome is None and failed and not self._failed:
                self._reason, self._failed = f"{reason} (while ending: {self._reason})", True
            self._stop.set()

    def _spawn(self, name: str, work: Callable[[], None]) -> threading.Thread:
        """A thread whose exceptions end the run by name."""

        def guarded() -> None:
            try:
                work()
            except Exception as error:
                self._stop_with(sentence(name, error), failed=True)

        thread = threading.Thread(target=guarded, name=f"slipscope-{name}", daemon=True)
        thread.start()
        return thread

    # ------------------------------------------------------------------ control

    def _control(self) -> None:
        """The whole life of the run; ends by publishing its outcome."""
        process = psutil.Process()
        used, began = process.cpu_times(), time.monotonic()
        sink: SessionSink | None = None
        try:
            self._bench.open()
            self._check_camera()
            camera = self._bench.camera
            sink = self._create_sink(camera.shape, camera.dtype, self.grid_x_px, self.grid_y_px)
            self._record_run(sink)
        except Exception as error:
            self._stop_with(sentence("control", error), failed=True)
        self._attempt("bench", self._bench.close)
        self._pipeline.close()
        now = process.cpu_times()
        resources = {
            "peak_memory_mib": round((self._recorder.peak_memory_bytes if self._recorder else process.memory_info().rss) / 2**20, 1),
            "cpu_s": round(now.user + now.system - used.user - used.system, 2),
            "wall_s": round(time.monotonic() - began, 2),
        }
        if sink is not None:
            self._finish(sink, resources)
        with self._lock:
            self._outcome = self._describe(resources)
            self._state = self._outcome.state
        self._ended.set()

    def _finish(self, sink: SessionSink, resources: dict[str, Any]) -> None:
        def write() -> None:
            sink.finish(self._describe(resources))
            sink.flush()

        self._attempt("session", write)
        self._attempt("session", sink.close)

    def _describe(self, resources: dict[str, Any]) -> Outcome:
        summary = summarise(self.config, self._snapshots, self.contact(), self._pipeline.notes) if self._snapshots else None
        return Outcome("failed" if self._failed else "done", self._reason, self._count(), summary, resources)

    def _check_camera(self) -> None:
        rows, columns = self._bench.camera.shape
        if (rows, columns) != (self.config.camera.height, self.config.camera.width):
            raise DeviceError(
                f"{self._bench.camera.name}: images of {self.config.camera.width} x {self.config.camera.height} were asked,"
                f" it gives {columns} x {rows}; set camera.width and camera.height to that"
            )

    def _record_run(self, sink: SessionSink) -> None:
        """From the first sample to the last byte on disk."""
        frame_bytes = self.config.camera.width * self.config.camera.height
        bytes_per_s = frame_bytes * self.sample_rate_hz / self._train.divisor
        self._recorder = Recorder(
            sink,
            int(max(self.config.recording.queue * bytes_per_s, 4 * frame_bytes)),
            self.config.recording.flush_interval,
            sender_waits=self._free_running,
            on_failure=lambda reason: self._stop_with(reason, failed=True),
        )
        recording = self._spawn("recorder", self._recorder.work)
        workers: list[threading.Thread] = []
        try:
            self._begin_phase(self._experiment.phase, 0)
            self._bench.camera.start(self._train)
            self._bench.forces.start(self._train)
            self._start_m = self._bench.actuator.position_m()
            self._state, self._awaited = "running", (0, time.monotonic())
            workers = [self._spawn("camera", self._receive), self._spawn("analysis", self._analyse)]
            self._measure()
        except Exception as error:
            self._stop_with(sentence("control", error), failed=True)
        finally:
            self._wind_down(workers)
            self._recorder.end()
            recording.join()

    def _measure(self) -> None:
        """Read, record, decide, until the experiment or somebody ends it."""
        while not self._stop.is_set():
            measured = self._take_block()
            self._watch_camera()
            before = self._experiment.phase
            if before is Phase.REFERENCE and self._reference_is_due(measured):
                self._reference_taken.wait(REFERENCE_WAIT_S)
                measured = replace(measured, has_reference=self._reference_taken.is_set())
            try:
                phase = self._experiment.advance(measured)
            except ExperimentFailed:
                if self._stop.is_set():
                    return  # the stage stands because somebody stopped it
                raise
            self._progress = self._experiment.progress(measured)
            if phase is not before:
                self._begin_phase(phase, measured.end_sample)
                self._act_on(phase)

    def _act_on(self, phase: Phase) -> None:
        """What entering a phase means for the actuator."""
        if phase is Phase.DRIVE:
            self._to_analysis.depth = UNHURRIED_DEPTH if self._free_running else 1
            self._bench.actuator.set_velocity(self._experiment.velocity_m_s)
            if not self._stop.is_set():
                self._bench.actuator.move_to(self._start_m + self._experiment.travel_m)
            if self._stop.is_set():  # a stop that came between the two lines above wins
                self._bench.actuator.stop()
        elif phase is Phase.END:
            self._stop_with(f"the drive of {self.config.run.travel:g} um is complete", failed=False)

    def _reference_is_due(self, measured: Measured) -> bool:
        began = self._history.phase_start(Phase.REFERENCE)
        return began is not None and measured.end_sample - began >= self.config.run.reference_time * self.sample_rate_hz

    def _take_block(self) -> Measured:
        """The next block, on its way to the disk, and what it says."""
        assert self._recorder is not None
        block = self._read_block()
        forces = self._chain.forces(block.volts)
        position = self._bench.actuator.position_m()
        moving = self._bench.actuator.is_moving()
        self._recorder.samples(block.first, block.volts, forces)
        self._recorder.position(block.end, position)
        self._history.append(block.first, forces, position)
        return Measured(block.end, forces, position - self._start_m, moving, self._reference_taken.is_set())

    def _read_block(self) -> SampleBlock:
        """The next block. A free-running source waits for our own disk and analysis, so it has a minute where hardware has seconds."""
        for _ in range(FREE_RUNNING_READS if self._free_running else 1):
            try:
                return self._bench.forces.read(READ_TIMEOUT_S)
            except DeviceTimeout as error:
                timeout = error
        raise timeout

    def _begin_phase(self, phase: Phase, sample: int) -> None:
        assert self._recorder is not None
        self._history.begin(phase, sample)
        self._recorder.event(Event(sample, "phase", str(phase)))

    def _watch_camera(self) -> None:
        """Give the camera up when a trigger that is long past has had no answer for too long."""
        answered, now = self._received + self._lost, time.monotonic()
        overdue = self._history.end - self._train.sample(answered) > 2 * self._train.divisor + self._exposure
        if not overdue or answered != self._awaited[0]:
            self._awaited = (answered, now)
        elif now - self._awaited[1] > CAMERA_PATIENCE_S:
            raise DeviceTimeout(
                f"{self._bench.camera.name}: trigger {answered} had no answer for {CAMERA_PATIENCE_S:g} s;"
                " check the trigger line and the camera"
            )

    def _wind_down(self, workers: list[threading.Thread]) -> None:
        """Actuator, last exposure, forces, camera, analysis, last events: in this order."""
        assert self._recorder is not None
        self._state = "stopping"
        self._attempt("actuator", self._bench.actuator.stop)
        self._attempt("forces", self._finish_exposure)
        self._attempt("forces", self._bench.forces.stop)
        self._final_sample = self._history.end
        self._history.finish()
        for worker in workers:
            worker.join()
        self._attempt("camera", self._bench.camera.stop)
        if self._experiment.phase is not Phase.END:
            self._attempt("recorder", lambda: self._begin_phase(Phase.END, self._history.end))
        contact = self.contact()
        if contact is not None:
            self._attempt("recorder", lambda: self._recorder.contact(contact) if self._recorder else None)
        event = Event(self._final_sample, "error" if self._failed else "stop", self._reason)
        self._attempt("recorder", lambda: self._recorder.event(event) if self._recorder else None)

    def _attempt(self, who: str, call: Callable[[], None]) -> None:
        """Do one step of the ending; a failure is noted and the next step still taken."""
        try:
            call()
        except Exception as error:
            self._stop_with(sentence(who, error), failed=True)

    def _finish_exposure(self) -> None:
        """Read on until no exposure is open, so that the last trigger can have its frame."""
        for _ in range(self._train.divisor):
            if (self._history.end - 1 - self._train.first) % self._train.divisor + 1 >= self._exposure:
                return
            self._take_block()

    # ------------------------------------------------------------------ camera

    def _receive(self) -> None:
        """Every trigger's fate, in order, until the last one is accounted for."""
        try:
            self._receive_answers()
        except Exception as error:
            self._stop_with(sentence("camera", error), failed=True)
        self._to_analysis.end()
        if self._stop.is_set():
            self._lose_the_rest()

    def _receive_answers(self) -> None:
        answered_at = time.monotonic()
        while self._final_sample is None or self._received + self._lost < self._train.count_before(self._final_sample):
            try:
                self._deliver(self._bench.camera.read(POLL_S))
                answered_at = time.monotonic()
            except DeviceTimeout:
                if self._final_sample is not None and time.monotonic() - answered_at > CAMERA_PATIENCE_S:
                    return

    def _deliver(self, answer: Frame | LostFrame) -> None:
        assert self._recorder is not None
        if isinstance(answer, LostFrame):
            self._lost += 1
            self._recorder.lost_frame(answer)
            return
        self._received += 1
        self._latest_image = answer.image
        self._recorder.frame(answer)
        self._to_analysis.put(answer)

    def _lose_the_rest(self) -> None:
        """Give every trigger that never had an answer its fate, once the last sample is known."""
        self._history.wait_for_end()
        for missing in range(self._received + self._lost, self._train.count_before(self._history.end)):
            self._deliver(LostFrame(missing, self._train.sample(missing), f"no image came before the run ended: {self._reason}"))

    # ------------------------------------------------------------------ analysis

    def _analyse(self) -> None:
        """One pipeline step per frame that gets here."""
        try:
            while not self._to_analysis.is_drained:
                frame = self._to_analysis.get(POLL_S)
                if frame is not None:
                    self._analyse_frame(frame)
        finally:
            self._to_analysis.end()  # whatever happened, nobody waits for us

    def _analyse_frame(self, frame: Frame) -> None:
        assert self._recorder is not None
        if not self._history.wait_for(frame.sample + self._exposure):
            self._to_analysis.skipped += 1  # the forces ended before its exposure did
            return
        snapshot = self._pipeline.step(frame.index, frame.sample, frame.image, self._history.conditions(frame.sample))
        if self._pipeline.reference_frame == frame.index:
            self._recorder.event(Event(frame.sample, "reference", f"frame {frame.index}"))
            self._reference_taken.set()
        if self._snapshots:
            self._snapshots[-1] = without_fields(self._snapshots[-1])
        self._snapshots.append(snapshot)
        self._analysed += 1
        self._recorder.snapshot(snapshot)

    def _count(self) -> Counts:
        return Counts(
            triggers=self._train.count_before(self._history.end),
            frames_received=self._received,
            frames_recorded=self._recorder.frames_recorded if self._recorder else 0,
            frames_lost=self._lost,
            frames_analysed=self._analysed,
            frames_skipped=self._to_analysis.skipped,
            samples=self._history.end,
        )
