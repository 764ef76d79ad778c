"""`slipscope analyze` and `sweep`: many sessions, each by itself, and what they have in common."""

from __future__ import annotations

import os
from collections.abc import Sequence

import psutil

from analysis.settings import PRESETS
from app.cli.names import JsonData
from app.cli.terminal import (
    DONE,
    FAILED,
    Bar,
    print_json,
    print_line,
    print_rows,
    print_table,
    say,
)
from app.records.quantities import joint_quantities, summary_quantities
from app.report.summary_rows import plain
from app.study.across_runs import Reduced
from app.study.analysis_plan import RECORDED, Plan
from app.study.analyzing import Analysed, AnalysisFailed, analyze
from app.system.errors import UserError
from app.system.interrupting import reason_of

SHOWN = 40  # runs in the table
MEMORY_BYTES = 700 << 20  # memory of a process that analyses
TABLES = (("a", "Q_s", "mu_s", "mu_d"), ("mu", "L", "E"))


def check_preset(preset: str) -> None:
    """Refuse a preset that there is not; UserError."""
    if preset not in (known := (*PRESETS, RECORDED)):
        raise UserError(f"--preset {preset}: it is not known; use one of {', '.join(known)}")


def done(plan: Plan, jobs: int, scheduler: str, *, overwrite: bool, as_json: bool) -> int:
    """Analyse what is planned, write and print; the exit code."""
    for note in plan.notes:
        say(f"note: {note}")
    try:
        with Bar("analysing", quiet=as_json) as bar:
            found = analyze(
                plan,
                jobs=jobs or most_jobs(len(plan.tasks)),
                scheduler=scheduler,
                overwrite=overwrite,
                on_progress=bar.show,
            )
    except KeyboardInterrupt as interrupt:
        say(
            f"{reason_of(interrupt)}: left before the end; {plan.output}: the same command goes on"
            " from there"
        )
        return FAILED
    except AnalysisFailed as error:
        if as_json:
            print_json({"error": str(error)})
        else:
            say(str(error))
        return FAILED
    if as_json:
        print_json(data_of(plan, found))
    else:
        _print(plan, found)
    return DONE


def most_jobs(sessions: int) -> int:
    """As many sessions at a time as processors and memory allow."""
    by_memory = int(psutil.virtual_memory().available) // MEMORY_BYTES
    return max(1, min(sessions, os.cpu_count() or 1, by_memory))


def data_of(plan: Plan, found: Analysed) -> JsonData:
    """The results as JSON, SI units in the keys."""
    return {
        "results": str(plan.output),
        "runs": [
            {"session": run.origin.session, "state": run.origin.state} | plain(run.summary)
            for run in found.runs
        ],
        "joint": plain(found.joint),
        "made_with": plan.made_with,
    }


def _print(plan: Plan, found: Analysed) -> None:
    for symbols in TABLES:
        _print_runs(found.runs[:SHOWN], symbols, "point" if plan.is_sweep else "session")
        print_line()
    if len(found.runs) > SHOWN:
        print_line(f"... and {len(found.runs) - SHOWN} more runs")
    print_line("value ± uncertainty, by noise and by what the operator gives together")
    print_line()
    if not plan.is_sweep:
        together = joint_quantities(found.joint)
        print_rows("All runs together", [(one.name, one.symbol, str(one)) for one in together])
    for note in found.joint.notes:
        print_line(f"note: {note}")
    print_line(f"results: {plan.output}")


def _print_runs(runs: Sequence[Reduced], symbols: Sequence[str], what: str) -> None:
    """Some quantities of each run, which is a session or a point of a sweep."""
    rows = []
    for run in runs:
        held = {one.symbol: one for one in summary_quantities(run.summary)}
        name = run.origin.note if what == "point" else run.origin.session
        rows.append([held["P"].rounded[0], *(str(held[symbol]) for symbol in symbols), name])
    print_table(["P (N)", *symbols, what], rows, texts=(what,), numbers="left")
