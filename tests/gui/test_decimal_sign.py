"""Numbers have the decimal sign of the operator's language wherever the window shows them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from operators import large
from PySide6.QtWidgets import (
    QAbstractButton,
    QComboBox,
    QLabel,
    QLineEdit,
    QTableWidget,
    QTreeWidget,
)
from pytestqt.qtbot import QtBot
from window_hands import Open, begin, finish, make_run, model_of

from app.gui.cells import Cell, Tone, localized, number, set_decimal_sign, typeset
from app.gui.charts import Chart, Line
from app.gui.run_steps import _left
from app.gui.window import MainWindow
from app.records.bench_view import ForcesView
from app.settings.config import load

WITH_POINT = re.compile(r"\d\.\d")  # no name of a file and no version is in the window


def texts_of(window: MainWindow) -> list[str]:
    """All that is written in it, and about what is under the pointer."""
    kinds = QLabel, QLineEdit, QAbstractButton
    found = [one.text() for kind in kinds for one in window.findChildren(kind)]
    kinds = QComboBox, QTableWidget, QTreeWidget
    for model in (one.model() for kind in kinds for one in window.findChildren(kind)):
        rows, columns = range(model.rowCount()), range(model.columnCount())
        found += [str(model.index(row, column).data()) for row in rows for column in columns]
    return found


@pytest.mark.usefixtures("german")
def test_no_number_of_the_window_has_a_point_where_the_language_has_a_comma(
    qtbot: QtBot, open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run()
    window = open_window(model=model_of(lambda: run))
    slow = ("actuator.max_velocity=25", "run.travel=190", "run.velocity=0.02")
    window.model.set_config(load(None, slow))
    large(window)
    for name in window.docks.by_name:
        window.docks.show(name)
    window.docks.show("experiment")
    window.docks.show("curves")
    begin(qtbot, window, run, 40)
    finish(qtbot, window, run)
    noise = np.zeros((1, 2))
    window.readouts.show_bench(ForcesView((0.5, 0.125), (0.1, 0.0), (0.1, 0.1), noise[0], noise, 1))
    assert window.readouts.views[1].value.text() == "0,125"
    window.readouts.show_bench(None)
    window.notice.say("the stage is at rest at 12.6413 mm")
    monkeypatch.setattr("app.gui.bench_panel.disk_text", lambda *_: ("45.3 GB free", Tone.NEUTRAL))
    window.bench._show()
    window.strip._say(Cell("verdict", "The disk has 5.3 GB left."))
    assert [text for text in texts_of(window) if WITH_POINT.search(text)] == []
    words = "\n".join(texts_of(window))
    for text in ("‹ 2,5", "2,6 h and the operator's time", "45,3 GB free", "has 5,3 GB left"):
        assert text in words
    assert _left(9000.0) == "2,5 h left"
    assert sum("," in text and bool(re.search(r"\d,\d", text)) for text in texts_of(window)) > 20
    canvas = window.interface.canvas
    for axis in (*canvas.axes, canvas._bar.axis, *window.curves.cells[0].plot.axes):
        assert axis.tickStrings([-0.5, 1.5], 1.0, 0.5) == ["−0,5", "1,5"]
        assert axis.tickStrings([-1.5e-5], 1.0, 1e-6) == ["−1,5e−05"]
    picture = window.interface
    canvas.colour_scale = True, (-1.5, 1.5), ""
    picture._show_ends()
    assert [end.text() for end in picture.ends] == ["−1,5", "1,5"]
    # files are named alike in all languages, as are the curves in them
    panel = window.curves.cells[0]
    name = panel.origin
    assert name.startswith("0.5 N ")
    line = Line(name, np.arange(3.0), np.arange(3.0), "shear", ("x", "y"))
    panel.show_chart(Chart("", "x", "y", (line,)))
    assert "0,5 N " in panel.plot.legend.toPlainText()
    assert f"{name},1," in panel.plot.table()
    assert "." not in canvas._scale.text.toPlainText()
    campaign = window.campaign
    campaign.open(Path("six-loads"))  # with names of files
    qtbot.waitUntil(lambda: campaign.lines is not None)
    campaign._put_row(0, replace(campaign.lines.runs[0], seconds=9000.0), is_next=False)
    assert "2,5 h" in texts_of(window)


def test_only_numbers_get_the_sign_of_the_language() -> None:
    set_decimal_sign(",")
    try:
        for text, shown in (
            ("P = 0.5 N, -0.25 and 1.5e-05.", "P = 0,5 N, −0,25 and 1,5e-05."),
            ("limits.normal_force = 1.9 N (±0.01)", "limits.normal_force = 1,9 N (±0,01)"),
            ("/data/2026.11/run-0.5N.h5 by 0.1.0", "/data/2026.11/run-0.5N.h5 by 0.1.0"),
            ("--set run.travel=-0.5 and x=0.5", "--set run.travel=-0.5 and x=0.5"),
            (r"C:\data\2026.11\0.5\-1.h5 (0.5)", r"C:\data\2026.11\0.5\-1.h5 (0,5)"),
            (r"D:\mu\sigma\delta\0.5", r"D:\mu\sigma\delta\0.5"),
            ("0.5-loads.h5, run-0.5 of 1.5", "0.5-loads.h5, run-0.5 of 1,5"),
            ("Version 3.09, slipscope 0.1: 0.5", "Version 3.09, slipscope 0.1: 0,5"),
            ("NI-DAQmx 24.5", "NI-DAQmx 24.5"),
            ("firmware 2.4 needs 0.5 s", "firmware 2.4 needs 0,5 s"),
            ("Firmware v2.4 (SFNC 2.3): 0.5", "Firmware v2.4 (SFNC 2.3): 0,5"),
            ("pyqtgraph 0.13, Qt 6.7, Python 3.14", "pyqtgraph 0.13, Qt 6.7, Python 3.14"),
            ("a division 0.5, aversion 0.5", "a division 0,5, aversion 0,5"),
        ):
            assert typeset(text) == shown
            assert typeset(shown) == shown
        assert number(-1.25, 2) == "−1,25"
        assert localized("-0.52 N (-0.5)") == "-0,52 N (-0,5)"
        assert localized("1.5e−05") == "1,5e−05"
    finally:
        set_decimal_sign(".")
    assert localized("0.5") == "0.5"
    assert typeset(text) == text  # not as it was shown before
