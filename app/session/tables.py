"""What a session and the results of several hold, as tables: an observation in each row, and one
spelling of the columns for everything that SlipScope exports.

A column is named by its quantity, which is the paper's symbol where the forces have it, and by its
unit: ``P_N``, ``ux_um``, and ``ux_sd_um`` for the standard uncertainty. Its numbers are in that
unit, NaN where nothing was measured. ``time_s`` of a frame counts from the start of the drive, that
of a sample, an event or a gap from sample 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from analysis.arrays import F64, Array, Rows
from app.records.quantities import Measurement, further_quantities, summary_quantities
from app.records.record_types import NAN, ContactResult, RingProfile, StressProfile
from app.records.schema import columns_of
from app.records.snapshot_numbers import NUMBERS
from app.records.study_results import RingSeries
from app.records.summary import Summary
from app.session.datasets import with_revocations
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.session.reader import SessionReader

Columns = dict[str, Array]

# unit as a column names it -> factor to SI; of all others the factor is 1
UNITS = {
    **{"mm": 1e-3, "um": 1e-6, "um_per_s": 1e-6, "uJ": 1e-6},
    **{"kPa": 1e3, "MPa": 1e6, "GPa_per_m": 1e9},
}
# unit of the file -> how a column names the one that people use; radii are in mm
_WRITTEN = {"m": "um", "Pa": "kPa", "N": "N", "s": "s", "rad": "rad"}
_SYMBOLS = {"normal_force": "P", "shear_force": "Q"}


class AbsentError(UserError):
    """A table with nothing in it."""


class Table(NamedTuple):
    """A table: its meaning, what makes its columns, and why it may not be there; without a reason,
    no rows say as much as some.

    `columns` gives arrays that fit one another as those of numpy do: (n, 1) beside (n, k).
    """

    meaning: str
    columns: Callable[[Any], Columns]
    missing: str = ""


def counted_from_0(path: Path, what: str, index: int, count: int) -> int:
    """The number of an item of a file, which may be counted from its end; IndexError."""
    n = index + count if index < 0 else index
    if not 0 <= n < count:
        raise IndexError(f"{path}: there is no {what} {index}; there are {count}, counted from 0")
    return n


def spelled(name: str) -> str:
    """How a table calls a number of a snapshot or of its field: ``shear_force_n`` is ``Q_N``."""
    unit = NUMBERS[name].unit if name in NUMBERS else ""
    if unit not in _WRITTEN:
        return name.replace("_std_", "_sd_")
    quantity, is_sd = name.rpartition("_")[0].removesuffix("_sd"), "_sd_" in name
    written = "mm" if quantity.endswith("radius") else _WRITTEN[unit]
    return f"{_SYMBOLS.get(quantity, quantity)}{'_sd' if is_sd else ''}_{written}"


def in_units(**si: Any) -> Columns:
    """Columns of the numbers given in SI units, each in the unit that its name ends with."""
    return {name: np.asarray(values) / _factor(name) for name, values in si.items()}


def _factor(name: str) -> float:
    return next((factor for unit, factor in UNITS.items() if name.endswith(f"_{unit}")), 1.0)


def rows_of(columns: Mapping[str, Array]) -> Columns:
    """The columns in full length, without the rows that are beyond the end of a profile."""
    named = dict(zip(columns, np.broadcast_arrays(*columns.values()), strict=True))
    if (place := named.get("r_mm")) is None:
        return {name: values.ravel() for name, values in named.items()}
    there = np.isfinite(place)
    return {name: values[there] for name, values in named.items()}


def of_frames(columns: Columns, wanted: range) -> Columns:
    """What belongs to frames with these numbers; all of a table without frames."""
    if "frame" not in columns:
        return columns
    frames = columns["frame"]
    chosen = [int(frame) in wanted for frame in frames.ravel()]
    return {
        name: values[chosen] if len(values) == len(frames) else values
        for name, values in columns.items()
    }


def pairs(held: Mapping[str, Any], name: str = "name", value: str = "value") -> Columns:
    """What is held by names, a row for each; those of nothing are texts."""
    kind = None if held else str
    return {name: np.array(list(held), kind), value: np.array(list(held.values()), kind)}


# ------------------------------------------------------------- of every run, in either kind of file


def result_columns(frames: Rows) -> Columns:
    """Every number of each frame."""
    columns = {spelled(name): frames[name] for name in frames.dtype.names or ()}
    return {
        name: values / _factor(name) if values.dtype.kind == "f" else values
        for name, values in columns.items()
    }


def of_each(frames: Rows) -> Columns:
    """Number and time of each frame, a row for each."""
    return {"frame": frames["frame"][:, None], "time_s": frames["time_s"][:, None]}


def ring_columns(frames: Rows, rings: RingSeries) -> Columns:
    """u_x of each ring and frame."""
    return of_each(frames) | in_units(r_mm=rings.radius_m, ux_um=rings.ux_m, ux_sd_um=rings.ux_sd_m)


def stress_columns(frames: Rows, rings: RingSeries) -> Columns:
    """sigma(r) of each frame."""
    return of_each(frames) | in_units(
        r_mm=rings.stress_radius_m, sigma_kPa=rings.stress_pa, sigma_sd_kPa=rings.stress_sd_pa
    )


def pressure_columns(summary: Summary) -> Columns:
    """p(r), k(r) and the local slip at the onset."""
    s, radius = summary, np.array(summary.pressure_radius_m)

    def beside(values: tuple[float, ...]) -> F64:  # an older file lacks some
        return np.array(values) if len(values) == len(radius) else np.full(len(radius), NAN)

    return in_units(
        r_mm=radius,
        p_kPa=beside(s.pressure_pa),
        p_sd_kPa=beside(s.pressure_sd_pa),
        k_GPa_per_m=beside(s.interface_stiffness_pa_m),
        k_sd_GPa_per_m=beside(s.interface_stiffness_sd_pa_m),
        precursor_slip_um=beside(s.precursor_slip_m),
    )


def budget_columns(summary: Summary) -> Columns:
    """What each input adds to the relative uncertainty of each quantity, with its sign."""
    inputs, quantities = summary.budget_inputs, summary.budget_quantities
    return {
        "quantity": np.array(quantities * len(inputs), str),
        "input": np.repeat(np.array(inputs, str), len(quantities)),
        "relative_sd": np.array(summary.budget, np.float64),
    }


def cycle_columns(summary: Summary) -> Columns:
    """What each cycle dissipates, by the force and by the local slip."""
    loops = summary.loop_work_j
    local = (*summary.local_work_j, *[NAN] * len(loops))[: len(loops)]
    return {"cycle": 1 + np.arange(len(loops))} | in_units(loop_work_uJ=loops, local_work_uJ=local)


def profile_columns(contact: ContactResult | None, pixel_m: float) -> Columns:
    """Azimuthal mean of the background difference about the contact's centre."""
    radius, grey = (contact.profile_radius_px, contact.profile_grey) if contact else ((), ())
    return in_units(r_mm=np.asarray(radius) * pixel_m, grey_counts=grey)


