"""`slipscope run` and `slipscope replay`: experiments in the window or without one, and the report
at their end.
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
from app.commands.names import mark_of, new_session_name, parse_pace
from app.commands.terminal import BAD_INPUT, DONE, FAILED, Bar, print_json, say
from app.config import load
from app.errors import UserError
from app.records import Health, Outcome
from app.session.files import check_new_session, next_free

POLL_S = 0.1
LEAVE_S = 10.0  # time that an experiment has to end when the user leaves in a hurry


class Source(Protocol):
    """A live run or a replay, as far as the terminal is concerned.

    Attributes
    ----------
    stays : bool
        Whether it goes on when who shows it leaves.
    """

    stays: bool

    def start(self) -> None: ...
    def wait(self, timeout: float | None = None) -> Outcome | None: ...
    def request_stop(self, reason: str) -> None: ...
    def stop_motion(self) -> None: ...
    def health(self) -> Health: ...
    def outcome(self) -> Outcome | None: ...


@dataclass(frozen=True, slots=True)
class _Made:
    """A source, and what reports its end."""

    source: Source
    report: Callable[[], dict[str, Any]]


class _Reports:
    """Reports each source once, when it has ended: a window may stay open long after that."""

    def __init__(self, made: list[_Made]) -> None:
        self._made = made
        self._reported: list[dict[str, Any]] = []

    @contextmanager
    def as_they_end(self) -> Iterator[None]:
        """Report from a thread of its own for as long as the block lasts."""
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
        """The reports of all that have ended, in order."""
        while self._report_next():
            pass
        return self._reported

    def _report_next(self) -> bool:
        ended = [made for made in self._made if made.source.outcome() is not None]
        if len(ended) == len(self._reported):
            return False
        self._reported.append(ended[len(self._reported)].report())
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
    from app.live import check_run
    from app.processes.launch import launched_or_made

    def make(is_first: bool) -> _Made:
        path = first if is_first else next_free(session or new_session_name(datetime.now()))
        may_replace = overwrite and is_first
        check_new_session(path, may_replace)
        check_run(config, path, speed, may_replace)
        source, before = launched_or_made(config, path, speed, may_replace), mark_of(path)

        def report() -> dict[str, Any]:
            is_recorded = mark_of(path) != before
            outcome = source.outcome()
            assert outcome is not None
            moved = outcome.resources.get("session")
            is_there = is_recorded or moved is not None
            return report_run(outcome, Path(moved or path) if is_there else None, as_json)

        return _Made(source, report)

    return _conduct(make, problem, autostart=autostart, as_json=as_json)


def attach(bench: str | None, headless: bool, as_json: bool) -> int:
    """Show a run that is under way in another process, and report its end; the exit code.

    Leaving does not end it.
    """
    from app.processes.launch import attached

    problem = window_problem(headless)
    source = attached(bench)

    def report() -> dict[str, Any]:
        outcome = source.outcome()
        assert outcome is not None
        session = Path(outcome.resources.get("session", source.session))
        return report_run(outcome, session if session.exists() else None, as_json)

    return _conduct(
        lambda _: _Made(source, report), problem, autostart=True, as_json=as_json, is_one=True
    )


def stop(bench: str | None) -> int:
    """Stop the motion of a run that is under way in another process; the exit code."""
    from app.processes.launch import attached

    source = attached(bench)
    source.stop_motion()
    say(f"the motion of {source.title} is stopped; its run ends and saves {source.session.name}")
    return DONE


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
    is_analysis = output is not None or bool(overrides)
    speed = parse_pace(pace or ("1" if problem is None and not is_analysis else "max"))
    from app.offline.reanalysis import Reanalysis
    from app.offline.replay import Replay

    def make(is_first: bool) -> _Made:
        if not is_analysis:
            source = Replay(session, pace=speed)
            return _Made(source, lambda: report_replay(source, as_json))
        path = output or session.with_stem(f"{session.stem}-analysis")
        if not is_first or output is None:
            path = next_free(path)
        analysis = Reanalysis(
            session, path, pace=speed, overrides=overrides, overwrite=overwrite and is_first
        )
        return _Made(analysis, lambda: report_analysis(analysis, as_json))

    if problem is None:
        make(is_first=True)  # a session that can not be replayed is refused here, not in a window
    return _conduct(make, problem, autostart=True, as_json=as_json)


def _conduct(
    make: Callable[[bool], _Made],
    problem: str | None,
    *,
    autostart: bool,
    as_json: bool,
    is_one: bool = False,
) -> int:
    """Let what `make` makes run its course, in the window unless there is a `problem`, and report
    it; the exit code.

    `make` is called with whether it is the first: further ones in the same window never replace a
    file. With `is_one` there are no further ones.
    """
    made: list[_Made] = []

    def make_and_keep() -> Any:
        made.append(make(not made))
        return made[-1].source

    reports = _Reports(made)
    if problem is None:
        from app.gui.start import run_window
        from app.processes.signals import acting_on_signals

        def stop(reason: str) -> None:
            for one in made:
                _stop(one.source, reason)

        first = make_and_keep() if is_one else None
        with reports.as_they_end(), acting_on_signals(stop) as signalled:
            run_window(make_and_keep, first, autostart=autostart, close_when=signalled.is_set)
            for one in made:
                _let_end(one.source)
    else:
        source = make_and_keep()  # what can not be used is refused before the long part begins
        if problem and not as_json:
            say(f"{problem} (going on without a window)")
        _follow(source, as_json)
    ended = reports.of_all()
    if as_json:
        print_json(ended[-1] if len(ended) == 1 else {"runs": ended})
    last: dict[str, Any] = ended[-1] if ended else {"state": "done"}
    if last.get("refused"):
        return BAD_INPUT
    agrees = last.get("comparison", {}).get("agrees", True)
    return DONE if agrees and last["state"] != "failed" else FAILED


def _let_end(source: Source) -> None:
    """Stop what the closed window left running, and wait for its end; a run that others have
    started goes on.
    """
    state = source.health().state
    if source.stays or state == "idle":
        return
    if state not in ("done", "failed"):
        source.request_stop("the window was closed")
    source.wait()


def _stop(source: Source, reason: str) -> None:
    """Stop the motion, then end what runs, unless others have started it."""
    if not source.stays and source.health().state in ("armed", "running", "stopping"):
        source.request_stop(reason)


def _follow(source: Source, as_json: bool) -> Outcome:
    """Start, show progress, and wait.

    Ctrl-C, and whatever else tells the program to end, ends the experiment in good order; a second
    one stops the motion again and leaves. A run that others have started is only left.
    """
    from app.processes.signals import acting_on_signals

    reasons: list[str] = []

    def stop(reason: str) -> None:
        reasons.append(reason)
        if not source.stays:
            source.request_stop(reason)

    try:
        with Bar("starting", quiet=as_json) as bar, acting_on_signals(stop):
            source.start()
            while True:
                outcome = source.wait(POLL_S)
                health = source.health()
                bar.show(_progress_text(health), health.progress)
                if outcome is not None:
                    return outcome
                if len(reasons) > (0 if source.stays else 1):
                    raise KeyboardInterrupt
    except BaseException as error:
        if not source.stays:
            if not reasons:
                source.request_stop(f"the terminal failed ({type(error).__name__}: {error})")
            source.stop_motion()  # again, which does not change the reason
            source.wait(LEAVE_S)
        raise


def _progress_text(health: Health) -> str:
    counts = health.counts
    lost = f", {counts.frames_lost} lost" if counts.frames_lost else ""
    advice = f": {health.reason}" if health.reason and health.state in ("armed", "running") else ""
    return f"{health.phase or health.state}{advice} ({counts.frames_received} frames{lost})"
