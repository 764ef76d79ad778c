"""What became of every trigger and sample, and whether all is well: one line, and the details."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtWidgets import QLabel

from app.gui.cells import DASH, Cell, Tone, count_cells, localized
from app.gui.panels import CellGrid, RunPanel
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import STRETCH, fill_bar, label, progress_bar, row, tint, write
from app.records.bench_view import Health
from app.records.record_types import Counts

NOTHING = Health("", "", "", Counts(), 0.0, 0.0, -1, 0, 0.0)
IDLE = Cell("verdict", "No run yet. Start (F5) begins one with the settings of the set-up.")


class HealthStrip(RunPanel):
    """A light, its sentence, and how far the run is; always in view."""

    def __init__(self) -> None:
        super().__init__()
        self.light, self.sentence = QLabel("●"), label("", "muted", is_cut=True)
        self.progress, self.progress_text = progress_bar("progress"), label("", "detail")
        self.progress.setFixedWidth(160)
        self.setLayout(
            row(
                *(self.light, (self.sentence, 1), self.progress, self.progress_text),
                spacing=8,
                margins=(10, 3, 10, 3),
            )
        )
        self._shown: Cell | None = None
        self._say(IDLE)

    def show_setup(self, setup: Setup) -> None:
        """Empty the strip."""
        self.empty()

    def empty(self, verdict: Cell = IDLE) -> None:
        """Show nothing of a run, but a sentence."""
        self._say(verdict)
        self.progress.setValue(0)
        self.progress_text.setText("")

    def show_view(self, view: ViewState) -> None:
        """Show the verdict and the progress as of now."""
        self._say(view.verdict)
        fill_bar(self.progress, view.progress)
        self.progress_text.setText(f"{100 * view.progress:.0f} %")

    def _say(self, verdict: Cell) -> None:
        if verdict == self._shown:
            return
        self._shown = verdict
        tint(self.light, verdict.tone)
        self.light.setToolTip(verdict.tone.name.lower())
        write(self.sentence, localized(verdict.value))


class HealthPanel(RunPanel):
    """The account of triggers, frames and samples, the queue, the disk, and the processor."""

    name, title = "health", "Health"

    def __init__(self) -> None:
        super().__init__()
        self.cells = CellGrid(style="count", columns=3)
        self.cells.setObjectName("")  # the panel has the frame
        self.queue, self.queue_text = progress_bar("queue"), label("", "detail")
        queue = row(label("recorder queue", "name"), (self.queue, 1), self.queue_text, spacing=8)
        self.hold(self.cells, queue, STRETCH, spacing=8)
        self.cells.show_cells(tuple(replace(cell, value=DASH) for cell in count_cells(NOTHING)))

    def show_view(self, view: ViewState) -> None:
        """Show the account as of now."""
        self.cells.show_cells((*view.counts, view.latency, view.screen, view.processor, view.disk))
        fill_bar(self.queue, view.queue_fill)
        self.queue_text.setText(f"{view.queue.value} {view.queue.unit}")
        tint(self.queue, view.queue.tone)
        tint(self.queue_text, None if view.queue.tone is Tone.GOOD else view.queue.tone)
