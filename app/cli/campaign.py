"""`slipscope campaign`: runs of one bench, one after the other, and how far they are."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from app.campaigns.page import PAGE, Progress, check_page, table, write_page
from app.campaigns.plan import Campaign, PlannedRun, orders
from app.campaigns.state import FoundSession, RunState, find_session, find_sessions, keep
from app.cli.end_of_run import draw
from app.cli.names import JsonData
from app.cli.run_and_replay import run_to_end
from app.cli.terminal import DONE, FAILED, TYPED, Bar, print_json, print_line, print_table, say
from app.processes.prepared import attached_run, prepared_run
from app.records.quantities import counted
from app.runs.live import check_run, expected_bytes, expected_seconds, make_bench
from app.runs.run_source import PreparedSource
from app.session.files import check_new_session, picture_of
from app.settings.sections import Config
from app.system.awake import kept_awake
from app.system.disk import free_bytes
from app.system.durations import duration
from app.system.errors import UserError
from drivers.errors import DeviceError
from drivers.sources import natures_of

REPEAT, SKIP, LEAVE, GO = "r", "s", "q", ""
BEGIN = {GO: "lift the block, then begin", SKIP: "skip it", LEAVE: "leave"}
FAILURE = {GO: "go on with the next", REPEAT: "repeat it", LEAVE: "leave"}


class CampaignWork:
    """A campaign on its way."""

    def __init__(
        self, plan: Campaign, pace: float | None, problem: str | None, as_json: bool
    ) -> None:
        self.plan, self.pace, self.problem, self.as_json = plan, pace, problem, as_json
        self.found = find_sessions(plan)
        self._due: list[PlannedRun] = []
        self._spent_s = self._expected_s = 0.0  # of the runs done by now
        self._signal = ""  # that told the program to end

    def due(self, wanted: Sequence[PlannedRun], retry: bool) -> list[PlannedRun]:
        """The runs that are to be done; failed ones only where they are to be tried again."""
        settled = (RunState.DONE,) if retry else (RunState.DONE, RunState.FAILED)
        return [run for run in wanted if self.found[run.number].state not in settled]

    def check(self, due: Sequence[PlannedRun]) -> None:
        """Refuse, before anything moves, runs that cannot be done; and say what they take."""
        plan = self.plan
        check_page(plan.folder)
        with Bar("checking", quiet=self.as_json) as bar:
            known: list[Config] = []
            for n, run in enumerate(due):
                bar.show(f"checking run {run.number}", n / len(due))
                try:
                    self._check_run(run, known)
                except (UserError, DeviceError) as error:
                    raise UserError(f"{plan.file.name}, run {run.number}: {error}") from None
        sizes = [expected_bytes(run.config) for run in due]
        needed, free = sum(sizes), free_bytes(plan.folder / PAGE)
        if needed > free:
            raise UserError(
                f"{plan.folder}: the {len(due)} runs need about {needed / 1e9:.1f} GB, the disk has"
                f" {free / 1e9:.1f} GB free; make room, or begin with some of them by --only"
            )
        if not self.as_json:
            each, seconds = max(sizes, default=0), sum(expected_seconds(run.config) for run in due)
            pace = f" at pace {self.pace:g}" if self.pace else " of the experiment's time"
            say(
                f"{plan.name}: {counted(len(plan.runs), 'run')}, {len(due)} to do:"
                f" {needed / 1e9:.2f} GB in {plan.folder} (the largest {each / 1e9:.2f} GB;"
                f" {free / 1e9:.0f} GB are free),"
                f" about {duration(seconds / (self.pace or 1))}{pace}"
            )

    def _check_run(self, run: PlannedRun, known: list[Config]) -> None:
        """Refuse a run that cannot be done; `known` are simulated worlds that can be made."""
        state = self.found[run.number].state
        if state is RunState.WAITING:
            if os.path.exists(left := picture_of(run.session)):
                raise UserError(
                    f"{left}: a picture of that name exists without its session; put"
                    f" {run.session.name} back, or move the picture away"
                )
            check_new_session(run.session, overwrite=False)
        if state is not RunState.RUNNING:
            check_run(run.config, run.session, self.pace, state is not RunState.WAITING)
        if natures_of(run.config.sources) == {"simulated"} and not _is_like(run.config, known):
            make_bench(run.config, self.pace)
            known.append(run.config)

    def draw_missing(self, wanted: Sequence[PlannedRun]) -> None:
        """Draw the pictures of runs that are done but were left, by a kill, without one."""
        for run in wanted:
            is_done = self.found[run.number].state is RunState.DONE
            if is_done and not picture_of(run.session).exists():
                draw(run.session, self.as_json)

    def progress(self) -> Progress:
        """How far it is."""
        return Progress(self.plan, self.found, self._left() if self._due else "")

    def go_through(self, due: Sequence[PlannedRun]) -> None:
        """Do these runs; until the operator leaves, or one is stopped."""
        self._due = list(due)
        try:
            with kept_awake():  # also between two runs
                while self._due and self._is_passed(self._due[0]):
                    self._due.pop(0)
        finally:
            self._due.clear()
            self._write_page()

    def _is_passed(self, run: PlannedRun) -> bool:
        """Do a run, again if the operator says so; whether the campaign goes on behind it."""
        begins = self.found[run.number].state is not RunState.RUNNING
        asks, answer = self.plan.pauses, GO
        if asks and begins:
            answer = self._ask(f"next, {orders(self.plan, run)}", BEGIN)
        while answer in (GO, REPEAT):
            found = self._do(run)
            if found.state is RunState.STOPPED:
                say(f"{run.name}: {found.reason}; the same command goes on with this run")
                return False
            if self._signal and len(self._due) > 1:  # it came when the run was over
                say(f"{self._signal} after {run.name}; the same command goes on with the next run")
                return False
            if found.state is RunState.DONE or not asks:
                return True
            answer = self._ask(f"{run.name} has failed", FAILURE)
            answer = SKIP if answer == GO else answer
        return answer != LEAVE

    def _do(self, run: PlannedRun) -> FoundSession:
        """Do a run; what has become of it."""
        number, before = run.number, self.found[run.number]
        if before.state is RunState.RUNNING:
            before = self.found[number] = find_session(run)  # it may have ended meanwhile
        if before.state is RunState.DONE:
            return before
        if before.is_there and (kept := keep(run.session)):
            say(f"{run.name}: {before.reason}; what there is of it is now {kept}")
        if not self.as_json:
            say(f"{orders(self.plan, run)}; {self.progress().sentence()}")
        self.found[number] = FoundSession(RunState.RUNNING)
        self._write_page()
        began = time.monotonic()
        try:
            ended = self._ended(run, before)
        except BaseException:
            self.found[number] = FoundSession(RunState.STOPPED, "the campaign was left")
            raise
        self.found[number] = ended
        if ended.state is RunState.DONE:
            self._spent_s += time.monotonic() - began
            self._expected_s += expected_seconds(run.config)
        elif ended.state is not RunState.STOPPED:
            say(f"{run.name}: {ended.reason}")
        return ended

    def _ended(self, run: PlannedRun, before: FoundSession) -> FoundSession:
        """Let a run take its course; what its session says then or, where there is none, how it
        ended.
        """
        made: list[PreparedSource] = []

        def make() -> PreparedSource:
            if before.state is RunState.RUNNING:
                made.append(attached_run(str(run.session.resolve())))
                made[0].source.stays = False  # to leave the campaign is to stop its run
            else:
                made.append(prepared_run(run.config, run.session, self.pace))
            return made[0]

        try:
            ended = run_to_end(make, self.problem, as_json=self.as_json, closes=True)
        except DeviceError as error:
            return FoundSession(RunState.FAILED, str(error))
        self._signal = ended.signal
        found, outcome = find_session(run), made[0].source.look().outcome
        if found.state is not RunState.WAITING:
            return found
        if outcome is None or outcome.state != "failed":
            return FoundSession(
                RunState.STOPPED, outcome.reason if outcome else "the window was closed"
            )
        return FoundSession(RunState.FAILED, outcome.reason)

    def report(self, wanted: Sequence[PlannedRun], checks_only: bool) -> int:
        """Print how far the campaign is; the exit code."""
        progress = self.progress()
        states = [self.found[run.number].state for run in wanted]
        page = None if checks_only else self.plan.folder / PAGE
        if self.as_json:
            print_json(_data(progress, page))
        else:
            headings, rows = table(progress)
            print_table(headings, rows, texts=("", "session", "state", "about.sample"))
            print_line(progress.sentence())
            if page:
                print_line(f"page: {page}")
            if (count := states.count(RunState.FAILED)) and not checks_only:
                say(f"{count} failed; --retry does them again, and keeps what there is of them")
        is_done = all(state is RunState.DONE for state in states)
        return DONE if is_done or checks_only else FAILED

    def _left(self) -> str:
        """How much time is left, in words."""
        seconds = sum(expected_seconds(run.config) for run in self._due)
        if self._expected_s:
            seconds *= self._spent_s / self._expected_s
        elif self.pace is None:
            return "the time left is known after the first"
        else:
            seconds /= self.pace
        asks = " and the operator's time" if self.plan.pauses else ""
        return f"about {duration(seconds)}{asks} left"

    def _ask(self, what: str, keys: dict[str, str]) -> str:
        """Which of the keys the operator presses."""
        choice = "; ".join(f"{key or 'Enter'}: {meaning}" for key, meaning in keys.items())
        say(f"{what}. {choice}")
        if sys.stdin is not None and sys.stdin.isatty():
            TYPED.take()  # what was typed before is no answer
        while line := TYPED.wait():
            answer = line.strip().lower()[:1]
            if answer in keys:
                return answer
            say(f"'{line.strip()[:20]}' is none of these: {choice}")
        say("nobody answers: the standard input is at its end")
        return LEAVE

    def _write_page(self) -> None:
        try:
            write_page(self.progress())
        except (UserError, OSError) as error:
            say(f"no page: {error}")


def _is_like(config: Config, known: Sequence[Config]) -> bool:
    """Whether the world of one of these is made as that of `config`."""
    return any(
        (c.sim, c.sample, c.forces, c.camera, c.run.normal_force)
        == (config.sim, config.sample, config.forces, config.camera, config.run.normal_force)
        for c in known
    )


def _data(progress: Progress, page: Path | None) -> JsonData:
    from app.report.summary_rows import plain

    runs = [
        {
            "number": run.number,
            "session": run.session,
            "settings": run.varied,
            "state": progress.found[run.number].state,
            "reason": progress.found[run.number].reason,
            "summary": progress.found[run.number].summary,
        }
        for run in progress.campaign.runs
    ]
    about = {"campaign": progress.campaign.name, "folder": progress.campaign.folder, "page": page}
    data: JsonData = plain({**about, "runs": runs})
    return data
