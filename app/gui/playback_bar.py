"""The bar under a replay: play and pause, one frame on, the pace, and a slider to any frame."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QComboBox, QFrame, QHBoxLayout, QLabel, QPushButton, QSlider, QStyle

from app.gui.source import PlaybackSource

PACES: dict[str, float | None] = {
    "0.1 x": 0.1,
    "0.25 x": 0.25,
    "0.5 x": 0.5,
    "1 x": 1.0,
    "2 x": 2.0,
    "5 x": 5.0,
    "10 x": 10.0,
    "max": None,
}


class FrameSlider(QSlider):
    """A slider that goes where it is pressed."""

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Go to the place under the pointer, and follow it from there."""
        if event.button() is Qt.MouseButton.LeftButton:
            self.setValue(
                QStyle.sliderValueFromPosition(
                    self.minimum(), self.maximum(), int(event.position().x()), self.width()
                )
            )
        super().mousePressEvent(event)


class PlaybackBar(QFrame):
    """What the operator does to a replay. `acted` tells that what is shown has changed."""

    acted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")
        self._source: PlaybackSource | None = None
        self.play, self.forward, self.back = (
            QPushButton("Pause"),
            QPushButton("▸|"),
            QPushButton("|◂"),
        )
        self.pace, self.slider, self.place = (
            QComboBox(),
            FrameSlider(Qt.Orientation.Horizontal),
            QLabel(""),
        )
        self.play.setToolTip("Space")
        self.forward.setToolTip(
            "the next frame (right arrow); while it stands at the newest one, that is analysed"
        )
        self.back.setToolTip("the frame before (left arrow)")
        self.pace.addItems(list(PACES))
        self.pace.setToolTip("seconds of the experiment per second")
        self.slider.setToolTip("any recorded frame, with the results it was recorded with")
        self.place.setObjectName("muted")
        self.place.setMinimumWidth(190)
        row = QHBoxLayout(self)
        row.setContentsMargins(12, 6, 12, 6)
        for widget in (self.play, self.back, self.forward, self.pace):
            widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
            row.addWidget(widget)
        row.addWidget(self.slider, 1)
        row.addWidget(self.place)
        self.slider.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.play.clicked.connect(self.toggle)
        self.forward.clicked.connect(self.go_forward)
        self.back.clicked.connect(self.go_back)
        self.pace.textActivated.connect(
            lambda text: self._do(lambda source: source.playback.set_pace(PACES[text]))
        )
        self.slider.valueChanged.connect(self._moved)
        self.hide()

    def attach(self, source: object) -> None:
        """Serve this source, if it can be played back; else go away."""
        self._source = source if isinstance(source, PlaybackSource) else None
        self.setVisible(self._source is not None)
        if self._source is not None:
            self.slider.setRange(0, self._source.frame_count - 1)
            pace = self._source.playback.pace
            self.pace.setCurrentText(
                next((text for text, value in PACES.items() if value == pace), "1 x")
            )
            self.refresh()

    def toggle(self) -> None:
        """Stand, or go on with the replay."""

        def act(source: PlaybackSource) -> None:
            if source.playback.is_paused:
                source.browser.show(None)
                source.playback.resume()
            else:
                source.playback.pause()

        self._do(act)

    def go_forward(self) -> None:
        """Show the next frame; from the newest one on, by playing it."""
        self._go(1)

    def go_back(self) -> None:
        """Show the frame before."""
        self._go(-1)

    def refresh(self) -> None:
        """Put slider and words where the replay is."""
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
        looks = "recorded frame" if source.is_browsing else "replayed frame"
        self.place.setText(f"{looks} {source.place + 1} of {source.frame_count}")

    def _go(self, way: int) -> None:
        def act(source: PlaybackSource) -> None:
            source.playback.pause()
            if way > 0 and not source.is_browsing:
                source.playback.step()
            elif source.can_browse:
                source.browser.show(min(max(source.place + way, 0), source.frame_count - 1))

        self._do(act)

    def _moved(self, number: int) -> None:
        def act(source: PlaybackSource) -> None:
            source.playback.pause()
            source.browser.show(number)

        self._do(act)

    def _do(self, act: Callable[[PlaybackSource], None]) -> None:
        if self._source is not None:
            act(self._source)
            self.refresh()
            self.acted.emit()
