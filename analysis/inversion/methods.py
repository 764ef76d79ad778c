"""One door to the inversions of u_x: by its rings, or of the whole field."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, as_grid, in_step
from analysis.contact.orientation import ALONG_X, Direction
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.geometry_checks import grid_pitch
from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.material import as_seen, rings_as_seen
from analysis.inversion.problem import InversionProblem, mask_radius
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.result import Inversion
from analysis.mechanics.hertz import contact_radius

METHODS = ("axisymmetric", "regularised", "cgls", "van-cittert")


def invert(
    x: ArrayLike, y: ArrayLike, ux: ArrayLike, sd: ArrayLike | None = None, **geometry: Any
) -> Inversion:
    """The shear stress under one field of u_x, and the displacement D of the block far away.

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,), or both (ny, nx)
        Where the points of the block were at the reference, from the contact's centre, metres; a
        square grid.
    ux : array_like, shape (ny, nx)
        Their displacement along x since then, against the sphere, metres; NaN where not measured.
    sd : array_like, shape (ny, nx), optional
        Its standard uncertainty, metres; default: measured in the field. By rings it is not used.
    **geometry
        As for `inverter`.

    Returns
    -------
    Inversion
        Pascals, newtons, metres. By rings a `RadialInversion`, with sigma(r).

    Raises
    ------
    ValueError
        The field does not allow it.

    References
    ----------
    Prevost et al. 2013, section 4 and Figs 9 to 11 and 13.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = y = np.linspace(-4e-3, 4e-3, 81)
    >>> block = {"E": 3.4e6, "nu": 0.5}
    >>> a = analysis.hertz.contact_radius(0.5, R=0.13, **block)
    >>> _, ux, _ = analysis.cattaneo_mindlin.field(x, y, Q=0.3, mu=0.9, P=0.5, a=a, **block)
    >>> found = analysis.invert(x, y, 20e-6 - ux, P=0.5, R=0.13, **block)
    >>> round(found.Q, 2), round(found.D * 1e6, 1)
    (0.3, 20.0)
    """
    ux, sd = in_step("inversion", ux=ux, sd=np.nan if sd is None else sd)
    return inverter(x, y, **geometry)(ux, sd)


def inverter(
    x: ArrayLike,
    y: ArrayLike,
    *,
    P: float,
    E: float,
    nu: float,
    R: float,
    method: str = "axisymmetric",
    roughness: float = 0.0,
    box: float = 0.0,
    noise_box: float | None = None,
    thickness: float = math.inf,
    direction: Direction = ALONG_X,
) -> Callable[[F64, F64], Inversion]:
    """An inversion for all fields of a run, set up once: a function of u_x and its standard
    uncertainty, metres, both of shape (ny, nx). The material is followed through the contact.

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,), or both (ny, nx)
        As for `invert`, metres.
    P : float
        Normal force, newtons.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio of the block.
    R : float
        Radius of the sphere, metres.
    method : str
        ``axisymmetric`` (rings), ``regularised`` (field, the most accurate), ``cgls`` or
        ``van-cittert`` (field, by iteration; the latter as in the paper).
    roughness : float
        Standard deviation h of the heights, metres: the stress reaches beyond Hertz's radius by
        sqrt(R h).
    box, noise_box : float
        Side of the correlation box, and distance over which points share noise, metres; see
        `AxisymmetricInversion`.
    thickness : float
        Of the block on a rigid plate, metres; default a half-space.
    direction : Direction
        Of the drive in the picture. All methods but ``axisymmetric`` need one along the rows.

    Raises
    ------
    ValueError
        The grid or a parameter does not allow it.

    References
    ----------
    Prevost et al. 2013, section 4.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = y = np.linspace(-4e-3, 4e-3, 81)
    >>> solve = analysis.inverter(x, y, P=0.5, E=3.4e6, nu=0.5, R=0.13, method="cgls")
    >>> still = solve(np.zeros((81, 81)), np.full((81, 81), 1e-8))
    >>> float(still.Q), str(still.stopped)
    (0.0, 'silent')
    """
    if method not in METHODS:
        raise ValueError(f"invert: method '{method}' was asked; use one of {', '.join(METHODS)}")
    x, y = as_grid(x, y)
    pitch = grid_pitch(x, y, "invert")
    radius, edge = mask_radius(P, E, nu, R, roughness, pitch), contact_radius(P, E, nu, R)
    block: dict[str, Any] = {"box": box, "thickness": thickness}
    smooth: dict[str, Any] = {"edge": edge, "noise_box": noise_box, **block}
    if method == "axisymmetric":
        rings = AxisymmetricInversion(x, y, pitch, radius, E, nu, **smooth)
        return lambda u, sd: rings.solve(rings_as_seen(x, y, u, pitch, direction))
    whole: Callable[[F64, F64 | None], Inversion]
    if method == "regularised":
        whole = RegularisedInversion(x, y, radius, E, nu, **smooth).solve
    else:
        problem = InversionProblem(np.hypot(x, y) < radius, pitch, E, nu, **block)
        whole = partial(conjugate_gradient if method == "cgls" else van_cittert, problem)

    def follow(u: F64, sd: F64) -> Inversion:
        seen, seen_sd = as_seen(u, sd, pitch, direction)
        return whole(seen, seen_sd if np.isfinite(sd).any() else None)

    return follow
