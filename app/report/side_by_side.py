"""Recorded runs side by side: their numbers with the differences, and their curves on the same
axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64, Rows
from analysis.options import UNITS
from app.records.legs import first_loading_rows, stage_travel
from app.records.quantities import Measurement, side_by_side, with_uncertainty
from app.records.record_types import Phase
from app.records.snapshot_numbers import stick_radii
from app.records.summary import Summary
from app.report.card import Card
from app.system.outputs import csv_text

MOST_UNCERTAIN = 0.2  # largest relative sd of c that is drawn
Quantities = Sequence[Measurement | None]


# states of an entry whose session is not there
CUT_SHORT, BEING_RECORDED = "cut short", "being recorded"


@dataclass(frozen=True, slots=True)
class Entry:
    """A file of a folder, as a list of sessions has it.

    Attributes
    ----------
    state : str
        How the run ended in one word, or that it is a further analysis; empty where the file cannot
         be read, which `problem` explains.
    load_n, mu_s : str
        Normal force (N) and static friction with its uncertainty; empty: not measured.
    started : str
        When, as ISO 8601.
    """

    path: Path
    state: str
    load_n: str = ""
    mu_s: str = ""
    started: str = ""
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What a comparison needs of a session.

    Attributes
    ----------
    loading : ndarray, shape (n, 2)
        Travel (um) and Q (N) of the drive; see `stage_travel`.
    sticking : ndarray, shape (n, 3)
        Q/(mu_s P), and c/a with its standard uncertainty, up to the onset of sliding; a is that of
        Hertz.
    is_steady : bool
        Whether the travel is v t, because nothing read the stage.
    preset : str
        The correlation: ``box 20, step 10``.
    """

    path: Path
    card: Card
    load_n: float
    loading: F64
    sticking: F64
    is_steady: bool
    preset: str

    @property
    def name(self) -> str:
        """Name of the file without its ending."""
        return self.path.stem


def curves_of(results: Rows, summary: Summary) -> tuple[F64, F64, bool]:
    """`Recorded.loading`, `sticking` and `is_steady`, from the numbers of a session's frames."""
    drive = results[results["phase"] == str(Phase.DRIVE)]
    read, shear, normal = (drive[n] for n in ("travel_m", "shear_force_n", "normal_force_n"))
    velocity, step = summary.sliding_velocity_m_s, drive["step"]
    travel, is_steady = stage_travel(read, drive["time_s"], step, velocity)
    loading = np.column_stack([travel * 1e6, shear])
    a, mu = summary.hertz_radius_m, summary.mu_s
    c, sd = stick_radii(drive)
    before = ~(drive["time_s"] > summary.onset_time_s)
    first = np.isin(np.arange(len(drive)), first_loading_rows(read, step))
    with np.errstate(divide="ignore", invalid="ignore"):
        sticking = np.column_stack([shear / (mu * normal), c / a, np.nan_to_num(sd) / a])
    is_known = first & before & np.isfinite(sticking).all(axis=1) & (sd < MOST_UNCERTAIN * a)
    return loading[np.isfinite(loading).all(axis=1)], sticking[is_known], is_steady


class Compared(NamedTuple):
    """One quantity of several sessions; `difference` is that of the last from the first, empty
    unless both were measured, and `in_sd` the same by their standard uncertainty by noise.
    """

    name: str
    symbol: str
    values: tuple[str, ...]
    difference: str
    in_sd: str
    unit: str


def compared(sessions: Sequence[Recorded]) -> list[Compared]:
    """The quantities of all sessions side by side, those that at least one has measured."""
    return [
        _row(known, found)
        for known, found in side_by_side(one.card.quantities for one in sessions)
        if any(q is not None and math.isfinite(q.value) for q in found)
    ]


def _row(known: Measurement, found: Quantities) -> Compared:
    texts = tuple(" ".join(q.rounded).strip() if q else "" for q in found)
    difference = in_sd = ""
    first, last, factor = found[0], found[-1], UNITS[known.unit]
    if len(found) > 1 and first and last and math.isfinite(apart := last.value - first.value):
        sd = math.hypot(*(s for s in (first.sd, last.sd) if math.isfinite(s)))
        difference = with_uncertainty(apart / factor, sd / factor)[0] if apart else "0"
        in_sd = f"{apart / sd:.1f}" if sd > 0 else ""
    return Compared(known.name, known.symbol, texts, difference, in_sd, known.unit)


def as_csv(sessions: Sequence[Recorded]) -> str:
    """The numbers of all sessions, unrounded, a row for each quantity."""
    heads = [
        f"{one.name} {what}" for one in sessions for what in ("value", "sd noise", "sd inputs")
    ]
    rows: list[Sequence[str | float]] = [("quantity", "symbol", "unit", *heads)]
    for known, found in side_by_side(one.card.quantities for one in sessions):
        numbers = (q.in_unit if q else (math.nan,) * 3 for q in found)
        rows.append((known.name, known.symbol, known.unit, *chain.from_iterable(numbers)))
    return csv_text(rows)


# from a small load to a large one: of rising lightness, for dark backgrounds and light ones
LOADS = ((64, 104, 214), (204, 92, 150), (240, 170, 60))
DISTINCT = ("#56b4e9", "#e69f00", "#cc79a7", "#009e73", "#d55e00", "#0072b2", "#f0e442")
ALIKE = 0.02  # loads that differ by a smaller share are one


def colours(loads_n: Sequence[float]) -> list[str]:
    """A colour for each session: by its load where they differ, else one that is told apart."""
    known = sorted(load for load in loads_n if math.isfinite(load))
    are_alike = any(high <= low * (1 + ALIKE) for low, high in pairwise(known))
    if len(known) < max(2, len(loads_n)) or are_alike:
        return [DISTINCT[k % len(DISTINCT)] for k in range(len(loads_n))]
    low, high = known[0], known[-1]
    shares = [(load - low) / (high - low) for load in loads_n]
    mixed = np.array([np.interp(shares, (0.0, 0.5, 1.0), part) for part in np.transpose(LOADS)])
    return ["#" + "".join(f"{round(part):02x}" for part in rgb) for rgb in mixed.T.tolist()]
