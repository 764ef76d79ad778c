"""The way from the window to a connected bench: nothing that a device does, or fails to do, holds
up the caller.
"""

from __future__ import annotations

import logging
import queue
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from app.records.bench_view import BenchPreview, BenchView, PictureView, StageTask
from app.settings.sections import Config
from app.system.errors import UnderLoad
from app.system.stopping import StopAnswer
from app.system.threads import start_thread

LOG = logging.getLogger(__name__)
SILENT_S = 3.0
Pair = tuple[float, float]  # of P and Q, or of their sensors


class LinkState(StrEnum):
    """How the window and the bench stand to one another."""

    OFF = "off"
    CONNECTING = "connecting"
    ON = "on"
    LEAVING = "leaving"


BUTTON = {
    LinkState.OFF: "Connect",
    LinkState.CONNECTING: "Cancel",
    LinkState.ON: "Disconnect",
    LinkState.LEAVING: "Connect",
}  # what the button that connects does


@dataclass(frozen=True, slots=True)
class BenchMessage:
    """A sentence for the operator."""

    sentence: str


@dataclass(frozen=True, slots=True)
class ZeroedForces:
    """What the sensors read without a force, volts, and what they had read in newtons."""

    volts: Pair
    before_n: Pair


@dataclass(frozen=True, slots=True)
class ZeroDoubt:
    """The sensors were not zeroed, because they read a force; why, for the operator to decide."""

    sentence: str


@dataclass(frozen=True, slots=True)
class CameraAdjusted:
    """What became of another exposure or gain.

    Attributes
    ----------
    is_live : bool
        Pictures are taken with it; if not, the bench has to be connected anew for that.
    problem : str
        Why the camera does not have it; then it is as it was.
    """

    is_live: bool
    exposure_s: float
    gain_db: float
    problem: str = ""


News = BenchMessage | ZeroedForces | ZeroDoubt | CameraAdjusted | StopAnswer


class SingleTask:
    """Does one thing at a time, in a thread of its own."""

    def __init__(self, name: str) -> None:
        self._name = f"bench-{name}"
        self._thread: threading.Thread | None = None
        self._since = 0.0

    def ask(self, step: Callable[[], None]) -> bool:
        """Begin to do it; False, and nothing is done, while the last one is under way."""
        if self._thread is not None and self._thread.is_alive():
            return False
        self._since = time.monotonic()
        self._thread = start_thread(self._name, step)
        return True

    @property
    def busy_s(self) -> float:
        """How long the thing under way has taken so far; 0 if there is none."""
        if self._thread is None or not self._thread.is_alive():
            return 0.0
        return time.monotonic() - self._since


