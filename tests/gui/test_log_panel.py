"""The log of the window, as people read it."""

import logging

import pytest
from pytestqt.qtbot import QtBot

from app.acquisition.recorder_thread import in_words
from app.gui.log_panel import LogPanel, LogStore
from app.records.record_types import Event, Gap
from drivers.protocols import LostFrame


def test_the_log_is_in_words_and_is_copied_with_its_details(qtbot: QtBot) -> None:
    store = LogStore()
    panel = LogPanel(store)
    qtbot.addWidget(panel)
    event = in_words(Event(120, "step", "1 of 4: it's 'dry'", 1))
    for level, text in ((logging.INFO, event), (logging.WARNING, "no: stage")):
        store.emit(logging.LogRecord("app.acquisition.run", level, "", 1, text, None, None))
    store.say("The run was not started.", is_trouble=False)
    panel.refresh()
    shown = panel.text.toPlainText().splitlines()
    assert [line[8:] for line in shown] == [
        " step: 1 of 4: it's 'dry' (sample 120)",
        " warning: no: stage",
        " The run was not started.",
    ]
    assert all(line[2] == line[5] == ":" for line in shown)  # each begins with the time of day
    panel.troubles.setChecked(True)
    assert panel.text.toPlainText().endswith("warning: no: stage")
    panel._copy_all()
    assert "app.acquisition.run" in "\n".join(text for _, text in panel._lines)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (Gap(500, 20, "late"), "20 samples from 500 on are lost: late"),
        (LostFrame(7, 900, "unplugged"), "trigger 7 has no image: unplugged (sample 900)"),
    ],
)
def test_what_is_lost_is_logged_in_words(record: Gap | LostFrame, words: str) -> None:
    assert in_words(record) == words
