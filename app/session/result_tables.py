"""What a file of results holds, as tables: those of every run below one another, with the number of
the run and its normal force, and what the runs have in common.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from app.records.schema import values
from app.records.study_results import RunResult
from app.session.tables import (
    AbsentError,
    Columns,
    Table,
    budget_columns,
    cycle_columns,
    in_units,
    note_columns,
    of_each,
    of_frames,
    pairs,
    pressure_columns,
    profile_columns,
    result_columns,
    ring_columns,
    rows_of,
    slide_columns,
    stress_columns,
    summary_columns,
    table_of,
)

if TYPE_CHECKING:  # what is written of a session is listed without HDF5
    from app.session.results import ResultsReader

# unit of the file -> that in which people read a joint quantity, and its factor
READ_IN = {"m": ("um", 1e-6), "Pa": ("MPa", 1e6), "1": ("", 1.0)}


def _law(run: RunResult) -> Columns:
    radius = np.array(run.summary.pressure_radius_m)
    return of_each(run.frames) | in_units(
        r_mm=radius[None, :], slip_um=run.law.slip_m, ratio=run.law.ratio
    )


def _fields(run: RunResult) -> Columns:
    held = run.instants
    return {"frame": held.frame[:, None, None]} | in_units(
        x_mm=held.x_m,
        y_mm=held.y_m[:, None],
        ux_um=held.ux_m,
        uy_um=held.uy_m,
        sigma_kPa=held.stress_pa,
    )


def _runs(run: RunResult) -> Columns:
    """All that is text of a run, but for its settings."""
    texts = {
        column.name: value for column, value in values(run.origin) if column.name != "settings"
    }
    return {name: np.array([value]) for name, value in texts.items()}


def _joint(reader: ResultsReader) -> Columns:
    held = {column.name: (column, value) for column, value in values(reader.joint)}
    rows = []
    for name, (column, value) in held.items():
        if isinstance(value, float) and not name.endswith("_errors"):
            _, sd = held.get(f"{name}_errors", (None, np.nan))
            unit, factor = READ_IN.get(column.unit, (column.unit, 1.0))
            rows.append((name, column.meaning, value / factor, unit, sd / factor))
    names = ("name", "meaning", "value", "unit", "sd")
    return {name: np.array(part) for name, part in zip(names, zip(*rows, strict=True), strict=True)}


_NO_FRAMES = "no frame of any run has it"
OF_RUNS: dict[str, Table] = {
    "results": Table(
        "every number of each frame", lambda run: result_columns(run.frames), _NO_FRAMES
    ),
    "rings": Table(
        "u_x(r): ring means, the motion of the lens taken off",
        lambda run: ring_columns(run.frames, run.rings),
        _NO_FRAMES,
    ),
    "stress": Table(
        "sigma(r): ring means of the shear traction",
        lambda run: stress_columns(run.frames, run.rings),
        "no run has a shear traction",
    ),
    "law": Table(
        "local slip and traction over that of sliding, by ring: the master curve",
        _law,
        "no run has a law, which needs a shear traction and sliding",
    ),
    "pressure": Table(
        "p(r), k(r) and the slip before the onset",
        lambda run: pressure_columns(run.summary),
        "no run has a measured pressure, which needs a shear traction and sliding",
    ),
    "summary": Table(
        "a quantity in each row, with its uncertainties",
        lambda run: summary_columns(run.summary, run.contact),
    ),
    "budget": Table(
        "what each input of the operator adds to the uncertainty of each quantity",
        lambda run: budget_columns(run.summary),
        "no run has a budget",
    ),
    "cycles": Table(
        "work dissipated in each cycle",
        lambda run: cycle_columns(run.summary),
        "no block was driven back and forth",
    ),
    "slides": Table(
        "peak and sliding friction of each slide of a protocol, after which hold",
        lambda run: slide_columns(run.summary),
        "no protocol has several slides",
    ),
    "notes": Table("why quantities are missing", lambda run: note_columns(run.summary)),
    "profile": Table(
        "azimuthal mean of the background difference",
        lambda run: profile_columns(run.contact, run.pictures.pixel_m),
        "no contact was measured",
    ),
    "fields": Table(
        "displacement and traction at the numbered instants", _fields, "there are no fields"
    ),
    "noise": Table(
        "standard deviation of u_x against the box",
        lambda run: asdict(run.noise),
        "the noise was not measured, see `slipscope analyze --help`",
    ),
    "runs": Table("which session each run is, and how it ended", _runs),
}
COMMON: dict[str, Table] = {
    "joint": Table("what the runs have in common, a quantity in each row", _joint),
    "joint_notes": Table(
        "why a joint quantity is missing, or what does not go together",
        lambda reader: {"note": np.array(reader.joint.notes, str)},
    ),
    "made_with": Table(
        "program, library, computer or setting that made the results",
        lambda reader: pairs(reader.made_with),
    ),
}


TABLES = (*OF_RUNS, *COMMON)


def results_table(reader: ResultsReader, what: str, frames: range | None = None) -> Columns:
    """A table of results by its name in `TABLES`; see `app.session.tables.session_table`."""

    def of_all(table: Table) -> Table:
        return table._replace(columns=lambda reader: _below(reader, table, frames))

    tables = {name: of_all(table) for name, table in OF_RUNS.items()} | COMMON
    return table_of(tables, reader, what, f"{reader.path}", frames)


def _below(reader: ResultsReader, table: Table, frames: range | None) -> Columns:
    """The rows of every run, one of which is in memory at a time."""
    if not len(reader):
        raise AbsentError(f"{reader.path}: it holds no runs; analyse sessions first")
    parts: list[Columns] = []
    for n in range(len(reader)):
        run = reader.run(n)
        own = table.columns(run)
        own = rows_of(own if frames is None else of_frames(own, frames))
        rows = len(next(iter(own.values())))
        whose = {"run": np.full(rows, n + 1), "P_N": np.full(rows, run.summary.normal_force_n)}
        parts.append(whose | own)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
