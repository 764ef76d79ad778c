"""From sessions to a file of results."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from app.evaluation.compiling import compile_analysis
from app.records.quantities import counted
from app.records.study_results import Joint, Origin, RunResult
from app.records.summary import Summary
from app.runs import live
from app.session.reader import SessionReader
from app.session.results import ResultsReader, write_runs
from app.settings.config import from_record, revised
from app.study import jobs as on_this_computer
from app.study.across_runs import Reduced, joint_of
from app.study.analysis_plan import Plan, Task, left
from app.study.cluster import results_on_cluster
from app.study.jobs import TaskReport
from app.study.one import settings_of
from app.study.parts import Parts
from app.study.worker import Failed
from app.system.durations import duration
from app.system.progress import HowFar, unheard


class Analysed(NamedTuple):
    """What an analysis came to: the runs in their order, and what they have in common."""

    runs: tuple[Reduced, ...]
    joint: Joint


class AnalysisFailed(RuntimeError):
    """Sessions that could not be analysed, and why."""


def analyze(
    plan: Plan,
    *,
    jobs: int = 1,
    scheduler: str = "",
    overwrite: bool = False,
    on_progress: HowFar = unheard,
) -> Analysed:
    """Analyse the sessions of a plan and write the file of results.

    The file does not depend on `jobs` or on `scheduler`, the address of a Dask cluster, to the bit.

    Raises
    ------
    UserError
        The results cannot be written, or there is no cluster.
    AnalysisFailed
        Some sessions could not be analysed. The results of the others are kept, and the same call
        goes on from there.
    """
    parts = Parts(plan.output)
    with parts.held():
        done = parts.done(plan.tasks)
        open_tasks = left(plan.tasks, done)
        if scheduler:
            reports = results_on_cluster(open_tasks, parts, scheduler)
        else:
            _compile(open_tasks)
            reports = on_this_computer.results_of(open_tasks, parts, jobs)
        failures = _followed(reports, open_tasks, len(plan.tasks), on_progress)
        if failures:
            others = counted(len(plan.tasks) - len(failures), "other session")
            kept = (
                f"the results of {others} are kept in {parts.folder.name}, and the same command"
                " goes on from there"
            )
            is_alone = len(failures) == len(plan.tasks)
            raise AnalysisFailed(
                f"analyze: {'; '.join(failures)}; {'nothing is kept' if is_alone else kept}"
            )
        return _gathered(plan, parts, overwrite)


def _compile(tasks: Sequence[Task]) -> None:
    """Compile once what all processes need."""
    for task in tasks[:1]:
        if task.world:
            config = revised(from_record(task.world, task.session), task.overrides)
            live.prepare(config, partial(compile_analysis, config), lambda what: None)
            return
        with SessionReader(Path(task.session)) as session:
            compile_analysis(settings_of(session, task.overrides))


def _followed(
    reports: Iterable[TaskReport], tasks: Sequence[Task], count: int, on_progress: HowFar
) -> list[str]:
    """Why sessions could not be analysed; tells the progress meanwhile."""
    weight = {task.key: task.frames for task in tasks}
    shares = dict.fromkeys(weight, 0.0)
    total, began, failures = sum(weight.values()), time.monotonic(), []
    done = count - len(tasks)
    on_progress(_progress_text(done, count, None), 0.0)
    for task, what in reports:
        shares[task.key] = what if isinstance(what, float) else 1.0
        if isinstance(what, Failed):
            failures.append(what.sentence)
        elif not isinstance(what, float):
            done += 1
        share = sum(weight[key] * share for key, share in shares.items()) / total
        spent = time.monotonic() - began
        on_progress(_progress_text(done, count, spent * (1 / share - 1) if share else None), share)
    return failures


def _progress_text(done: int, count: int, left_s: float | None) -> str:
    text = f"{done} of {counted(count, 'session')}"
    if left_s is None or done == count:
        return text
    return f"{text}, {duration(left_s)} left"


def _gathered(plan: Plan, parts: Parts, overwrite: bool) -> Analysed:
    """Write the file of results from the parts, one at a time."""
    found: list[tuple[Reduced, Task]] = []
    for task in plan.tasks:
        with ResultsReader(parts.place(task)) as part:
            found.append((Reduced(part.part(Origin, 0), part.part(Summary, 0)), task))
    if plan.is_sweep:
        joint = Joint(notes=("the runs of a sweep have no constants in common",))
    else:
        found.sort(key=lambda pair: _order(pair[0]))
        joint = joint_of([run for run, _ in found])
    runs = tuple(run for run, _ in found)
    joint = replace(joint, notes=(*plan.notes, *joint.notes))

    def each() -> Iterator[RunResult]:
        for _, task in found:
            with ResultsReader(parts.place(task)) as part:
                yield part.run(0)

    write_runs(plan.output, each(), joint, plan.made_with, overwrite=overwrite)
    parts.are_over = True
    return Analysed(runs, joint)


def _order(run: Reduced) -> tuple[bool, float, str, str]:
    """By normal force, those without one at the end, then by name."""
    force = run.summary.normal_force_n
    is_known = math.isfinite(force)
    return not is_known, force if is_known else 0.0, run.origin.session, run.origin.started
