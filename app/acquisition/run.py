"""One live run: threads from the devices to disk and analysis, and a stop that comes first.

control   reads the force blocks, decides the phases, commands the actuator, watches the limits
camera    reads every trigger's fate (`receiver`)
analysis  one pipeline step per frame (`analysis_thread`)
recorder  everything to the session, by threads of its own (`recorder_thread`)

States: idle -> armed -> running -> stopping -> done | failed. Whatever happens, in whichever
thread, the actuator is stopped first, what was measured reaches the disk, and the run ends in a
named state with a reason (`ending`).
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from analysis.arrays import Array
from app.acquisition.analysis_thread import AnalysisThread
from app.acquisition.channels import LatestChannel
from app.acquisition.control_loop import ControlLoop
from app.acquisition.force_reader import BenchDevices
from app.acquisition.receiver import Receiver, check_camera
from app.acquisition.recorder_thread import Recorder, SessionSink
from app.acquisition.stage import unsupervised
from app.acquisition.watchdog import START_S
from app.evaluation.frame_analysis import FrameAnalysis
from app.evaluation.observed_run import ObservedRun, not_begun
from app.evaluation.quality import YOUNG_S, Quality
from app.evaluation.setup import bytes_per_s
from app.experiment.decisions import ExperimentFailed
from app.experiment.live_findings import LiveFindings
from app.records.bench_view import Health
from app.records.record_types import LAST, SUPERVISOR, Counts, End, Event, Outcome, Phase
from app.records.summary import Summary
from app.settings.sections import Config
from app.system import logs
from app.system.awake import kept_awake
from app.system.stopping import StopAnswer
from app.system.usage import Usage
from drivers.errors import DeviceTimeout
from drivers.protocols import Frame, TriggerTrain

LOG = logging.getLogger(__name__)

CLOSING_S = 12.0  # of a bench, which gives up each of its devices after some seconds itself
PAUSE_S = 0.001  # pause between two looks at sources that wait
REFERENCE_WAIT_S = 30.0  # nothing moves meanwhile, and nothing is sampled
KEPT_S = 1.5  # of frames for the analysis: taking the reference takes longer than a frame
FEWEST_QUEUED = 4  # frames that the recorder's queue holds, however short it was asked


@dataclass(frozen=True, slots=True)
class _Workers:
    """Who works while the bench does."""

    recorder: Recorder
    receiver: Receiver
    analysis: AnalysisThread


class Run(ObservedRun):
    """One loading experiment on one bench, recorded and analysed as it goes.

    Parameters
    ----------
    config : Config
    bench : BenchDevices
        Opened by the run, closed by the run.
    create_sink : callable
        Makes the session, once the bench is open and its camera is as the settings say.
    pipeline : FrameAnalysis
        What analyses the frames.
    pace : float or None
        Seconds of the board per second; None where the sources wait for us (simulation at full
        speed): then nothing is skipped and no queue can run full.
    title : str
        Name of the bench, for people.
    output : Path
        Where the session goes.
    prepare : callable
        Done first, before the bench is opened (compilation); it tells what it is at.
    """

    def __init__(
        self,
        config: Config,
        bench: BenchDevices,
        create_sink: Callable[[], SessionSink],
        pipeline: FrameAnalysis,
        *,
        pace: float | None,
        title: str,
        output: Path,
        prepare: Callable[[Callable[[str], None]], None],
    ) -> None:
        super().__init__(config, title, pipeline)
        self.output = output
        self._bench = bench
        self._create_sink = create_sink
        self._free_running = pace is None
        self._quality = Quality(config, pace)
        self._prepare = prepare
        self._preparing = ""
        self._train = TriggerTrain(first=0, divisor=config.camera.divisor)
        fewest_s = FEWEST_QUEUED * config.camera.divisor / self.sample_rate_hz
        self._queue_s = max(config.recording.queue, fewest_s)
        self._history = self._analysis.history
        loop = ControlLoop(config, bench, self._history, pace=pace, on_drive=self._hurry)
        self._loop, self._experiment, self._ending = loop, loop.experiment, loop.ending
        self._watchdog, self._ask = loop.watchdog, loop.watchdog.ask
        self._stage, self._reader = loop.stage, loop.reader
        self._unsupervised = unsupervised(config)
        self._depth = math.ceil(KEPT_S * config.frame_rate_hz)
        self._to_analysis: LatestChannel[Frame] = LatestChannel(
            self._depth, sender_waits=self._free_running
        )
        self._findings = LiveFindings(config, self._analysis.series.since)
        self._workers: _Workers | None = None
        self._progress, self._left_s = 0.0, (math.nan, math.nan)

    # ------------------------------------------------------------------ what others may call, from
    # any thread

    def start(self) -> None:
        """Open the bench and begin, unless it was stopped before; returns at once."""
        with self._starting:
            if self._is_called_off:
                return
            if self._state != "idle":
                raise RuntimeError(
                    f"run: start was asked, but the run is {self._state}; make a new run"
                )
            self._state = "armed"
        self._thread = self._ending.spawn("control", self._control)

    def request_stop(self, reason: str) -> None:
        """End the run in good order: the actuator stops now, what was measured is kept, the state
        is "done". One that has not begun never will.
        """
        called_off = self._call_off("run", reason)
        self._ending.call(called_off.reason if called_off else reason, failed=False)
        if called_off:
            self._watchdog.close()
            self._analysis.close()

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator in the calling thread, then end the run; what the actuator answered."""
        state = self._state
        self.request_stop("STOP MOTION was pressed")
        return self._stage.answer_to_stop("idle" if state == "idle" else self._state)

    def stop_answer(self) -> StopAnswer | None:
        """What became of the newest stop, whoever called for it, once the position of the stage was
        read; None where none was sent.
        """
        return self._stage.stop_answer

    def answer(self, text: str, question: str = "") -> None:
        """Answer a question, if it is that of the step under way."""
        self._experiment.answer(text, question)

    def pause(self) -> None:
        """Wait for the operator's answer before the next step."""
        if self._state == "running":
            self._experiment.pause()

    def cancel_pause(self) -> None:
        """Withdraw a pause that has not begun."""
        self._experiment.cancel_pause()

    def note(self, text: str) -> None:
        """Record what the operator notes, with the newest sample, while the run goes on."""
        if self._state == "running":
            self._experiment.note(text)

    def latest_image(self) -> Array | None:
        """The newest frame's image, not to be written to."""
        return self._workers.receiver.latest_image if self._workers else None

    def motion(self) -> tuple[int, float, bool]:
        """Newest sample, travel of the stage (m), and whether it drives: for a supervisor. No
        more once it has taken a stop: the end of a run samples no forces, and may take a while.
        """
        is_driven = self._stage.is_owed or not self._ending.is_called.is_set()
        drives = self._state in ("running", "stopping") and self._experiment.phase is Phase.DRIVE
        return self._history.end, self._stage.travel_m, drives and is_driven

    def health(self) -> Health:
        """State, counts, queue and disk at this moment."""
        under_way, state = self._state in ("running", "stopping"), self._state
        if state in ("armed", "running") and self._ending.is_called.is_set():
            state = "stopping"  # also while something is prepared that takes long
        receiver = self._workers.receiver if self._workers else None
        recorder = self._workers.recorder if self._workers else None
        age_s, losses = math.nan, [self._reader.losses]
        if receiver is not None:
            losses.append(receiver.losses)
            if receiver.latest_image is not None:
                age_s = self._reader.age_s(receiver.latest_sample)
        return Health(
            state=state,
            reason=self._ending.reason
            or (self._experiment.advice if under_way else self._preparing),
            phase=str(self._experiment.phase) if under_way else "",
            counts=self._count(),
            queue_fill=recorder.fill if recorder else 0.0,
            queue_seconds=self._queue_s,
            disk_free_bytes=recorder.disk_free_bytes if recorder else -1,
            sample=self._history.end,
            progress=self._progress,
            uncertain=len(self._analysis.uncertain),
            exposures=self._reader.exposures,
            losses="; ".join(filter(None, map(str, losses))),
            damage=str(self._analysis.damage),
            image_age_s=age_s,
            shed=self._quality.shed,
            shed_why=self._quality.why,
            step=self._experiment.text if under_way else "",
            step_number=self._experiment.number if under_way else 0,
            left_s=self._left_s[0],
            all_left_s=self._left_s[1],
            question=self._experiment.question if under_way else "",
            is_pause_asked=under_way and self._experiment.is_pause_asked,
            is_paused=under_way and self._experiment.is_paused,
        )

    # ------------------------------------------------------- the life of the run, in its thread

    def _control(self) -> None:
        try:
            with logs.beside(self.output), nullcontext() if self._free_running else kept_awake():
                self._live()
        except BaseException as error:
            self._ending.fail("control", error)
        finally:
            if not self._ended.is_set():  # whatever happened, somebody waits for the end
                self._end(Outcome(End.FAILED, self._ending.reason, self._count(), None))

    def _live(self) -> None:
        """From the opening of the bench to the publishing of the outcome."""
        usage = Usage()
        sink: SessionSink | None = None
        LOG.info("run on the %s, session %s", self.title, self.output.name)
        try:
            if self._is_made_ready():
                sink = self._create_sink()
                self._record_run(sink)
        except BaseException as error:  # whatever it is, the session is closed
            self._ending.fail("control", error)
        self._stage.confirm_stop()
        self._stage.is_connected = False
        if "bench" not in self._watchdog.given_up:
            close = partial(self._watchdog.aside, "bench", self._bench.close, CLOSING_S)
            self._ending.attempt("bench", close)
        self._watchdog.close()
        self._analysis.close()
        resources = usage.resources(
            self._workers.recorder.peak_memory_bytes if self._workers else 0
        )
        outcome = self._outcome_now(self._summary(), resources)
        if sink is not None:
            self._finish(sink, outcome)
            if sink.receipt is not None:
                resources["receipt"] = str(sink.receipt)
            if sink.path != self.output:
                resources["session"] = str(sink.path)
        self._ending.close()
        ended = self._outcome_now(outcome.summary, resources)
        self._progress = 1.0 if ended.is_complete else self._progress
        LOG.info("%s; %s", ended.ended_as, logs.listed(asdict(ended.counts) | resources))
        self._end(ended)

    def _is_made_ready(self) -> bool:
        """Prepare, open the bench and see that the drive can be done; False where the run was
        stopped before: then nothing is started, and nothing written.
        """
        steps: list[Callable[[], None]] = [
            lambda: self._prepare(self._say_preparing),
            self._open,
            lambda: check_camera(self._bench.camera, self.config),
            lambda: self._ask(self._stage.name, self._stage.arm),
        ]
        for step in steps:
            if not self._ending.is_called.is_set():
                step()
        if self._ending.is_called.is_set():
            self._ending.reason = not_begun("run", self._ending.reason)
            return False
        return True

    def _open(self) -> None:
        def work() -> None:
            self._bench.open()
            if "bench" in self._watchdog.given_up:  # nobody waits for it any more
                self._bench.close()

        try:
            self._ask("bench", work, math.inf)
            self._stage.is_connected = True
            if self._unsupervised:
                LOG.warning("%s", self._unsupervised)
        except DeviceTimeout:
            if "bench" not in self._watchdog.given_up or self._ending.failed:
                raise
            LOG.warning("the bench did not open before the run was stopped, and was given up")

    def _say_preparing(self, what: str) -> None:
        LOG.info("%s", what)
        self._preparing = what

    def _finish(self, sink: SessionSink, outcome: Outcome) -> None:
        self._ending.attempt("session", lambda: sink.append(outcome))
        # told whatever ended the run: it says what can be repaired
        self._ending.attempt("session", sink.close, in_any_case=True)

    def _summary(self) -> Summary | None:
        """What the run comes down to; None where no frame was analysed."""
        try:
            return self._analysis.summary()
        except BaseException as error:
            self._ending.fail("summary", error)
            return None

    def _outcome_now(self, summary: Summary | None, resources: dict[str, Any]) -> Outcome:
        """How the run ends, by the reason that stands at this moment."""
        return Outcome(self._ending.end, self._ending.reason, self._count(), summary, resources)

    def _record_run(self, sink: SessionSink) -> None:
        """From the first sample to the last byte on disk."""
        recorder = Recorder(
            sink,
            self._queue_s,
            bytes_per_s(self.config),
            self.config.recording.flush_interval,
            sender_waits=self._free_running,
            on_failure=lambda reason: self._ending.call(reason, failed=True),
        )
        receiver = Receiver(
            self._bench.camera,
            self._train,
            self._history,
            recorder,
            self._to_analysis,
            self._ending,
            self.config.limits,
            self._reader.block_s,
        )
        analysis = AnalysisThread(self._analysis, recorder, self._to_analysis, self._quality)
        self._workers = workers = _Workers(recorder, receiver, analysis)
        recording: list[threading.Thread] = []
        others: list[threading.Thread] = []
        try:
            for name, work in recorder.works():
                recording.append(self._ending.spawn(name, work))
            if self._unsupervised:
                recorder.append(Event(0, SUPERVISOR, self._unsupervised))
            self._reader.record = recorder.append
            self._loop.carry_out(0)
            for device in (self._bench.camera, self._bench.forces):
                self._ask(device.name, partial(device.start, self._train), START_S)
            self._state = "running"
            others.append(self._ending.spawn("camera", receiver.work))
            others.append(self._ending.spawn("analysis", analysis.work))
            self._measure(workers)
        except BaseException as error:
            self._ending.fail("control", error)
        if len(others) < 2:
            self._to_analysis.abandon()  # nobody takes what is put there
        try:
            self._wind_down(workers, others)
        finally:
            self._history.finish()
            recorder.end()
            for thread in recording:
                thread.join()

    def _measure(self, workers: _Workers) -> None:
        """Read, record, decide, until the experiment or somebody ends it."""
        while not self._ending.is_called.is_set():
            has_reference = workers.analysis.reference_taken.is_set()
            measured = self._reader.take(has_reference=has_reference)
            while (
                workers.receiver.is_behind(drives=self._watchdog.drives)
                and self._free_running
                and not self._ending.is_called.is_set()
            ):
                time.sleep(PAUSE_S)  # recorded forces would run ahead of what is analysed
            if measured is None:
                self._reader.check_gaps()
                continue
            if self._free_running and self._experiment.looks:
                self._catch_up(workers)
            if self._experiment.is_reference_due(measured):
                measured = replace(measured, has_reference=self._wait_for_reference(workers))
            try:
                phase = self._experiment.advance(replace(measured, seen=self._findings.look))
            except ExperimentFailed:
                if self._ending.is_called.is_set():
                    return  # the stage stands because somebody stopped it
                raise
            self._progress = self._experiment.progress(measured)
            self._left_s = self._experiment.left_s(measured)
            self._loop.carry_out(measured.end_sample)
            if phase is Phase.END:
                self._ending.call(self._experiment.completed, failed=False, is_complete=True)

    def _catch_up(self, workers: _Workers) -> None:
        """Wait until the frames that have come are analysed: a step looks at what they show."""
        give_up = time.monotonic() + REFERENCE_WAIT_S
        while (
            workers.analysis.is_behind(workers.receiver.received)
            and not self._ending.is_called.is_set()
            and time.monotonic() < give_up
        ):
            time.sleep(PAUSE_S)

    def _hurry(self) -> None:
        """Keep young frames for an analysis that is too slow, as the stage is to move."""
        if not self._free_running:
            depth = young = max(1, round(YOUNG_S * self.config.frame_rate_hz))
            if self._quality.may_be_late:
                # one more, for the first frame that comes in the drive has no room otherwise; and
                # one less, that is begun while the one before it is analysed
                depth, young = self._depth + 1, max(1, young - 1)
            self._to_analysis.narrow(depth, young, self._quality.period_s)
        self._watchdog.drives = not self._free_running

    def _wait_for_reference(self, workers: _Workers) -> bool:
        """Whether the reference is in place, after waiting for it as long as nothing is sampled
        meanwhile, and a frame that has come may become it.
        """
        give_up = time.monotonic() + REFERENCE_WAIT_S
        due = self._train.count_before(self._history.end - self.config.exposure_samples)
        while not workers.analysis.reference_taken.wait(0.01):
            is_in_vain = (
                workers.receiver.answered >= due
                and not workers.analysis.is_behind(workers.receiver.received)
                and self._analysis.pipeline.reference_frame is None
            )
            if (
                self._ending.is_called.is_set()
                or self._ask(self._bench.forces.name, self._bench.forces.backlog)
                or time.monotonic() > give_up
                or is_in_vain
            ):
                return False
        self._watchdog.heard(0.0)  # nothing was sampled, so no force has become older meanwhile
        return True

    # ------------------------------------------------------------------ the end

    def _wind_down(self, workers: _Workers, others: list[threading.Thread]) -> None:
        """Actuator, last samples and exposure, forces, whether the stage stands, camera, analysis,
        last events: in this order. A device that was given up is left alone.
        """
        attempt = self._ending.attempt
        self._state = "stopping"
        self._wind_down_device(self._stage.name, self._stage.stop_now)
        if self._bench.forces.name not in self._watchdog.given_up:
            read_on, stood = self._reader.read_on, self._loop.now
            attempt("forces", lambda: read_on(stood(), self._train))
        self._wind_down_device(self._bench.forces.name, self._bench.forces.stop)
        self._stage.confirm_stop()
        self._history.finish()
        workers.receiver.join(*others)
        self._analysis.revoke(workers.receiver.revoked_from)
        self._wind_down_device(self._bench.camera.name, self._bench.camera.stop)
        if self._experiment.phase is not Phase.END:
            begin, end = self._loop.begin_phase, self._history.end
            attempt("recorder", lambda: begin(Phase.END, end))
        last = Event(self._history.end, LAST[self._ending.end], self._ending.reason)
        attempt("recorder", lambda: workers.recorder.append(last))

    def _wind_down_device(self, name: str, step: Callable[[], None]) -> None:
        if name not in self._watchdog.given_up:
            self._ending.attempt(name, lambda: self._ask(name, step))

    def _count(self) -> Counts:
        workers = self._workers
        return Counts(
            triggers=self._train.count_before(self._history.end),
            frames_received=workers.receiver.received if workers else 0,
            frames_recorded=workers.recorder.frames_recorded if workers else 0,
            frames_lost=(workers.receiver.lost + workers.recorder.frames_refused if workers else 0),
            frames_analysed=len(self._analysis.series),
            frames_skipped=self._to_analysis.skipped,
            samples=self._history.end - self._reader.samples_lost,
            samples_lost=self._reader.samples_lost,
        )
