"""Pixels in the colours of a table, as they are on the screen."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import cast

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRect, QRectF
from PySide6.QtGui import QImage, QPainter, QRegion, QTransform, qRgba
from PySide6.QtWidgets import QGraphicsItem, QWidget

from analysis.arrays import U8

FEW = 100_000  # pixels: the colours of more Qt looks up sooner than numpy
Place = tuple[QRectF, QRegion]  # of the whole on the screen, and what is seen of it
Parts = list[tuple[QRect, QImage]]


class Raster(QGraphicsItem):
    """Pixels in the colours of a table. On a screen each of its pixels has the colour of that which
    its centre is in: Qt would scale the indices of colours in all its threads, and other formats to
    a pixel beside their place. What another raster on top hides is not drawn.
    """

    def __init__(self, box: pg.ViewBox, on_top: Raster | None = None) -> None:
        super().__init__()
        self._box, self._on_top, self._rect = box, on_top, QRectF()
        self._image = self._next = _Image(np.empty((1, 1), np.uint8), QRectF(), None)
        self._place: Place | None = None  # where it was drawn last

    def prepare(self, pixels: U8) -> None:
        """Make, in another thread, what will be drawn if these are shown next as those of now are,
        and nothing moves.
        """
        made, place = self._image.like(pixels), self._place
        if place is not None and made.is_indexed:  # not after colours, as of a connected bench
            made.parts(place)
        self._next = made

    def show_pixels(self, pixels: U8, rect: QRectF, table: U8 | None) -> None:
        """Draw indices of `table`, or colours where there is none, in a rectangle of the axes."""
        made, of = self._next, (pixels, rect, table)
        self._image = made if made.is_of(*of) else _Image(*of, self._image)
        if rect != self._rect:
            self.prepareGeometryChange()
            self._rect = rect
        self.update()
        self.show()

    def boundingRect(self) -> QRectF:
        """Where it is."""
        return self._rect

    def paint(self, painter: QPainter, _: object, widget: QWidget | None = None) -> None:
        """Draw it, in a file as it is."""
        if widget is None:
            painter.drawImage(self._rect, self._image.whole())
            return
        to_screen = painter.deviceTransform()
        whole, parts = to_screen.mapRect(self._rect), self._seen(to_screen, self._rect)
        top = self._on_top
        if top is not None and top.isVisible() and top.opacity() == 1.0:
            parts -= top._seen(to_screen, top._image.hiding)
        self._place = whole, parts
        painter.resetTransform()
        origin = painter.deviceTransform()
        painter.scale(1 / origin.m11(), 1 / origin.m22())
        for part, image in self._image.parts(self._place):
            painter.drawImage(QPointF(part.x() - origin.dx(), part.y() - origin.dy()), image)

    def _seen(self, to_screen: QTransform, rect: QRectF) -> QRegion:
        """The pixels of the screen whose centres a part takes, as far as it is in view."""
        ends = to_screen.mapRect(rect & self._box.viewRect()).getCoords()
        left, top, right, bottom = (math.ceil(at - 0.5) for at in ends)
        return QRegion(left, top, right - left, bottom - top)


class _Image:
    """What a raster draws, made in any thread, `hiding` being the part that nothing is seen
    through.
    """

    def __init__(
        self, pixels: U8, rect: QRectF, table: U8 | None, before: _Image | None = None
    ) -> None:
        self._of = pixels, rect, table
        self._pixels = np.ascontiguousarray(pixels)
        self._colours = np.empty(0, np.uint32)
        if before is not None and table is before._of[2]:
            self._colours = before._colours
        elif table is not None:
            self._colours = np.array([qRgba(*colour) for colour in table.tolist()], np.uint32)
        self._place: Place | None = None  # of the parts that are made
        self._parts: Parts = []
        begin, end = 0, (cols := pixels.shape[1])
        if table is not None and not table[:, 3].all():  # a field that moves loses its last columns
            whole = np.flatnonzero(pixels.all(axis=0))
            begin, end = (whole[0], whole[-1] + 1) if len(whole) else (0, 0)
            end = begin if end - begin > len(whole) else end
        self._is_opaque, wide = end - begin == cols, rect.width() / cols
        self.hiding = rect.adjusted(begin * wide, 0, (end - cols) * wide, 0)

    def like(self, pixels: U8) -> _Image:
        """Other pixels in its place and colours."""
        return _Image(pixels, *self._of[1:], self)

    def is_of(self, pixels: U8, rect: QRectF, table: U8 | None) -> bool:
        """Whether it shows these."""
        return pixels is self._of[0] and rect == self._of[1] and table is self._of[2]

    @property
    def is_indexed(self) -> bool:
        """Whether its pixels are indices of a table."""
        return self._of[2] is not None

    def whole(self) -> QImage:
        """All of it, a pixel for each of its own."""
        return self._coloured(self._pixels)

    def parts(self, place: Place) -> Parts:
        """What is seen of it at a place, as it is on the screen."""
        if place != self._place:
            whole, parts = self._place = place
            rects = cast(Iterable[QRect], parts)
            self._parts = [(part, self._scaled_part(whole, part)) for part in rects]
        return self._parts

    def _scaled_part(self, whole: QRectF, part: QRect) -> QImage:
        """What is in a part of the screen, where the whole takes another. Colours are looked up for
        the fewest pixels.
        """
        near, more = self._pixels, []
        for axis, first, count, start, length in (
            (1, part.left(), part.width(), whole.left(), whole.width()),
            (0, part.top(), part.height(), whole.top(), whole.height()),  # whole rows, copied soon
        ):
            has = self._pixels.shape[axis]
            which = _which(first, count, start, has / length)
            if count < has:
                near = near.take(which, axis=axis, mode="clip")
            else:
                more.append((axis, which))
        kind = QImage.Format
        to = kind.Format_RGB32 if self._is_opaque else kind.Format_ARGB32_Premultiplied
        if near.ndim == 2 and near.size < FEW:
            colours = self._colours.take(near)
        else:
            image = self._coloured(near).convertToFormat(to)
            if not more:
                return image
            colours = np.frombuffer(image.constBits(), np.uint32).reshape(near.shape[:2])
        for axis, which in more:
            colours = colours.take(which, axis=axis, mode="clip")
        return QImage(colours.data, part.width(), part.height(), to)

    def _coloured(self, pixels: U8) -> QImage:
        """Indices of the table or colours as an image, which does not keep them."""
        height, width, *colours = pixels.shape
        kind = QImage.Format.Format_RGB888 if colours else QImage.Format.Format_Indexed8
        image = QImage(pixels.data, width, height, pixels.strides[0], kind)
        image.setColorTable([] if colours else self._colours.tolist())
        return image


@lru_cache(maxsize=32)
def _which(first: int, count: int, start: float, scale: float) -> NDArray[np.intp]:
    """In which pixel of an image that begins at `start` the centres of those of the screen are."""
    return ((np.arange(first, first + count) + 0.5 - start) * scale).astype(np.intp)
