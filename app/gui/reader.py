"""The newest view of a run, read in a thread of its own: nothing a source does can freeze the
window.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

from app.gui.source import RunSource
from app.gui.view_state import Scene, ViewState, read, resolve, scene_of


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What came of one look at the source: the scene and its view, or a sentence that says why
    there is none.
    """

    scene: Scene | None
    view: ViewState | None
    problem: str


class Reader:
    """Looks at one source when asked, one look at a time; only the newest answer is kept.

    The thread is a daemon: a source that never answers can not keep the program alive.
    """

    def __init__(self, source: RunSource) -> None:
        self.source = source
        self._asked = threading.Event()
        self._closed = False
        self._asked_at: float | None = None
        self._answer: Answer | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(
            target=self._work, name="slipscope-window-reader", daemon=True
        )
        self._thread.start()

    def ask(self) -> None:
        """Ask for a look; does nothing while one is under way. Returns at once."""
        if self._asked_at is None:
            self._asked_at = time.monotonic()
            self._asked.set()

    def take(self) -> Answer | None:
        """The newest answer, once; None if there is no newer one. Returns at once."""
        with self._lock:
            answer, self._answer = self._answer, None
        return answer

    def silent_s(self) -> float:
        """How long the present look has been waiting for the source."""
        asked_at = self._asked_at
        return 0.0 if asked_at is None else time.monotonic() - asked_at

    def close(self) -> None:
        """End the thread; waits a moment for a look under way, never for long."""
        self._closed = True
        self._asked.set()
        self._thread.join(0.5)

    def _work(self) -> None:
        scene: Scene | None = None
        view: ViewState | None = None
        while True:
            self._asked.wait()
            self._asked.clear()
            if self._closed:
                return
            problem = ""
            try:
                scene = scene or scene_of(self.source)
                view = resolve(scene, read(self.source, view.curves.seen if view else 0), view)
            except (
                Exception
            ) as error:  # whatever the source raises is shown, and the next look may succeed
                problem = (
                    f"The run could not be read ({type(error).__name__}: {error}); it goes on, and"
                    " STOP MOTION still works."
                )
            with self._lock:
                self._answer = Answer(scene, view, problem)
            self._asked_at = None
