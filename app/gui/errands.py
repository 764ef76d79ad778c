"""What threads do with a run for the window, so that no run can hold it up: make it, and give it
orders.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from app.runs.run_source import RunSource

LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class Making:
    """A source that a thread makes, and what became of it."""

    what: str
    is_live: bool  # it is a run, no replay
    source: RunSource | None = None
    problem: str = ""
    is_over: bool = False
    is_stopped: bool = False  # STOP was pressed meanwhile: it does not begin

    def begin(self, make: Callable[[], RunSource]) -> None:
        """Let a thread make it; returns at once."""

        def work() -> None:
            try:
                self.source = make()
            except Exception as error:
                LOG.warning("%s could not be made", self.what, exc_info=error)
                self.problem = f"{self.what} could not be made: {error}"
            self.is_over = True

        threading.Thread(target=work, name="slipscope-window-maker", daemon=True).start()


def give_order(
    source: RunSource,
    act: Callable[[RunSource], None],
    failed: str,
    say: Callable[[str], object],
) -> None:
    """Let a thread `act` on a source; returns at once. `say`, called in that thread, is told that
    it has `failed`, and why.
    """

    def work() -> None:
        try:
            act(source)
        except Exception as error:
            LOG.error("%s", failed, exc_info=error)
            say(f"{failed}: {error}")

    threading.Thread(target=work, name="slipscope-window-order", daemon=True).start()


def unexpected(what: str) -> str:
    """The sentence for an error that nobody has expected."""
    return (
        f"Something in the program went wrong ({what}): what was asked last may not have been"
        " done. STOP MOTION still works, a run goes on, and the log has the details."
    )
