"""Young's modulus from the balance of the inverted stress with the shear force over a run (paper,
section 4 and Fig. 9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import in_step
from analysis.robust import robust_sd, serial_correlation, serial_sum

MIN_FRAMES = 8
OUTLYING = 4.0  # robust standard deviations
LEAST_RANGE = 5.0  # least range of Q, in sds of a frame's balance
ROUNDS = 20


@dataclass(frozen=True, slots=True)
class Modulus:
    """Young's modulus from a run. NaN where it cannot be determined; `notes` then gives the
    reason.

    Attributes
    ----------
    E, E_sd : float
        Pascals; the uncertainty holds the scatter of the frames and what the caller states of the
        inversion.
    slope : float
        Slope of Q against the integral of the stress for the modulus supposed: E = slope
        E_supposed.
    offset : float
        Q where the integral is 0: the error of the force sensor's zero, newtons.
    frames, outliers : int
        Number of frames in the balance, and left out of it.
    notes : tuple of str
    """

    E: float = np.nan
    E_sd: float = np.nan
    slope: float = np.nan
    offset: float = np.nan
    frames: int = 0
    outliers: int = 0
    notes: tuple[str, ...] = ()


def balance_modulus(
    integral: ArrayLike,
    integral_sd: ArrayLike,
    Q: ArrayLike,
    E_supposed: float,
    *,
    Q_sd: float = 1e-3,
) -> Modulus:
    """Young's modulus at which the stress sums up to the shear force: the stress from an inversion
    is proportional to the modulus that it supposes.

    Parameters
    ----------
    integral, integral_sd : array_like, shape (nt,)
        Integral of the stress over the contact in each frame (N), inverted with `E_supposed`, and
        its standard uncertainty.
    Q : array_like, shape (nt,)
        Shear force (N), counted from the frame of reference of the displacements. Frames with a NaN
        are ignored.
    E_supposed : float
        Pascals.
    Q_sd : float
        Noise of the force, newtons.

    Notes
    -----
    A line through both, with errors in both (York 1966), outlying frames left out. Errors that
    all frames share and no force changes, such as the noise of the reference image and the force
    sensor's zero, are in the offset. The uncertainty allows for errors that successive frames
    share; the budget of a run has those by pixel size, thickness and other inputs.

    References
    ----------
    Prevost et al. 2013, section 4, Fig. 9.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> Q = np.linspace(0.02, 0.4, 20)
    >>> found = analysis.balance_modulus(1.1 * Q, 1e-3, Q, 3.3e6)
    >>> round(found.E * 1e-6, 3)  # the stress summed up to a tenth too much
    3.0
    """
    if not (E_supposed > 0 and Q_sd > 0):
        raise ValueError(
            f"modulus: E {E_supposed:g} Pa and a noise of {Q_sd:g} N found; use positive ones"
        )
    columns = in_step("modulus", integral=integral, integral_sd=integral_sd, Q=Q)
    x, sx, y = map(np.ravel, columns)
    good = np.isfinite(x) & np.isfinite(sx) & np.isfinite(y)
    x, sx, y = x[good], sx[good], y[good]
    if len(x) < MIN_FRAMES:
        why = f"{len(x)} frames have a stress and a force; {MIN_FRAMES} or more are needed"
        return Modulus(frames=len(x), notes=(f"modulus: {why}",))
    slope, offset = np.polyfit(x, y, 1) if np.ptp(x) > 0 else (0.0, 0.0)
    keep = np.ones(len(x), np.bool_)
    for _ in range(ROUNDS):
        weight = keep / (Q_sd**2 + (slope * sx) ** 2)
        middle, level = weight @ x / weight.sum(), weight @ y / weight.sum()
        dx, dy = x - middle, y - level
        # the best place of each frame on the line, so that noise of the integral does not flatten
        # it (York 1966)
        pull = weight * (weight * (Q_sd**2 * dx + slope * sx**2 * dy))
        slope = float(pull @ dy / (pull @ dx)) if np.any(pull * dx) else 0.0
        offset = float(level - slope * middle)
        residual = (y - offset - slope * x) / np.sqrt(Q_sd**2 + (slope * sx) ** 2)
        scale = max(1.0, robust_sd(residual))
        kept, keep = keep, np.abs(residual) < OUTLYING * scale
    spread = float(weight @ (dx * dx))
    frame_sd = float(np.sqrt(len(x) / weight.sum())) * scale
    frames, outliers = int(keep.sum()), int((~keep).sum())
    why = ""
    if not np.ptp(y[keep]) > LEAST_RANGE * frame_sd:
        why = f"Q varies by {np.ptp(y):.2g} N, frames scatter by {frame_sd:.2g} N; drive further"
    elif not slope > 0:
        why = f"stress and force have opposite signs (slope {slope:.3g}); check the sign of Q"
    if why:
        return Modulus(frames=frames, outliers=outliers, notes=(f"modulus: {why}",))
    correlation = serial_correlation(residual[keep], 2)
    slope_sd = scale * np.sqrt(serial_sum((np.sqrt(weight) * dx)[keep], correlation)) / spread
    E = slope * E_supposed
    notes: tuple[str, ...] = ()
    if not np.array_equal(kept, keep):
        notes = (f"modulus: which frames are outliers was still changing after {ROUNDS} rounds",)
    return Modulus(E, float(slope_sd * E_supposed), slope, offset, frames, outliers, notes)
