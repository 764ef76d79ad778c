"""The stage of a connected bench: where it is, and the ways to move it without a run."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QHideEvent

from app.gui.background import Take
from app.gui.bench_cells import goal_text, jog_speeds, jog_texts, stage_text, task_text
from app.gui.bench_link import BenchLink
from app.gui.cells import Tone, localized, number, typeset
from app.gui.number_boxes import NumberBox
from app.gui.widgets import (
    Panel,
    Part,
    button,
    by_pointer_only,
    label,
    row,
    tint,
    widget,
    words,
)
from app.gui.window_model import WindowModel
from app.records.bench_view import StageTask, StageView
from app.settings.sections import Config

HOLD_MS = 100
LOOKS = 5  # at a stage at rest after which a motion is over: it may have been asked for just now
LONGEST_MM = 1e4  # of what can be typed; where the stage can go it says itself
ARROWS = ("«", "‹", "›", "»")
FREE = (
    "The stage searches its origin, wherever in its travel that is, and limits.travel counts from"
    " there. Is the block lifted, and the way free?"
)


class StagePanel(Panel):
    """Buttons to hold that jog the stage, a place to send it to, and the search of its origin.

    Parameters
    ----------
    say : callable
        Shows a sentence beside the devices; empty: none any more.
    said : QWidget or layout
        Where that is shown: below the buttons, so that it moves none from under the mouse.
    """

    def __init__(self, model: WindowModel, link: BenchLink, say: Take, said: Part) -> None:
        super().__init__()
        self._model, self._link, self._say = model, link, say
        self._held: tuple[int, float] | None = None
        self._stage: StageView | None = None
        self._looks = LOOKS  # at a stage at rest since the last motion; it is noted at the last one
        self._hold_timer = widget(QTimer, self, timeout=self._hold)
        model.stop_pressed.connect(self._forget_held)  # a stop wins over a button that is held
        self._build(said)

    def show_stage(self, stage: StageView | None) -> None:
        """Show the stage of the bench that is connected."""
        before, self._stage = self._stage, stage
        text, tone = stage_text(stage)
        self.place.setText(text)
        tint(self.place, tone if tone is Tone.BUSY else None)
        self.room.setText(goal_text(stage))
        if stage is not None and before is None:
            self.goal.setValue(stage.position_m * 1e3)
        is_sent = stage is not None and stage.task in (StageTask.MOVE, StageTask.HOME)
        self.go.setText("Stop" if is_sent else "Go")
        for one in (*self.jogs, self.goal, self.go, self.home):
            one.setEnabled(stage is not None)
        self.home.setEnabled(stage is not None and not is_sent)

    def follow(self, stage: StageView | None) -> str:
        """Note in the log where a motion has led; what the stage does now, empty: it stands."""
        if stage is None:
            return ""
        doing, is_asked = task_text(stage), self._held is not None or self._link.is_sending
        if self._looks < LOOKS:
            self._looks = 0 if doing or is_asked else self._looks + 1
            if self._looks == LOOKS:
                self._model.noted.emit(f"Bench: the stage is at {stage_text(stage)[0]}")
        return doing

    def show_settings(self, config: Config) -> None:
        """Show how fast the stage is moved by these settings."""
        slow, fast = jog_speeds(config)
        for jog, arrow, speed in zip(self.jogs, ARROWS, (fast, slow, slow, fast), strict=True):
            text, does, tip = map(typeset, jog_texts(arrow, speed))
            jog.setText(text)
            jog.setAccessibleName(does)
            jog.setToolTip(tip)
        speed_um_s = localized(f"{fast * 1e6:g}")
        self.go.setToolTip(
            f"Moves the stage there at {speed_um_s} µm/s, within its bounds and while forces are"
            " read; STOP MOTION, or this button, stops it, and so does a window that stands still"
        )

    # ------------------------------------------------------------------ orders

    def _note(self, what: str) -> None:
        where = f" from {stage_text(self._stage)[0]}" if self._stage else ""
        self._model.noted.emit(f"Bench: {typeset(what)}{where}")
        self._looks = 0

    def _press(self, direction: int, is_fast: bool) -> None:
        self._held = direction, jog_speeds(self._model.config)[is_fast]
        way = "along" if direction > 0 else "against"
        self._note(f"jog {way} the drive at {self._held[1] * 1e6:g} um/s")
        self._say("")
        self._hold()
        self._hold_timer.start(HOLD_MS)

    def _hold(self) -> None:
        if self._held is not None:
            self._link.hold(*self._held)

    def _forget_held(self) -> None:
        self._hold_timer.stop()
        self._held = None

    def let_go(self) -> None:
        """Stop the stage."""
        self._forget_held()
        self._link.let_go()

    def _go(self) -> None:
        if self._stage is not None and self._stage.task in (StageTask.MOVE, StageTask.HOME):
            self.let_go()
            return
        self.goal.interpretText()
        goal_mm, speed = self.goal.value(), jog_speeds(self._model.config)[1]
        self._say("")
        self._note(f"move to {number(goal_mm, 4)} mm at {speed * 1e6:g} um/s")
        self._link.move(goal_mm * 1e-3, speed)

    def _search(self) -> None:
        self._say("")
        self._note("search of the origin; the operator says that the way is free,")
        self._link.home()

    def event(self, event: QEvent) -> bool:
        """Let go when another window comes to the front: it may get the word that the button was
        let go of.
        """
        if event.type() == QEvent.Type.WindowDeactivate and self._held is not None:
            self.let_go()
        return super().event(event)

    def hideEvent(self, event: QHideEvent) -> None:
        """Nobody holds a button that nobody sees."""
        if self._held is not None:
            self.let_go()
        super().hideEvent(event)

    def _build(self, said: Part) -> None:
        self.place, self.room = label("–", "count"), words("detail")
        self.jogs = [button("") for _ in ARROWS]
        for jog, direction, is_fast in zip(
            self.jogs, (-1, -1, 1, 1), (True, False, False, True), strict=True
        ):
            jog.setStyleSheet("padding: 8px 2px; min-width: 40px;")
            jog.pressed.connect(partial(self._press, direction, is_fast))
            jog.released.connect(self.let_go)
        ends = (-LONGEST_MM, LONGEST_MM)
        self.goal = NumberBox("Place to go to", "mm", ends, 4)
        self.go = button("Go", act=self._go)
        ask = partial(self._model.asked.emit, FREE, "It is free, search", self._search, "No")
        self.home = button("Home …", "Lets the stage search its origin, after a question", ask)
        self.room.setMinimumHeight(2 * self.room.fontMetrics().lineSpacing())
        self.go.setStyleSheet("padding: 4px 8px;")
        self.home.setStyleSheet("padding: 4px 6px;")
        self.goal.setSingleStep(0.01)
        self.goal.setToolTip("Place in the stage's own coordinate; nothing moves before Go")
        by_pointer_only(*self.jogs, self.go, self.home)
        head = row(label("stage", "name"), (self.place, 1), spacing=8)
        jogs = row(*((b, 1) for b in self.jogs), spacing=4)
        unit = label("µm/s, hold to move", "detail")
        to = row(label("to", "name"), (self.goal, 1), self.go, self.home)
        self.hold(head, self.room, jogs, unit, to, said)
