"""Opens the window, keeps it alive until it is closed, and leaves nothing behind."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QEvent, QEventLoop, QTimer
from PySide6.QtWidgets import QApplication

from app.gui.garbage import collected_here
from app.gui.icon import program_icon
from app.gui.memory import WindowMemory
from app.gui.run_factory import RunFactory
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.record_types import Outcome
from app.runs.run_source import RunSource
from app.settings.config import from_data
from app.settings.sections import Config
from app.settings.toml_text import parse_toml
from app.system.errors import UserError
from app.system.heap import keep_freed_memory

LOG = logging.getLogger(__name__)
LOOK_MS = 200


def run_window(
    source: RunSource | None = None,
    factory: RunFactory | None = None,
    config: Config | None = None,
    *,
    session: Path | None = None,
    autostart: bool,
    close_when: Callable[[], bool] = lambda: False,
    on_ready: Callable[[MainWindow], None] | None = None,
) -> Outcome | None:
    """How the last run in the window ended, once the window is closed; None where none did.

    Parameters
    ----------
    source : RunSource, optional
        What the window shows at first.
    factory : RunFactory, optional
        Makes the runs that Start begins, and replays; without one `source` is all there is.
    config : Config, optional
        Settings of the first run; without any those of the last evening, or else the default ones.
    session : Path, optional
        The file of the first run.
    autostart : bool
        Begin at once.
    close_when : callable
        Whether the program has been told to end: then the motion is stopped and the window closes.
    on_ready : callable, optional
        Called with the window when it is on the screen.
    """
    application = QApplication.instance() or QApplication(["slipscope"])
    assert isinstance(application, QApplication)
    application.setStyle("Fusion")
    application.setWindowIcon(program_icon())
    application.setDesktopFileName("slipscope")  # by which a desktop finds the entry of a window
    sys.setswitchinterval(0.001)  # a key waits for no more than that for the interpreter
    keep_freed_memory()

    def is_urgent() -> bool:
        return window.is_live()

    with collected_here(is_urgent):
        model = None if factory is None else opened_model(factory, config, session)
        window = MainWindow(source, model)
        window.show()
        if autostart:
            QTimer.singleShot(0, window, window.begin)
        if on_ready is not None:
            QTimer.singleShot(0, window, lambda: on_ready(window))
        loop = QEventLoop()
        window.closed.connect(loop.quit)
        timer = QTimer(window)

        def look() -> None:
            if close_when():
                timer.stop()
                window.close_after_run()

        timer.timeout.connect(look)
        timer.start(LOOK_MS)
        with _exceptions_told(window):
            loop.exec()
        outcome = window.outcome() or (window.source.look().outcome if window.source else None)
        # nothing of the window outlives the interpreter
        window.deleteLater()
        application.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        application.processEvents()
        return outcome


def opened_model(factory: RunFactory, config: Config | None, session: Path | None) -> WindowModel:
    """A model with these settings; without any with the set-up of the last evening, if it can be
    used.
    """
    restored = ""
    if config is None and (kept := WindowMemory().set_up()) is not None:
        settings, name, when = kept
        try:  # no folder is that of the settings: code must have been confirmed wherever it lies
            config = from_data(parse_toml(settings), "the set-up of the last evening", folders=())
        except (UserError, ValueError) as error:
            LOG.warning("the set-up of the last evening is not used: %s", error)
        else:
            restored, session = when, session or (Path(name) if name else None)
    model = WindowModel(factory, config or Config(), session)
    model.restored = restored
    return model


@contextmanager
def _exceptions_told(window: MainWindow) -> Iterator[None]:
    """Have the window say, and the log keep, an exception that nothing else has caught: in a slot,
    in a callback, or in any thread. The hooks of before hear of it as well.
    """
    hook, thread_hook = sys.excepthook, threading.excepthook

    def tell(error: BaseException | None) -> None:
        if isinstance(error, Exception):
            window.report_exception(error)

    def of_slot(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        tell(error)
        hook(kind, error, trace)

    def of_thread(given: threading.ExceptHookArgs) -> None:
        tell(given.exc_value)
        thread_hook(given)

    sys.excepthook, threading.excepthook = of_slot, of_thread
    try:
        yield
    finally:
        sys.excepthook, threading.excepthook = hook, thread_hook
