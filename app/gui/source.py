"""What the window needs of a live run or of a replay."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.evaluation.timeline import ReplayVerdict, Timeline
from app.records.record_types import F64, Snapshot
from app.records.run_view import RunView
from app.settings.sections import Config
from app.system.stopping import StopAnswer

Image = NDArray[np.uint8] | NDArray[np.uint16]
Rect = tuple[float, float, float, float]  # left, top, width, height in px


class RunSource(Protocol):
    """A live run or a replay: the window starts it, reads it, and asks it to stop.

    A source opens devices and files in `start`, not when it is constructed. Whatever only reads is
    called from one thread, which may be any.

    Attributes
    ----------
    title : str
        The name of the run, "simulated bench" or "replay of x.h5".
    config : Config
        The settings of this run.
    grid_x_px, grid_y_px : ndarray, shapes (nx,) and (ny,)
        Box centres along x and y, one every `config.dic.step`.
    stays : bool
        Whether it goes on when the window is closed.
    """

    stays: bool

    title: str
    config: Config
    grid_x_px: F64
    grid_y_px: F64

    def start(self) -> None:
        """Begin; returns at once."""

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator at once, then end the run; from any thread, at any time. What the
        actuator answered.
        """

    def request_stop(self, reason: str) -> None:
        """Ask for an orderly end of the run; returns at once."""

    def answer(self, text: str) -> None:
        """Answer the question of the step under way."""

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        """What it shows now: all snapshots but the first `seen`, and nothing but its state if that
        is negative; `is_shown` says that somebody sees them.
        """


class Kind(StrEnum):
    """What a source shows: a run that goes on, a recorded one, or a further analysis of it."""

    LIVE = "live"
    REPLAY = "replay"
    ANALYSIS = "analysis"


class PlaybackControl(Protocol):
    """Pace and pause of a replay; from any thread, returns at once."""

    pace: float | None  # seconds of the experiment per second; None: as fast as the machine
    is_paused: bool

    def set_pace(self, pace: float | None) -> None: ...


@runtime_checkable
class PlaybackSource(Protocol):
    """What a replay has beyond a `RunSource`. A frame is named by its number as recorded.

    Attributes
    ----------
    kind : str
        A `Kind`.
    timeline : Timeline
        What the recorded run did when.
    """

    kind: str
    playback: PlaybackControl
    timeline: Timeline

    @property
    def can_browse(self) -> bool:
        """Whether recorded frames can be shown yet."""

    @property
    def is_browsing(self) -> bool:
        """Whether a recorded frame is shown instead of the newest replayed one."""

    @property
    def is_playing(self) -> bool:
        """Whether the frame that is shown changes by itself."""

    @property
    def frame(self) -> int:
        """The frame that is shown."""

    def show(self, frame: int) -> None:
        """Pause, and show a recorded frame."""

    def move(self, frames: int) -> None:
        """Pause, and show the frame that was recorded so many before or after."""

    def play(self) -> None:
        """Go on from the frame that is shown."""

    def pause(self) -> None:
        """Stay at the frame that is shown."""

    def has_results(self, frame: int) -> bool:
        """Whether there are results of a recorded frame."""

    def analyse(self, frame: int) -> None:
        """Compute the results of a frame that has none; it may take a second."""

    def browsed(self) -> Snapshot | None:
        """Results of the frame that is shown; None while it is the newest replayed one."""

    def verdict(self) -> ReplayVerdict | None:
        """Whether the results are the recorded ones; None while that is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """What does not change during a run; the rectangle is that of the grid of boxes."""

    title: str
    pixel_um: float
    grid_rect_px: Rect
    config: Config
    kind: Kind = Kind.LIVE
    timeline: Timeline | None = None  # of a recorded run


def setup_of(source: RunSource) -> Setup:
    """What does not change during the run of `source`."""
    x, y, config = source.grid_x_px, source.grid_y_px, source.config
    step = float(config.dic.step)
    rect = (float(x[0]) - step / 2, float(y[0]) - step / 2, step * len(x), step * len(y))
    about = (source.title, config.camera.pixel * 1e6, rect, config)
    if isinstance(source, PlaybackSource):
        return Setup(*about, Kind(source.kind), source.timeline)
    return Setup(*about)
