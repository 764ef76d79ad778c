"""What is drawn at a redraw: the picture each time, all else in turn, and nothing too seldom."""

import time
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from app.gui.redraw_scheduler import RedrawScheduler
from app.records.record_types import Phase

STEP_S, REDRAWS = 0.1, 60
OLDEST_S = 1.0 - STEP_S  # so that what is read a redraw before it is drawn is no older than 1 s


class Drawn:
    """Notes when it is drawn."""

    def __init__(self, clock: list[float]) -> None:
        self.at: list[float] = []
        self._clock = clock

    def isVisible(self) -> bool:
        return True

    def show_view(self, _: Any) -> None:
        self.at.append(self._clock[0])


@pytest.mark.parametrize("count", [1, 4, 12])
def test_the_picture_is_drawn_each_time_and_all_else_often_enough(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    picture, numbers, *others = (Drawn(clock) for _ in range(count + 2))
    scheduler = RedrawScheduler(picture, numbers.show_view, lambda: others)
    view: Any = SimpleNamespace(
        goes_on=True, badge="RUNNING", phase=Phase.DRIVE, steps=SimpleNamespace(question="")
    )
    for _ in range(REDRAWS):
        for draw in scheduler.of(view):
            draw(view)
        clock[0] += STEP_S
    assert len(picture.at) == REDRAWS
    for one in (numbers, *others):
        gaps = [after - before for before, after in pairwise(one.at)]
        assert min(gaps[1:]) > 0.4  # at first all are drawn
        assert max(gaps) < OLDEST_S
