"""Work in threads, and a window that is gone before its result comes."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event

import pytest
import shiboken6
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from app.gui.background import BackgroundWork, CallsInWindowThread


@pytest.mark.parametrize("how", ["by Qt", "by Python"])
def test_what_comes_back_after_its_owner_is_dropped(
    qapp: QApplication, qtbot: QtBot, how: str
) -> None:
    owner, stays, told = QObject(), QObject(), []
    may_end, work = Event(), BackgroundWork(owner)
    work.start(lambda: may_end.wait(10), lambda _: told.append("gone"), told.append)
    if how == "by Qt":
        shiboken6.delete(owner)
    else:
        del owner
    may_end.set()
    BackgroundWork(stays).start(
        lambda: may_end.wait(10), lambda _: told.append("stays"), told.append
    )
    qtbot.waitUntil(lambda: "stays" in told)
    qtbot.wait(20)
    assert told == ["stays"]


def test_what_comes_back_while_the_program_ends_is_dropped(qapp: QApplication) -> None:
    calls, told = CallsInWindowThread(), list[str]()
    calls.ask(lambda: told.append("before"))
    qapp.processEvents()
    shiboken6.delete(calls)  # as Qt does with what is left at the end
    calls.ask(lambda: told.append("after"))
    qapp.processEvents()
    assert told == ["before"]


def test_what_is_done_in_order_waits_for_what_was_started_before(qtbot: QtBot) -> None:
    owner, done, may_end = QObject(), [], Event()
    work = BackgroundWork(owner)
    work.start(lambda: may_end.wait(10), lambda _: done.append("note"), done.append, in_order=True)
    work.start(lambda: None, lambda _: done.append("resume"), done.append, in_order=True)
    work.start(lambda: None, lambda _: done.append("another"), done.append)
    qtbot.waitUntil(lambda: bool(done))
    qtbot.wait(20)
    assert done == ["another"]
    may_end.set()
    qtbot.waitUntil(lambda: len(done) == 3)
    assert done[1:] == ["note", "resume"]


def test_what_overtakes_is_overtaken_by_nothing_that_follows(qtbot: QtBot) -> None:
    owner, done, may_end = QObject(), [], Event()
    work = BackgroundWork(owner)

    def start(name: str, act: Callable[[], object], patience_s: float | None = None) -> None:
        told = done.append
        work.start(act, lambda _: told(name), told, in_order=True, patience_s=patience_s)

    start("note", lambda: may_end.wait(10))
    start("pause", lambda: None)
    start("end", lambda: None, patience_s=0.01)
    start("withdraw", lambda: None)
    qtbot.waitUntil(lambda: bool(done))
    qtbot.wait(50)
    assert done == ["end"]
    may_end.set()
    qtbot.waitUntil(lambda: len(done) == 4)
    assert done == ["end", "note", "pause", "withdraw"]
