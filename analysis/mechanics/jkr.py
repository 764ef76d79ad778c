"""Johnson, Kendall and Roberts: a Hertz contact with adhesion, for soft bodies whose attraction
reaches less far than it bends them.

SI units. w is the work of adhesion (J/m^2), P the normal force, negative where it pulls; E, nu
and R are those of Hertz. The theory holds where adhesion reaches less far than the deformation,
at a `tabor_parameter` above about 5; Maugis' theory covers smaller ones. A rough face adheres far
less than its smooth back, which is why the paper takes E from a JKR test of the back and leaves
adhesion out of the friction runs.

References
----------
Johnson, Kendall, Roberts 1971; Johnson, Contact Mechanics, section 5.5; Prevost et al. 2013,
section 2.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats
from analysis.mechanics.hertz import check, reduced_modulus


def pull_off_force(w: float, R: float) -> float:
    """Normal force -(3/2) pi w R (newtons) at which the contact tears off."""
    check("JKR contact", work=w, R=R)
    return -1.5 * np.pi * w * R


def normal_force(a: ArrayLike, w: float, E: float, nu: float, R: float) -> F64:
    """Normal force P (newtons) that holds a contact of radius `a`; Hertz's for w = 0."""
    check("JKR contact", R=R)
    a, stiff = floats(a), reduced_modulus(E, nu)
    return np.asarray(4 * stiff * a**3 / (3 * R) - np.sqrt(8 * np.pi * _work(w) * stiff * a**3))


def contact_radius(P: ArrayLike, w: float, E: float, nu: float, R: float) -> F64:
    """Stable contact radius in metres under the normal force P, shape of `P`; NaN where it pulls
    harder than `pull_off_force`.
    """
    check("JKR contact", R=R)
    P, pull = floats(P), 1.5 * np.pi * _work(w) * R
    beyond = P + pull
    root = np.sqrt(np.where(beyond >= 0, beyond, np.nan))
    scale = np.cbrt(3 * R / (4 * reduced_modulus(E, nu)))
    return np.asarray(scale * np.cbrt(root + np.sqrt(pull)) ** 2)


def indentation(a: ArrayLike, w: float, E: float, nu: float, R: float) -> F64:
    """Distance in metres by which the block far away has approached the sphere since they touched
    without force.
    """
    check("JKR contact", R=R)
    a = floats(a)
    return np.asarray(a * a / R - np.sqrt(2 * np.pi * a * _work(w) / reduced_modulus(E, nu)))


def pressure(r: ArrayLike, a: float, w: float, E: float, nu: float, R: float) -> F64:
    """Contact pressure (Pa) at the distance r from the centre, negative where it pulls; 0 outside,
    -inf at the edge itself.
    """
    check("JKR pressure", radius=a, R=R)
    stiff, x = reduced_modulus(E, nu), floats(r) / a
    root = np.sqrt(np.maximum((1 - x) * (1 + x), 0.0))
    pull = np.sqrt(2 * _work(w) * stiff / (np.pi * a))
    with np.errstate(divide="ignore"):
        pulled = np.where(x <= 1, np.divide(pull, root), 0.0) if w > 0 else 0.0
    return np.asarray(2 * stiff * a / (np.pi * R) * root - pulled)


def work_of_adhesion(a: ArrayLike, P: ArrayLike, E: float, nu: float, R: float) -> F64:
    """Work of adhesion w (J/m^2) by which a contact under P has the radius `a`, which broadcast;
    NaN where `a` is smaller than Hertz's.
    """
    check("JKR contact", R=R)
    a, stiff = floats(a), reduced_modulus(E, nu)
    missing = 4 * stiff * a**3 / (3 * R) - floats(P)
    return np.asarray(np.where(missing >= 0, missing, np.nan) ** 2 / (8 * np.pi * stiff * a**3))


def tabor_parameter(w: float, E: float, nu: float, R: float, reach: float = 0.3e-9) -> float:
    """Elastic deformation by adhesion over the reach of the attraction (metres): JKR holds above
    about 5, its opposite (DMT) below 0.1.
    """
    check("JKR contact", R=R, reach=reach)
    return float(np.cbrt(R * (_work(w) / reduced_modulus(E, nu)) ** 2) / reach)


def _work(w: float) -> float:
    if not 0 <= w < np.inf:
        raise ValueError(
            f"JKR contact: a work of adhesion of {w:g} J/m^2 found; give a finite number, 0 or more"
        )
    return w
