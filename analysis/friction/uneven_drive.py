"""The way of an actuator that does not go at constant velocity, as with the periodic error of a
screw: its own encoder does not show that, the pictures do.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats

MOST_TERMS = 40  # of the polynomial through the way: twenty periods of a screw
FRAMES_PER_TERM = 4
MOST_FRAMES = 4096  # evenly chosen of a longer drive


def even_time(time: ArrayLike, way: ArrayLike) -> tuple[F64, float] | None:
    """At which times a drive at the same mean velocity would have been where this one was in each
    frame, and the standard uncertainty of one of them; seconds. None where the way is a straight
    line over the time as far as it shows.

    Parameters
    ----------
    time, way : array_like, shape (n,)
        Of each frame, s, increasing, and m; frames whose way is NaN are ignored.

    Notes
    -----
    A polynomial goes through the way, of the order that Schwarz's criterion prefers by how far each
    frame lies off the polynomial through all others.

    References
    ----------
    Schwarz, Ann. Statist. 6 (1978) 461; Allen, Technometrics 16 (1974) 125 (each left out in turn).

    Examples
    --------
    >>> import numpy as np
    >>> from analysis.friction.uneven_drive import even_time
    >>> t = np.arange(0, 20, 0.1)
    >>> noise = 2e-8 * np.random.default_rng(0).normal(size=200)
    >>> even_time(t, 5e-6 * t + noise) is None
    True
    >>> lag = 0.5e-6 * np.cos(0.6 * t)
    >>> even, sd = even_time(t, 5e-6 * t - lag + noise)
    >>> bool(np.ptp((even - t + lag / 5e-6)[5:-5]) < 0.04), round(sd, 3)
    (True, 0.001)
    """
    t, s = all_floats(time, way)
    known = np.flatnonzero(np.isfinite(t + s))
    known = known[:: max(1, len(known) // MOST_FRAMES)]
    most = min(MOST_TERMS, len(known) // FRAMES_PER_TERM)
    if most <= 2:
        return None
    begin, end = t[known[[0, -1]]].tolist()
    x = 2 * (t - begin) / (end - begin) - 1
    columns, mixed = np.linalg.qr(np.polynomial.legendre.legvander(x[known], most - 1))
    size = columns.T @ s[known]
    n, terms = len(known), np.arange(1, most + 1)
    off = s[known, None] - np.cumsum(columns * size, axis=1)
    # each frame from what goes through the others: no term is there for the sake of one
    missed = np.square(off / (1 + 1e-12 - np.cumsum(columns**2, axis=1))).sum(axis=0)
    best = 2 + int(np.argmin((n * np.log(missed + 1e-30) + terms * np.log(n))[1:]))
    if best == 2:
        return None
    slope = size[:2] @ np.linalg.inv(mixed[:2, :2]).T
    velocity = 2 * float(slope[1]) / (end - begin)
    x = np.clip(x, -1.0, 1.0)
    followed = np.polynomial.legendre.legval(x, np.linalg.solve(mixed[:best, :best], size[:best]))
    line = np.polynomial.legendre.legval(x, slope)
    even = t + (followed - line) / velocity
    left = float(np.linalg.norm(off[:, best - 1]))
    return even, left * math.sqrt(best / n / (n - best)) / abs(velocity)