class BenchLink:
    """A bench that is connected, looked at and disconnected on request; every method returns at
    once and is called from one thread.

    Parameters
    ----------
    connect : callable
        Connects the bench of some settings, which may take seconds.

    Attributes
    ----------
    phase : LinkState
    problem : str
        Why the bench is not connected; empty where that was asked.
    view : BenchView or None
        The newest one of this connection.
    picture : PictureView or None
    free_bytes : int
        Space where the session goes; -1 where that is not known.
    """

    def __init__(self, connect: Callable[[Config], BenchPreview]) -> None:
        self.phase, self.problem = LinkState.OFF, ""
        self.view: BenchView | None = None
        self.picture: PictureView | None = None
        self.free_bytes = -1
        self._connect = connect
        self._preview: BenchPreview | None = None
        # one for each time that a connection was asked for, also with the same settings
        self._wanted: tuple[Config] | None = None
        self._has: tuple[Config] | None = None
        self._news: queue.SimpleQueue[News] = queue.SimpleQueue()
        names = "life", "look", "jog", "move", "zero"
        self._life, self._look, self._jog, self._move, self._zero = map(SingleTask, names)

    @property
    def preview(self) -> BenchPreview | None:
        """The bench, while it is connected."""
        return self._preview

    @property
    def is_wanted(self) -> bool:
        """Whether a bench is to be connected, or to stay so."""
        return self._wanted is not None

    def news(self) -> list[News]:
        """What there is to tell since the last call."""
        found = []
        while not self._news.empty():
            found.append(self._news.get())
        return found

    # ------------------------------------------------------------------ connection

    def connect(self, config: Config) -> None:
        """Connect this bench; one that is connected is let go of first."""
        self._wanted, self.problem = (config,), ""
        self._life.ask(self._live)

    def disconnect(self, why: str = "") -> None:
        """Let go of the bench."""
        self._wanted, self.problem = None, why
        self._life.ask(self._live)

    def _live(self) -> None:
        """Bring the connection to what is wanted, also if that changes meanwhile."""
        while True:
            wanted = self._wanted
            if self._preview is not None and wanted is not self._has:
                self.phase = LinkState.LEAVING
                self._leave()
            elif wanted is not None and self._preview is None:
                self.phase = LinkState.CONNECTING
                try:
                    self._preview, self._has = self._connect(*wanted), wanted
                except Exception as error:
                    LOG.debug("the bench could not be connected", exc_info=error)
                    if self._wanted is wanted:
                        self._wanted, self.problem = None, _words(error)
            else:
                self.phase = LinkState.OFF if self._preview is None else LinkState.ON
                if self._wanted is wanted:
                    return

    def _leave(self) -> None:
        preview, self._preview, self._has = self._preview, None, None
        assert preview is not None
        try:
            if (answer := preview.close()) is not None:
                self._news.put(answer)
        except Exception as error:
            self._news.put(BenchMessage(str(error)))
        self.view = self.picture = None

    # ------------------------------------------------------------------ looking

    def look(self, folder: Path) -> None:
        """Take another look, unless one is under way."""
        if self._wanted is not self._has:  # it changed while the last change came to its end
            self._life.ask(self._live)
        preview = self._preview
        if preview is not None and self.phase is LinkState.ON:
            self._look.ask(lambda: self._take_look(preview, folder))
            if self.task in (StageTask.MOVE, StageTask.HOME):  # while somebody looks
                self._order(self._jog, lambda preview: preview.go_on())

    @property
    def task(self) -> StageTask | None:
        """What the stage is ordered to do."""
        stage = self.view.stage if self.view else None
        return stage.task if stage else None

    @property
    def is_silent(self) -> bool:
        """Whether the look under way has been waiting for long."""
        return self.phase is LinkState.ON and self._look.busy_s > SILENT_S

    def _take_look(self, preview: BenchPreview, folder: Path) -> None:
        known = self.picture.number if self.picture else -1
        try:
            view = preview.look(known)
        except TimeoutError as error:
            LOG.debug("no look", exc_info=error)
            return
        except Exception as error:
            if preview is self._preview:
                self.disconnect(str(error))
            return
        try:
            free = shutil.disk_usage(nearest(folder)).free
        except OSError:
            free = -1
        if preview is self._preview:
            self.view, self.free_bytes = view, free
            self.picture = view.picture or self.picture

    # ------------------------------------------------------------------ orders

    def hold(self, direction: int, velocity_m_s: float) -> None:
        """Let the stage move for a moment more."""
        self._order(self._jog, lambda preview: preview.jog(direction, velocity_m_s))

    def move(self, goal_m: float, velocity_m_s: float) -> None:
        """Begin to move the stage to a place; it goes on while the bench is looked at."""
        self._order(self._move, lambda preview: preview.move(goal_m, velocity_m_s))

    def home(self) -> None:
        """Begin to search the origin of the stage."""
        self._order(self._move, lambda preview: preview.home())

    def let_go(self) -> None:
        """Stop the stage; also while the last stop is still being confirmed."""
        self._order(SingleTask("stop"), lambda preview: self._news.put(preview.let_go()))

    def zero(self, *, under_load: bool = False) -> None:
        """Zero the sensors; a force that they read is told first, unless `under_load`."""
        forces = self.view.forces if self.view else None
        before = forces.newest if forces else (0.0, 0.0)

        def step(preview: BenchPreview) -> None:
            try:
                volts = preview.zero(under_load=under_load)
            except UnderLoad as doubt:
                self._news.put(ZeroDoubt(str(doubt)))
            else:
                self._news.put(ZeroedForces(volts, before))

        self._order(self._zero, step)

    def set_zero(self, volts: Pair) -> None:
        """Show the forces with these readings without a force."""
        self._order(SingleTask("set-zero"), lambda preview: preview.set_zero(volts))

    def adjust_camera(self, exposure_s: float, gain_db: float) -> None:
        """Take pictures with this exposure and gain."""

        def step(preview: BenchPreview) -> None:
            is_live, problem = True, ""
            try:
                is_live = preview.adjust_camera(exposure_s, gain_db)
            except Exception as error:
                problem = _words(error)
            self._news.put(CameraAdjusted(is_live, exposure_s, gain_db, problem))

        self._order(SingleTask("camera"), step)

    @property
    def is_sending(self) -> bool:
        """Whether an order to move the stage is on its way."""
        return self._move.busy_s > 0 or self._jog.busy_s > 0

    @property
    def is_zeroing(self) -> bool:
        """Whether the sensors are being zeroed."""
        return self._zero.busy_s > 0

    def _order(self, errand: SingleTask, step: Callable[[BenchPreview], None]) -> None:
        preview = self._preview
        if preview is None:
            return

        def work() -> None:
            try:
                step(preview)
            except Exception as error:
                self._news.put(BenchMessage(_words(error)))

        errand.ask(work)


def _words(error: Exception) -> str:
    return str(error) or type(error).__name__


def nearest(folder: Path) -> Path:
    """The folder, or the nearest one above it that is there."""
    folder = folder.absolute()
    return next((place for place in (folder, *folder.parents) if place.is_dir()), folder)
