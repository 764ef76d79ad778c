"""An exception that nobody expected is seen: in the window, in the log, and by whoever looked for
exceptions before; the window goes on.
"""

import sys
import threading
from collections.abc import Callable

import pytest
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from scripted_run import ScriptedRun
from workshops import Makes

from app.gui.background import BackgroundWork
from app.gui.start import run_window
from app.gui.window import MainWindow


def fails() -> None:
    raise ZeroDivisionError("deep inside")


def in_a_slot(window: MainWindow) -> None:
    QTimer.singleShot(0, window, fails)


def in_a_done_callback(window: MainWindow) -> None:
    BackgroundWork(window).start(lambda: 1, lambda _: fails(), lambda _: None)


def in_a_thread(window: MainWindow) -> None:
    threading.Thread(target=fails).start()


@pytest.mark.slow
@pytest.mark.parametrize("where", [in_a_slot, in_a_done_callback, in_a_thread])
def test_an_exception_is_a_notice_and_in_the_log_and_the_window_goes_on(
    qapp: QApplication, monkeypatch: pytest.MonkeyPatch, where: Callable[[MainWindow], None]
) -> None:
    came: list[str] = []  # at the hooks that were there before, as those of the tests are
    monkeypatch.setattr(sys, "excepthook", lambda kind, *_: came.append(kind.__name__))
    monkeypatch.setattr(threading, "excepthook", lambda given: came.append(given.exc_type.__name__))
    before = sys.excepthook, threading.excepthook
    seen: list[tuple[str, str]] = []
    run = ScriptedRun(320, 240, frames=60)

    def use(window: MainWindow) -> None:
        where(window)
        tries = iter(range(600))

        def look() -> None:
            if not window.notice.isVisible() and next(tries, None) is not None:
                return
            timer.stop()
            window.log.refresh()
            seen.append((window.notice.text.text(), window.log.text.toPlainText()))
            window.begin()  # it is in use as before
            run.stop_motion()
            window._must_close = True
            window.close()

        timer = QTimer(window)
        timer.timeout.connect(look)
        timer.start(50)

    run_window(run, Makes(lambda: run), autostart=False, on_ready=use)  # type: ignore[arg-type]
    ((notice, log),) = seen
    assert "ZeroDivisionError: deep inside" in notice
    assert "STOP MOTION" in notice
    assert "Traceback" in log
    assert 'raise ZeroDivisionError("deep inside")' in log
    assert came == ["ZeroDivisionError"]
    assert run.started
    assert (sys.excepthook, threading.excepthook) == before


def test_the_same_exception_again_and_again_is_in_the_log_once(
    qapp: QApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "excepthook", lambda *_: None)
    logs: list[str] = []

    def use(window: MainWindow) -> None:
        count = iter(range(30))

        def again() -> None:
            if next(count, None) is None:
                timer.stop()
                window.log.refresh()
                logs.append(window.log.text.toPlainText())
                window.close()
            else:
                fails()

        timer = QTimer(window)
        timer.timeout.connect(again)
        timer.start(5)

    run_window(None, Makes(lambda: None), autostart=False, on_ready=use)  # type: ignore[arg-type]
    assert logs[0].count("raise ZeroDivisionError") == 1
