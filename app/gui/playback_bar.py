"""The bar under a replay: play and pause, single frames, the pace, and a slider to any frame."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QComboBox, QPushButton, QSlider, QStyle

from app.gui.source import PlaybackSource
from app.gui.widgets import Panel, label, row

PACES: dict[str, float | None] = {
    f"{pace:g} x": pace for pace in (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
} | {"max": None}


class FrameSlider(QSlider):
    """A slider that jumps to where it is pressed."""

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Jump to the place under the pointer, and follow it from there."""
        if event.button() is Qt.MouseButton.LeftButton:
            x = int(event.position().x())
            lowest, highest = self.minimum(), self.maximum()
            self.setValue(QStyle.sliderValueFromPosition(lowest, highest, x, self.width()))
        super().mousePressEvent(event)


class PlaybackBar(Panel):
    """Controls of a replay; `acted` is emitted when another frame is to be shown."""

    acted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._source: PlaybackSource | None = None
        self.play = QPushButton("Pause")
        self.forward, self.back = QPushButton("▸|"), QPushButton("|◂")
        self.pace, self.slider = QComboBox(), FrameSlider(Qt.Orientation.Horizontal)
        self.place = label("", "muted")
        self.place.setMinimumWidth(190)
        self.pace.addItems(list(PACES))
        self.play.setToolTip("Space")
        self.forward.setToolTip("Next frame (right arrow). After the newest one, replays one more.")
        self.back.setToolTip("Previous frame (left arrow)")
        self.pace.setToolTip("Seconds of the experiment per second")
        self.slider.setToolTip("Any recorded frame, with the results recorded with it")
        for widget in (self.play, self.back, self.forward, self.pace, self.slider):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # the keys belong to the window
        self.setLayout(
            row(
                *(self.play, self.back, self.forward, self.pace, (self.slider, 1), self.place),
                margins=(12, 6, 12, 6),
            )
        )
        self.play.clicked.connect(self.toggle)
        self.forward.clicked.connect(self.go_forward)
        self.back.clicked.connect(self.go_back)
        self.pace.textActivated.connect(
            lambda text: self._do(lambda source: source.playback.set_pace(PACES[text]))
        )
        self.slider.valueChanged.connect(self._show_frame)
        self.hide()

    def attach(self, source: object) -> None:
        """Control `source`; hide where it is not a replay."""
        self._source = source if isinstance(source, PlaybackSource) else None
        self.setVisible(self._source is not None)
        if self._source is not None:
            self.slider.setRange(0, self._source.frame_count - 1)
            pace = self._source.playback.pace
            names = [name for name, value in PACES.items() if value == pace]
            self.pace.setCurrentText(names[0] if names else "1 x")
            self.refresh()

    def toggle(self) -> None:
        """Pause the replay, or go on with it."""

        def act(source: PlaybackSource) -> None:
            if source.playback.is_paused:
                source.browser.show(None)
                source.playback.resume()
            else:
                source.playback.pause()

        self._do(act)

    def go_forward(self) -> None:
        """Show the next frame; after the newest one, by replaying one more."""
        self._go(1)

    def go_back(self) -> None:
        """Show the previous frame."""
        self._go(-1)

    def refresh(self) -> None:
        """Show where the replay is."""
        source = self._source
        if source is None:
            return
        for widget in (self.back, self.slider):
            widget.setEnabled(source.can_browse)
        self.play.setText("Play" if source.playback.is_paused else "Pause")
        if not self.slider.isSliderDown():
            self.slider.blockSignals(True)
            self.slider.setValue(source.place)
            self.slider.blockSignals(False)
        kind = "recorded" if source.is_browsing else "replayed"
        self.place.setText(f"{kind} frame {source.place + 1} of {source.frame_count}")

    def _go(self, frames: int) -> None:
        def act(source: PlaybackSource) -> None:
            source.playback.pause()
            if frames > 0 and not source.is_browsing:
                source.playback.step()
            elif source.can_browse:
                source.browser.show(min(max(source.place + frames, 0), source.frame_count - 1))

        self._do(act)

    def _show_frame(self, number: int) -> None:
        def act(source: PlaybackSource) -> None:
            source.playback.pause()
            source.browser.show(number)

        self._do(act)

    def _do(self, act: Callable[[PlaybackSource], None]) -> None:
        if self._source is not None:
            act(self._source)
            self.refresh()
            self.acted.emit()
