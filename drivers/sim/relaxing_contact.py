"""The sheared contact of a block that relaxes: its state depends on the time of the drive.

The block is a standard linear solid (`analysis.mechanics.relaxation`), and the modulus of the
settings the relaxed one: the contact was pressed long ago, so that the normal force and the area
are constant and those of the elastic block, to which this contact comes back in a slow drive. A
fast one meets the modulus E/(1 - g). The law of the interface holds for the real slip. The stage
may be held and turn back.

The contact is solved on points of time `STEP_S` apart, and on the samples of commands to the stage.
Between them Q follows the stage with the stiffness of the contact, and what is left evenly.
"""

from __future__ import annotations

import bisect
import threading

import numpy as np

from analysis.arrays import F64, I64
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from drivers.sim.sheared import DriveInTime, Past, Rests, Sheared, SolvedContact, Turns

STEP_S = 0.02
MOST_STATES = 4096  # that are kept; those between two of them are solved again


class RelaxingContact:
    """Solved in the course of a run.

    Parameters
    ----------
    sphere : SphereContact
    compliance : float
        In series, m/N.
    rate : int
        Samples per second.
    start : int
        Sample from which on the contact is driven.
    """

    has_memory = True

    def __init__(self, sphere: SphereContact, compliance: float, rate: int, start: int) -> None:
        self.limit = sphere.limit
        self._loading, self._compliance = AxisymmetricLoading(sphere), compliance
        full = self._loading.at_force(self.limit * (1 - 1e-9))  # after as long as it takes
        self.onset = float(full.displacement(0.0)[0]) + compliance * self.limit
        self._rate, self._start, self._every = rate, start, max(1, round(STEP_S * rate))
        self._samples, self._states = [start], [self._loading.rest]
        self._ahead = (start, start, self._loading.rest)
        self._solving = threading.Lock()  # the board and the camera ask in threads of their own

    def shear_force(self, driven: F64, past: Past) -> F64:
        """See `Contact`."""
        if past.samples is None:
            return np.full(np.shape(driven), np.nan)
        samples, path = _asked(past)
        way = np.broadcast_to(driven, samples.shape)
        Q = np.zeros(samples.shape)
        i = int(np.searchsorted(samples, self._start, "right"))
        with self._solving:
            while i < len(samples):
                begin, before = self._before(int(samples[i]), path)
                end = self._next(begin, path)
                after = self._after(begin, before, end, path)
                some = slice(i, int(np.searchsorted(samples, end, "right")))
                k = after.stiffness / (1 + self._compliance * after.stiffness)
                here, there = (one.D + self._compliance * one.Q for one in (before, after))
                left = after.Q - before.Q - k * (there - here)
                share = (samples[some] - begin) / (end - begin)
                Q[some] = before.Q + k * (way[some] - here) + left * share
                i = some.stop
        return Q if np.ndim(driven) else Q[0]

    def sheared(self, driven: float, past: Past) -> Sheared:
        """See `Contact`."""
        samples, path = _asked(past)
        sample = int(samples[0])
        with self._solving:
            begin, state = self._before(sample, path)
            return SolvedContact(
                self._after(begin, state, sample, path) if sample > begin else state
            )

    def peak(self, turns: Turns, rests: Rests) -> float:
        """See `Contact`: a block that relaxes adds nothing to the friction."""
        return self.limit

    def _next(self, begin: int, path: DriveInTime) -> int:
        """The point of time after another one."""
        end = begin + self._every - (begin - self._start) % self._every
        command = path.command_after(begin)
        return end if command is None else min(end, command)

    def _before(self, sample: int, path: DriveInTime) -> tuple[int, LoadingState]:
        """The last point of time before a sample, and the state there."""
        at = max(bisect.bisect_left(self._samples, sample) - 1, 0)
        begin, state = self._samples[at], self._states[at]
        while (end := self._next(begin, path)) < sample:
            begin, state, at = end, self._after(begin, state, end, path), at + 1
            self._samples.insert(at, begin)
            self._states.insert(at, state)
        if len(self._samples) > MOST_STATES:
            del self._samples[1:-1:2], self._states[1:-1:2]
        return begin, state

    def _after(self, begin: int, state: LoadingState, end: int, path: DriveInTime) -> LoadingState:
        if self._ahead[:2] != (begin, end):
            found = self._loading.advance(
                state,
                path.driven_from(begin, end),
                compliance=self._compliance,
                duration=(end - begin) / self._rate,
            )
            self._ahead = (begin, end, found)
        return self._ahead[2]


def _asked(past: Past) -> tuple[I64, DriveInTime]:
    assert past.samples is not None
    assert past.path is not None
    return np.atleast_1d(past.samples), past.path
