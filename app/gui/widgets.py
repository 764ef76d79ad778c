"""The small pieces that all parts of the window are made of."""

from __future__ import annotations

from typing import TypeVar

from PySide6.QtWidgets import QBoxLayout, QFrame, QHBoxLayout, QLabel, QLayout, QVBoxLayout, QWidget

from app.gui.cells import Tone

# in a layout: a widget or a layout, with its share of the free space; a number is a gap in pixels
Part = QWidget | QLayout | tuple[QWidget | QLayout, int] | int
STRETCH = -1  # in place of a gap: all the free space
Box = TypeVar("Box", bound=QBoxLayout)


class Panel(QFrame):
    """A framed part of the window."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")


def label(text: str, style: str) -> QLabel:
    """A text in one of the styles of `theme.STYLE`."""
    made = QLabel(text)
    made.setObjectName(style)
    return made


def row(
    *parts: Part, spacing: int | None = None, margins: tuple[int, int, int, int] = (0, 0, 0, 0)
) -> QHBoxLayout:
    """`parts` side by side; `margins` are left, top, right, bottom."""
    return _filled(QHBoxLayout(), parts, spacing, margins)


def column(
    *parts: Part, spacing: int | None = None, margins: tuple[int, int, int, int] = (0, 0, 0, 0)
) -> QVBoxLayout:
    """`parts` one below the other; `margins` are left, top, right, bottom."""
    return _filled(QVBoxLayout(), parts, spacing, margins)


def _filled(
    box: Box, parts: tuple[Part, ...], spacing: int | None, margins: tuple[int, int, int, int]
) -> Box:
    box.setContentsMargins(*margins)
    if spacing is not None:
        box.setSpacing(spacing)
    for part in parts:
        what, share = part if isinstance(part, tuple) else (part, 0)
        if isinstance(what, QWidget):
            box.addWidget(what, share)
        elif isinstance(what, QLayout):
            box.addLayout(what, share)
        elif what == STRETCH:
            box.addStretch(1)
        else:
            box.addSpacing(what)
    return box


def tint(widget: QWidget, tone: Tone | None) -> None:
    """Give a widget the colour of a tone, in the look of the window; None: its own again."""
    _polish(widget, "tone", str(tone or ""))


def restyle(widget: QWidget, style: str) -> None:
    """Give a widget another of the styles of `theme.STYLE`."""
    _polish(widget, "objectName", style)


def _polish(widget: QWidget, name: str, value: str) -> None:
    if (widget.property(name) or "") != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
