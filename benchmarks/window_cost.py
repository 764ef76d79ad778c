"""What the window takes of its process' main thread while it shows a run: simulated bench at
23.8 frames/s, 1600 x 1200, in processes of its own, recorded and analysed, with the window on the
display. Counted is the processor time of the main thread in the first 15 s of the drive at most,
with all painting and with all looks between redraws; in the share of the whole process, also the
thread that reads the run. In the rest of the drive, which is slower where it is long, the time
without event handling is measured. An image is as old as the trigger of the newest frame that the
bench had counted when the image was read, until the picture has been painted; the display's own
time is not in it, and the sample clock is compared with that of the computer at the moment when
its samples came soonest.

    xvfb-run -a -s "-screen 0 1920x1080x24" python -m benchmarks window_cost [--seconds N]
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PySide6.QtCore import QObject, QTimer

from app.gui.image_view import InterfaceView
from app.gui.plots.picture import PicturePlot
from app.processes.client import LaunchedRun
from app.records.record_types import Phase
from app.records.run_view import RunView
from app.settings import config
from benchmarks.report import Report
from benchmarks.window_run import in_window

SUBJECT = "Cost of the window"
SETTINGS = ("camera.divisor=42",)
PROBE_MS = 5  # from one look at the event loop to the next
MOST_COSTS_S = 15.0  # of the drive, in which costs are counted; in the rest the gaps between events
TRAVEL_UM = 300.0  # at most, more slowly in a longer drive


class Cost(NamedTuple):
    """What the window's process has taken of the processor, at the beginning of a redraw."""

    redraw: int
    wall_s: float
    main_s: float
    process_s: float


class Watched(LaunchedRun):
    """A run that notes when its samples came, and which frame was the newest at each look."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.zero_s = np.inf  # on the computer's clock, of sample 0
        self.counted = 0

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        """What the run shows, noted."""
        view, rate = super().look(seen, is_shown=is_shown), self.config.forces.sample_rate
        if view.health.sample:
            self.zero_s = min(self.zero_s, time.monotonic() - view.health.sample / rate)
        self.counted = view.health.counts.frames_received
        return view


class Probe(QObject):
    """Measures in the main thread: first what redraws cost, then the gaps between events, for a
    timer that looks so often costs more than all else.
    """

    def __init__(self, window: Any, run: Watched, costs_s: float) -> None:
        super().__init__(window)
        self.run, self._costs_s = run, costs_s
        self.began: Cost | None = None
        self.ended = Cost(0, 0.0, 0.0, 0.0)
        self.gaps: list[tuple[float, float]] = []  # s without events, s of them the thread ran
        self.ages: list[tuple[float, int]] = []  # when painted, number of the newest frame
        self._redraws = 0
        self._fresh: int | None = None
        view = window.findChild(InterfaceView)
        self._show, view.show_view = view.show_view, self._shown
        paint = PicturePlot.paintEvent

        def painted(canvas: PicturePlot, event: Any) -> None:
            paint(canvas, event)
            if self._fresh is not None:
                self.ages.append((time.monotonic(), self._fresh - 1))
                self._fresh = None

        PicturePlot.paintEvent = painted  # type: ignore[method-assign]
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._tick)
        self._last = self._ran = 0.0

    def _shown(self, view: Any) -> None:
        if view.phase == Phase.DRIVE:
            now = Cost(self._redraws, time.monotonic(), time.thread_time(), time.process_time())
            self.began = self.began or now
            self._redraws += 1
            self._fresh = self.run.counted
            if now.wall_s - self.began.wall_s < self._costs_s:
                self.ended = now
            elif not self._timer.isActive():
                self._last, self._ran = time.monotonic(), time.thread_time()
                self._timer.start(PROBE_MS)
        elif self.began is not None:
            self._timer.stop()
        self._show(view)

    def _tick(self) -> None:
        now, ran = time.monotonic(), time.thread_time()
        self.gaps.append((now - self._last - 1e-3 * PROBE_MS, ran - self._ran))
        self._last, self._ran = now, ran


def measure(report: Report, *, seconds: float = 30.0) -> int:
    """Run in a window."""
    probes: list[Probe] = []
    with tempfile.TemporaryDirectory() as folder:
        costs_s = min(seconds / 2, MOST_COSTS_S)
        travel = min(5 * seconds, TRAVEL_UM)
        drive = (f"run.travel={travel:g}", f"run.velocity={travel / seconds:g}")
        settings = config.load(None, [*SETTINGS, *drive])
        run = Watched(settings, Path(folder) / "a.h5", pace=1.0, overwrite=False)

        def ready(window: Any) -> Callable[[], object]:
            probes.append(Probe(window, run, costs_s))
            return run.wait

        outcome = in_window(run, ready)
    (probe,) = probes
    assert probe.began is not None, outcome.reason
    redraws, wall, main, process = np.subtract(probe.ended, probe.began)
    report.add("redraws per second", redraws / wall, "1/s")
    report.add("main thread, mean per redraw", 1e3 * main / redraws, "ms", 6.0)
    report.add("main thread at that rate", 100 * main / wall, "% of a core")
    report.add("all threads of the window's process", 100 * process / wall, "% of a core", 12.0)
    gap, ran = max(probe.gaps, default=(np.nan, np.nan))
    report.add("longest time without event handling", 1e3 * gap, "ms", 60.0)
    report.add("of it the main thread ran", 1e3 * ran, "ms")
    report.add("times over 60 ms", sum(gap > 0.06 for gap, _ in probe.gaps), "")
    step = settings.camera.divisor / settings.forces.sample_rate
    ages = [painted - run.zero_s - frame * step for painted, frame in probe.ages]
    report.add("trigger to painted image, median", 1e3 * np.median(ages), "ms", 120.0)
    report.add("trigger to painted image, 95 % below", 1e3 * np.percentile(ages, 95), "ms")
    counts = outcome.counts
    report.add("analysed frames", 100 * counts.frames_analysed / counts.frames_received, "%")
    return 0
