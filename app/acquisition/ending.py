"""How a run comes to its end: one named reason, and the actuator stopped before anything else is
done.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from app.experiment.decisions import ExperimentFailed
from app.records.record_types import End
from app.system.disk import DiskError
from app.system.errors import UserError, in_full
from app.system.threads import start_thread
from drivers.errors import DeviceError

LOG = logging.getLogger(__name__)
FOR_PEOPLE = DeviceError, ExperimentFailed, UserError, DiskError  # the message says it all


def sentence(who: str, error: BaseException) -> str:
    """The reason a run ends with: what was meant for people as it is, anything else with its
    kind.
    """
    if isinstance(error, FOR_PEOPLE):
        return str(error)
    return f"{who}: {in_full(error)}"


class Ending:
    """The end of a run, which any thread may call for at any time.

    Parameters
    ----------
    stop_actuator : callable
        Stops the motion; called in the thread that calls for the end, each time.

    Attributes
    ----------
    is_called : threading.Event
        Set once the run is to end.
    reason : str
        The first reason given; a failure while ending is put before it, one that follows a failure
        only where it is told in any case.
    end : End
        How the run ends.
    """

    def __init__(self, stop_actuator: Callable[[], None]) -> None:
        self.is_called = threading.Event()
        self.reason = ""
        self.end = End.STOPPED
        self._stop_actuator = stop_actuator
        self._lock = threading.Lock()
        self._closed = False

    @property
    def failed(self) -> bool:
        """Whether the run ends by a failure."""
        return self.end is End.FAILED

    def call(
        self, reason: str, *, failed: bool, is_complete: bool = False, in_any_case: bool = False
    ) -> None:
        """Name the end, then stop the actuator.

        A failure outranks an orderly end; otherwise the first reason stays. An orderly end is that
        of a run that has done all of it, or else somebody's.
        """
        end = End.FAILED if failed else End.COMPLETE if is_complete else End.STOPPED
        self._note(reason, end, in_any_case=in_any_case)
        try:
            self._stop_actuator()
        except BaseException as error:  # the run must end whatever the actuator says
            self._note(f"the actuator did not confirm its stop: {error}", End.FAILED)

    def attempt(self, who: str, step: Callable[[], None], *, in_any_case: bool = False) -> None:
        """Take one step of the ending; its failure, whatever it is, is noted and the next step can
        still be taken.

        Parameters
        ----------
        in_any_case : bool
            Whether its failure is told beside an earlier one, too.
        """
        try:
            step()
        except BaseException as error:  # a thread that is gone can name nothing
            self.fail(who, error, in_any_case=in_any_case)

    def fail(self, who: str, error: BaseException, *, in_any_case: bool = False) -> None:
        """Name an error as the end, with who has met it."""
        LOG.debug("%s: the end of the run is called for", who, exc_info=error)
        self.call(sentence(who, error), failed=True, in_any_case=in_any_case)

    def close(self) -> None:
        """The outcome is published: from now on nothing changes it."""
        with self._lock:
            self._closed = True

    def spawn(self, name: str, work: Callable[[], None]) -> threading.Thread:
        """A thread, started, whose exceptions end the run by name."""
        return start_thread(name, self.attempt, name, work)

    def _note(self, reason: str, end: End, *, in_any_case: bool = False) -> None:
        LOG.log(logging.ERROR if end is End.FAILED else logging.INFO, "%s", reason)
        with self._lock:
            if self._closed:
                return
            if not self.is_called.is_set():
                self.reason, self.end = reason, end
            elif end is End.FAILED and (in_any_case or not self.failed):
                if self.failed and reason not in self.reason:
                    self.reason = f"{self.reason}; {reason}"
                elif not self.failed:
                    self.reason, self.end = f"{reason} (while ending: {self.reason})", end
            self.is_called.set()
