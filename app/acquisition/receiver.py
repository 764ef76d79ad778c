"""The camera's side of a run: the fate of every trigger, to the disk without loss and to the
analysis newest first.
"""

from __future__ import annotations

import math
import threading
import time
from weakref import ref

from analysis.arrays import Array
from app.acquisition.channels import LatestChannel
from app.acquisition.ending import Ending
from app.acquisition.losses import Losses
from app.acquisition.recorder_thread import Recorder
from app.acquisition.watchdog import blamed
from app.evaluation.history import History
from app.records.record_types import ACCOUNT, REVOKED, Event
from app.settings.sections import Config, Limits
from app.system.priority import give_way
from drivers.answers import check_answer
from drivers.errors import DeviceError, DeviceTimeout
from drivers.protocols import Camera, Frame, LostFrame, TriggerTrain
from drivers.turns import TurnClock

POLL_S = 0.1
PAUSE_S = 0.02
PATIENCE_S = 3.0  # without an answer to a trigger that is past, then the camera is given up
LEAST_PATIENCE_S = 0.3  # while the stage moves
JUDGED_FROM = 20  # triggers, the share that was lost


class Receiver:
    """Asks the camera for every trigger's fate, in order, until the last one is accounted for.

    Parameters
    ----------
    block_s : float
        Time between two blocks of forces, seconds: `is_behind` is asked once for each.

    Attributes
    ----------
    received, lost : int
        Triggers answered so far, by a frame and by a named loss.
    losses : Losses
        Their names.
    latest_image : ndarray or None
        The newest frame's image, not to be written to.
    latest_sample : int
        The sample of its trigger.
    revoked_from : int or None
        The frame from which on nothing is certain, because the account at the end does not hold.
    """

    def __init__(
        self,
        camera: Camera,
        train: TriggerTrain,
        history: History,
        recorder: Recorder,
        to_analysis: LatestChannel[Frame],
        ending: Ending,
        limits: Limits,
        block_s: float,
    ) -> None:
        self.received = 0
        self.lost, self.losses = 0, Losses()
        self.latest_image: Array | None = None
        self.latest_sample = 0
        self.revoked_from: int | None = None
        self._camera = camera
        self._train = train
        self._history = history
        self._recorder = recorder
        self._to_analysis = to_analysis
        self._ending = ending
        self._limits = limits
        self._answering = threading.Lock()
        self._turns = TurnClock(block_s)
        self._asked_at = math.inf  # since then a call of the camera lasts
        self._is_over = False  # every trigger is accounted for, or the camera was given up
        self._heard = (0, 0)  # triggers answered and images delivered by the camera
        self._heard_at = 0.0  # when that changed last
        self._images: list[ref[Array]] = []  # that were delivered, some of them in use
        self._doubt = ""  # about the trigger of the newest frame
        self._hands_over = False  # a frame, to a disk or an analysis that may make it wait

    @property
    def answered(self) -> int:
        """Triggers whose fate is known."""
        return self.received + self.lost

    def is_behind(self, *, drives: bool) -> bool:
        """Whether a trigger that is long past has had no answer yet.

        Raises
        ------
        DeviceTimeout
            Nothing has come from the camera for too long. An image that was delivered, and waits
            for what tells its trigger, is no silence, nor is one that a simulated camera draws
            while nothing is driven.
        """
        now = self._turns.read()
        late = 2 * self._train.divisor + self._history.exposure_samples
        overdue = self._history.end - self._train.sample(self.answered) > late
        patience_s = PATIENCE_S
        if drives:
            # the camera may have fallen silent a period before
            left_s = self._limits.age - (late + self._train.divisor) / self._history.sample_rate_hz
            patience_s = min(PATIENCE_S, max(LEAST_PATIENCE_S, left_s))
        heard = (self.answered, getattr(self._camera, "delivered", 0))
        is_drawing = not drives and getattr(self._camera, "is_drawing", False)
        if not overdue or self._hands_over or is_drawing or heard != self._heard:
            self._heard, self._heard_at = heard, now
        elif now - self._heard_at > patience_s:
            raise DeviceTimeout(
                f"{self._camera.name}: no image came for {patience_s:.2g} s, trigger"
                f" {self.answered} has had no answer; check the trigger line and the camera"
            )
        return overdue

    def work(self) -> None:
        """Receive until the end; then every trigger without an answer is a named loss."""
        try:
            if getattr(self._camera, "draws", False):  # a simulated one
                give_way(5)
            self._receive()
        except BaseException as error:  # every trigger has its fate all the same
            self._ending.fail("camera", error)
        self._history.wait_for_end()
        self._account()
        self._close_account()

    def join(self, *threads: threading.Thread) -> None:
        """Wait for the threads of the camera and of the analysis, after the history has ended; a
        camera that does not return is given up.
        """
        for thread in threads[:1]:
            while thread.is_alive():
                thread.join(POLL_S)
                if not self._hands_over and self._turns.read() - self._asked_at > PATIENCE_S:
                    self._ending.call(
                        f"{self._camera.name}: it did not return from a call and was given up;"
                        " check the camera, its connection and its driver",
                        failed=True,
                    )
                    self._account()
                    break
        for thread in threads[1:]:
            thread.join()

    def _account(self) -> None:
        """Every trigger without an answer is a named loss, and no answer counts any more."""
        try:
            with self._answering:
                for missing in range(self.answered, self._train.count_before(self._history.end)):
                    self._deliver(
                        LostFrame(
                            missing,
                            self._train.sample(missing),
                            f"no image came before the run ended: {self._ending.reason}",
                        )
                    )
                self._is_over = True
        finally:  # nobody waits for more
            self._to_analysis.end()

    def _close_account(self) -> None:
        """Record what the camera's driver says of all triggers, if it does, and from which frame on
        nothing is certain, if its account does not hold.
        """
        balance = getattr(self._camera, "balance", None)
        if balance is not None and (text := balance()):
            self._recorder.append(Event(self._history.end, ACCOUNT, text))
        uncertain_from = getattr(self._camera, "uncertain_from", None)
        if uncertain_from is not None and (first := uncertain_from()) is not None:
            self.revoked_from = first
            text = f"{first}: from this frame on nothing is certain, the account does not hold"
            self._recorder.append(Event(self._history.end, REVOKED, text, first))

    def _receive(self) -> None:
        answered_at = self._turns.read()
        while not self._history.has_ended or self.answered < self._train.count_before(
            self._history.end
        ):
            try:
                self._asked_at = self._turns.read()
                with blamed(self._camera.name):
                    answer = self._camera.read(POLL_S)
                with self._answering:
                    if self._is_over:
                        return
                    due, rate = self.answered, self._history.sample_rate_hz
                    check_answer(self._camera, answer, due, self._train, rate, self._in_use())
                    self._deliver(answer)
                answered_at = self._turns.read()
                self._asked_at = math.inf
                self._check_losses()
            except DeviceTimeout:
                self._asked_at = math.inf
                if self._history.has_ended:
                    if self._turns.read() - answered_at > PATIENCE_S:
                        return
                    time.sleep(PAUSE_S)  # a camera without a board answers at once

    def _in_use(self) -> list[Array]:
        """Images that somebody still needs; who keeps the list keeps them in use."""
        return [image for one in self._images if (image := one()) is not None]

    def _check_losses(self) -> None:
        share, is_judged = self.lost / self.answered, self.answered >= JUDGED_FROM
        if is_judged and share > self._limits.lost_frames and not self._ending.is_called.is_set():
            self._ending.call(
                f"{self._camera.name}: {self.lost} of {self.answered} triggers have no image,"
                f" limits.lost_frames is {self._limits.lost_frames:g} ({self.losses}); check the"
                " camera, its cable and its trigger",
                failed=True,
            )

    def _deliver(self, answer: Frame | LostFrame) -> None:
        if isinstance(answer, LostFrame):
            self.lost += 1
            self.losses.add(answer.reason)
            self._recorder.append(answer)
            return
        self.received += 1
        self.latest_image, self.latest_sample = answer.image, answer.sample
        self._images = [*map(ref, self._in_use()), ref(answer.image)]
        self._hands_over = True
        try:
            if answer.doubt != self._doubt:
                self._doubt = answer.doubt
                text = f"from frame {answer.index} on: {answer.doubt or 'no more doubt'}"
                self._recorder.append(Event(answer.sample, "camera", text))
            self._recorder.append(answer)
            self._to_analysis.put(answer)
        finally:
            self._hands_over = False


def check_camera(camera: Camera, config: Config) -> None:
    """Refuse images of another kind or size than the settings want.

    Raises
    ------
    DeviceError
    """
    if camera.dtype != config.camera.dtype:
        raise DeviceError(
            f"{camera.name}: {config.camera.pixel_format} was asked, it gives images of"
            f" {camera.dtype.itemsize * 8} bit;"
            f" set camera.pixel_format to {'Mono16' if camera.dtype.itemsize == 2 else 'Mono8'}"
        )
    if camera.shape != config.camera.shape:
        rows, columns = camera.shape
        raise DeviceError(
            f"{camera.name}: images of {config.camera.width} x {config.camera.height} were asked,"
            f" it gives {columns} x {rows}; set camera.width and camera.height to that"
        )
