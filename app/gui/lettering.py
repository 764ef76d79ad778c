"""Text in drawings, where it covers nothing, and with subscripts: ``a_H`` is an a with a small H
below the line.
"""

from __future__ import annotations

import re

import numpy as np
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QFont, QFontMetricsF, QPainter

from app.records.record_types import F64

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


def free(rooms: list[QRectF], axes: QRectF, drawn: list[F64], used: list[QRectF]) -> QRectF:
    """The first of `rooms` in the axes that is on no other text and on no curve, if there is one;
    it joins those in use. A curve is given by its points on the screen, shape (n, 2).
    """
    inside = [room for room in rooms if axes.contains(room)] or rooms
    apart = [r for r in inside if not any(r.intersects(other) for other in used)] or inside
    room = next((r for r in apart if not any(_crosses(p, r) for p in drawn)), apart[0])
    used.append(room)
    return room


def _crosses(piece: F64, room: QRectF) -> bool:
    """Whether a curve, whose points go to the right, runs through a room."""
    x = np.linspace(room.left(), room.right(), 9)
    y = np.interp(x, piece[:, 0], piece[:, 1], left=np.nan, right=np.nan)
    y = y[np.isfinite(y)]
    return bool(y.size and y.max() > room.top() and y.min() < room.bottom())
