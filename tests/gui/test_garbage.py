"""Python's garbage collection keeps to the thread of the window."""

from __future__ import annotations

import gc
import threading
from typing import ClassVar

from pytestqt.qtbot import QtBot

from app.gui.garbage import collected_here


class Loop:
    """Refers to itself, and notes the thread in which it is found."""

    found_in: ClassVar[list[int]] = []

    def __init__(self) -> None:
        self.me = self

    def __del__(self) -> None:
        self.found_in.append(threading.get_ident())


def busy(kept: list[list[int]]) -> None:
    """What sets off a collection of Python's own."""
    kept.extend([n] for n in range(100_000))


def test_a_busy_thread_collects_nothing_and_the_window_soon_does(qtbot: QtBot) -> None:
    Loop.found_in.clear()
    gc.enable()
    with collected_here():
        Loop()
        kept: list[list[int]] = []
        thread = threading.Thread(target=busy, args=(kept,))
        thread.start()
        thread.join()
        assert Loop.found_in == []
        qtbot.waitUntil(lambda: len(Loop.found_in) == 1)
        assert Loop.found_in == [threading.get_ident()]
    assert gc.isenabled()
