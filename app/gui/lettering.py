"""Text in drawings, with subscripts: ``a_H`` is an a with a small H below the line."""

from __future__ import annotations

import re

from PySide6.QtCore import QPointF
from PySide6.QtGui import QFont, QFontMetricsF, QPainter

SUBSCRIPT = re.compile(r"_(\w)")
SIZE, DEPTH = 0.75, 0.2  # of a subscript, in sizes and heights of the text


def advance(font: QFont, text: str) -> float:
    """The width of a text."""
    whole, *others = SUBSCRIPT.split(text)
    width = QFontMetricsF(font).horizontalAdvance(whole + "".join(others[1::2]))
    if others:
        width += QFontMetricsF(_small(font)).horizontalAdvance("".join(others[::2]))
    return width


def write(painter: QPainter, at: QPointF, text: str) -> None:
    """Write a text whose base line begins at a place."""
    if "_" not in text:
        painter.drawText(at, text)
        return
    font = painter.font()
    for n, piece in enumerate(SUBSCRIPT.split(text)):
        painter.setFont(_small(font) if n % 2 else font)
        metrics = QFontMetricsF(painter.font())
        painter.drawText(at + QPointF(0, DEPTH * metrics.height() if n % 2 else 0), piece)
        at = at + QPointF(metrics.horizontalAdvance(piece), 0)
    painter.setFont(font)


def _small(font: QFont) -> QFont:
    made = QFont(font)
    made.setPointSizeF(SIZE * font.pointSizeF())
    return made
