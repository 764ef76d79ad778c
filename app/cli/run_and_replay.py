"""`slipscope run` and `slipscope replay`: experiments in the window or without one, and the report
at their end.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from app.cli.end_of_run import report_end
from app.cli.names import JsonData
from app.cli.terminal import BAD_INPUT, DONE, FAILED, TYPED, Bar, print_json, say
from app.records.bench_view import Health
from app.records.quantities import counted
from app.records.record_types import Outcome
from app.runs.run_source import PreparedSource, RunSource
from app.session.files import check_new_session, new_session_name, next_free
from app.settings.sections import Config
from app.system.errors import UserError, in_full
from app.system.stopping import StopAnswer
from app.system.threads import start_thread

POLL_S = 0.1
LEAVE_S = 10.0  # time that an experiment has to end when the user leaves in a hurry


class WindowStart(NamedTuple):
    """What the window is to begin with: settings and file of its first run, its pace, and whether
    that file may be replaced; whether settings that nobody gave are those of the last evening.
    Without settings a source is shown, whose settings are the next run's.
    """

    config: Config | None = None
    session: Path | None = None
    pace: float | None = 1.0
    overwrite: bool = False
    restores: bool = False


class EndedRuns(NamedTuple):
    """The reports of what has run its course, and the signal that told the program to end, in
    words; empty if none came.
    """

    reports: list[JsonData]
    signal: str


class _Reports:
    """Reports each source once, when it has ended, and lets go of it: a window may stay open for an
    evening of them.
    """

    def __init__(self, made: list[PreparedSource], as_json: bool) -> None:
        self._made, self._as_json = made, as_json
        self._reported: list[JsonData] = []

    @contextmanager
    def as_they_end(self) -> Iterator[None]:
        """Report from a thread of its own for as long as the block lasts."""
        over = threading.Event()

        def watch() -> None:
            while not over.wait(POLL_S):
                self._report_next()

        watcher = start_thread("reports", watch, daemon=False)
        try:
            yield
        finally:
            over.set()
            watcher.join()

    @property
    def are_there(self) -> bool:
        """Whether any has been given."""
        return bool(self._reported)

    def of_all(self) -> list[JsonData]:
        """The reports of all that have ended, in order."""
        while self._report_next():
            pass
        return self._reported

    def _report_next(self) -> bool:
        for made in tuple(self._made):
            if made.source.wait(0.0) is not None:  # its threads are gone
                self._reported.append(report_end(made, self._as_json))
                self._made.remove(made)  # it holds its images and fields
                return True
        return False


def window_problem(headless: bool) -> str | None:
    """Why there is no window: what is missing, or nothing ("") if none was wanted; None if there is
    one.
    """
    if headless:
        return ""
    from app.system.display import display_problem

    return display_problem()


def run_and_report(
    start: WindowStart, headless: bool, as_json: bool = False, *, autostart: bool = True
) -> int:
    """Run a loading experiment and report it, in the window if there can be one; the exit code."""
    config = start.config or Config()
    session = start.session or next_free(new_session_name(datetime.now()))
    check_new_session(session, start.overwrite)
    problem = window_problem(headless)
    if problem is not None and not autostart:
        raise UserError(
            f"{problem}; `slipscope run --headless` runs the simulated experiment without one"
        )

    from app.processes.prepared import prepared_run

    def make() -> PreparedSource:
        return prepared_run(config, session, start.pace, start.overwrite)

    start = start._replace(config=config, restores=start.config is None)
    done = run_to_end(make, problem, autostart=autostart, as_json=as_json, window=start)
    return print_reports(done, as_json)


def run_to_end(
    make: Callable[[], PreparedSource],
    problem: str | None,
    *,
    autostart: bool = True,
    as_json: bool,
    window: WindowStart | None = None,
    closes: bool = False,
) -> EndedRuns:
    """Let what `make` makes run its course, in the window unless there is a `problem`.

    With `window` further runs and replays can be made there, and its settings, if it has some, are
    those of the first run. With `closes` the window closes after what was made.
    """
    made: list[PreparedSource] = []  # and not yet reported
    signals: list[str] = []

    def keep(one: PreparedSource) -> RunSource:
        made.append(one)
        if one.warning:
            say(one.warning)
        return one.source

    reports = _Reports(made, as_json)
    if problem is None:
        from app.gui.run_factory import RunFactory
        from app.gui.start import run_window
        from app.processes.signals import acting_on_signals

        def stop(reason: str) -> None:
            signals.append(reason)
            for one in tuple(made):
                _stop(one.source, reason)

        # what cannot be used is refused here, not in a window
        first = None if window and window.config else keep(make())
        config = first.config if first else window and window.config
        factory = window and RunFactory(keep, pace=window.pace, overwrite=window.overwrite)
        with reports.as_they_end(), acting_on_signals(stop) as signalled:
            run_window(
                first,
                factory,
                None if window and window.restores else config,
                session=window and window.session,
                autostart=autostart,
                close_when=lambda: signalled.is_set() or (closes and reports.are_there),
            )
            for one in tuple(made):
                _let_end(one.source)
    else:
        source = keep(make())  # what cannot be used is refused before the long part begins
        if problem and not as_json:
            say(f"{problem} (going on without a window)")
        _follow(source, as_json, signals)
    return EndedRuns(reports.of_all(), signals[0] if signals else "")


def print_reports(done: EndedRuns, as_json: bool) -> int:
    """Print the reports, if they are wanted as JSON; the exit code."""
    ended = done.reports
    if as_json:
        print_json(ended[-1] if len(ended) == 1 else {"runs": ended})
    last: JsonData = ended[-1] if ended else {"state": "done"}
    if last.get("refused"):
        return BAD_INPUT
    agrees = last.get("comparison", {}).get("agrees", True)
    # a run may be stopped as its operator likes, once there is a session; a replay has then not
    # compared every frame
    whole = ("done", "stopped") if "comparison" not in last and last.get("session") else ("done",)
    return DONE if agrees and last["state"] in whole else FAILED


def _let_end(source: RunSource) -> None:
    """Stop what the closed window left running, and wait for its end; a run that others have
    started goes on.
    """
    state = source.look().health.state
    if source.stays or state == "idle":
        return
    if state not in ("done", "failed"):
        source.request_stop("the window was closed")
    source.wait()


def _stop(source: RunSource, reason: str) -> None:
    """Stop the motion, then end what runs, unless others have started it."""
    if not source.stays and source.look().health.state in ("armed", "running", "stopping"):
        source.request_stop(reason)


def _follow(source: RunSource, as_json: bool, signals: list[str]) -> Outcome:
    """Start, show progress, and wait; `signals` gets the reason of each signal that comes.

    Ctrl-C, and whatever else tells the program to end, ends the experiment in good order; a second
    one stops the motion again and leaves. A run that others have started is only left.
    """
    from app.processes.signals import acting_on_signals

    operator, stops = _Operator(source), _StopReports()

    def stop(reason: str) -> None:
        signals.append(reason)
        if not source.stays:
            source.request_stop(reason)

    try:
        with Bar("starting", quiet=as_json) as bar, acting_on_signals(stop):
            source.start()
            while True:
                outcome = source.wait(POLL_S)
                now = source.look()
                health = now.health
                operator.ask(health.question)
                stops.tell(now.stop, everything=bool(signals))
                bar.show(_progress_text(health), health.progress)
                if outcome is not None:
                    return outcome
                if len(signals) > (0 if source.stays else 1):
                    raise KeyboardInterrupt
    except BaseException as error:
        if not source.stays:
            if not signals:
                source.request_stop(f"the terminal failed ({in_full(error)})")
            # again, which does not change the reason
            stops.tell(source.stop_motion(), everything=True)
            source.wait(LEAVE_S)
            stops.tell(source.look().stop, everything=True)
        raise


class _StopReports:
    """Tells whoever sits at the terminal what became of a stop: each answer once, and that one has
    failed also where nobody has called for it.
    """

    def __init__(self) -> None:
        self._reported: StopAnswer | None = None

    def tell(self, answer: StopAnswer | None, *, everything: bool) -> None:
        """Tell the newest answer."""
        if answer is None or answer == self._reported:
            return
        if everything or answer.has_failed:
            say(answer.sentence)
            self._reported = answer


class _Operator:
    """Whoever sits at the terminal: is shown a question, and answers it with a line."""

    def __init__(self, source: RunSource) -> None:
        self._source, self._asked, self._is_answered = source, "", True

    def ask(self, question: str) -> None:
        """Show a question once, and pass on the next line that is typed while it stands; what is
        typed while none stands is for nobody.
        """
        line = TYPED.take()
        if line and question and question == self._asked and not self._is_answered:
            self._is_answered = True
            self._source.answer(line.strip() or "yes", question)
        if question and question != self._asked and sys.stdin and sys.stdin.isatty():
            say(f"{question} (type an answer, or just Enter)")
            self._is_answered = False
            TYPED.ask()
        self._asked = question


def _progress_text(health: Health) -> str:
    counts = health.counts
    step = f", step {health.doing}" if health.step else ""
    lost = f", {counts.frames_lost} lost" if counts.frames_lost else ""
    advice = f": {health.reason}" if health.reason and health.state in ("armed", "running") else ""
    frames = counted(counts.frames_received, "frame")
    return f"{health.phase or health.state}{step}{advice} ({frames}{lost})"
