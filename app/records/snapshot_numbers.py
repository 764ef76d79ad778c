"""The numbers of a snapshot by their names, whichever of its parts hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from analysis.arrays import F64
from app.records.effort import Effort
from app.records.record_types import NAN, Conditions, FrameMotion, Phase, Snapshot, Stick, Traction
from app.records.schema import columns_of

# the numbers of a snapshot by their names, and the parts that hold them
NUMBERS = {c.attribute: c for c in columns_of(Snapshot) if c.group == "/entry/results"}
ROW = np.dtype([(n, "U16" if c.kind is Phase else c.dtype) for n, c in NUMBERS.items()])
"""A row of a table of them, with the phase as text."""
_PARTS: dict[str, Any] = {
    "conditions": Conditions,
    "motion": FrameMotion,
    "stick": Stick,
    "traction": Traction,
    "effort": Effort,
}
RADII = (0.0, 0.5, 0.75, 1.0)  # shares of a at which u_x is followed in time (the paper's Fig. 7)
WHOLE = [name for name, c in NUMBERS.items() if "int" in c.dtype and c.kind is not Phase]
"""Those of the numbers that are whole."""


def numbers_of(snapshot: Snapshot) -> dict[str, Any]:
    """The numbers of a snapshot by their names; NaN where a part is not there."""
    numbers: dict[str, Any] = {"frame": snapshot.frame, "sample": snapshot.sample}
    for name, kind in _PARTS.items():
        part = getattr(snapshot, name)
        for number in kind.__slots__:
            numbers[number] = NAN if part is None else getattr(part, number)
    return numbers


def snapshot_of(numbers: Mapping[str, Any]) -> Snapshot:
    """The snapshot that has these numbers and no arrays; parts of which all are NaN are not
    there.
    """
    parts: dict[str, Any] = {}
    for name, kind in _PARTS.items():
        held = [numbers[number] for number in kind.__slots__]
        is_there = any(not isinstance(number, float) or math.isfinite(number) for number in held)
        parts[name] = kind(*held) if is_there else None
    return Snapshot(numbers["frame"], numbers["sample"], **parts)


def series_of(snapshots: Iterable[Snapshot], name: str) -> F64:
    """One number of every snapshot, by its name; NaN where its part is not there."""
    part = next((part for part, kind in _PARTS.items() if name in kind.__slots__), None)
    holders = [getattr(s, part) if part else s for s in snapshots]
    return np.array([NAN if h is None else getattr(h, name) for h in holders], np.float64)


def all_series(snapshots: Sequence[Snapshot], *names: str) -> tuple[F64, ...]:
    """Each of these numbers of every snapshot."""
    return tuple(series_of(snapshots, name) for name in names)


def known_series(snapshots: Sequence[Snapshot], *names: str) -> F64:
    """Each of these numbers of those snapshots in which all of them are known, shape (names, n)."""
    table = np.stack(all_series(snapshots, *names))
    return table[:, np.isfinite(table).all(axis=0)]


def stick_radii(rows: np.ndarray) -> tuple[F64, F64]:
    """`Snapshot.stick_radius` of each row of a table of numbers: c and its uncertainty, metres."""
    has_peak = np.isfinite(rows["peak_radius_m"])
    c = np.where(has_peak, rows["peak_radius_m"], rows["stick_radius_m"])
    return c, np.where(has_peak, rows["peak_radius_sd_m"], rows["stick_radius_sd_m"])


def ring_displacements(snapshot: Snapshot, radius_m: F64) -> F64:
    """Ring mean of u_x at some radii, linear between the rings, that of the first one within it;
    NaN beyond them.
    """
    rings = snapshot.rings
    if rings is None or not (good := np.isfinite(rings.ux_m)).any():
        return np.full(len(radius_m), NAN)
    ux = np.interp(radius_m, rings.radius_m[good], rings.ux_m[good], right=NAN)
    return np.where(np.isfinite(radius_m), ux, NAN)
