"""How a run ended: as rows of text for people, and as plain data in SI units for machines."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

from app.records import Counts, Outcome
from app.report.quantities import summary_quantities
from app.summary import Summary


class Row(NamedTuple):
    """One line of a table: what it is about, its symbol in the paper, and its value."""

    label: str
    symbol: str
    value: str


def summary_rows(summary: Summary) -> list[Row]:
    """What the experiment comes down to, in the units of the paper."""
    common = summary.calibration_sd
    return [
        *(Row(q.name, q.symbol, str(q)) for q in summary_quantities(summary)),
        Row(
            "calibration, common to every mu",
            "u(mu)",
            f"± {100 * common:.1f} %" if common > 0 else "not known",
        ),
    ]


def compared_rows(recorded: Summary, now: Summary) -> list[Row]:
    """The quantities in which two analyses of one experiment differ in the digits shown."""
    pairs = zip(summary_rows(recorded), summary_rows(now), strict=True)
    rows = [
        Row(old.label, old.symbol, f"{old.value} -> {new.value}")
        for old, new in pairs
        if old.value != new.value
    ]
    return rows or [Row("the same in all digits shown", "", "")]


def counts_rows(counts: Counts) -> list[Row]:
    """What became of every trigger and every sample."""
    c = counts
    frames = f"{c.frames_received} received, {c.frames_recorded} recorded, {c.frames_lost} lost"
    return [
        Row("triggers", "", f"{c.triggers}"),
        Row("frames", "", frames),
        Row("frames analysed", "", f"{c.frames_analysed}, {c.frames_skipped} skipped"),
        Row("force samples", "", f"{c.samples} recorded, {c.samples_lost} lost"),
    ]


def resources_rows(resources: dict[str, Any]) -> list[Row]:
    """Memory and processor time that the run took, and the receipt of its session."""
    rows = []
    if "peak_memory_mib" in resources:
        rows.append(Row("peak memory", "", f"{resources['peak_memory_mib']:.0f} MiB"))
    if "cpu_s" in resources and "wall_s" in resources:
        cpu, wall = float(resources["cpu_s"]), float(resources["wall_s"])
        share = f" ({cpu / wall:.2f} cores)" if wall > 0 else ""
        rows.append(Row("processor time", "", f"{cpu:.1f} s in {wall:.1f} s{share}"))
    if "receipt" in resources:
        rows.append(Row("session", "", str(resources["receipt"])))
    return rows


def outcome_rows(outcome: Outcome) -> list[Row]:
    """The whole report at the end of a run."""
    rows = summary_rows(outcome.summary) if outcome.summary else []
    return rows + counts_rows(outcome.counts) + resources_rows(outcome.resources)


def plain(value: Any) -> Any:
    """Any result as JSON can hold it.

    NaN becomes null, arrays and tuples become lists, paths and enumerations text.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy arrays and scalars
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bool | int) or value is None:
        return value
    return str(value)


def outcome_data(outcome: Outcome) -> dict[str, Any]:
    """How a run ended, with SI units named in the keys and null where nothing was measured."""
    data: dict[str, Any] = plain(outcome)
    return data
