"""A replay against what was recorded: to the bit, within the uncertainty, or different."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from analysis.arrays import all_floats, floats
from app.records.record_types import Record, Snapshot
from app.records.schema import Column, values
from app.session.layout import FORMAT_VERSION
from app.session.reader import SessionReader
from app.session.versions import processor

SAME, DIFFERS = "agrees to the bit", "differs"
AGREES = 0.1  # largest difference, in sds, that rounding explains
STATED = 0.01  # uncertainty of what states none, as share of its largest value
TIMES = ("/entry/results/took", "/entry/results/waited")  # of the run, which no replay repeats
# what states none, but follows from something that does
FOLLOWS = {"/entry/results/centre_ux": "/entry/rings/ux", "/entry/rings/radius": "/entry/rings/ux"}


def unlike(
    a: Snapshot, b: Snapshot, version: int = FORMAT_VERSION
) -> Iterator[tuple[Column, Any, Any]]:
    """The datasets in which two snapshots differ by a bit, of those that a session of that version
    of the format has, and both values.
    """
    for (column, new), (_, old) in zip(values(a), values(b), strict=True):
        x, y = column.stored(new), column.stored(old)
        if column.path in TIMES or column.since > version:
            continue
        if not np.array_equal(x, y, equal_nan=True):
            yield column, x, y


def processor_of(held: dict[str, str]) -> str:
    """Model and instructions of the processor that these versions of a session name."""
    known = [held[name] for name in processor() if name in held]
    return ", ".join(known) or "an unknown processor"


class Comparison:
    """Takes the results of a replay and compares them, bit for bit, with those that were recorded.

    Attributes
    ----------
    frames, identical : int
        Replayed frames, and those of them that gave the recorded results.
    first_difference : str
        The first frame and quantity that differ; empty if none do.
    largest_difference : str
        The one that is largest by the stated standard uncertainty, in its unit; empty if none.
    share : float
        It as a share of that uncertainty; infinite where a number is missing or a state differs.
    recorded_on, replayed_on : str
        Processors.
    """

    def __init__(self) -> None:
        self.frames = self.identical = 0
        self.first_difference = self.largest_difference = ""
        self.share = 0.0
        self.recorded_on, self.replayed_on = "", processor_of(processor())
        self._recorded: Iterator[Snapshot] = iter(())
        self._format = FORMAT_VERSION

    @property
    def all_identical(self) -> bool:
        """Whether every replayed frame gave the recorded results."""
        return self.frames == self.identical

    @property
    def agrees(self) -> bool:
        """Whether nothing differs by more than another processor rounds."""
        return self.all_identical or self.share <= AGREES

    @property
    def verdict(self) -> str:
        """`SAME`, ``agrees within x of the uncertainty``, or `DIFFERS`."""
        if self.all_identical:
            return SAME
        within = f"agrees within {self.share:.2g} of the uncertainty"
        return within if self.agrees else DIFFERS

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict and, where something differs, what; none before the first frame."""
        if not self.frames:
            return ()
        same = f"{self.identical} of {self.frames} frames gave the recorded results to the bit"
        verdict = f"the replay {self.verdict}: {same}"
        if not self.first_difference:
            return (verdict,)
        share = self.share
        of = f", {share:.2g} of its standard uncertainty" if math.isfinite(share) else ""
        return (
            verdict,
            f"first difference: {self.first_difference}",
            f"largest difference: {self.largest_difference}{of}",
            f"recorded on: {self.recorded_on}",
            f"replayed on: {self.replayed_on}",
        )

    def begin(self, session: SessionReader) -> None:
        """Compare with the results in this session, which must stay open."""
        self._recorded, self._format = session.snapshots(), session.format
        self.recorded_on = processor_of(session.header.versions)

    def append(self, record: Record, /) -> None:
        """Compare a snapshot with the next one that was recorded; other records do not matter."""
        if not isinstance(record, Snapshot):
            return
        recorded, is_same = next(self._recorded), True
        for column, x, y in unlike(record, recorded, self._format):
            name = column.path.removeprefix("/entry/")
            if is_same and not self.first_difference:
                self.first_difference = f"frame {record.frame}: {name}"
            is_same = False
            largest, share = _largest(column, x, y, recorded)
            if share > self.share or not self.largest_difference:
                self.share = share
                what = f"{largest:.2g} {column.unit}".removesuffix(" 1")
                self.largest_difference = f"{what} in {name} of frame {record.frame}"
        self.frames += 1
        self.identical += is_same

    def flush(self) -> None:
        """Do nothing: nothing is written."""


def _largest(column: Column, new: Any, old: Any, recorded: Snapshot) -> tuple[float, float]:
    """The largest difference of two values of a column, and as a share of the recorded standard
    uncertainty; of a field, each point's is taken to be at least the median.
    """
    x, y = all_floats(new, old)
    is_number = column.dtype.startswith("float")
    if not is_number or x.shape != y.shape or (np.isfinite(x) != np.isfinite(y)).any():
        return np.inf, np.inf
    apart = np.abs(x - y)
    name = f"{FOLLOWS.get(column.path, column.path).removesuffix('_errors')}_errors"
    stated = next((c.stored(v) for c, v in values(recorded) if c.path == name), None)
    sd: Any = floats(np.nan if stated is None else stated)
    typical = np.nanmedian(sd) if np.isfinite(sd).any() else STATED * np.nanmax(np.abs(y))
    sd = np.fmax(sd, typical) if sd.shape == x.shape else typical
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(apart > 0, apart / sd, 0.0)
    return float(np.nanmax(apart)), float(np.nanmax(share))
