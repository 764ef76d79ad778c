"""Hertz: an elastic block pressed on a rigid sphere. SI units throughout."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats


def check(who: str, *, P: float = 0.0, a: float = 0.0, nu: float = 0.0, **positive: float) -> None:
    """Refuse what no contact has: a negative force P (N) or radius a (m), nu outside 0 to 0.5,
    another quantity that is not above 0.

    Raises
    ------
    ValueError
        The message is one sentence that begins with `who`.
    """
    for name, value in (("P", P), ("a", a)):
        if not 0 <= value < math.inf:
            raise ValueError(f"{who}: {name} = {value:g} found; give a finite number, 0 or more")
    if not 0 <= nu <= 0.5:
        raise ValueError(f"{who}: Poisson's ratio {nu:g} found; give 0 to 0.5")
    for name, value in positive.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{who}: {name} = {value:g} found; give a finite number above 0")


def reduced_modulus(E: float, nu: float) -> float:
    """E* = E / (1 - nu^2) of an elastic block against a rigid body, pascals."""
    check("elastic block", E=E, nu=nu)
    return E / (1 - nu**2)


def shear_modulus(E: float, nu: float) -> float:
    """G = E / (2 (1 + nu)), pascals."""
    check("elastic block", E=E, nu=nu)
    return E / (2 * (1 + nu))


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

    Raises
    ------
    ValueError
        A parameter is out of its range.

    References
    ----------
    Johnson, Contact Mechanics, eq. 4.22.
    """
    check("Hertz contact", P=P, R=R)
    return float(np.cbrt(3 * P * R / (4 * reduced_modulus(E, nu))))


def indentation(a: float, R: float) -> float:
    """Distance a^2/R in metres by which the block far away has approached the sphere since they
    touched.
    """
    check("Hertz contact", a=a, R=R)
    return a * a / R


def peak_pressure(P: float, a: float) -> float:
    """Pressure p0 = 3P/(2 pi a^2) at the centre of a contact of radius a, pascals; 0 for a contact
    of no force and no radius.
    """
    check("Hertz pressure", P=P, a=a)
    if a == 0 < P:
        raise ValueError(
            f"Hertz pressure: a force of {P:g} N acts on a contact of radius 0; give the contact's"
            " radius"
        )
    return 3 * P / (2 * np.pi * a**2) if a > 0 else 0.0


def effective_radius(r: ArrayLike, p: ArrayLike) -> float:
    """``(3 pi/4) sum of p r / sum of p``, metres: the contact radius, if the pressure p (Pa) at
    evenly spaced distances r (m) is Hertz's. NaN where the pressures add up to nothing.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> r = 1e-5 * (np.arange(200) + 0.5)
    >>> round(analysis.hertz.effective_radius(r, analysis.hertz.pressure(r, 0.1, 1.2e-3)), 5)
    0.0012
    """
    r, p = floats(r), floats(p)
    line = float(p.sum())
    return 0.75 * math.pi * float(p @ r) / line if line > 0 else math.nan


def pressure(r: ArrayLike, P: float, a: float) -> F64:
    """Contact pressure at the distance r from the centre, pascals, shape of `r`; 0 outside the
    contact.

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
    r = floats(r)
    root = np.sqrt(np.maximum((a - r) * (a + r), 0.0))
    return np.asarray(peak_pressure(P, a) / (a or 1.0) * root)
