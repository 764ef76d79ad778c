"""Runs of the simulated bench over a grid of settings, analysed as sessions are, of which nothing
but the results is kept.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from app.records.study_results import RunResult
from app.runs import live
from app.session.versions import versions
from app.settings.config import ConfigError, from_record, load, revised, to_toml
from app.settings.sections import Config
from app.study.analysis_plan import ENDINGS, RECORDED, Plan, Task, check_room_for, key_of
from app.study.one import run_result
from app.system.errors import UserError
from app.system.outputs import check_output
from app.system.progress import ShareDone

MOST_POINTS = 100_000
SIMULATED = 0.5  # share of a point's time that its simulation takes


def swept(
    bench: Path | None,
    over: Sequence[str],
    output: Path,
    *,
    preset: str,
    overrides: Sequence[str] = (),
    overwrite: bool = False,
) -> Plan:
    """The analysis of a simulated run at every point of a grid.

    Parameters
    ----------
    bench : Path or None
        Settings of the simulated bench.
    over : sequence of str
        ``table.key=value;value;...``: the values that a setting takes, each with every one of the
        other settings.
    preset : str
        Of the image correlation; `RECORDED`: as the settings say.

    Raises
    ------
    UserError, ConfigError
        A setting cannot be used, the bench is a real one, or the results cannot be written.
    """
    check_output(output, overwrite, what="file of results", endings=ENDINGS)
    axes = [_values(axis) for axis in over]
    count = math.prod(map(len, axes))
    if count > MOST_POINTS:
        raise UserError(f"sweep: {count} points are requested, {MOST_POINTS} is the limit")
    changes = () if preset == RECORDED else (f"dic.preset={preset}",)
    tasks = []
    for n, point in enumerate(itertools.product(*axes), 1):
        config = _at(point, bench, overrides)
        if set(config.sources) != {"sim"}:
            raise UserError(
                f"sweep: the bench is {', '.join(config.sources)}; a sweep is for the simulated one"
            )
        try:
            live.scenario(config)
        except ValueError as error:
            raise UserError(f"sweep: {' '.join(point)}: {error}") from None
        frames = round(abs(config.run.travel) / config.run.velocity * config.frame_rate_hz)
        world = to_toml(config, comments=False)
        key = key_of(world, revised(config, changes))
        tasks.append(Task(f"point-{n:06d}", changes, max(1, frames), key, world, " ".join(point)))
    check_room_for(output, count)
    made_with = versions() | {"preset": preset, "set": " ".join(overrides), "over": " ".join(over)}
    return Plan(tuple(tasks), output, made_with, (), is_sweep=True)


def _at(point: Sequence[str], bench: Path | None, overrides: Sequence[str]) -> Config:
    """The settings of a point.

    Raises
    ------
    ConfigError
        They cannot be used; it names --set where `overrides` alone cannot be used either.
    """
    try:
        return load(bench, (*overrides, "recording.results=forces", *point), option="--over")
    except ConfigError:
        load(bench, overrides)
        raise


def _values(axis: str) -> list[str]:
    name, is_there, values = axis.partition("=")
    held = [value.strip() for value in values.split(";") if value.strip()]
    if not (is_there and held):
        raise UserError(f"--over {axis}: values are needed, as in {name}=0.1;0.3;0.5")
    return [f"{name}={value}" for value in held]


def simulated_result(task: Task, on_progress: ShareDone, threads: int | None) -> RunResult:
    """The results of a run that is made for it; UserError where the run fails."""
    config: Config = from_record(task.world, task.session)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{task.session}.h5"
        run = live.make_run(config, path, pace=None)
        run.start()
        outcome = run.wait()
        if outcome is None or outcome.state != "done":
            raise UserError(f"{task.note or task.session}: {run.health().reason}")
        on_progress(SIMULATED)
        found = run_result(
            path, task.overrides, lambda share: on_progress(SIMULATED * (1 + share)), threads
        )
    # no time of day, so that the same sweep is the same file
    origin = replace(found.origin, session=task.session, started="", checksum="", note=task.note)
    return replace(found, origin=origin)
