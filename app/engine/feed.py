"""What the bench measured, given to a history in blocks as a live run gives it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.forces import SensorChain
from app.engine.history import History
from app.records import Phase


class Feed:
    """Gives a history the readings of an experiment, a block for each position of the stage, in
    their order.

    Parameters
    ----------
    volts : ndarray, shape (n, 2)
        Readings from sample 0 on.
    positions : iterable of (int, float)
        Sample at which a block ends, and position of the stage in metres then.
    phases : iterable of (int, Phase)
        Sample on which each phase began.
    """

    def __init__(
        self,
        history: History,
        chain: SensorChain,
        volts: NDArray[np.float64],
        positions: Iterable[tuple[int, float]],
        phases: Iterable[tuple[int, Phase]],
    ) -> None:
        self._history, self._chain, self._volts = history, chain, volts
        self._positions, self._phases = list(positions), list(phases)

    def up_to(self, sample: int) -> None:
        """Feed everything that was known when the exposure starting at `sample` had ended."""
        history = self._history
        while history.end < sample + history.exposure_samples and self._positions:
            while self._phases and self._phases[0][0] <= history.end:
                began, phase = self._phases.pop(0)
                history.begin(phase, began)
            end, metres = self._positions.pop(0)
            begin = history.end
            history.append(begin, self._chain.forces(self._volts[begin:end]), metres, end)
