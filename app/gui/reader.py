"""The newest view of a run, read in a thread of its own so that no source can freeze the window."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass

from app.gui.background import Act, Take
from app.gui.load import ProcessorLoad
from app.gui.source import Point, Setup, setup_of
from app.gui.view_state import NOTHING_DISPLAYED, ViewState, read, resolve
from app.runs.run_source import RunSource
from app.system.errors import in_full
from app.system.threads import start_thread

LOG = logging.getLogger(__name__)
CLOSES_S = 0.5  # for which a window that closes waits for the look under way


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What came of one look at the source: its view, or a sentence that says why there is none."""

    setup: Setup | None
    view: ViewState | None
    problem: str


class ViewReader:
    """Looks at one source on request, one look at a time; only the newest answer is kept. In the
    thread of the looks `prepare` is called with each view, and `answered` once it can be taken.

    The thread is a daemon: a source that never answers does not keep the program alive. It is one
    for all looks, for on a busy computer the window would wait for the start of each. It gives way
    to no other process: one that held the interpreter then would keep the window waiting.
    """

    def __init__(
        self,
        source: RunSource,
        answered: Act,
        prepare: Take,
    ) -> None:
        self.source, self._answered, self._prepare = source, answered, prepare
        self._requested = threading.Event()
        self._closed = False
        self.is_shown = True  # whether the window can be seen
        self.display = NOTHING_DISPLAYED  # what was seen in it
        self.point_px: Point | None = None  # that the operator chose in the picture
        self._requested_at: float | None = None
        self._answer: Answer | None = None
        self._lock = threading.Lock()
        self._thread = start_thread("window-reader", self._work)

    def request(self, *, anew: bool = False) -> None:
        """Request a look, unless one is under way, or `anew` after that; returns at once."""
        is_idle = self._requested_at is None
        if is_idle:
            self._requested_at = time.monotonic()
        if is_idle or anew:
            self._requested.set()

    def take(self) -> Answer | None:
        """The newest answer, once; None if there is no newer one. Returns at once."""
        with self._lock:
            answer, self._answer = self._answer, None
        return answer

    def silent_s(self) -> float:
        """How long the look under way has been waiting for the source."""
        requested_at = self._requested_at
        return 0.0 if requested_at is None else time.monotonic() - requested_at

    def close(self, patience_s: float = 0.0) -> None:
        """End the thread, and wait for a look under way for no longer than that."""
        self._closed = True
        self._requested.set()
        self._thread.join(patience_s)

    def _work(self) -> None:
        setup: Setup | None = None
        view: ViewState | None = None
        problem = ""
        load = ProcessorLoad()
        while True:
            self._requested.wait()
            self._requested.clear()
            if self._closed:
                return
            before, problem = problem, ""
            try:
                setup = setup or setup_of(self.source)
                seen = view.curves.seen if view else 0
                newest = read(
                    self.source,
                    seen,
                    is_shown=self.is_shown,
                    display=self.display,
                    cores=load.cores(),
                    point_px=self.point_px,
                )
                view = resolve(setup, newest, view)
                self._prepare(view)
            except Exception as error:  # it is shown, and the next look may succeed
                problem = (
                    f"The run could not be read ({in_full(error)}); it goes on, and STOP MOTION"
                    " still works."
                )
                if problem != before:  # once, not at every look
                    LOG.warning("the window could not read the run", exc_info=error)
            with self._lock:
                self._answer = Answer(setup, view, problem)
            self._requested_at = None
            self._answered()
