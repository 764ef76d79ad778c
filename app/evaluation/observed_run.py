"""What the window and the terminal see of an experiment, live or recorded."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from analysis.arrays import Array
from app.evaluation.frame_analysis import Analysis, FrameAnalysis
from app.evaluation.quality import Quality
from app.evaluation.setup import grid_of
from app.records.bench_view import Health
from app.records.record_types import Counts, End, Outcome
from app.records.run_view import FORCE_POINTS, RunView
from app.settings.sections import Config
from app.system.stopping import StopAnswer


def not_begun(what: str, reason: str) -> str:
    """Why something that was stopped before it began has ended."""
    return f"the {what} was stopped before it began: {reason}"


class ObservedRun(ABC):
    """An experiment that is being analysed, to be read from any thread.

    Attributes
    ----------
    config : Config
    title : str
        What it is, for people.
    pixel_m, sample_rate_hz : float
    grid_x_px, grid_y_px : ndarray, shape (nx,) and (ny,)
        Centres of the correlation boxes.
    stays : bool
        Whether it goes on when the window that shows it is closed.
    """

    stays = False

    def __init__(self, config: Config, title: str, pipeline: FrameAnalysis) -> None:
        self.config, self.title = config, title
        self.pixel_m = config.camera.pixel
        self.sample_rate_hz = float(config.forces.sample_rate)
        self._analysis = Analysis(config, pipeline)
        self._quality = Quality(config, None)
        grid = grid_of(config)
        self.grid_x_px, self.grid_y_px = grid.x_px, grid.y_px
        self._state = "idle"
        self._starting = threading.Lock()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._outcome: Outcome | None = None
        self._is_called_off = False  # it was to end before it began

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """The outcome once the experiment has ended and its threads are gone; None if it has not
        after `timeout` seconds.
        """
        if not self._ended.wait(timeout):
            return None
        if self._thread is not None:
            # an interpreter that ends while the thread lets go of its arrays may crash
            self._thread.join()
        return self._outcome

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        """What it shows now: of the snapshots those after the first `seen`, or only what it is at
        if that is negative. `is_shown` says that a window shows them.
        """
        outcome = self.outcome()  # first, so that all that is read after an outcome is complete
        now, analysis = (self.health(), outcome, self.stop_answer()), self._analysis
        if seen < 0:
            return RunView(*now)
        if is_shown:
            self._quality.shows()
        return RunView(
            *now,
            tuple(analysis.series.since(seen)),
            analysis.pipeline.contact,
            analysis.history.block_means(FORCE_POINTS),
            self.latest_image(),
            analysis.reference_image,
        )

    @abstractmethod
    def health(self) -> Health:
        """The state of the experiment at a glance."""

    @abstractmethod
    def latest_image(self) -> Array | None:
        """The newest frame's image, the same object until there is a newer one."""

    def answer(self, text: str, question: str = "") -> None:  # noqa: B027 - nothing to answer
        """Answer the question of the step under way; what is recorded asks none."""

    def pause(self) -> None:  # noqa: B027 - nothing to wait for
        """Wait before the next step; what is recorded already has none."""

    def cancel_pause(self) -> None:  # noqa: B027 - nothing to withdraw
        """Withdraw a pause that has not begun; what is recorded has none."""

    def note(self, text: str) -> None:  # noqa: B027 - nothing is recorded
        """Record a note of the operator; what is recorded already takes none."""

    def stop_answer(self) -> StopAnswer | None:
        """What became of a stop; what is recorded moves nothing."""
        return None

    def outcome(self) -> Outcome | None:
        """How the experiment ended; None while it has not."""
        return self._outcome

    def _call_off(self, what: str, reason: str) -> Outcome | None:
        """End an experiment that has not begun, which never will; None if it has begun."""
        with self._starting:
            if self._state != "idle":
                return None
            self._is_called_off = True
            why = not_begun(what, reason)
            outcome = Outcome(End.STOPPED, why, Counts(), None)
            self._end(outcome)
        return outcome

    def _end(self, outcome: Outcome) -> None:
        self._outcome = outcome
        self._state = outcome.state
        self._ended.set()
