"""A bench that is connected and looked at, without a run: each device in a thread of its own, so
that one that fails, or falls silent, hides no other.

Camera and forces begin as in a run, the camera first, with fewer triggers a second.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from app.acquisition.ending import sentence
from app.acquisition.force_reader import BenchDevices
from app.acquisition.jog import JoggedStage
from app.acquisition.live_forces import LiveForces
from app.acquisition.picture import picture_of
from app.acquisition.watchdog import PATIENCE_S
from app.experiment.course import MeasuredBlock
from app.records.bench_view import (
    END_OF_RANGE,
    KINDS,
    BenchView,
    DeviceState,
    DeviceView,
    PictureView,
)
from app.records.quantities import counted
from app.settings.sections import Config
from app.system.stopping import StopAnswer
from drivers.answers import check_answer
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, OutOfLimits
from drivers.protocols import AdjustableCamera, Frame, TriggerTrain

LOG = logging.getLogger(__name__)
MOST_HZ = 10.0  # pictures per second
CAMERA_S = 5.0  # for which the forces wait for the camera, which must be started before them
READ_S = 0.3
POLL_S = 0.1  # pause between two looks at the stage
CHECK_S = 0.02  # pause between two looks at what may forbid a motion
AGAIN_S = 1.0  # between two attempts to reach a stage that has failed, or would not move
SHOWN_S = 3.0  # for which a loss is shown; without a picture for as long, that is said
ADJUST_S = 2.0  # in which the camera comes to what was asked of it
PAUSE_S = 0.05  # after a read that gave nothing: it returns at once when there are no triggers


class _ConnectedDevice:
    """A device, its state, and the thread that opens it, works with it and closes it."""

    def __init__(self, device: Any, work: Callable[[], None]) -> None:
        self.device, self.name = device, str(device.name)
        self.is_open = False
        self.description = ""
        self.state, self.sentence = DeviceState.CONNECTING, ""
        self._work = work
        self.thread = threading.Thread(
            target=self._run, name=f"slipscope-{self.name.replace(' ', '-')}", daemon=True
        )

    def tell(self, state: DeviceState, what: str = "") -> None:
        """Note how it is; without a word, what it says of itself."""
        new = state, what or self.description
        if new != (self.state, self.sentence):
            LOG.info("%s: %s: %s", self.name, *new)
        self.sentence, self.state = new[1], state

    @property
    def view(self) -> DeviceView:
        """What is shown."""
        return DeviceView(self.name, self.state, self.sentence)

    def _run(self) -> None:
        try:
            self.device.open()
            self.description = str(self.device.describe())
            self.is_open = True
            self.tell(DeviceState.READY)
            self._work()
        except BaseException as error:  # a thread that is gone shows its last reading for ever
            LOG.debug("%s", self.name, exc_info=error)
            self.tell(DeviceState.FAILED, sentence(self.name, error))
        self.is_open = False
        try:
            self.device.close()
        except BaseException as error:
            LOG.warning("%s: it did not close: %s", self.name, error)
        if self.state is not DeviceState.FAILED:
            self.tell(DeviceState.CLOSED)


class Preview:
    """The devices of a bench, looked at; has the methods of `app.records.bench_view.BenchPreview`,
    of which `JoggedStage` and `LiveForces` have those that only ask for the stage or set a zero.

    Parameters
    ----------
    config : Config
    bench : BenchDevices
        Opened and closed by this object, device by device.
    guard : callable, optional
        Called once before the stage is moved for the first time.
    can_restart : bool
        Whether the forces can be started twice: a simulated world runs only once.
    bytes_per_s : float
        What a second of a run's recording takes.
    """

    def __init__(
        self,
        config: Config,
        bench: BenchDevices,
        *,
        guard: Callable[[], None] = lambda: None,
        can_restart: bool = True,
        bytes_per_s: float = math.nan,
    ) -> None:
        self._config, self._bytes_per_s, self._can_restart = config, bytes_per_s, can_restart
        rate = config.forces.sample_rate
        self._train = TriggerTrain(0, max(config.camera.divisor, math.ceil(rate / MOST_HZ)))
        self._stage = stage = JoggedStage(config, bench.actuator, self._newest_forces, guard)
        self._forces = LiveForces(config, bench, stage)
        self.jog, self.move, self.home, self.go_on = stage.hold, stage.move, stage.home, stage.go_on
        self.let_go, self.stop_motion = stage.let_go, stage.stop_motion
        self.set_zero = self._forces.set_zero
        self._picture: PictureView | None = None
        self._pictured_at = -math.inf
        self._lost, self._samples_lost_at = 0, -math.inf
        self._adjustments: queue.SimpleQueue[tuple[Future[None], Callable[[], None]]]
        self._adjustments = queue.SimpleQueue()
        self._may_start, self._is_started = threading.Event(), threading.Event()
        self._sampling = threading.Event()
        self._closing = threading.Event()
        self._devices = {
            "actuator": _ConnectedDevice(bench.actuator, self._follow_stage),
            "camera": _ConnectedDevice(bench.camera, self._take_pictures),
            "forces": _ConnectedDevice(bench.forces, self._read_forces),
        }
        self._watch = threading.Thread(target=self._check, name="slipscope-jog", daemon=True)

    # ------------------------------------------------------------------ what others may call

    def start(self) -> None:
        """Begin to connect; returns at once."""
        for kind in KINDS:
            self._devices[kind].thread.start()
        self._watch.start()

    def look(self, known: int = -1) -> BenchView:
        """What the bench shows now; without the picture if that is the one of number `known`."""
        picture = self._picture
        return BenchView(
            {kind: device.view for kind, device in self._devices.items()},
            self._forces.view(),
            None if picture is None or picture.number == known else picture,
            self._stage.view(),
            self._bytes_per_s,
            self._stage.said,
            self._stage.failure,
            time.monotonic() - self._pictured_at,
        )

    def motion(self) -> tuple[int, float, bool]:
        """Newest sample, travel of the stage (m), whether it is moved: for a supervisor."""
        return self._forces.history.end, self._stage.travel_m, self._stage.is_driven

    def stop_answer(self) -> StopAnswer | None:
        """What became of the newest stop; None where none was sent."""
        return self._stage.stop_answer

    def zero(self, *, under_load: bool = False) -> tuple[float, float]:
        """See `LiveForces.zero`; refused while the stage is moved."""
        if self._stage.is_driven:
            raise DeviceFault("zero: the stage moves; let go of it first")
        if not self._sampling.is_set():
            raise DeviceFault("zero: no forces are read; see the line of the forces")
        return self._forces.zero(under_load=under_load)

    def adjust_camera(self, exposure_s: float, gain_db: float) -> bool:
        """See `app.records.bench_view.BenchPreview.adjust_camera`; the camera is asked by the
        thread that works with it, between two pictures.

        Raises
        ------
        OutOfLimits
            The camera does not have that exposure or gain.
        DeviceTimeout
            It takes no pictures.
        """
        camera = self._devices["camera"]
        if not isinstance(camera.device, AdjustableCamera):
            return False
        if exposure_s > self._period_s:
            raise OutOfLimits(
                f"{camera.name}: an exposure of {exposure_s * 1e3:g} ms was requested, a connected"
                f" camera is triggered every {self._period_s * 1e3:g} ms; use a shorter one"
            )
        adjustment: Future[None] = Future()
        self._adjustments.put((adjustment, partial(camera.device.adjust, exposure_s, gain_db)))
        try:
            adjustment.result(ADJUST_S)
        except TimeoutError:
            raise DeviceTimeout(
                f"{camera.name}: exposure and gain were not changed in {ADJUST_S:g} s, it takes no"
                " pictures; connect it again"
            ) from None
        return True

    def close(self) -> StopAnswer | None:
        """Stop the stage and let go of every device, as far as they answer; what became of the
        newest stop.

        Raises
        ------
        DeviceTimeout
            Some do not return from a call; only the end of this process frees them.
        """
        if self._stage.is_driven:
            self._stage.let_go()
        self._closing.set()
        silent = []
        give_up = time.monotonic() + PATIENCE_S
        for kind in ("forces", "camera", "actuator"):
            device = self._devices[kind]
            device.thread.join(max(0.0, give_up - time.monotonic()))
            if device.thread.is_alive():
                silent.append(device.name)
        if silent:
            raise DeviceTimeout(f"{', '.join(silent)}: no return from a call; given up")
        return self.stop_answer()

    def _newest_forces(self) -> MeasuredBlock | None:
        return self._forces.newest()

    # ------------------------------------------------------------------ the threads

    def _check(self) -> None:
        while not self._closing.wait(CHECK_S):
            try:
                self._stage.check()
            except BaseException as error:  # a stage that nobody looks after would go on
                LOG.error("jog: %s", sentence("jog", error), exc_info=error)

    def _follow_stage(self) -> None:
        me = self._devices["actuator"]
        refusal, tried_at = "not tried", -math.inf
        pause_s = 0.0
        while not self._closing.wait(pause_s):
            try:
                self._stage.poll()
                if refusal and time.monotonic() - tried_at > AGAIN_S:
                    refusal, tried_at = self._refusal(), time.monotonic()
                me.tell(DeviceState.LOOK if refusal else DeviceState.READY, refusal)
                pause_s = POLL_S
            except DeviceError as error:
                me.tell(DeviceState.FAILED, str(error))
                pause_s = AGAIN_S

    def _refusal(self) -> str:
        """Why the stage would refuse a move; empty if it would not."""
        try:
            self._stage.make_ready()
        except DeviceError as error:
            return str(error)
        return ""

    def _take_pictures(self) -> None:
        me = self._devices["camera"]
        self._await(self._may_start)
        if self._closing.is_set():
            return
        me.device.start(self._train)
        self._is_started.set()
        me.tell(DeviceState.READY)
        self._await(self._sampling)
        came_at, lost_at, due = time.monotonic(), -math.inf, 0
        while not self._closing.is_set():
            self._adjust()
            try:
                answer = me.device.read(READ_S)
            except DeviceTimeout:
                if time.monotonic() - came_at > max(SHOWN_S, 4 * self._period_s):
                    me.tell(DeviceState.LOOK, self._no_picture(me.name))
                self._closing.wait(PAUSE_S)
                continue
            check_answer(me.device, answer, due, self._train, self._config.forces.sample_rate)
            due += 1
            if isinstance(answer, Frame):
                self._pictured_at = came_at = time.monotonic()
                full_scale = self._config.camera.full_scale
                self._picture = picture_of(answer.index, answer.image, full_scale, self._lost)
                if came_at - lost_at > SHOWN_S:
                    me.tell(DeviceState.READY)
            else:
                self._lost, lost_at = self._lost + 1, time.monotonic()
                lost = f"{counted(self._lost, 'trigger')} without an image: {answer.reason}"
                me.tell(DeviceState.LOOK, lost)

    def _adjust(self) -> None:
        """Do what was asked of the camera meanwhile."""
        while not self._adjustments.empty():
            adjustment, act = self._adjustments.get()
            try:
                adjustment.set_result(act())
            except DeviceError as error:
                adjustment.set_exception(error)

    def _await(self, forces_came: threading.Event) -> None:
        """Return once the forces have come so far, or the bench is closed."""
        me, forces = self._devices["camera"], self._devices["forces"]
        while not (forces_came.wait(POLL_S) or self._closing.is_set()):
            if forces.state is DeviceState.FAILED:
                me.tell(DeviceState.LOOK, self._untriggered(me.name))

    @property
    def _period_s(self) -> float:
        return self._train.divisor / self._config.forces.sample_rate

    def _untriggered(self, name: str) -> str:
        forces = self._devices["forces"].name
        return f"{name}: it is connected and not triggered, because the {forces} do not work"

    def _no_picture(self, name: str) -> str:
        if not self._sampling.is_set():
            return self._untriggered(name)
        return (
            f"{name}: it is triggered {1 / self._period_s:.3g} times a second and delivers nothing;"
            " check the wire of the trigger and camera.trigger_line"
        )

    def _read_forces(self) -> None:
        me, forces = self._devices["forces"], self._devices["forces"].device
        camera, give_up = self._devices["camera"], time.monotonic() + CAMERA_S
        while camera.state is DeviceState.CONNECTING and time.monotonic() < give_up:
            if self._closing.wait(POLL_S / 10):
                return
        if camera.is_open:
            self._start_camera()
        forces.start(self._train)
        self._sampling.set()
        try:
            while not self._closing.is_set():
                if camera.is_open and not self._may_start.is_set():
                    self._start_late_camera(forces)
                self._take_forces(me)
        finally:
            self._sampling.clear()
            forces.stop()

    def _take_forces(self, me: _ConnectedDevice) -> None:
        try:
            measured = self._forces.take()
        except DeviceTimeout as error:
            me.tell(DeviceState.LOOK, str(error))
            return
        if measured is None:
            self._samples_lost_at = time.monotonic()
        used = measured.range_used if measured else ()
        ends = [
            s for s, share in zip(("normal", "shear"), used, strict=False) if share >= END_OF_RANGE
        ]
        if ends:
            me.tell(
                DeviceState.LOOK,
                f"{me.name}: the {' and the '.join(ends)} sensor reads the end of its range; check"
                " the sensor's gap and cable, or raise forces.range",
            )
        elif time.monotonic() - self._samples_lost_at > SHOWN_S:
            me.tell(DeviceState.READY)
        else:
            me.tell(DeviceState.LOOK, f"samples were lost: {self._forces.losses}")

    def _start_camera(self) -> None:
        """Let the camera wait for triggers; returns once it does, or is no longer open."""
        self._may_start.set()
        camera = self._devices["camera"]
        give_up = time.monotonic() + CAMERA_S
        while time.monotonic() < give_up and camera.is_open:
            if self._is_started.wait(POLL_S / 10):
                return

    def _start_late_camera(self, forces: Any) -> None:
        """Start a camera that came after the forces had begun, and the triggers anew."""
        if not self._can_restart:
            self._start_camera()
            return
        self._sampling.clear()
        forces.stop()
        self._start_camera()
        self._forces.restart()
        forces.start(self._train)
        self._sampling.set()
