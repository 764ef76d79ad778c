"""Opens the window, keeps it alive until it is closed, and leaves nothing behind."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QEventLoop, QTimer
from PySide6.QtWidgets import QApplication

from app.gui.source import RunSource
from app.gui.window import MainWindow
from app.records import Outcome

SETTLE_MS = 300  # between the last data and the picture of the window


def run_window(
    make_source: Callable[[], RunSource],
    *,
    autostart: bool,
    on_ready: Callable[[MainWindow], None] | None = None,
    screenshot: Path | None = None,
) -> Outcome | None:
    """How the last run in the window ended, once the window is closed; None where none did.

    Parameters
    ----------
    make_source : callable
        Makes a run; called when the window opens, and by Start for every further one.
    autostart : bool
        Begin the first run at once.
    on_ready : callable, optional
        Called with the window when it is on the screen.
    screenshot : Path, optional
        File for a picture of the window at the end of the run, which then closes by itself.
    """
    application = QApplication.instance() or QApplication(["slipscope"])
    assert isinstance(application, QApplication)
    application.setStyle("Fusion")
    pg.setConfigOptions(useOpenGL=False, antialias=False)
    window = MainWindow(make_source=make_source)
    window.show()
    if autostart:
        QTimer.singleShot(0, window, window.begin)
    if on_ready is not None:
        QTimer.singleShot(0, window, lambda: on_ready(window))
    if screenshot is not None:
        _picture_at_end(window, screenshot)
    loop = QEventLoop()
    window.closed.connect(loop.quit)
    with _interrupt_closes(window):
        loop.exec()
    outcome = window.outcome() or (window.source.outcome() if window.source else None)
    # pyqtgraph may crash an interpreter that ends while one of its windows still exists
    window.deleteLater()
    application.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    application.processEvents()
    return outcome


def _picture_at_end(window: MainWindow, path: Path) -> None:
    """Save a picture and close the window when the run has ended."""
    timer = QTimer(window)

    def look() -> None:
        if window.outcome() is not None:
            timer.stop()
            window.grab().save(str(path))
            window.close()

    timer.timeout.connect(look)
    timer.start(SETTLE_MS)


@contextmanager
def _interrupt_closes(window: MainWindow) -> Iterator[None]:
    """Let Ctrl-C stop the motion and close the window, at the next tick of its timer."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: window.close_after_run())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
