"""A plot with its title and its tools: show all, copy, save as a picture or as numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path

from PySide6.QtCore import QBuffer, QMarginsF, QPointF, QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import (
    QActionGroup,
    QGuiApplication,
    QImage,
    QKeySequence,
    QPageSize,
    QPainter,
    QPdfWriter,
)
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QFileDialog, QMenu, QToolButton, QWidget

from app.gui import theme
from app.gui.background import BackgroundWork
from app.gui.cells import localized
from app.gui.charts import Chart
from app.gui.file_question import ask_file
from app.gui.plots.curves import CurvePlot
from app.gui.plots.plot import Plot
from app.gui.widgets import (
    STRETCH,
    Panel,
    PanelLabel,
    SteadyLine,
    column,
    label,
    row,
    tool_button,
    write,
)

KINDS = {
    "png": "picture (*.png)",
    "svg": "drawing (*.svg)",
    "pdf": "page (*.pdf)",
    "csv": "numbers (*.csv)",
}
Content = Callable[[], bytes]  # makes what a file holds, in any thread
LONGEST_ORIGIN = 60  # letters of it in the name of a file: a name has at most 255 bytes
MM_PER_INCH = 25.4
PNG_DPI = 300
SIZES_MM = {
    "As on the screen": None,
    "One column, 85 × 65 mm": (85.0, 65.0),
    "Two columns, 175 × 110 mm": (175.0, 110.0),
    "Slide, 254 × 143 mm": (254.0, 143.0),
}


class PlotPanel(Panel):
    """A plot with a heading, a caption below it, and the tools that all plots share.

    `heading` takes the place of the title, and `controls` stand beside it.

    Attributes
    ----------
    origin : str
        The session and the load of what is drawn, written below it in a file.
    size_mm : (float, float) or None
        Width and height of a picture in a file; None: as on the screen.
    """

    def __init__(
        self,
        plot: Plot,
        *controls: QWidget,
        title: str = "",
        heading: QWidget | None = None,
    ) -> None:
        super().__init__()
        self.plot, self.origin = plot, ""
        self.size_mm: tuple[float, float] | None = None
        self.caption = label("", "muted", is_cut=True, kind=PanelLabel)
        self.saved = label("", "muted", is_cut=True, visible=False)
        self.heading = heading or label(title, "heading")
        self._line = SteadyLine(self.caption)
        self._line.hide()
        self._background = BackgroundWork(self)
        tip = "Show all (R, or a double click on the plot)"
        self.show_all = tool_button("⟲", tip, plot.reset, style="")
        self.tools = tool_button("⋯", "Copy, save as PNG, SVG, PDF or CSV", style="")
        self.tools.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.tools.setMenu(self._menu())
        self.head = row(self.heading, STRETCH, *controls, self.show_all, self.tools, spacing=2)
        parts = (self.head, self._line, (plot, 1), self.saved)
        self.body = column(*parts, spacing=2, margins=(10, 5, 8, 5))
        self.setLayout(self.body)

    def show_chart(self, chart: Chart) -> None:
        """Draw `chart` with its caption, in a panel of curves."""
        assert isinstance(self.plot, CurvePlot)
        self.plot.show_chart(chart)
        self.say(chart.caption)

    def say(self, caption: str) -> None:
        """Write this below the heading."""
        self.caption.setText(localized(caption))  # Qt does nothing where it is the same
        if self._line.isHidden() != (not caption):
            self._line.setVisible(bool(caption))

    def copy(self) -> None:
        """Put a picture of the plot on the clipboard."""
        QGuiApplication.clipboard().setPixmap(self.plot.grab())

    # ------------------------------------------------------------------ files

    def ask_where(self, kind: str) -> None:
        """Ask for a file of a kind; the window, and STOP MOTION in it, stay within reach."""
        origin = self.origin[:LONGEST_ORIGIN]
        name = re.sub(r"\W+", "-", f"{origin} {self.plot.title}").strip("-") or "plot"
        ask_file(
            self,
            f"Save as {kind.upper()}",
            self.save,
            start=Path(f"{name}.{kind}"),
            kinds=KINDS[kind],
            mode=QFileDialog.FileMode.AnyFile,
            endings=(kind, *KINDS),
        )

    def save(self, path: Path) -> None:
        """Save the plot as what the end of the name says, and say below the plot that it was, or
        why not. It is drawn at once, in light colours, and written in the background.
        """
        makes = {"csv": self._numbers, "svg": self._drawing, "pdf": self._page}
        content = makes.get(path.suffix.lower().removeprefix("."), self._picture)()
        self._background.start(
            lambda: path.write_bytes(content()),
            lambda _: self.say_below(f"Saved as {path.absolute()}"),
            lambda problem: self.say_below(f"The plot was not saved: {problem}"),
        )

    def say_below(self, sentence: str) -> None:
        """Write a sentence below the plot."""
        write(self.saved, sentence)
        self.saved.show()

    def _numbers(self) -> Content:
        return self.plot.table().encode

    def _picture(self) -> Content:
        ratio = PNG_DPI / self.logicalDpiX()
        image = QImage(self._size() * ratio, QImage.Format.Format_RGB32)
        painter = QPainter(image)
        painter.scale(ratio, ratio)
        self._paint(painter, ratio)
        return partial(_as_png, image)

    def _drawing(self) -> Content:
        buffer, generator = QBuffer(), QSvgGenerator()
        buffer.open(QBuffer.OpenModeFlag.WriteOnly)
        generator.setOutputDevice(buffer)
        generator.setResolution(self.logicalDpiX())
        generator.setSize(self._size())
        generator.setViewBox(self._room())
        generator.setTitle(self.plot.title)
        self._paint(QPainter(generator))
        return partial(bytes, buffer.data().data())

    def _page(self) -> Content:
        buffer, size = QBuffer(), self._size()
        buffer.open(QBuffer.OpenModeFlag.WriteOnly)
        writer = QPdfWriter(buffer)
        points = QSizeF(size) * 72 / self.logicalDpiX()
        writer.setPageSize(QPageSize(points, QPageSize.Unit.Point))
        writer.setPageMargins(QMarginsF())
        writer.setResolution(self.logicalDpiX())  # of the texts' sizes; all is drawn as lines
        writer.setTitle(self.plot.title)
        self._paint(QPainter(writer))
        return partial(bytes, buffer.data().data())

    def _size(self) -> QSize:
        """Of a picture, in pixels of the screen."""
        if self.size_mm is None:
            return QSize(self.plot.size())
        across, down = (round(mm / MM_PER_INCH * self.logicalDpiX()) for mm in self.size_mm)
        return QSize(across, down)

    def _room(self) -> QRectF:
        return QRectF(QPointF(), QSizeF(self._size()))

    def _paint(self, painter: QPainter, pen_ratio: float = 1.0) -> None:
        """Draw the plot, and below it where it is from, and end the drawing."""
        room, text = self._room(), self.fontMetrics()
        painter.fillRect(room, theme.LIGHT.panel)
        now = datetime.now().strftime("%Y-%m-%d %H:%M")
        origin = " · ".join(filter(None, (self.plot.title, self.origin, now)))
        margin, wrapped = text.height() // 2, Qt.TextFlag.TextWordWrap
        words = room.toRect().adjusted(margin, 0, -margin, 0)
        if text.boundingRect(words, wrapped, origin).width() > words.width():  # a word alone
            wrapped = Qt.TextFlag.TextWrapAnywhere
        foot = text.boundingRect(words, wrapped, origin).height() + margin
        self.plot.paint(painter, room.adjusted(0, 0, 0, -foot), pen_ratio)
        painter.setFont(self.font())
        painter.setPen(theme.LIGHT.muted)
        words.setTop(words.bottom() + 1 - foot)
        painter.drawText(words, wrapped, origin)
        painter.end()

    # ------------------------------------------------------------------ menu

    def _menu(self) -> QMenu:
        menu = QMenu(self)
        menu.addAction("Show all\tR", self.plot.reset)
        copy = menu.addAction("Copy picture", self.copy)
        copy.setShortcut(QKeySequence(QKeySequence.StandardKey.Copy))
        copy.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        self.plot.addAction(copy)
        for kind in KINDS:
            menu.addAction(f"Save as {kind.upper()} …", partial(self.ask_where, kind))
        sizes = menu.addMenu("Size of saved pictures")
        group = QActionGroup(sizes)
        for name, size_mm in SIZES_MM.items():
            choice = sizes.addAction(name, partial(setattr, self, "size_mm", size_mm))
            choice.setCheckable(True)
            choice.setChecked(size_mm == self.size_mm)
            group.addAction(choice)
        self.plot.offer(menu.actions()[1:])  # it has its own to show all
        return menu


def _as_png(image: QImage) -> bytes:
    buffer = QBuffer()
    buffer.open(QBuffer.OpenModeFlag.WriteOnly)
    image.save(buffer, "PNG")  # type: ignore[call-overload]
    return bytes(buffer.data().data())
