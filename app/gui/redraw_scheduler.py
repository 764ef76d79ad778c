"""What of a view is drawn at a redraw: the picture each time, all else in turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from app.gui.view_state import ViewState
from app.gui.window_model import RunDisplay
from app.records.record_types import Phase

FRESH_S = 0.5  # numbers are read twice a second, and drawn as often
TURN_S = 0.75  # in which all others are drawn; none of their words is older than 1 s

Draw = Callable[[ViewState], None]


class RedrawScheduler:
    """Deals out the work of redraws.

    Parameters
    ----------
    picture : RunDisplay
        Drawn each time.
    numbers : callable
        Draws all numbers, which must be of one instant: side by side they are compared.
    others : callable
        Gives what is drawn one after the other, where it can be seen.
    """

    def __init__(
        self, picture: RunDisplay, numbers: Draw, others: Callable[[], Iterable[RunDisplay]]
    ) -> None:
        self._picture, self._numbers, self._others = picture, numbers, others
        self._turn, self._turned = 0, 0.0  # the next of the others, when they had theirs
        self._due = 0.0  # how many of them are to be drawn, in part
        self._counted_at = 0.0  # when the numbers had theirs
        self._shown_state = ("", "", "")

    def of(self, view: ViewState) -> list[Draw]:
        """What is drawn of a view. Numbers follow at once where a load is pressed by hand, and
        where another step begins.
        """
        others, now = self.others(), time.monotonic()
        self._due += len(others) * (now - self._turned) / TURN_S
        self._turned, count = now, int(self._due)
        self._due %= 1
        if view.goes_on and count < len(others):
            start = self._turn % len(others)
            self._turn = start + count
            others = (2 * others)[start : start + count]
        state = (view.badge, view.phase, view.steps.question)
        is_pressed = view.phase == Phase.CONTACT
        is_due = is_pressed or state != self._shown_state or now - self._counted_at >= FRESH_S
        if is_due or not view.goes_on:
            self._counted_at, self._shown_state = now, state
            others.insert(0, self._numbers)
        return [self._picture.show_view, *others]

    def others(self) -> list[Draw]:
        """What draws the parts in view other than picture and numbers."""
        return [one.show_view for one in self._others() if one.isVisible()]
