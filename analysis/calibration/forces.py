"""Forces from the voltages of the two capacitive sensors, cross-coupling removed (paper, section
2.1).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SensorChain:
    """The chain of sensor, cantilever and coupling; index 0 is the normal direction, 1 the shear
    direction.

    Attributes
    ----------
    sensitivity_m_per_v : (2,)
        Displacement of the cantilever per volt; negative where the voltage falls as the force
        grows.
    stiffness_n_per_m : (2,)
        Stiffness of the cantilever, k_N and k_T.
    zero_v : (2,)
        Reading without a force.
    coupling : (2, 2)
        The two cantilevers read, in newtons, ``coupling @ (P, Q)``; the identity where neither
        feels the other's force.
    stiffness_std_n_per_m : (2,)
        Standard uncertainties of the stiffnesses.

    Raises
    ------
    ValueError
        A constant is not finite, a sensitivity or stiffness is zero, or the coupling cannot be
        inverted.
    """

    sensitivity_m_per_v: Pair
    stiffness_n_per_m: Pair
    zero_v: Pair = (0.0, 0.0)
    coupling: tuple[Pair, Pair] = ((1.0, 0.0), (0.0, 1.0))
    stiffness_std_n_per_m: Pair = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            shape = (2, 2) if name == "coupling" else (2,)
            value = floats(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(
                    f"sensor chain: {name} must be finite numbers of shape {shape}, found"
                    f" {getattr(self, name)}"
                )
        if not self._newtons_per_volt.all():
            raise ValueError(
                "sensor chain: a sensitivity or stiffness of zero gives no force, found"
                f" {self.sensitivity_m_per_v} m/V and {self.stiffness_n_per_m} N/m; give those of"
                " the calibration"
            )
        if np.linalg.cond(self.coupling) > 1e6:
            raise ValueError(
                f"sensor chain: the coupling {self.coupling} has no inverse, so that P and Q cannot"
                " be separated; give that of the calibration"
            )

    @property
    def _newtons_per_volt(self) -> F64:
        return np.multiply(self.sensitivity_m_per_v, self.stiffness_n_per_m)

    def relative_uncertainty(self) -> Pair:
        """Relative standard uncertainty of P and of Q by the stiffness of the cantilevers: the same
        for all readings of a bench.

        The cross-coupling, a per cent of a force, passes on a per cent of it and is left out. The
        uncertainty of a ratio Q/P is the root of the sum of their squares.
        """
        both = zip(self.stiffness_std_n_per_m, self.stiffness_n_per_m, strict=True)
        normal, shear = (std / abs(k) for std, k in both)
        return normal, shear

    def forces(self, volts: ArrayLike) -> F64:
        """Normal and shear force in newtons, columns P and Q, of readings in volts; both of shape
        (n, 2), NaN where the reading is NaN.
        """
        readings = (floats(volts) - self.zero_v) * self._newtons_per_volt
        return readings @ np.linalg.inv(self.coupling).T

    def volts(self, forces: ArrayLike) -> F64:
        """Readings in volts, of the normal and the shear sensor, that forces in newtons give,
        columns P and Q: the inverse of `forces`.
        """
        readings = floats(forces) @ np.transpose(self.coupling)
        return np.asarray(readings / self._newtons_per_volt + self.zero_v)