def summary_columns(summary: Summary | None, contact: ContactResult | None) -> Columns:
    """What the run comes down to, a quantity in each row, in the unit that the row names, with its
    uncertainties by noise and by the operator's inputs, and the upper bound of what is not
    resolved.
    """
    rows = [*summary_quantities(summary), *further_quantities(summary)] if summary else []
    if contact:
        pairs = (("centre of the contact", contact.centre_px), ("shift", contact.shift_px))
        rows += [
            Measurement(f"{name}, {axis}", axis, value, unit="px")
            for name, pair in pairs
            for axis, value in zip("xy", pair, strict=True)
        ]
    return {
        **{
            name: np.array([getattr(row, name) for row in rows], str) for name in ("name", "symbol")
        },
        "value": np.array([row.in_unit[0] for row in rows], np.float64),
        "unit": np.array([row.unit for row in rows], str),
        "sd_noise": np.array([row.in_unit[1] for row in rows], np.float64),
        "sd_inputs": np.array([row.in_unit[2] for row in rows], np.float64),
        "upper_bound": np.array([row.bound_in_unit for row in rows], np.float64),
    }


# ------------------------------------------------------------- of a session


def rings_of(reader: SessionReader) -> RingSeries:
    """The ring means of u_x and of sigma_xz of every result, a row for each; NaN where it has
    none, and beyond the end of each profile.
    """
    rings = _profiles(reader, RingProfile, "ring_count")
    return RingSeries(*rings, *_profiles(reader, StressProfile, "stress_count"))


