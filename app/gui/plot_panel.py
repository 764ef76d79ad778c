"""A plot with its title and its tools: show all, copy, save as a picture or as numbers."""

from __future__ import annotations

import re
from pathlib import Path

from PySide6.QtCore import QPoint, QRectF, Qt
from PySide6.QtGui import QAction, QGuiApplication, QKeySequence, QPainter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QFileDialog, QMenu, QSizePolicy, QToolButton, QWidget

from app.gui.canvas import Canvas
from app.gui.charts import Chart
from app.gui.file_question import ask_file
from app.gui.widgets import STRETCH, Panel, column, label, row

KINDS = {"png": "picture (*.png)", "svg": "drawing (*.svg)", "csv": "numbers (*.csv)"}


class PlotPanel(Panel):
    """A canvas with a heading, a caption below it, and the tools that all plots share.

    `heading` takes the place of the title, and `controls` stand beside it.
    """

    def __init__(
        self, canvas: Canvas, *controls: QWidget, title: str = "", heading: QWidget | None = None
    ) -> None:
        super().__init__()
        self.canvas, self.caption = canvas, label("", "muted")
        self.heading = heading or label(title, "heading")
        # a long caption is cut short instead of making the plot wider
        self.caption.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.caption.hide()
        self.show_all = _tool("⤢", "Show all (R, or a double click on the plot)")
        self.show_all.clicked.connect(canvas.reset)
        self.tools = _tool("⋯", "Copy, save as PNG, SVG or CSV")
        self.tools.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.tools.setMenu(self._menu())
        canvas.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        canvas.customContextMenuRequested.connect(self._pop_up)
        self.head = row(self.heading, STRETCH, *controls, self.show_all, self.tools, spacing=2)
        parts = (self.head, self.caption, (canvas, 1))
        self.body = column(*parts, spacing=2, margins=(10, 5, 8, 5))
        self.setLayout(self.body)

    def show_chart(self, chart: Chart) -> None:
        """Draw `chart` with its caption."""
        self.canvas.show_chart(chart)
        if chart.caption != self.caption.text():
            self.caption.setText(chart.caption)
            self.caption.setVisible(bool(chart.caption))

    def copy(self) -> None:
        """Put a picture of the plot on the clipboard."""
        QGuiApplication.clipboard().setPixmap(self.canvas.grab())

    def save(self, path: Path) -> None:
        """Save the plot as what the end of the name says: .png, .svg or .csv.

        Raises
        ------
        OSError
            The file can not be written.
        """
        kind = path.suffix.lower()
        if kind == ".csv":
            path.write_text(self.canvas.table(), encoding="utf-8", newline="")
        elif kind == ".svg":
            self._save_drawing(path)
        elif not self.canvas.grab().save(str(path), "PNG"):
            raise OSError(f"{path} can not be written; choose another folder")

    def _save_drawing(self, path: Path) -> None:
        with path.open("wb"):  # the generator does not say why it can not
            pass
        generator = QSvgGenerator()
        generator.setFileName(str(path))
        generator.setSize(self.canvas.size())
        generator.setViewBox(self.canvas.rect())
        generator.setTitle(self.canvas.chart.title)
        painter = QPainter(generator)
        self.canvas.paint(painter, QRectF(self.canvas.rect()))
        painter.end()

    def ask_where(self, kind: str) -> None:
        """Ask for a file of a kind; the window, and STOP MOTION in it, stay within reach."""
        name = re.sub(r"\W+", "-", self.canvas.chart.title).strip("-") or "plot"
        ask_file(
            self,
            f"Save as {kind.upper()}",
            self._save_or_say,
            start=Path(f"{name}.{kind}"),
            kinds=KINDS[kind],
            mode=QFileDialog.FileMode.AnyFile,
            ending=kind,
        )

    def _save_or_say(self, path: Path) -> None:
        try:
            self.save(path)
        except OSError as error:
            self.caption.setText(f"The plot was not saved: {error}")
            self.caption.show()

    def _menu(self) -> QMenu:
        menu = QMenu(self)
        show_all = QAction("Show all\tR", menu)
        show_all.triggered.connect(self.canvas.reset)
        copy = QAction("Copy picture", self.canvas)
        copy.setShortcut(QKeySequence(QKeySequence.StandardKey.Copy))
        copy.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        copy.triggered.connect(self.copy)
        self.canvas.addAction(copy)
        menu.addActions([show_all, copy])
        menu.addSeparator()
        for kind in KINDS:
            save = QAction(f"Save as {kind.upper()} …", menu)
            save.triggered.connect(lambda _=False, kind=kind: self.ask_where(kind))
            menu.addAction(save)
        return menu

    def _pop_up(self, at: QPoint) -> None:
        self.tools.menu().popup(self.canvas.mapToGlobal(at))


def _tool(text: str, tooltip: str) -> QToolButton:
    button = QToolButton()
    button.setText(text)
    button.setToolTip(tooltip)
    button.setAccessibleName(tooltip)
    return button
