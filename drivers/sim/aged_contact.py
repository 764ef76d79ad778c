"""Static friction that grows while a contact that slid is held, and the peak of Q with which it
slides again.

The micro-contacts creep and grow, so that after a hold of duration t the contact holds more than
it slid with, by ``mu beta ln(1 + t/t0)``, and forgets it while it slides a length D_c (Dieterich
1979; Baumberger and Caroli 2006, section 5). Here the whole contact ages alike: the traction, and
with it Q, is that of the contact without ageing times 1 + f(s), where s is the slip of its centre
since the hold,

    f(s) = beta ln(1 + t/t0) h(s) + f0 exp(-s/D_c),  h(s) = (1 - exp(-s/(mu L))) exp(-s/D_c)

with h over its greatest value, so that the peak is what the law says, and f0 what was left of an
earlier hold. A hold before the contact slides ages nothing, and a stage that turns back meets a
contact without ageing.

References
----------
Dieterich 1979, J. Geophys. Res. 84; Baumberger and Caroli 2006, Adv. Phys. 55.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64, floats

POINTS, LENGTHS = 4000, 16.0  # of the table of f, which reaches that many lengths of decay
STEADY = 0.05  # least slope of the stage over the slip: below, the contact all but jumps


class Rest(NamedTuple):
    """A hold: where the contact was driven by then (m), and for how long (s)."""

    driven: float
    hold_s: float


@dataclass(frozen=True, slots=True)
class Law:
    """How a contact ages: beta, t0 (s), D_c (m), and mu L (m), over which it yields."""

    rate: float
    time_s: float
    slip: float
    soft: float

    def share(self, hold_s: float) -> float:
        """How much more it holds after a hold, as a share of mu."""
        return float(self.rate * np.log1p(hold_s / self.time_s))


class Aged:
    """The contact from a hold on.

    Parameters
    ----------
    law : Law
    hold_s : float
    base : float
        Driven distance (m) at which the contact without ageing is where this one is held.
    left : float
        f there, of an earlier hold.
    stretch : float
        How much further the stage has to go (m) for a traction that is greater by its whole:
        elastic displacement of the centre, cantilever and lens holder.
    way : float
        1.0 or -1.0.

    Raises
    ------
    ValueError
        The friction falls faster than the bench unloads: it would jump.
    """

    def __init__(
        self, law: Law, hold_s: float, base: float, left: float, stretch: float, way: float
    ) -> None:
        reach = LENGTHS * max(law.slip, law.soft)
        slip = reach * np.linspace(0.0, 1.0, POINTS) ** 2
        decay = np.exp(-slip / law.slip)
        rise = -np.expm1(-slip / law.soft) * decay
        self._slip = slip
        self._extra = law.share(hold_s) * rise / rise.max() + left * decay
        self._along = slip + stretch * self._extra
        self._base, self._way = base, way
        slope = np.diff(self._along) / np.diff(slip)
        if slope.min() < STEADY:
            raise ValueError(
                f"sim.ageing: after a hold of {hold_s:.4g} s friction would fall by"
                f" {law.share(hold_s):.3g} of mu over {law.slip * 1e6:.3g} um, faster than the"
                " bench unloads, and the contact would jump (stick-slip), which is not modelled;"
                f" hold for less long, or give a longer sim.ageing_slip ({stretch * 1e6:.3g} um of"
                " the stage carry the whole friction)"
            )

    @property
    def peak(self) -> float:
        """Greatest f."""
        return float(self._extra.max())

    def at(self, driven: F64) -> tuple[F64, F64]:
        """Where the contact without ageing is when this one is driven so far, and f."""
        along = self._way * (floats(driven) - self._base)
        slip = np.interp(along, self._along, self._slip)
        beyond = np.maximum(along - self._along[-1], 0.0)
        extra = np.interp(along, self._along, self._extra)
        return self._base + self._way * (slip + beyond), extra
