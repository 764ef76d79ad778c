"""`slipscope analyze` and `sweep`: many sessions, each by itself, and what they have in common."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil
from rich.table import Table

from analysis.settings import PRESETS
from app.commands.terminal import DONE, FAILED, Bar, console, output, print_json, say
from app.errors import UserError
from app.report.quantities import Measurement, summary_quantities
from app.report.summary import plain
from app.results import Joint
from app.study.analyzing import Analysed, AnalysisFailed
from app.study.analyzing import analyze as analyzed
from app.study.joint import Reduced
from app.study.plan import RECORDED, Plan, planned
from app.study.sweep import swept

SHOWN = 40  # runs in the table
WIDTH = 132  # columns that its rows take
MEMORY_BYTES = 700 << 20  # of a process that analyses
TABLES = (("a", "Q_s", "mu_s", "mu_d"), ("mu", "L", "E"))


def analyze(
    sessions: Sequence[Path],
    results: Path,
    *,
    preset: str,
    overrides: Sequence[str],
    jobs: int,
    scheduler: str,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Analyse sessions, write and print; the exit code."""
    _check_preset(preset)
    plan = planned(sessions, results, preset=preset, overrides=overrides, overwrite=overwrite)
    return _done(plan, jobs, scheduler, overwrite=overwrite, as_json=as_json)


def sweep(
    bench: Path | None,
    over: Sequence[str],
    results: Path,
    *,
    preset: str,
    overrides: Sequence[str],
    jobs: int,
    scheduler: str,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Run and analyse a grid of simulated worlds, write and print; the exit code."""
    _check_preset(preset)
    plan = swept(bench, over, results, preset=preset, overrides=overrides, overwrite=overwrite)
    return _done(plan, jobs, scheduler, overwrite=overwrite, as_json=as_json)


def _check_preset(preset: str) -> None:
    if preset not in (known := (*PRESETS, RECORDED)):
        raise UserError(f"--preset {preset}: it is not known; use one of {', '.join(known)}")


def _done(plan: Plan, jobs: int, scheduler: str, *, overwrite: bool, as_json: bool) -> int:
    for note in plan.notes:
        say(f"note: {note}")
    try:
        with Bar("analysing", quiet=as_json) as bar:
            found = analyzed(
                plan,
                jobs=jobs or most_jobs(len(plan.tasks)),
                scheduler=scheduler,
                overwrite=overwrite,
                on_progress=bar.show,
            )
    except KeyboardInterrupt:
        say(f"Ctrl-C: left before the end; {plan.output}: the same command goes on from there")
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


def data_of(plan: Plan, found: Analysed) -> dict[str, Any]:
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
    out = console()
    out.width = max(out.width, WIDTH)  # wrapped rows can not be read
    for symbols in TABLES:
        out.print(_table(found.runs[:SHOWN], symbols, "point" if plan.is_sweep else "session"))
        out.print()
    if len(found.runs) > SHOWN:
        out.print(f"... and {len(found.runs) - SHOWN} more runs")
    out.print("value ± noise of images and forces ± what the operator gives", style="dim")
    out.print()
    rows = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    for one in joint_quantities(found.joint):
        rows.add_row(one.name, one.symbol, str(one))
    if not plan.is_sweep:
        out.print("All runs together", style="bold")
        out.print(rows)
        out.print()
    for note in found.joint.notes:
        output().print(f"note: {note}")
    output().print(f"results: {plan.output}")


def joint_quantities(joint: Joint) -> tuple[Measurement, ...]:
    """What the runs have in common, in the units of the paper; uncertainties of all kinds."""
    j = joint
    return (
        Measurement("Young's modulus", "E", j.young_modulus_pa, j.young_modulus_sd_pa, "MPa"),
        Measurement("friction at 1 N", "mu", j.mu, j.mu_sd),
        Measurement("its fall with the load, P^-n", "n", j.decay, j.decay_sd),
        Measurement("length of the local law", "L", j.length_m, j.length_sd_m, "um"),
        Measurement(
            "the same by stiffness", "p/k", j.stiffness_length_m, j.stiffness_length_sd_m, "um"
        ),
        Measurement(
            "the same by roughness", "L(h)", j.roughness_length_m, j.roughness_length_sd_m, "um"
        ),
    )


def _table(runs: Sequence[Reduced], symbols: Sequence[str], what: str) -> Table:
    """Some quantities of each run, which is a session or a point of a sweep."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("P (N)", *symbols, what):
        table.add_column(heading, no_wrap=True)
    for run in runs:
        held = {one.symbol: one for one in summary_quantities(run.summary)}
        cells = [str(held[symbol]) for symbol in symbols]
        name = run.origin.note if what == "point" else run.origin.session
        table.add_row(held["P"].rounded[0], *cells, name)
    return table
