"""What does not change during the run that the window shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from app.evaluation.timeline import Timeline
from app.records.record_types import F64
from app.runs.run_source import Kind, RunSource, kind_of
from app.settings.protocol_steps import Approach
from app.settings.sections import Config

if TYPE_CHECKING:
    from app.replay.replay import Replay

Point = tuple[float, float]  # x and y
Rect = tuple[float, float, float, float]  # left, top, width, height in px


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """What does not change during a run; the rectangle is that of the grid of boxes, and `session`
    the file that is recorded or was.
    """

    title: str
    pixel_um: float
    grid_rect_px: Rect
    config: Config
    kind: Kind = Kind.LIVE
    timeline: Timeline | None = None  # of a recorded run
    session: Path | None = None

    @property
    def load_n(self) -> float:
        """The first load of the protocol (N); NaN if it has none."""
        steps = self.config.run.protocol
        return next((s.normal_force for s in steps if isinstance(s, Approach)), math.nan)

    @property
    def name(self) -> str:
        """The load, if any, and the session, ``0.5 N run-a``, or the title of a run without one."""
        load = f"{self.load_n:g} N " if math.isfinite(self.load_n) else ""
        return f"{load}{self.session.stem if self.session else self.title}"


def centres_px(rect: Rect, values: NDArray[Any]) -> tuple[F64, F64]:
    """The x of columns and the y of rows of values that fill a rectangle."""
    left, top, width, height = rect
    rows, cols = values.shape
    x, y = np.arange(cols) + 0.5, np.arange(rows) + 0.5
    return left + x * width / cols, top + y * height / rows


def cell_at(rect: Rect, values: NDArray[Any], x_px: float, y_px: float) -> tuple[int, int] | None:
    """Row and column at a place of values that fill a rectangle; None beside it."""
    left, top, width, height = rect
    rows, cols = values.shape
    row, col = math.floor((y_px - top) / height * rows), math.floor((x_px - left) / width * cols)
    return (row, col) if 0 <= row < rows and 0 <= col < cols else None


def setup_of(source: RunSource) -> Setup:
    """What does not change during the run of `source`."""
    x, y, config = source.grid_x_px, source.grid_y_px, source.config
    step = float(config.dic.step)
    rect = (float(x[0]) - step / 2, float(y[0]) - step / 2, step * len(x), step * len(y))
    about = (source.title, config.camera.pixel * 1e6, rect, config)
    replay = as_replay(source)
    line = replay.timeline if replay else None
    return Setup(*about, kind_of(source), line, session_of(source))


def session_of(source: RunSource) -> Path | None:
    """The file that is recorded, written or played."""
    files = (getattr(source, name, None) for name in ("session", "output", "path"))
    return next(filter(None, files), None)


def as_replay(source: object) -> Replay | None:
    """The source if it plays or analyses what was recorded, None for a run on a bench."""
    return None if kind_of(source) is Kind.LIVE else cast("Replay", source)
