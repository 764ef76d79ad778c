"""What the window needs from a run, live or replayed: something to read, and three ways to act on
it.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from app.results import F64, ContactResult, Health, Outcome, Snapshot
from app.settings import Config

Image = NDArray[np.uint8] | NDArray[np.uint16]


class Hands(Protocol):
    """What may be done to a replay while it runs; from any thread, returns at once."""

    pace: float | None
    is_paused: bool

    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def step(self) -> None: ...
    def set_pace(self, pace: float | None) -> None: ...


class Pages(Protocol):
    """Any recorded frame, to look at; None: back to the newest one."""

    def show(self, number: int | None) -> None: ...


@runtime_checkable
class PlaybackSource(Protocol):
    """What a replay has beyond a `RunSource`."""

    playback: Hands
    browser: Pages

    @property
    def frame_count(self) -> int:
        """Frames that there are to replay."""

    @property
    def can_browse(self) -> bool:
        """Whether any frame can be looked at yet."""

    @property
    def is_browsing(self) -> bool:
        """Whether a recorded frame is looked at."""

    @property
    def place(self) -> int:
        """Number of the frame that is shown, from 0."""

    def browsed(self) -> Snapshot | None:
        """Recorded results of the frame that is looked at; None while it is the newest one."""


class RunSource(Protocol):
    """A live run or a replay as the window sees it: it reads, and asks to stop.

    Constructing a source touches no device and no file; `start` does. The reads may be called from
    any one thread.
    """

    @property
    def title(self) -> str:
        """What is being run, e.g. "simulated bench" or "replay of x.h5"."""

    @property
    def pixel_m(self) -> float:
        """Size of a pixel on the interface."""

    @property
    def grid_x_px(self) -> NDArray[Any]:
        """Box centres along x, shape (nx,), evenly spaced."""

    @property
    def grid_y_px(self) -> NDArray[Any]:
        """Box centres along y, shape (ny,), evenly spaced."""

    @property
    def sample_rate_hz(self) -> float:
        """Rate of the DAQ sample clock."""

    @property
    def config(self) -> Config:
        """The settings of this run."""

    def start(self) -> None:
        """Begin; returns at once."""

    def stop_motion(self) -> None:
        """Stop the actuator at once, then end the run.

        From any thread, at any time; a replay just ends.
        """

    def request_stop(self, reason: str) -> None:
        """Ask for an orderly end of the run; returns at once."""

    def health(self) -> Health:
        """The state of the run at a glance."""

    def latest_image(self) -> Image | None:
        """The newest image, shape (rows, cols); None before the first.

        The same object until there is a newer one.
        """

    def snapshots_since(self, n: int) -> list[Snapshot]:
        """All snapshots but the first `n`, in order."""

    def contact(self) -> ContactResult | None:
        """The apparent contact on the reference frame, once it is known."""

    def force_history(self, n: int) -> tuple[NDArray[Any], F64, F64]:
        """Sample numbers, P and Q (newtons) of the whole run, thinned to about `n` points."""

    def outcome(self) -> Outcome | None:
        """How the run ended; None until then."""
