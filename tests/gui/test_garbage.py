"""Python's garbage collection keeps to the thread of the window."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable
from typing import ClassVar

import pytest
from pytestqt.qtbot import QtBot

from app.gui import garbage
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


def test_the_oldest_garbage_waits_far_longer_while_something_is_urgent(
    qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    Loop.found_in.clear()
    thresholds = gc.get_threshold()
    monkeypatch.setattr(garbage, "LOOK_MS", 10)
    with collected_here(lambda: True):
        old = Loop()
        gc.collect(1)  # it is of the oldest from now on
        del old
        gc.set_threshold(1, 1, 1)
        monkeypatch.setattr(gc, "collect", noted := Noted(gc.collect))
        try:
            qtbot.waitUntil(lambda: len(Loop.found_in) == 1)
            before = noted.generations[: noted.generations.index(2)]
            assert before.count(1) >= garbage.LATER
        finally:
            gc.set_threshold(*thresholds)


class Noted:
    """Collects, and notes which generation."""

    def __init__(self, collect: Callable[[int], int]) -> None:
        self._collect, self.generations = collect, list[int]()

    def __call__(self, generation: int = 2) -> int:
        self.generations.append(generation)
        return self._collect(generation)
