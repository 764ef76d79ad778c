"""A bench that is connected and looked at without a run, in a process of its own: a device that
hurts its process hurts no window, and every device is free once the process has ended.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from typing import Any, TypeVar

from app.acquisition.connected_bench import Preview
from app.acquisition.force_reader import BenchDevices
from app.processes.calls import Methods, asked_at
from app.processes.serving import ServedBench, serve
from app.processes.starting import Launch
from app.processes.supervision import SupervisedBench
from app.runs import live
from app.system.stopping import StopAnswer
from drivers.errors import DeviceError, DeviceFault

LOG = logging.getLogger(__name__)
Answer = TypeVar("Answer", bound=StopAnswer | None)


class ServedPreview(ServedBench):
    """A connected bench."""

    lingers_s = 2.0

    def __init__(self, launch: Launch) -> None:
        super().__init__(launch)
        self._limits = launch.order.limits
        self._supervised: SupervisedBench | None = None
        self._stopped_at = -math.inf  # when the newest stop came
        self.preview = live.make_preview(launch.order, guard=self._guard)

    def start(self) -> None:
        """Begin to connect."""
        self.preview.start()

    def methods(self) -> Methods:
        """What one connection may call."""
        preview = self.preview
        return {
            "look": preview.look,
            "jog": self._unless_stopped(preview.jog),
            "move": self._unless_stopped(preview.move),
            "home": self._unless_stopped(preview.home),
            "go_on": preview.go_on,
            "let_go": self._stops(preview.let_go),
            "stop_motion": self._stops(preview.stop_motion),
            "stop_answer": preview.stop_answer,
            "zero": lambda under_load: preview.zero(under_load=under_load),
            "set_zero": preview.set_zero,
            "adjust_camera": preview.adjust_camera,
            "close": self._stops(self.close),
        }

    def _stops(self, stop: Callable[[], Answer]) -> Callable[[], Answer]:
        def stopped() -> Answer:
            self._stopped_at = time.monotonic()
            return stop()

        return stopped

    def _unless_stopped(self, move: Callable[..., None]) -> Callable[..., None]:
        """What moves the stage, unless a stop has overtaken the order."""

        def moved(*arguments: Any) -> None:
            if asked_at() > self._stopped_at:
                move(*arguments)
            if asked_at() <= self._stopped_at:
                if self.preview.motion()[2]:  # the stop came between the lines above
                    self.preview.stop_motion()
                raise DeviceFault("a stop came after this order, which is not carried out")

        return moved

    def stop(self, reason: str) -> None:
        """Let go of the devices."""
        self.close()

    def close(self) -> StopAnswer | None:
        """Let go of the devices; the process ends after that. What became of the newest stop."""
        try:
            self.preview.close()
        except DeviceError as error:
            LOG.warning("%s", error)  # the end of the process frees them
        finally:
            # a stage that could not be stopped is the supervisor's once this process has ended
            if self._supervised is not None and not self.preview.motion()[2]:
                self._supervised.end_watch()
            self.has_ended.set()
        return self.preview.stop_answer()

    def _guard(self, bench: BenchDevices, preview: Preview) -> None:
        """Have the stage stopped from outside should this process fail, as in a run."""
        supervised = self.supervised(bench, self._limits, preview.motion)
        supervised.begin_watch()
        self._supervised = supervised


def main() -> None:
    """Serve a connected bench."""
    serve(ServedPreview)
