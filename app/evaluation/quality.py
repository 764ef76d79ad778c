"""What is computed of each frame of a live run: what somebody asks for, and of that, with
``dic.quality = "auto"``, as much as the processor can do in time.
"""

from __future__ import annotations

import math
import time

from app.records.effort import EVERYTHING, Asker, Effort, Product, left_out
from app.settings.sections import Config

LATEST_S = 0.25  # longest time from the arrival of a frame to its result
YOUNG_S = LATEST_S / 2  # from which less is computed, and the most that waits for a slow analysis
BUSY, IDLE = 0.9, 0.5  # shares of the time between frames
CALM_S, MOST_CALM_S = 2.0, 30.0  # without a frame in a hurry, until more is computed again
RELAPSE_S = 5.0  # after which the calm must have lasted twice as long
SHOWN_S = 2.0  # a window that has not read for so long shows nothing

_LEFT_OUT = (  # at each step, the first of which leaves out redraws
    Product(0),
    Product(0),
    Product.EVERY_POINT,
    Product.EVERY_POINT | Product.PICTURE,
    Product.EVERY_POINT | Product.PICTURE | Product.SETTLED,
)
_RECORDED = {
    "fields": Product.CONTACT | Product.PICTURE | Product.SETTLED,
    "profiles": Product.CONTACT | Product.SETTLED,
    "forces": Product(0),
}
_SHOWN = Product(EVERYTHING)


def complete(config: Config) -> Effort:
    """The effort of a frame of which everything is computed that the settings name."""
    return Effort(int(_RECORDED["fields"] | _every_point(config)))


def _every_point(config: Config) -> Product:
    return Product.EVERY_POINT if config.stress.field else Product(0)


class Quality:
    """Decides the effort of each frame. The analysis asks and tells; the rest is for any thread.

    Parameters
    ----------
    config : Config
    pace : float or None
        Seconds of the board per second; None where frames wait for their analysis.

    Attributes
    ----------
    period_s : float
        Time between frames.
    shed : int
        How many steps are left out, see `Effort`.
    why : str
        What made it so many; empty for none.
    """

    def __init__(self, config: Config, pace: float | None) -> None:
        self.shed, self.why = 0, ""
        self._is_auto = pace is not None and config.dic.quality == "auto"
        self.period_s = 1 / (config.frame_rate_hz * (pace or 1.0))
        self._recorded = _RECORDED[config.recording.results]
        self._every_point = _every_point(config)
        self._shown_until = -math.inf
        self._steps = [n for n, left in enumerate(_LEFT_OUT) if self._matters(n, left)]
        self._calm_since = self._eased_at = self._changed_at = -math.inf
        self._calm_s = CALM_S
        self._load = 0.0  # of the newest frames, as a share of the time between frames

    def _matters(self, n: int, without: Product) -> bool:
        """Whether a step leaves out something that may be asked for."""
        news = without & ~_LEFT_OUT[n - 1] if n else without
        return n < 2 or bool(news & (Product.PICTURE | Product.SETTLED | self._every_point))

    @property
    def may_be_late(self) -> bool:
        """Whether a frame waits for its analysis although its result will be late."""
        return not self._is_auto

    def shows(self) -> None:
        """Note that a window shows fields and curves now."""
        self._shown_until = time.monotonic() + SHOWN_S

    def effort(self) -> Effort:
        """What is to be computed of the next frame."""
        is_shown = time.monotonic() < self._shown_until
        shown = _SHOWN & ~(Product.EVERY_POINT & ~self._every_point) if is_shown else Product(0)
        wanted = (self._recorded | shown) & ~_LEFT_OUT[self.shed]
        asked_by = (Asker.RECORD if self._recorded else 0) | (Asker.WINDOW if is_shown else 0)
        return Effort(int(wanted), int(asked_by), self.shed)

    def took(self, waited_s: float, took_s: float, skipped: int, now_s: float) -> str:
        """Note how long a frame waited and took, and how many were skipped before it; what is
        changed because of it, in words, or nothing.
        """
        if not self._is_auto:
            return ""
        self._load += 0.3 * (took_s / self.period_s - self._load)
        late_s = waited_s + took_s
        if late_s > YOUNG_S or skipped or self._load > BUSY:
            self._calm_since = now_s
            why = f"a frame had its result after {late_s:.2f} s"
            if skipped:
                why += f", {skipped} before it had none"
            is_settled = now_s - self._changed_at >= LATEST_S  # what waits has come before a change
            return self._change(+1, why, now_s) if is_settled else ""
        if self._load > IDLE:
            self._calm_since = now_s
        if now_s - self._calm_since >= self._calm_s:
            return self._change(-1, f"none was late for {self._calm_s:.0f} s", now_s)
        return ""

    def _change(self, by: int, why: str, now_s: float) -> str:
        place = self._steps.index(self.shed) + by
        if not 0 <= place < len(self._steps):
            return ""
        if by > 0:
            relapses = now_s - self._eased_at < RELAPSE_S
            self._calm_s = min(2 * self._calm_s, MOST_CALM_S) if relapses else CALM_S
        else:
            self._eased_at = now_s
        self._calm_since = self._changed_at = now_s
        self._load = IDLE
        self.shed = self._steps[place]
        self.why = why if self.shed else ""
        return f"left out: {left_out(self.shed)}; {why}"
