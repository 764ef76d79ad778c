"""The numbers of a run for people (text with units and uncertainties) and for machines (plain
values in SI units).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from app.records import Counts, Outcome, Summary

NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a summary: what it is, its symbol in the paper, and its value with unit and
    uncertainty.
    """

    label: str
    symbol: str
    value: str


def decimals_for(sd: float) -> int:
    """Decimals that show a standard uncertainty with two significant digits."""
    exponent = math.floor(math.log10(sd))
    if float(f"{sd:.1e}") >= 10 ** (exponent + 1):  # 0.0996 is written 0.10
        exponent += 1
    return max(0, 1 - exponent)


def measured_text(value: float, sd: float, unit: str = "") -> str:
    """A value as ``1.853 ± 0.024 mm``: two digits of the uncertainty set the digits of the value.

    Without a usable uncertainty the value has three significant digits; NaN is "not measured".
    """
    if not math.isfinite(value):
        return NOT_MEASURED
    if not (math.isfinite(sd) and sd > 0):
        digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
        return f"{value:.{digits}f} {unit}".rstrip()
    digits = decimals_for(sd)
    return f"{value:.{digits}f} ± {sd:.{digits}f} {unit}".rstrip()


def range_text(value: float, low: float, high: float, unit: str = "") -> str:
    """A mean with the least and greatest value, as ``0.930 (0.921 to 0.938)``."""
    if not math.isfinite(value):
        return NOT_MEASURED
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return measured_text(value, math.nan, unit)
    digits = decimals_for((high - low) / 2)
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f}) {unit}".rstrip()


def summary_rows(summary: Summary) -> list[Row]:
    """What the experiment comes down to, in the units of the paper."""
    s = summary
    return [
        Row("normal force", "P", measured_text(s.normal_force_n, math.nan, "N")),
        Row(
            "apparent contact radius",
            "a",
            measured_text(s.apparent_radius_m * 1e3, s.apparent_radius_sd_m * 1e3, "mm"),
        ),
        Row("Hertz contact radius", "a_H", measured_text(s.hertz_radius_m * 1e3, math.nan, "mm")),
        Row("onset of sliding", "t_s", measured_text(s.onset_time_s, s.onset_time_sd_s, "s")),
        Row(
            "shear force at the onset",
            "Q_s",
            measured_text(s.static_force_n, s.mu_s_sd * s.normal_force_n, "N"),
        ),
        Row("static friction", "mu_s", measured_text(s.mu_s, s.mu_s_sd)),
        Row("dynamic friction", "mu_d", range_text(s.mu_d, *s.mu_d_range)),
        Row("friction of the local law", "mu", measured_text(s.law_mu, s.law_mu_sd)),
        Row(
            "length of the local law",
            "L",
            measured_text(s.law_length_m * 1e6, s.law_length_sd_m * 1e6, "um"),
        ),
        Row(
            "Young's modulus, from the stress",
            "E",
            measured_text(s.young_modulus_pa * 1e-6, s.young_modulus_sd_pa * 1e-6, "MPa"),
        ),
        Row(
            "besides, all mu together",
            "u(mu)",
            f"± {100 * s.calibration_sd:.1f} % by the calibration"
            if s.calibration_sd > 0
            else "not given",
        ),
        Row("sliding velocity", "v", measured_text(s.sliding_velocity_m_s * 1e6, math.nan, "um/s")),
    ]


def compared_rows(recorded: Summary, now: Summary) -> list[Row]:
    """What two analyses of one experiment come down to, where they differ in what is shown."""
    pairs = zip(summary_rows(recorded), summary_rows(now), strict=True)
    rows = [
        Row(a.label, a.symbol, f"{a.value} -> {b.value}") for a, b in pairs if a.value != b.value
    ]
    return rows or [Row("the same in all digits shown", "", "")]


def counts_rows(counts: Counts) -> list[Row]:
    """The fate of every trigger and every sample."""
    c = counts
    return [
        Row("triggers", "", f"{c.triggers}"),
        Row(
            "frames",
            "",
            f"{c.frames_received} received, {c.frames_recorded} recorded, {c.frames_lost} lost",
        ),
        Row("frames analysed", "", f"{c.frames_analysed}, {c.frames_skipped} skipped"),
        Row("force samples", "", f"{c.samples} recorded, {c.samples_lost} lost"),
    ]


def resources_rows(resources: dict[str, Any]) -> list[Row]:
    """What the run took of the computer."""
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
    """Everything that is told at the end of a run."""
    rows = summary_rows(outcome.summary) if outcome.summary else []
    return rows + counts_rows(outcome.counts) + resources_rows(outcome.resources)


def plain(value: Any) -> Any:
    """Any result as JSON can hold it: NaN becomes null, arrays and tuples become lists, paths and
    enumerations text.
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
    """How a run ended, for machines: SI units, named in the keys; null where nothing was measured."""
    data: dict[str, Any] = plain(outcome)
    return data
