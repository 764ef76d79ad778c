"""A window in long and rough use, on the simulated bench: it opens, it is closed at random instants
of a run, and it runs one experiment after the other.

    python -m benchmarks evening [--closes 50] [--runs 20]

It is in view when `slipscope run` has put it on the display, from the start of that program on.

Each close is a program of its own, whose window is closed between its opening and the end of its
run, as its frame's button does, twice: the run is stopped and saved first. It must end by itself,
with exit code 0, and leave a session that opens, or none if the run had not begun. The runs in a
row are of small pictures, in one window, whose process has its memory, its open files, its threads
and the processor time of a redraw in its main thread compared with those after the fifth, by when
everything that is made once has been made; of the times, the medians of the first and the last five
from then on. Without a display Qt draws off the screen.
"""

from __future__ import annotations

import gc
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from app.session.reader import SessionReader
from benchmarks.report import Report

SUBJECT = "Evenings in the window"
SETTINGS = (
    *("camera.width=480", "camera.height=360", "camera.pixel=16", "limits.age=10"),
    *("run.normal_force=0.1", "run.background_time=0.2", "sim.press_time=0.3"),
    *("run.settle_time=0.2", "run.reference_time=0.4", "run.travel=60"),
)
PACE, LATEST_S = 4.0, 9.0  # at which a run is over by then
PATIENCE_S = 60.0
FIRST_RUNS = 5
OPENINGS = 5
MIB = 2**20


def in_window(session: Path, made: list[Any], ready: Callable[[Any], None]) -> None:
    """Run in a window, to which `ready` does something; `made` gets each of its runs."""
    from app.gui.run_factory import RunFactory
    from app.gui.start import run_window
    from app.settings.config import load

    factory, settings = RunFactory(made.append, pace=PACE), load(None, SETTINGS)
    run_window(None, factory, settings, session=session, autostart=True, on_ready=ready)


def one_close(seconds: float, session: Path) -> None:
    """In a program of its own: close the window of a run after so many seconds."""
    from PySide6.QtCore import QTimer

    made: list[Any] = []

    def ready(window: Any) -> None:
        for later_s in (seconds, seconds + 0.3):
            QTimer.singleShot(round(1000 * later_s), window, window.close_after_run)

    in_window(session, made, ready)
    for one in made:
        if one.source.look().health.state != "idle":
            one.source.wait(PATIENCE_S)


def one_opening() -> None:
    """In a program of its own: say when the window of `slipscope run` is on the display."""
    from PySide6.QtCore import QTimer

    from app.cli import main
    from app.gui import start

    opened = start.run_window

    def opens(*args: Any, **kwargs: Any) -> Any:
        def ready(window: Any) -> None:
            timer = QTimer(window)

            def look() -> None:
                if window.windowHandle().isExposed():
                    print(time.time(), flush=True)
                    timer.stop()
                    window.close_after_run()
                    window.close_after_run()

            timer.timeout.connect(look)
            timer.start(1)

        return opened(*args, **kwargs | {"on_ready": ready, "autostart": False})

    start.run_window = opens
    sys.argv[1:] = ["run"]
    main()


def in_view(report: Report) -> None:
    """Open the window some times."""
    seconds = []
    for _ in range(OPENINGS):
        began = time.time()
        done = subprocess.run(
            [sys.executable, "-m", __name__, "open"], capture_output=True, text=True, check=True
        )
        seconds.append(float(done.stdout.split()[0]) - began)
    report.add("from the start of the program to the window", np.median(seconds), "s", 1.5)
    report.add("the longest of five", max(seconds), "s")


