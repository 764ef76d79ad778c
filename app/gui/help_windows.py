"""Help: the manual, page by page, and what program this is; windows beside which the main one, and
STOP MOTION in it, stays in use.
"""

from __future__ import annotations

import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import PySide6
from PySide6.QtCore import QByteArray, Qt, QUrl
from PySide6.QtGui import QColor, QImage, QPalette
from PySide6.QtWidgets import QDialog, QListWidget, QMessageBox, QTextBrowser, QWidget

from app.gui import theme
from app.gui.background import BackgroundWork
from app.gui.cells import Tone
from app.gui.widgets import row, widget
from app.system.manual import manual_folder

FIRST = ("window", "bench", "protocols", "campaigns", "analysis", "results", "glossary")
PICTURE_PX = 740  # widest picture in a page
PAPER = (
    "A. Prevost, J. Scheibert, G. Debrégeas, Probing the micromechanics of a multi-contact"
    " interface at the onset of frictional sliding, Eur. Phys. J. E 36 (2013) 17"
)


class ManualPage(QTextBrowser):
    """A page whose pictures are not wider than itself."""

    def loadResource(self, kind: int, name: QUrl | str) -> Any:
        """What the page names; a picture as large as there is room for it."""
        found = super().loadResource(kind, name)
        picture = QImage.fromData(found) if isinstance(found, QByteArray) else QImage()
        if picture.width() <= PICTURE_PX:
            return found
        return picture.scaledToWidth(PICTURE_PX, Qt.TransformationMode.SmoothTransformation)


class Manual(QDialog):
    """The pages of the manual, which comes with the program."""

    def __init__(self, parent: QWidget, docs: Path | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Manual")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(1000, 700)
        self._given, self._background = docs, BackgroundWork(self)
        name = "Pages of the manual"
        self.pages = widget(QListWidget, accessibleName=name, currentTextChanged=self.show_page)
        self.pages.setFixedWidth(180)
        self.text = widget(ManualPage, openLinks=False, anchorClicked=self._follow)
        colours = self.text.palette()
        colours.setColor(QPalette.ColorRole.Link, QColor(theme.now().tones[Tone.BUSY]))
        self.text.setPalette(colours)
        self.setLayout(row(self.pages, (self.text, 1), margins=(6, 6, 6, 6)))
        self._background.start(self._names, self._list, self.text.setPlainText)

    def show_page(self, name: str, section: str = "") -> None:
        """Show a page, at one of its headings."""

        def read() -> tuple[Path, str]:
            folder = self._docs()
            return folder, (folder / f"{name}.md").read_text(encoding="utf-8")

        def show(found: tuple[Path, str]) -> None:
            folder, markdown = found
            self.text.document().setBaseUrl(QUrl.fromLocalFile(f"{folder}/"))
            self.text.setMarkdown(markdown)
            if section:
                self.text.scrollToAnchor(section)

        self._background.start_anew(read, show, self.text.setPlainText)

    def _docs(self) -> Path:
        """The folder of the pages; a file may be read to find it."""
        return self._given or manual_folder()

    def _names(self) -> list[str]:
        found = {path.stem for path in self._docs().glob("*.md")} - {"index"}  # that of the site
        if not found:
            raise FileNotFoundError(
                f"{self._docs()}: the manual is not there; it is the folder docs of the sources of"
                " SlipScope, and part of its wheel"
            )
        return [name for name in FIRST if name in found] + sorted(found - set(FIRST))

    def _list(self, names: list[str]) -> None:
        self.pages.addItems(names)
        self.pages.setCurrentRow(0)

    def _follow(self, url: QUrl) -> None:
        """Another page of the manual, or a place of this one; what leads elsewhere is left."""
        page = Path(url.path()).stem or self.pages.currentItem().text()
        found = self.pages.findItems(page, Qt.MatchFlag.MatchExactly)
        if found and url.isRelative():
            self.pages.setCurrentItem(found[0])
            self.show_page(page, url.fragment())


def about(parent: QWidget) -> QMessageBox:
    """What program this is, of which version, on what it runs, and whose method it follows."""
    box = QMessageBox(parent)
    box.setWindowTitle("About SlipScope")
    box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    box.setModal(False)
    box.setTextFormat(Qt.TextFormat.RichText)
    box.setText(
        f"<h3>SlipScope {metadata.version('slipscope')}</h3>"
        f"<p>{metadata.metadata('slipscope')['Summary']}.</p>"
        f"<p>The experiment and its analysis: {PAPER}.</p>"
        f"<p>Python {platform.python_version()}, Qt {PySide6.__version__}, {platform.platform()}."
        " <tt>slipscope doctor</tt> shows more about this computer. MIT licence.</p>"
    )
    box.show()
    return box
