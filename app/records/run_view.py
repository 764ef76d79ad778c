"""What a run, live or recorded, shows at one moment: asked for by the window and the terminal, and
made in the process that has the run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64, I64, Array
from app.records.bench_view import Health
from app.records.record_types import ContactResult, Outcome, Snapshot
from app.system.stopping import StopAnswer

FORCE_POINTS = 2000  # more than a screen has columns
Forces = tuple[I64, F64, F64]
NO_FORCES: Forces = (np.empty(0, np.int64), np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True, eq=False)
class RunView:
    """A run at a glance, which can be pickled.

    Attributes
    ----------
    health : Health
    outcome : Outcome or None
        How it ended; all that is read beside it is complete. None until then.
    stop : StopAnswer or None
        What is known of the newest stop, whoever called for it; None where none was sent.
    snapshots : tuple of Snapshot
        Those that the caller does not know, in order; only the newest holds all its parts.
    contact : ContactResult or None
        The apparent contact on the reference frame; None before the reference.
    forces : tuple of ndarray
        Sample numbers, P and Q (newtons) of the whole run, thinned to about `FORCE_POINTS`.
    image : ndarray or None
        The newest image, shape (rows, cols), not to be written to; the same object until there is
        a newer one. It holds until the next but one.
    reference : ndarray or None
        The image from which displacements are measured, the same object from then on; None before
        it was taken.
    """

    health: Health
    outcome: Outcome | None = None
    stop: StopAnswer | None = None
    snapshots: tuple[Snapshot, ...] = ()
    contact: ContactResult | None = None
    forces: Forces = NO_FORCES
    image: Array | None = None
    reference: Array | None = None
