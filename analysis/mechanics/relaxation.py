"""A block whose modulus relaxes as that of a standard linear solid, in contacts of constant area.

The modulus under a constant strain falls from E/(1 - g) to E as ``E (1 + g/(1 - g) exp(-t/tau))``.
Where the area of the contact does not change, the equations of the elastic block hold with the
modulus replaced by this operator (Lee and Radok's correspondence): at each moment the surface is
displaced as an elastic block of the modulus E would be by the traction

    (1 - g) sigma + g m,    dm/dt = (sigma - m) (1 - g)/tau

so that m, the lagged traction, is sigma behind a low-pass. Between two times the traction is taken
as linear, for which the step is exact: its error falls with the square of the step. Poisson's ratio
stays, and so does the material under the contact: a block that moves by its contact radius within
tau is another problem.

References
----------
Lee and Radok 1960, J. Appl. Mech. 27; Johnson 1985, Contact Mechanics, section 6.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats


def lag_weights(x: ArrayLike) -> tuple[F64, F64, F64]:
    """Weights, in what a low-pass of first order gives after x > 0 of its time constants, of what
    it gave before and of its input before and after, which is linear between; any shape.
    """
    passed = floats(x)
    kept, mean = np.exp(-passed), -np.expm1(-passed) / passed
    return kept, mean - kept, 1 - mean


@dataclass(frozen=True)
class Relaxation:
    """The share g of the modulus at once that relaxes, and the time tau (s) in which it does so.

    Raises
    ------
    ValueError
        The share is not from 0 to below 1, or the time not positive.
    """

    share: float = 0.0
    time: float = 1.0

    def __post_init__(self) -> None:
        if not (0 <= self.share < 1 and 0 < self.time < math.inf):
            raise ValueError(
                f"relaxation: a share of {self.share:g} of the modulus in {self.time:g} s found;"
                " give a share from 0 to below 1 and a positive time"
            )

    def lag(self, duration: float) -> tuple[float, float, float]:
        """Weights of m before, and of the traction before and after, in m after `duration` (s)."""
        x = duration * (1 - self.share) / self.time
        if x == 0 or math.isinf(x):
            return (1.0, 0.0, 0.0) if x == 0 else (0.0, 0.0, 1.0)
        kept, old, new = lag_weights(x)
        return float(kept), float(old), float(new)

    def step(self, lagged: F64, sigma: F64, duration: float) -> tuple[F64, float]:
        """The part of the traction that displaces the surface after a step which is due to the
        traction `sigma` (Pa) and m = `lagged` before it, and the share of the traction after it.
        """
        kept, old, new = self.lag(duration)
        left = self.share * (kept * lagged + old * sigma)
        return np.asarray(left), 1 - self.share + self.share * new

    def lagged(self, lagged: F64, sigma: F64, after: F64, duration: float) -> F64:
        """The traction m after a step, at whose end the traction is `after`."""
        kept, old, new = self.lag(duration)
        return np.asarray(kept * lagged + old * sigma + new * after)


ELASTIC = Relaxation()


class RelaxationCorrection:
    """The traction of a stream of fields from what it would be on an elastic block of the relaxed
    modulus, of any shape that stays. The stream begins at rest.

    Parameters
    ----------
    relaxation : Relaxation
    start : float
        When the block was at rest, seconds.

    Attributes
    ----------
    gain : float
        By how much the noise of the last field is larger in its traction.

    Examples
    --------
    >>> import math
    >>> from analysis.mechanics.relaxation import Relaxation, RelaxationCorrection
    >>> block = RelaxationCorrection(Relaxation(0.5, 1.0))  # of a traction of 1 Pa from 1e-9 s on
    >>> seen = [(t, 1 - 0.5 * math.exp(-0.5 * t)) for t in (1e-9, 0.5, 1.0)]
    >>> [round(float(block.at(t, u)), 6) for t, u in seen]
    [1.0, 1.0, 1.0]
    """

    def __init__(self, relaxation: Relaxation, start: float = 0.0) -> None:
        self._relaxation, self._time = relaxation, start
        self._lagged = self._sigma = np.zeros(())
        self.gain = 1.0

    def at(self, time: float, seen: ArrayLike) -> F64:
        """The traction (Pa) at a time (s) from what an elastic block would show, not before the
        last one.
        """
        passed = time - self._time
        left, share = self._relaxation.step(self._lagged, self._sigma, passed)
        sigma = np.asarray((floats(seen) - left) / share)
        self._lagged = self._relaxation.lagged(self._lagged, self._sigma, sigma, passed)
        self._sigma, self._time, self.gain = sigma, time, 1 / share
        return sigma
