"""A pressure between axisymmetric faces that is given by a table. SI units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, floats
from analysis.mechanics import hertz

FEWEST = 5  # rows
NODES = 4001


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedPressure:
    """Pressure by a table; equal to itself alone.

    Attributes
    ----------
    load : float
        Normal force that it carries, newtons.
    reach : float
        Radius of the contact, metres: there is no pressure beyond it.
    peak_pressure : float
        At the centre, pascals.
    effective_radius : float
        ``(3 pi/4) sum of p r dr / sum of p dr``, metres: `reach` for Hertz's pressure.
    """

    load: float
    reach: float
    peak_pressure: float
    effective_radius: float
    # of the peak, over sqrt(1 - r^2/reach^2), in which Hertz's is linear
    _share: scipy.interpolate.PchipInterpolator

    def pressure(self, r: ArrayLike) -> F64:
        """Pressure at the distance r from the centre, pascals, shape of `r`."""
        x = np.minimum(np.abs(floats(r)) / self.reach, 1.0)
        return np.asarray(self.peak_pressure * self._share(np.sqrt((1 - x) * (1 + x))))

    def radius_at(self, share: float) -> float:
        """Radius in metres at which the pressure has come down to a share of that at the centre."""
        r = np.linspace(0, self.reach, NODES)
        return float(np.interp(-share * self.peak_pressure, -self.pressure(r), r))

    def at_load(self, P: float) -> TabulatedPressure:
        """The pressure under another load: as with a sphere, all radii and pressures grow with the
        cube root of the load.
        """
        by = float(np.cbrt(P / self.load))
        grown = {"reach": self.reach, "effective_radius": self.effective_radius}
        grown |= {"peak_pressure": self.peak_pressure}
        return replace(self, load=P, **{name: by * value for name, value in grown.items()})


def tabulated_pressure(P: float, r: ArrayLike, p: ArrayLike) -> TabulatedPressure:
    """The pressure of a table, scaled so that it carries a load.

    Parameters
    ----------
    P : float
        Normal force, newtons, above 0.
    r, p : array_like, shape (n,)
        Distance from the centre (m), from 0 and increasing, and pressure there in any unit, never
        rising, to 0 in the last row: that is the edge of the contact. Smooth between (PCHIP).

    Raises
    ------
    ValueError
        The table is something else, or the load is not above 0.

    Examples
    --------
    >>> import numpy as np
    >>> from analysis.mechanics.tabulated_pressure import tabulated_pressure
    >>> r = np.linspace(0, 1e-3, 50)
    >>> found = tabulated_pressure(0.5, r, np.sqrt(1 - (r / 1e-3) ** 2))
    >>> round(found.peak_pressure * np.pi * 1e-6 / 0.5, 4), round(found.effective_radius * 1e3, 4)
    (1.5, 1.0)
    """
    hertz.check("pressure", force=P)
    r, p = all_floats(r, p)
    is_table = r.ndim == 1 and r.shape == p.shape and len(r) >= FEWEST
    if (
        not (is_table and np.isfinite([r, p]).all() and (np.diff(r) > 0).all())
        or not (r[0] == p[-1] == 0 and (p[:-1] > 0).all())
        or not (np.diff(p) <= 0).all()
    ):
        raise ValueError(
            f"pressure: a table of {r.size} distances and {p.size} pressures was given; give"
            f" {FEWEST} rows or more, in which the distance rises from 0 and the pressure falls to"
            " 0 in the last row alone, never rising or below 0"
        )
    a = float(r[-1])
    share = scipy.interpolate.PchipInterpolator(np.sqrt(1 - (r[::-1] / a) ** 2), p[::-1] / p[0])
    at = np.linspace(0, np.pi / 2, NODES)  # r = a sin(at)
    along = share(np.cos(at)) * np.cos(at)
    total, line = (float(scipy.integrate.simpson(v, x=at)) for v in (along * np.sin(at), along))
    peak = P / (2 * np.pi * a**2 * total)
    return TabulatedPressure(P, a, peak, 0.75 * np.pi * a * total / line, share)
