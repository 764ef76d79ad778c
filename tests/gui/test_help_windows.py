"""The manual and what the program says of itself, beside the window."""

from importlib import metadata

from PySide6.QtCore import QUrl
from PySide6.QtWidgets import QMessageBox, QWidget

from app.gui.help_windows import FIRST, Manual, about
from app.system.manual import manual_folder

DOCS = manual_folder()


def shown(qtbot, manual, text):
    qtbot.waitUntil(lambda: text in manual.text.toPlainText())


def test_the_manual_has_every_page_of_the_documentation_the_window_first(qtbot):
    parent = QWidget()
    qtbot.addWidget(parent)
    manual = Manual(parent)
    manual.show()
    assert not manual.isModal()
    qtbot.waitUntil(lambda: manual.pages.count() > 0)
    pages = [manual.pages.item(k).text() for k in range(manual.pages.count())]
    assert pages[: len(FIRST)] == list(FIRST)
    assert set(pages) == {path.stem for path in DOCS.glob("*.md")} - {"index"}
    shown(qtbot, manual, DOCS.joinpath("window.md").read_text().splitlines()[0].lstrip("# "))
    manual.text.anchorClicked.emit(QUrl("glossary.md#terms"))
    shown(qtbot, manual, "stick radius")
    assert manual.pages.currentItem().text() == "glossary"


def test_a_program_without_its_documentation_says_so(qtbot, tmp_path):
    parent = QWidget()
    qtbot.addWidget(parent)
    manual = Manual(parent, tmp_path)
    manual.show()
    shown(qtbot, manual, f"{tmp_path}: the manual is not there")


def test_about_has_the_version_and_whose_method_it_is_and_holds_up_nothing(qtbot):
    parent = QWidget()
    qtbot.addWidget(parent)
    box = about(parent)
    assert isinstance(box, QMessageBox)
    assert not box.isModal()
    assert metadata.version("slipscope") in box.text()
    assert "Eur. Phys. J. E 36" in box.text()
