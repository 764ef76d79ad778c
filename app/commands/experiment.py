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
from app.results import Health, Outcome
from app.session.files import check_new_session

POLL_S = 0.1
LEAVE_S = 10.0  # what a run has to come to its end when it is left in a hurry


class Source(Protocol):
    """A live run or a replay, as far as the terminal needs it."""

    def start(self) -> None: ...
    def wait(self, timeout: float | None = None) -> Outcome | None: ...
    def request_stop(self, reason: str) -> None: ...
    def stop_motion(self) -> None: ...
    def health(self) -> Health: ...
    def outcome(self) -> Outcome | None: ...


@dataclass(frozen=True, slots=True)
class Recorded:
    """A source and the session file that belongs to it."""

    source: Any
    session: Path
    before: object  # the mark of a file of that name before the run


class _Reports:
    """The report of each run, made once, when the run has ended: a window may stay open long after."""

    def __init__(self, made: list[Recorded], report: Callable[[Recorded], dict[str, Any]]) -> None:
        self._made = made
        self._report = report
        self._reported: list[dict[str, Any]] = []

    @contextmanager
    def as_they_end(self) -> Iterator[None]:
        """Report every run as soon as it has ended, beside whatever the calling thread does."""
        over = threading.Event()

        def watch() -> None:
            while not over.wait(POLL_S):
                self._next()

        watcher = threading.Thread(target=watch, name="slipscope-reports")
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()

    def of_all(self) -> list[dict[str, Any]]:
        """The reports of all runs that ended, in order."""
        while self._next():
            pass
        return self._reported

    def _next(self) -> bool:
        started = [recorded for recorded in self._made if recorded.source.outcome() is not None]
        if len(started) == len(self._reported):
            return False
        self._reported.append(self._report(started[len(self._reported)]))
        return True


def window_problem(headless: bool) -> str | None:
    """Why there is no window: asked for (""), or what is missing; None where there is one."""
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
    asked = session
    first = asked or next_free(new_session_name(datetime.now()))
    check_new_session(first, overwrite)
    problem = window_problem(headless)
    if problem is not None and not autostart:
        raise UserError(
            f"{problem}; `slipscope run --headless` runs the simulated experiment without one"
            if problem
            else "no window was asked"
        )
    from app.live import make_run

    made: list[Recorded] = []

    def make() -> Any:
        """The first run has the name that was asked; further ones in the same window never replace
        anything.
        """
        again = bool(made)
        path = next_free(asked or new_session_name(datetime.now())) if again else first
        check_new_session(path, overwrite and not again)
        made.append(
            Recorded(
                make_run(config, path, pace=speed, overwrite=overwrite and not again),
                path,
                mark_of(path),
            )
        )
        return made[-1].source

    if problem is not None:
        source = make()  # whatever is wrong with what was asked is said before the long part begins
        _say_why_headless(problem, as_json)
        _follow(source, as_json)
    reports = _Reports(
        made,
        lambda r: report_run(
            r.source.outcome(), r.session if mark_of(r.session) != r.before else None, as_json
        ),
    )
    if problem is None:
        with reports.as_they_end():
            _in_window(make, autostart=autostart)
            for recorded in made:
                _let_end(recorded.source)
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
    """Replay a session, or analyse it once more into `output` where that or other settings are
    asked, and report it; the exit code.
    """
    problem = window_problem(headless)
    once_more = output is not None or bool(overrides)
    speed = parse_pace(pace or ("1" if problem is None and not once_more else "max"))
    from app.reanalysis import Reanalysis
    from app.replay import make_replay

    made: list[Any] = []

    def make() -> Any:
        """The first analysis has the name that was asked; further ones in the same window never
        replace anything.
        """
        if not once_more:
            return make_replay(session, pace=speed)
        asked = output or session.with_stem(f"{session.stem}-analysis")
        first = output is not None and not made
        path = asked if first else next_free(asked)
        check_new_session(path, overwrite and first)
        return Reanalysis(
            session, path, pace=speed, overrides=overrides, overwrite=overwrite and first
        )

    def make_and_keep() -> Any:
        made.append(make())
        return made[-1]

    if problem is not None:
        source = make_and_keep()
        _say_why_headless(problem, as_json)
        _follow(source, as_json)
    else:
        make()  # a session that can not be replayed is refused here, not in a window
        _in_window(make_and_keep, autostart=True)
        for replayed in made:
            _let_end(replayed)
    source = next((replayed for replayed in reversed(made) if replayed.outcome() is not None), None)
    if source is None:
        return DONE
    outcome: Outcome = source.outcome()
    data = (
        report_analysis(source, outcome, as_json)
        if once_more
        else report_replay(source, outcome, session, as_json)
    )
    if as_json:
        print_json(data)
    return FAILED if outcome.state == "failed" else DONE


def _say_why_headless(problem: str, as_json: bool) -> None:
    if problem and not as_json:
        say(f"{problem} (going on without a window)")


def _in_window(make: Callable[[], Any], *, autostart: bool) -> None:
    from app.gui.start import run_window

    run_window(make, autostart=autostart)


def _let_end(source: Source) -> None:
    """Wait for what the window left behind, once it was told to stop."""
    state = source.health().state
    if state not in ("idle", "done", "failed"):
        source.request_stop("the window was closed")
    if state != "idle":
        source.wait()


def _follow(source: Source, as_json: bool) -> Outcome:
    """Start, show progress, and wait; Ctrl-C stops in good order, a second one stops the motion
    again and leaves.
    """
    asked_to_stop = False
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
                    if asked_to_stop:
                        raise
                    asked_to_stop = True
                    source.request_stop("Ctrl-C was pressed")
    except BaseException:
        source.stop_motion()
        source.wait(LEAVE_S)
        raise


def _progress_text(health: Health) -> str:
    counts = health.counts
    frames = f"{counts.frames_received} frames" + (
        f", {counts.frames_lost} lost" if counts.frames_lost else ""
    )
    advice = f": {health.reason}" if health.reason and health.state in ("armed", "running") else ""
    return f"{health.phase or health.state}{advice} ({frames})"
