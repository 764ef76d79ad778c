"""u_x of one place on the picture in all frames so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.gui.cells import number
from app.gui.charts import Chart, Line
from app.gui.frame_results import over_lens_um
from app.gui.run_curves import time_axis
from app.gui.source import Point, Setup, cell_at
from app.records.record_types import F32, Snapshot

MOST_BYTES = 64_000_000  # of fields: beyond it every second of them is kept


@dataclass(frozen=True, slots=True, eq=False)
class FieldHistory:
    """The fields of u_x of a run so far, as many as there is room for.

    Attributes
    ----------
    fields : tuple of (float, ndarray of shape (ny, nx))
        Times on the sample clock (s), and u_x without the motion of the lens (um).
    every, seen : int
        One of so many that were seen is kept, and how many that were.
    newest : int
        Number of the newest frame that was seen; -1 before any.
    """

    fields: tuple[tuple[float, F32], ...] = ()
    every: int = 1
    seen: int = 0
    newest: int = -1

    def with_frame(self, snapshot: Snapshot | None, middle_s: float, setup: Setup) -> FieldHistory:
        """With the field of a snapshot whose exposure has its middle at that time; itself where it
        has none that is new.
        """
        if snapshot is None or snapshot.frame <= self.newest or snapshot.motion is None:
            return self
        longer = replace(self, seen=self.seen + 1, newest=snapshot.frame)
        if self.seen % self.every:
            return longer
        fields = (*self.fields, (middle_s, over_lens_um(snapshot, setup)[0]))
        if len(fields) * fields[0][1].nbytes > MOST_BYTES:
            return replace(longer, fields=fields[::2], every=2 * self.every)
        return replace(longer, fields=fields)

    def chart(self, place_px: Point | None, start_s: float, setup: Setup) -> Chart:
        """u_x against time at a place on the picture (x, y), from the start of the drive if that is
        known; nothing where no place was chosen, or none that was measured.
        """
        begins_s, label = time_axis(start_s)
        chart = Chart("", label, "uₓ (µm)", y_least=(0.0, 1.0))
        if place_px is None or not self.fields:
            return chart
        cell = cell_at(setup.grid_rect_px, self.fields[0][1], *place_px)
        mm = setup.pixel_um * 1e-3
        where = f"at {number(place_px[0] * mm, 2)} mm, {number(place_px[1] * mm, 2)} mm"
        if cell is None:
            return replace(chart, caption=f"{where}: outside of what is measured")
        time_s = np.array([time_s for time_s, _ in self.fields]) - begins_s
        ux_um = np.array([field[cell] for _, field in self.fields], float)
        known = np.isfinite(ux_um)
        line = Line("", time_s[known], ux_um[known], "displacement", ("time_s", "ux_um"), width=1.4)
        kept = f", {len(self.fields)} fields of the run" if known.any() else ": not measured"
        return replace(chart, lines=(line,), caption=where + kept)