def _profiles(reader: SessionReader, kind: type, counter: str) -> Iterator[F64]:
    """Each field of the profiles of a kind, in order, shape (results, the longest)."""
    rows, columns = len(reader.analysed_frames()), columns_of(kind)
    if any(column.since > reader.format for column in columns):
        yield from (np.empty((rows, 0)) for _ in columns)
        return
    counts = reader.file.read(reader.dataset(f"/entry/results/{counter}"))[:rows]
    for column in columns:
        values = np.array(reader.file.read(reader.dataset(column.path)), np.float64)[:rows]
        values[np.arange(values.shape[1]) >= counts[:, None]] = NAN
        yield values


def stage_um(at: Array, metres: F64, samples: Array) -> F64:
    """Position of the stage at samples, in um: linear between its readings, of which `at` are the
    samples; NaN if there are none.
    """
    known = np.isfinite(metres)
    if not known.any():
        return np.full(len(samples), NAN)
    position: F64 = np.interp(samples, at[known], metres[known] * 1e6)
    return position


def force_columns(reader: SessionReader) -> Columns:
    """Forces, readings and the position of the stage at every sample, and the further channels."""
    held = reader.forces()
    samples = np.arange(len(held.volts))
    columns = _at(reader, samples) | {
        "P_N": held.forces[:, 0],
        "Q_N": held.forces[:, 1],
        "normal_V": held.volts[:, 0],
        "shear_V": held.volts[:, 1],
        "stage_um": stage_um(*reader.positions(), samples),
    }
    if (channels := reader.header.auxiliary) is not None and held.auxiliary is not None:
        own = {name.partition("_")[0].lower() for name in columns}
        for label, values in zip(channels.labels, held.auxiliary.T, strict=True):
            # `slipscope import` would take it for a second column of a quantity
            name = f"aux_{label}" if label.rpartition("_")[0].lower() in own else label
            while name in columns:
                name = f"aux_{name}"
            columns[name] = values
    return columns


def _at(reader: SessionReader, samples: Any) -> Columns:
    at = np.array(samples, np.int64)
    return {"sample": at, "time_s": at / reader.header.sample_rate_hz}


def _stage(reader: SessionReader) -> Columns:
    samples, metres = reader.positions()
    return _at(reader, samples) | in_units(stage_um=metres)


def _triggers(reader: SessionReader) -> Columns:
    table = with_revocations(reader.triggers(), reader.events())
    return {
        "frame": table["index"],
        **_at(reader, table["sample"]),
        "received": table["received"],
        "analysed": table["analysed"],
        "reason": table["reason"].astype(str),
        "first": table["first"],
        "last": table["last"],
        "camera_s": table["stamp"],
    }


def _events(reader: SessionReader) -> Columns:
    events = reader.events()
    texts = {name: np.array([getattr(e, name) for e in events], str) for name in ("kind", "text")}
    return _at(reader, [event.sample for event in events]) | texts


def _gaps(reader: SessionReader) -> Columns:
    gaps = np.array(reader.gaps(), np.int64).reshape(-1, 2)
    return _at(reader, gaps[:, 0]) | {"samples": gaps[:, 1]}


def _run(reader: SessionReader) -> Columns:
    header, outcome = reader.header, reader.outcome
    about = {
        "session": reader.path.name.encode("utf-8", "backslashreplace").decode(),  # any bytes
        "start_time": header.started,
        "end_time": reader.ended,
        "state": outcome.ended_as,
        "reason": outcome.reason,
        "sample": header.sample,
        "operator": header.operator,
        "note": header.note,
    }
    return pairs(about)


def slide_columns(summary: Summary) -> Columns:
    """What each slide of a protocol of several steps gave."""
    names = ("hold_s", "peak", "peak_sd", "mu_d", "mu_d_sd", "rise", "rise_sd")
    held = {"velocity_um_per_s": "velocity_m_s"} | dict(zip(names, names, strict=True))
    columns = {name: getattr(summary, f"slide_{attribute}") for name, attribute in held.items()}
    return {"step": np.array(summary.slide_step, np.int64)} | in_units(**columns)


