"""A plot is copied, and saved as a picture, a drawing, a page or numbers."""

import csv
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import pytest
from plot_hands import chart, plot_panel, settle  # noqa: F401 (a fixture)
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QGuiApplication, QImage
from PySide6.QtWidgets import QFileDialog, QLineEdit
from pytestqt.qtbot import QtBot

from app.gui import theme
from app.gui.plot_panel import PlotPanel


def test_copy_by_keyboard(qtbot: QtBot, panel: PlotPanel) -> None:
    QGuiApplication.clipboard().clear()
    panel.plot.setFocus()
    qtbot.keyClick(panel.plot, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    assert QGuiApplication.clipboard().image().width() == panel.plot.width()


def chosen(panel: PlotPanel, kind: str, path: Path) -> None:
    """Choose a kind in the menu, and the file in the dialog that opens."""
    (action,) = (a for a in panel.tools.menu().actions() if kind.upper() in a.text())
    action.trigger()
    dialog = panel.findChild(QFileDialog)
    assert dialog is not None
    assert not dialog.isModal()  # STOP MOTION stays within reach
    dialog.fileSelected.emit(str(path))
    dialog.close()


@pytest.mark.parametrize(
    ("name", "whole"),
    [("slipscope-20261127-232119again", "232119again"), (9 * "a_long_name_" + "232119", "a_long")],
)
def test_a_small_picture_says_all_of_where_it_is_from(
    qtbot: QtBot, panel: PlotPanel, tmp_path: Path, name: str, whole: str
) -> None:
    panel.origin, panel.size_mm = f"0.5 N {name}", (85.0, 65.0)
    panel.save(path := tmp_path / "small.svg")
    qtbot.waitUntil(lambda: panel.saved.text() == f"Saved as {path}")
    texts = [one.strip() for one in ElementTree.parse(path).getroot().itertext()]
    across = 85.0 / 25.4 * panel.logicalDpiX()
    assert max(map(panel.fontMetrics().horizontalAdvance, texts)) < across
    for words in ("Loading curve", "0.5 N", name, f"{datetime.now():%Y-%m-%d}"):
        assert words in "".join(texts)
    assert any(whole in one for one in texts)


@pytest.mark.parametrize("kind", ["png", "svg", "pdf", "csv"])
def test_save_from_the_menu(qtbot: QtBot, panel: PlotPanel, tmp_path: Path, kind: str) -> None:
    panel.origin = "0.5 N run-a"
    before, path = panel.plot.size(), tmp_path / f"curve.{kind}"
    chosen(panel, kind, path)
    assert panel.plot.size() == before
    qtbot.waitUntil(lambda: panel.saved.text() == f"Saved as {path}")
    assert panel.saved.isVisible()
    if kind == "png":
        image = QImage(str(path))
        assert image.width() == pytest.approx(before.width() * 300 / panel.logicalDpiX(), abs=1)
        assert image.pixelColor(2, 2) == QColor(theme.LIGHT.panel)
    elif kind == "svg":
        tree = ElementTree.parse(path)
        texts = "".join(tree.getroot().itertext())
        assert "Q (N)" in texts
        assert "0.5 N run-a" in texts
        assert list(tree.iter("{http://www.w3.org/2000/svg}polyline")) or list(
            tree.iter("{http://www.w3.org/2000/svg}path")
        )
        assert not list(tree.iter("{http://www.w3.org/2000/svg}image"))
    elif kind == "pdf":
        assert path.read_bytes().startswith(b"%PDF")
    else:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
        assert len(rows) == 50
        assert float(rows[-1]["Q_N"]) == 1.0


@pytest.mark.parametrize(
    ("typed", "saved"), [("load 0.5", "load 0.5.csv"), ("a", "a.csv"), ("a.SVG", "a.SVG")]
)
def test_a_name_without_an_ending_gets_that_of_the_kind(
    qtbot: QtBot, panel: PlotPanel, tmp_path: Path, typed: str, saved: str
) -> None:
    panel.ask_where("csv")
    dialog = panel.findChild(QFileDialog)
    dialog.setDirectory(str(tmp_path))
    line = dialog.findChild(QLineEdit)
    line.setText(typed)
    qtbot.keyClick(line, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: "Saved as" in panel.saved.text())
    (path,) = tmp_path.iterdir()
    assert path.name == saved
    assert path.read_bytes().startswith(b"<?xml" if saved == "a.SVG" else b"curve,travel_um")


def test_the_plot_of_many_sessions_is_proposed_a_name_that_a_file_can_have(
    panel: PlotPanel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    panel.origin = ", ".join(f"2026-11-30-sample-A-{n} P = 0.3 N, standard" for n in range(9))
    panel.ask_where("png")
    dialog = panel.findChild(QFileDialog)
    (name,) = dialog.selectedFiles()
    dialog.close()
    assert len(Path(name).name) < 100
    assert name.endswith("-Loading-curve.png")


def test_a_picture_of_a_chosen_size(qtbot: QtBot, panel: PlotPanel, tmp_path: Path) -> None:
    (sizes,) = (a.menu() for a in panel.tools.menu().actions() if a.menu() is not None)
    (choice,) = (a for a in sizes.actions() if a.text().startswith("One column"))
    choice.trigger()
    path, shown = tmp_path / "a.png", panel.plot.grab().toImage()
    panel.save(path)
    assert panel.plot.grab().toImage() == shown  # the plot on the screen is as it was
    qtbot.waitUntil(lambda: "Saved" in panel.saved.text())
    image = QImage(str(path))
    assert image.width() == pytest.approx(85 / 25.4 * 300, abs=3)
    assert image.height() == pytest.approx(65 / 25.4 * 300, abs=3)


def test_a_plot_that_can_not_be_saved_says_so(
    qtbot: QtBot, panel: PlotPanel, tmp_path: Path
) -> None:
    for kind in ("png", "svg", "csv", "pdf"):
        panel.saved.setText("")
        panel.save(tmp_path / "nowhere" / f"a.{kind}")
        qtbot.waitUntil(lambda: "was not saved" in panel.saved.text())
