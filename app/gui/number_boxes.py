"""Boxes for one number, which change by what is typed, and by no wheel that passes over them."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QValidator, QWheelEvent
from PySide6.QtWidgets import QDoubleSpinBox, QSpinBox


class NoWheel:
    """The wheel scrolls the panel in which this is, and changes nothing."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the panel."""
        event.ignore()


class CountBox(NoWheel, QSpinBox):
    """A whole number."""


class NumberBox(NoWheel, QDoubleSpinBox):
    """A number and its unit, with the decimal sign of the language; point and comma that are typed
    are both that sign.
    """

    def __init__(self, name: str, unit: str, ends: tuple[float, float], decimals: int) -> None:
        super().__init__()
        self.setAccessibleName(name)
        self.setSuffix(f" {unit}")
        self.setDecimals(decimals)
        self.setRange(*ends)
        self.setKeyboardTracking(False)
        self.setMinimumWidth(70)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._shown = self.value()

    def put(self, number: float) -> None:
        """Show a number, which may have more decimals."""
        self.setValue(number)
        self._shown = self.value()

    @property
    def is_typed(self) -> bool:
        """Whether another number was typed."""
        return self.value() != self._shown

    def validate(self, text: str, at: int) -> tuple[QValidator.State, str, int]:
        """Whether that can be a number."""
        return super().validate(self._in_language(text), at)

    def valueFromText(self, text: str) -> float:
        """The number that was typed."""
        return super().valueFromText(self._in_language(text))

    def _in_language(self, text: str) -> str:
        return text.replace(",", ".").replace(".", self.locale().decimalPoint())
