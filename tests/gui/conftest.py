import os

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt loads

from functools import partial

import pytest
from pytestqt.qtbot import QtBot


@pytest.fixture
def qtbot(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> QtBot:
    """The robot that uses a window, with patience for a busy machine."""
    for wait in ("waitUntil", "waitSignal"):
        monkeypatch.setattr(qtbot, wait, partial(getattr(qtbot, wait), timeout=60_000))
    return qtbot
