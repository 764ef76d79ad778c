"""How far the holder of the lens gives way to the shear force, from what is seen of the lens
itself: marks on its glass that the camera sees, or a gauge at its holder.

The block cannot tell it: within the contact it follows the lens by all of the compliance, and slips
on it by an amount that grows with Q as well. Metres per newton.

References
----------
Prevost et al. 2013, section 3 (0.68 um/N).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.calibration.serial_fit import finite_readings, serial_fit
from analysis.calibration.stage_motion import way_of_legs

SURE = 5.0  # standard deviations from which a departure is real
MOST_DEPARTURE = 0.05  # of the motion: of a loop, or of a bend
MOST_ALIKE = 0.98  # correlation of Q and time, beyond which a drift is no other than a compliance
LEAST_RANGE_N = 0.02


@dataclass(frozen=True, slots=True)
class HolderCompliance:
    """Motion of the lens: per shear force (m/N), in time (m/s), and per unit of a further channel
    (m, 0 where there is none), each with its standard uncertainty; what is left (m, rms).
    """

    value_m_n: float
    sd_m_n: float
    drift_m_s: float
    drift_sd_m_s: float
    per_unit_m: float
    per_unit_sd_m: float
    rms_m: float


def holder_compliance(
    time_s: ArrayLike, Q: ArrayLike, moved_m: ArrayLike, further: ArrayLike | None = None
) -> HolderCompliance:
    """Compliance of the holder of the lens, and its drift.

    Parameters
    ----------
    time_s, Q, moved_m : array_like, shape (n,)
        Readings of the shear force in newtons, and how far the lens has moved along it, metres; NaN
        where missing. Q should go up and down, or rest, which separates a drift from it.
    further : array_like, shape (n,), optional
        A further channel that may move the lens, such as a temperature in its own unit.

    Raises
    ------
    ValueError
        Too few readings, too small a range of Q, a drift that cannot be separated from Q; a lens
        that moves against Q, not in proportion to it, or that does not come back.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> time = np.arange(100.0)
    >>> Q = 0.5 * np.sin(time / 10) + 0.5
    >>> found = analysis.compliance.holder_compliance(time, Q, 0.68e-6 * Q + 1e-9 * time)
    >>> round(found.value_m_n * 1e6, 3), round(found.drift_m_s * 1e9, 3)
    (0.68, 1.0)
    """
    nothing = np.zeros(np.shape(time_s))
    t, force, moved, other = finite_readings(
        "compliance", time_s, Q, moved_m, nothing if further is None else further
    )
    spans = [float(np.ptp(one)) for one in (t, force, other)]
    if not spans[0] > 0:
        raise ValueError("compliance: the times are all the same; give those of the readings")
    if spans[1] < LEAST_RANGE_N:
        raise ValueError(
            f"compliance: Q changes by {spans[1]:.2g} N; {LEAST_RANGE_N:g} N or more are needed:"
            " load the contact in shear"
        )
    place, share, wander = (
        (one - one.mean()) / (span or 1.0)
        for one, span in zip((t, force, other), spans, strict=True)
    )
    alike = abs(float(np.corrcoef(t, force)[0, 1]))
    if alike > MOST_ALIKE:
        raise ValueError(
            f"compliance: Q rises with time alone (correlation {alike:.3f}), so that a drift looks"
            " like a compliance; let Q come back, or rest before and after"
        )
    columns = [np.ones_like(t), share, place]
    if spans[2] > 0:
        columns.append(wander)
    departures = {"a loop": way_of_legs(force)[0] / 2, "a bend": 4 * share**2}
    more = serial_fit("compliance", np.column_stack([*columns, *departures.values()]), moved)
    whole = abs(float(more.values[1]))
    for what, value, sd in zip(departures, more.values[-2:], more.sds[-2:], strict=True):
        if abs(value) > max(MOST_DEPARTURE * whole, SURE * sd):
            raise ValueError(
                f"compliance: the motion of the lens has {what} of {abs(value) * 1e9:.3g} nm beside"
                f" {whole * 1e9:.3g} nm in proportion to Q; look for a screw that is loose, or"
                " marks that are on the block"
            )
    fit = serial_fit("compliance", np.column_stack(columns), moved)
    value, sd = fit.of(1, spans[1])
    if value < -SURE * sd:
        raise ValueError(
            f"compliance: the lens moves by {value * 1e6:.3g} um/N, against Q; check the sign of Q"
            " and of the drive in the picture"
        )
    per_unit = fit.of(3, spans[2]) if spans[2] > 0 else (0.0, math.nan)
    return HolderCompliance(value, sd, *fit.of(2, spans[0]), *per_unit, fit.rms)
