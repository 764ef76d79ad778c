"""Hertz: an elastic block pressed on a rigid sphere. SI units throughout."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

F64 = NDArray[np.float64]


def reduced_modulus(E: float, nu: float) -> float:
    """E* = E / (1 - nu^2) of an elastic block against a rigid body, pascals."""
    return E / (1 - nu**2)


def contact_radius(P: float, E: float, nu: float, R: float) -> float:
    """Contact radius a_H in metres under the normal force P; 0 where P is 0.

    Parameters
    ----------
    P : float
        Normal force, newtons, 0 or more.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio of the block.
    R : float
        Radius of the sphere, metres.

    References
    ----------
    Johnson, Contact Mechanics, eq. 4.22.
    """
    return float(np.cbrt(3 * P * R / (4 * reduced_modulus(E, nu))))


def peak_pressure(P: float, a: float) -> float:
    """Pressure p0 = 3P/(2 pi a^2) at the centre of a contact of radius a, pascals."""
    return 3 * P / (2 * np.pi * a**2)


def pressure(r: ArrayLike, P: float, a: float) -> F64:
    """Contact pressure at the distance r from the centre, pascals, shape of `r`; 0 outside the contact.

    Parameters
    ----------
    r : array_like
        Distance from the contact's centre, metres.
    P, a : float
        Normal force (N) and contact radius (m).

    References
    ----------
    Johnson, Contact Mechanics, eq. 3.39.
    """
    x = np.asarray(r, dtype=np.float64) / a
    return np.asarray(peak_pressure(P, a) * np.sqrt(np.maximum((1 - x) * (1 + x), 0.0)))
