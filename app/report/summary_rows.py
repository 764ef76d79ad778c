"""How a run ended: as rows of text for people, and as plain data in SI units for machines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from app.records.quantities import (
    Measurement,
    ageing_quantities,
    joint_quantities,
    local_quantities,
    summary_quantities,
    upper_bounds,
)
from app.records.record_types import Counts, Outcome
from app.records.study_results import Joint
from app.records.summary import Summary


class Row(NamedTuple):
    """One line of a table: what it is about, its symbol in the paper, and its value."""

    label: str
    symbol: str
    value: str


def summary_rows(summary: Summary) -> list[Row]:
    """What the experiment comes down to, in the units of the paper."""
    rows = [Row(q.name, q.symbol, str(q)) for q in summary_quantities(summary)]
    return rows + further_rows(summary)


def further_rows(summary: Summary) -> list[Row]:
    """What is told beside the quantities: ranges, cycles, slides, and what the inputs cost."""
    (low, high), rows = summary.mu_d_range, list[Row]()
    if high > low and math.isfinite(summary.mu_d_sd):
        rows.append(Row("Q/P while it slides", "", f"{low:.4f} to {high:.4f}"))
    if summary.calibration_sd > 0 and not summary.budget:
        share = f"± {100 * summary.calibration_sd:.1f} %"
        rows.append(Row("uncertainty of every mu by the calibration", "u(mu)", share))
    rows += known_rows(local_quantities(summary))
    return rows + slide_rows(summary) + budget_rows(summary)


def known_rows(quantities: Iterable[Measurement]) -> list[Row]:
    """Those quantities that were measured."""
    return [Row(q.name, q.symbol, str(q)) for q in quantities if math.isfinite(q.value)]


def slide_rows(summary: Summary) -> list[Row]:
    """What each slide of a protocol gave, and how the contact ages while it is held."""
    s, rows = summary, []

    def with_sd(value: float, sd: float) -> str:
        return f"{value:.4f} ± {sd:.4f}" if math.isfinite(value) else "-"

    for i, step in enumerate(s.slide_step):
        after = f" after {s.slide_hold_s[i]:.4g} s" if s.slide_hold_s[i] > 0 else ""
        speed = f"{1e6 * s.slide_velocity_m_s[i]:.3g} um/s"
        peak = with_sd(s.slide_peak[i], s.slide_peak_sd[i])
        words = f"peak {peak}, mu_d {with_sd(s.slide_mu_d[i], s.slide_mu_d_sd[i])}"
        if math.isfinite(s.slide_rise[i]):
            words += f", rise {with_sd(s.slide_rise[i], s.slide_rise_sd[i])}"
        rows.append(Row(f"step {step}: {speed}{after}", "Q/P", words))
    return rows + known_rows(ageing_quantities(summary))


BUDGETED = {  # results whose budget is told, by their symbols
    "onset_time": "t_s",
    "mu_d": "mu",
    "law_length": "L",
    "young_modulus": "E",
    "pressure": "p",
    "stress": "sigma",
    "peak_radius": "c",
    "block_displacement": "D",
}
LEAST_SHARE = 0.2  # inputs that cause less of the whole uncertainty are not named


def budget_rows(summary: Summary) -> list[Row]:
    """Which inputs cost how much of a result, those that matter, the dearest first."""
    rows: list[Row] = []
    for name, symbol in BUDGETED.items():
        shares, whole = summary.shares(name), summary.systematic(name)
        if not 0 < whole < math.inf:
            continue
        dear = sorted(shares, key=lambda one: -abs(shares[one]))
        largest = [one for one in dear if abs(shares[one]) > LEAST_SHARE * whole]
        words = [f"{one} {_percent(shares[one], '+')}" for one in largest]
        label = "" if rows else "what the inputs cost"
        rows.append(Row(label, f"u({symbol})", f"{_percent(whole)} %: " + ", ".join(words)))
    return rows


def _percent(share: float, sign: str = "") -> str:
    """A share in percent, to two digits, never as a power of ten."""
    percent = 100 * share
    return f"{percent:{sign}.0f}" if abs(percent) >= 99.5 else f"{percent:{sign}.2g}"


def compared_rows(recorded: Summary, now: Summary) -> list[Row]:
    """The quantities in which two analyses of one experiment differ in the digits shown."""
    rows = []
    for old, new in zip(summary_quantities(recorded), summary_quantities(now), strict=True):
        # the inputs are common to both: the digits are those of the noise where these differ
        pairs = [(old, new)]
        if old.is_resolved and new.is_resolved:
            pairs.insert(0, (old.by_noise, new.by_noise))
        for before, after in (map(str, pair) for pair in pairs):
            if before != after:
                rows.append(Row(old.name, old.symbol, f"{before} -> {after}"))
                break
    for name, symbol in BUDGETED.items():
        shares = [one.systematic(name) for one in (recorded, now)]
        before, after = map(_percent, shares)
        if before != after and all(map(math.isfinite, shares)):
            rows.append(Row("what the inputs cost", f"u({symbol})", f"{before} % -> {after} %"))
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
        data = {
            field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)
        }
        if isinstance(value, Joint):
            return data | {"not_resolved_upper_bound": upper_bounds(joint_quantities(value))}
        return data | budget_data(value) if isinstance(value, Summary) else data
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
    return data | {"state": outcome.ended_as}


def budget_data(summary: Summary) -> dict[str, Any]:
    """The budget by quantity and input, in place of the rows in which it is stored: relative
    uncertainties, by all inputs together and by each; and the upper bounds of what is not resolved,
    SI.
    """
    shares = {name: summary.shares(name) for name in summary.budget_quantities}
    whole = {name: summary.systematic(name) for name in summary.budget_quantities}
    bounds = upper_bounds(summary_quantities(summary))
    return {"uncertainty_by_inputs": plain(whole), "budget": plain(shares),
            "not_resolved_upper_bound": bounds}  # fmt: skip