def many_closes(report: Report, number: int) -> bool:
    """Close so many windows, each at another instant; whether all ended well."""
    ended_well = sessions = 0
    longest_s = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for k in range(number):
            session, seconds = Path(folder) / f"{k}.h5", random.uniform(0.0, LATEST_S)
            words = [f"{seconds}", str(session)]
            began = time.monotonic()
            try:
                done = subprocess.run(
                    [sys.executable, "-m", __name__, *words], timeout=PATIENCE_S, check=False
                )
            except subprocess.TimeoutExpired:
                print(f"closed after {seconds:.2f} s: it did not end")
                continue
            longest_s = max(longest_s, time.monotonic() - began - seconds)
            is_readable = not session.exists() or _opens(session)
            sessions += session.exists()
            if done.returncode or not is_readable:
                print(f"closed after {seconds:.2f} s: exit code {done.returncode}")
            ended_well += not done.returncode and is_readable
    report.add("windows closed at random instants", number)
    report.add("that did not end by themselves and properly", number - ended_well, at_most=0)
    report.add("of them with a session, which opens", sessions)
    report.add("longest from the opening, beyond the time of the close", longest_s, "s")
    return ended_well == number


def _opens(session: Path) -> bool:
    with SessionReader(session) as read:
        return read.outcome is not None


def runs_in_a_row(report: Report, number: int) -> None:
    """Run so many experiments in one window."""
    from PySide6.QtCore import QTimer

    kept: list[tuple[float, ...]] = []  # after each run: memory, files, threads, redraw
    made: list[Any] = []
    spent: list[float] = []  # of the main thread, at each redraw of the run
    with tempfile.TemporaryDirectory() as folder:

        def ready(window: Any) -> None:
            timer, me, show = QTimer(window), psutil.Process(), window.interface.show_view
            files = me.num_handles if sys.platform == "win32" else me.num_fds

            def shown(view: Any) -> None:
                spent.append(time.thread_time())
                show(view)

            window.interface.show_view = shown

            def look() -> None:
                if not made or window.source is not made[-1].source or window.outcome() is None:
                    return
                made.clear()  # what the command keeps of a run is not the window's
                gc.collect()
                redraw_ms = 1e3 * float(np.median(np.diff(spent)))
                kept.append((me.memory_info().rss / MIB, files(), me.num_threads(), redraw_ms))
                spent.clear()
                said = "run {}: {:.1f} MiB, {} open files, {} threads, {:.2f} ms a redraw"
                print(said.format(len(kept), *kept[-1]), file=sys.stderr, flush=True)
                if len(kept) == number:
                    window.close()
                else:
                    window.begin()

            timer.timeout.connect(look)
            timer.start(500)

        in_window(Path(folder) / "evening.h5", made, ready)
    memory, handles, threads, redraws = np.array(kept[FIRST_RUNS - 1 :]).T
    first, last = (float(np.median(times)) for times in (redraws[:5], redraws[-5:]))
    report.add("runs in one window", len(kept))
    report.add(f"memory after run {FIRST_RUNS}", memory[0], "MiB", digits=4)
    report.add("its growth until the last", 100 * (memory[-1] / memory[0] - 1), "%", 3.0, digits=2)
    report.add(f"open files after run {FIRST_RUNS}", handles[0])
    report.add("more after the last", handles[-1] - handles[0], at_most=0)
    report.add(f"threads after run {FIRST_RUNS}", threads[0])
    report.add("more threads after the last", threads[-1] - threads[0], at_most=0)
    report.add("main thread, redraw of the first five runs", first, "ms", digits=3)
    report.add("its growth until the last five", 100 * (last / first - 1), "%", 3.0, digits=2)


def measure(report: Report, *, closes: int = 50, runs: int = 20) -> int:
    """Open and close windows, then run one experiment after the other."""
    if "DISPLAY" not in os.environ:
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    in_view(report)
    are_well = many_closes(report, closes) if closes else True
    if runs > FIRST_RUNS:
        runs_in_a_row(report, runs)
    return 0 if are_well else 1


if __name__ == "__main__":
    if sys.argv[1] == "open":
        one_opening()
    else:
        one_close(float(sys.argv[1]), Path(sys.argv[2]))