def note_columns(summary: Summary) -> Columns:
    """Why quantities could not be measured."""
    return {"note": np.array(summary.notes, str)}


_UNFINISHED = "the run did not reach its end, and only then is this computed"
_NO_LAW = "no pressure was measured, which needs a shear traction and sliding"
SESSION = {
    "results": Table(
        "every number of each analysed frame",
        lambda reader: result_columns(reader.results()),
        "none of these frames was analysed",
    ),
    "forces": Table("forces, readings and stage at every sample", force_columns),
    "rings": Table(
        "u_x(r): ring means about the contact's centre, the motion of the lens taken off",
        lambda reader: ring_columns(reader.results(), rings_of(reader)),
        "no ring means were measured, which needs a reference, and more of recording.results than"
        " forces",
    ),
    "stress": Table(
        "sigma(r): ring means of the shear traction",
        lambda reader: stress_columns(reader.results(), rings_of(reader)),
        "no shear traction was computed, which needs a reference, a stress.method, and more of"
        " recording.results than forces",
    ),
    "law": Table(
        "local slip and traction over that of sliding, by ring",
        lambda reader: {"frame": np.empty(0, np.int64)},
        "a session does not hold its points; `slipscope analyze` writes them to a file of results",
    ),
    "pressure": Table(
        "p(r), k(r) and the slip before the onset, over the distance from the contact's centre",
        lambda reader: pressure_columns(reader.outcome.measured),
        _NO_LAW,
    ),
    "summary": Table(
        "a quantity in each row, with its uncertainties",
        lambda reader: summary_columns(reader.outcome.summary, reader.contact()),
        _UNFINISHED,
    ),
    "budget": Table(
        "what each input of the operator adds to the uncertainty of each quantity",
        lambda reader: budget_columns(reader.outcome.measured),
        _UNFINISHED,
    ),
    "cycles": Table(
        "work dissipated in each cycle",
        lambda reader: cycle_columns(reader.outcome.measured),
        "the block was not driven back and forth",
    ),
    "slides": Table(
        "peak and sliding friction of each slide of a protocol, after which hold",
        lambda reader: slide_columns(reader.outcome.measured),
        "the protocol has not several slides",
    ),
    "notes": Table(
        "why a quantity of the summary is missing, and what to know of others",
        lambda reader: note_columns(reader.outcome.measured),
    ),
    "profile": Table(
        "azimuthal mean of the background difference, of which a is the edge",
        lambda reader: profile_columns(reader.contact(), reader.header.pixel_m),
        "the contact was not measured",
    ),
    "run": Table("who ran it, on what, when, and how it ended", _run),
    "triggers": Table("every trigger and its fate", _triggers),
    "stage": Table("the readings of the stage", _stage),
    "events": Table("what happened", _events),
    "gaps": Table("samples of the forces that are missing", _gaps),
    "counts": Table(
        "the account of frames and samples",
        lambda reader: pairs(asdict(reader.outcome.counts), "count"),
    ),
    "versions": Table(
        "what the session was made with",
        lambda reader: pairs(reader.header.versions, value="version"),
    ),
}


def session_table(reader: SessionReader, what: str, frames: range | None = None) -> Columns:
    """A table of a session by its name in `SESSION`, as columns of one length.

    Parameters
    ----------
    frames : range, optional
        Only what belongs to frames with these numbers.

    Raises
    ------
    UserError
        There is no such table, or nothing in it.
    """
    return table_of(SESSION, reader, what, f"{reader.path}", frames)


def table_of(
    tables: Mapping[str, Table], held: Any, what: str, name: str, frames: range | None = None
) -> Columns:
    """A table of what is held by a file of that name; for the rest see `session_table`."""
    if what not in tables:
        raise UserError(f"{name}: it has no table {what}; there are {', '.join(tables)}")
    table = tables[what]
    columns = table.columns(held)
    columns = rows_of(columns if frames is None else of_frames(columns, frames))
    if table.missing and not len(next(iter(columns.values()))):
        why = table.missing if frames is None else "none of these frames was analysed, or has one"
        raise AbsentError(f"{name}: there is nothing for a table of {what}: {why}")
    return columns
