"""`slipscope run` and `slipscope replay`: a run or a replay, in the window or without, and the
report at its end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

from app.commands.ending import report_analysis, report_replay, report_run
from app.commands.names import mark_of, new_session_name, next_free, parse_pace
from app.commands.terminal import DONE, FAILED, Bar, print_json, say
from app.config import load
from app.errors import UserError
from app.records import Health, Outcome
from app.session.files import check_new_session

POLL_S = 0.1
LEAVE_S = 10.0  # time that an experiment has to end when the user leaves in a hurry


class Source(Protocol):
    """A live run or a replay, as far as the terminal needs it."""

    def start(self) -> None: ...
    def wait(self, timeout: float | None = None) -> Outcome | None: ...
    def request_stop(self, reason: str) -> None: ...
    def stop_motion(self) -> None: ...
    def health(self) -> Health: ...
    def outcome(self) -> Outcome | None: ...


@dataclass(frozen=True, slots=True)
class _Made:
    """A run, and the session file that belongs to it."""

    source: Any
    session: Path
    before: object  # the mark of a file of that name before the run

    def report(self, as_json: bool) -> dict[str, Any]:
        """Report how the run ended."""
        is_recorded = mark_of(self.session) != self.before
        return report_run(self.source.outcome(), self.session if is_recorded else None, as_json)


class _Reports:
    """Reports each run once, when it has ended: a window may stay open long after that."""

    def __init__(self, made: list[_Made], as_json: bool) -> None:
        self._made, self._as_json = made, as_json
        self._reported: list[dict[str, Any]] = []

    @contextmanager
    def as_they_end(self) -> Iterator[None]:
        """Report runs from a thread of its own for as long as the block lasts."""
        over = threading.Event()

        def watch() -> None:
            while not over.wait(POLL_S):
                self._report_next()

        watcher = threading.Thread(target=watch, name="slipscope-reports")
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()

    def of_all(self) -> list[dict[str, Any]]:
        """The reports of all runs that have ended, in order."""
        while self._report_next():
            pass
        return self._reported

    def _report_next(self) -> bool:
        ended = [made for made in self._made if made.source.outcome() is not None]
        if len(ended) == len(self._reported):
            return False
        self._reported.append(ended[len(self._reported)].report(self._as_json))
        return True


def window_problem(headless: bool) -> str | None:
    """Why there is no window: what is missing, or nothing ("") if none was wanted; None if there is
    one.
    """
    if headless:
        return ""
    from app.gui.display import display_problem

    return display_problem()


def run(
    bench: Path | None,
    session: Path | None,
    headless: bool,
    pace: str,
    overrides: Sequence[str],
    overwrite: bool,
    as_json: bool,
    autostart: bool,
) -> int:
    """Run a loading experiment and report it; the exit code."""
    config = load(bench, tuple(overrides))
    speed = parse_pace(pace)
    first = session or next_free(new_session_name(datetime.now()))
    check_new_session(first, overwrite)
    problem = window_problem(headless)
    if problem is not None and not autostart:
        raise UserError(
            f"{problem}; `slipscope run --headless` runs the simulated experiment without one"
        )
    from app.live import make_run

    made: list[_Made] = []

    def make() -> Any:
        """The first run has the name that was given; further ones in the same window never replace
        anything.
        """
        path, may_replace = first, overwrite
        if made:
            path, may_replace = next_free(session or new_session_name(datetime.now())), False
            check_new_session(path, overwrite=False)
        before = mark_of(path)
        source = make_run(config, path, pace=speed, overwrite=may_replace)
        made.append(_Made(source, path, before))
        return source

    reports = _Reports(made, as_json)
    if problem is None:
        with reports.as_they_end():
            _in_window(make, autostart=autostart)
            for one in made:
                _let_end(one.source)
    else:
        source = make()  # whatever can not be used is reported before the long part begins
        _say_why_headless(problem, as_json)
        _follow(source, as_json)
    ended = reports.of_all()
    if as_json:
        print_json(ended[-1] if len(ended) == 1 else {"runs": ended})
    return FAILED if ended and ended[-1]["state"] == "failed" else DONE


def replay(
    session: Path,
    headless: bool,
    pace: str | None,
    output: Path | None,
    overrides: Sequence[str],
    overwrite: bool,
    as_json: bool,
) -> int:
    """Replay a session, or analyse it again if an output or other settings are given, and report
    it; the exit code.
    """
    problem = window_problem(headless)
    is_reanalysis = output is not None or bool(overrides)
    speed = parse_pace(pace or ("1" if problem is None and not is_reanalysis else "max"))
    from app.offline.reanalysis import Reanalysis
    from app.offline.replay import Replay

    made: list[Any] = []

    def make() -> Any:
        """The first analysis has the name that was given; further ones in the same window never
        replace anything.
        """
        if not is_reanalysis:
            return Replay(session, pace=speed)
        path, may_replace = output, overwrite
        if path is None or made:
            path = next_free(output or session.with_stem(f"{session.stem}-analysis"))
            may_replace = False
        return Reanalysis(session, path, pace=speed, overrides=overrides, overwrite=may_replace)

    def make_and_keep() -> Any:
        made.append(make())
        return made[-1]

    if problem is None:
        make()  # a session that can not be replayed is refused here, not in a window
        _in_window(make_and_keep, autostart=True)
        for source in made:
            _let_end(source)
    else:
        source = make_and_keep()
        _say_why_headless(problem, as_json)
        _follow(source, as_json)
    source = next((one for one in reversed(made) if one.outcome() is not None), None)
    if source is None:
        return DONE
    report = report_analysis if is_reanalysis else report_replay
    data = report(source, as_json)
    if as_json:
        print_json(data)
    return FAILED if data["state"] == "failed" else DONE


def _say_why_headless(problem: str, as_json: bool) -> None:
    if problem and not as_json:
        say(f"{problem} (going on without a window)")


def _in_window(make: Callable[[], Any], *, autostart: bool) -> None:
    from app.gui.start import run_window

    run_window(make, autostart=autostart)


def _let_end(source: Source) -> None:
    """Stop what the closed window left running, and wait for its end."""
    state = source.health().state
    if state not in ("idle", "done", "failed"):
        source.request_stop("the window was closed")
    if state != "idle":
        source.wait()


def _follow(source: Source, as_json: bool) -> Outcome:
    """Start, show progress, and wait.

    Ctrl-C ends the experiment in good order; a second one stops the motion again and leaves.
    """
    is_stopping = False
    try:
        with Bar("starting", quiet=as_json) as bar:
            source.start()
            while True:
                try:
                    outcome = source.wait(POLL_S)
                    health = source.health()
                    bar.show(_progress_text(health), health.progress)
                    if outcome is not None:
                        return outcome
                except KeyboardInterrupt:
                    if is_stopping:
                        raise
                    is_stopping = True
                    source.request_stop("Ctrl-C was pressed")
    except BaseException:
        source.stop_motion()
        source.wait(LEAVE_S)
        raise


def _progress_text(health: Health) -> str:
    counts = health.counts
    lost = f", {counts.frames_lost} lost" if counts.frames_lost else ""
    advice = f": {health.reason}" if health.reason and health.state in ("armed", "running") else ""
    return f"{health.phase or health.state}{advice} ({counts.frames_received} frames{lost})"
