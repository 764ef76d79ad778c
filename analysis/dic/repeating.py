"""Boxes whose pattern repeats itself, so that their displacement is known up to whole periods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64, Bool
from analysis.dic.neighbours import filled
from analysis.dic.status import AMBIGUOUS
from analysis.dic.tracker import Estimate

TRUSTED = 0.25  # of a period; a point that has moved further may have moved the other way


@dataclass(frozen=True, slots=True)
class Repetition:
    """Which points of a reference have a pattern that repeats itself.

    Attributes
    ----------
    points : ndarray of bool, shape (ny, nx)
    period_px : float
        Shortest distance at which it does, px.
    """

    points: Bool
    period_px: float

    def expected(self, found: F64, sure: Bool, before: F64) -> F64:
        """The displacement (2, ny, nx) before, and what it has changed since where a search says so
        and the pattern does not repeat itself; elsewhere the change of the points around.
        """
        return before + filled(found - before, sure & ~self.points)

    def judged(
        self, found: Estimate, before: F64, again: Callable[[F64, Bool], Estimate]
    ) -> Estimate:
        """The estimate with those of the points that are further than a quarter of a period from
        where they are expected measured once more, by ``again(start, points)``, from there, and
        AMBIGUOUS where they are not found there: their peak may be that of another period.
        """
        expected = self.expected(found.u, found.is_ok, before)
        if (far := self._is_far(found, expected)).any():
            found = found.replaced(again(np.where(far, expected, before), far), far)
            found.status[self._is_far(found, expected)] = AMBIGUOUS
        return found

    def _is_far(self, found: Estimate, expected: F64) -> Bool:
        distance = np.hypot(*(found.u - expected))
        return np.asarray(self.points & found.is_ok & (distance > TRUSTED * self.period_px))

    def __str__(self) -> str:
        """What an operator should know of it."""
        return (
            f"picture: the pattern of the reference repeats itself every {self.period_px:.3g} px in"
            f" {self.points.mean():.0%} of the boxes, whose displacement is known up to whole"
            " periods: it is taken to change from image to image as that of the boxes around, or"
            " else by less than a quarter of a period, and is lost (ambiguous) where it does not;"
            " use a random pattern, or take images more often"
        )


def remarks_of(repetition: Repetition | None) -> tuple[str, ...]:
    """The sentences of a tracker about it."""
    return (str(repetition),) if repetition else ()
