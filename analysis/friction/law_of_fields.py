"""The local friction law from the displacement fields of a drive."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import as_grid, floats, in_step
from analysis.friction.local_law import DRAWS, LocalLaw, fit_local_law
from analysis.inversion.axisymmetric import AxisymmetricInversion, InvertedRings
from analysis.inversion.geometry_checks import grid_pitch
from analysis.inversion.material import rings_as_seen
from analysis.inversion.problem import mask_radius
from analysis.mechanics.hertz import contact_radius


def friction_law(
    x: ArrayLike,
    y: ArrayLike,
    ux: ArrayLike,
    P: ArrayLike,
    Q: ArrayLike,
    *,
    E: float,
    nu: float,
    R: float,
    roughness: float = 0.0,
    box: float = 0.0,
    noise_box: float | None = None,
    thickness: float = math.inf,
    Q_sd: float = 1e-3,
    draws: int = DRAWS,
) -> LocalLaw:
    """Friction coefficient mu, elastic length L, modulus E and pressure p(r) from the fields of a
    first loading that ends in sliding.

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,), or both (ny, nx)
        Where the points of the block were at the reference, from the contact's centre, metres; a
        square grid.
    ux : array_like, shape (nt, ny, nx)
        Their displacement along x since the start of the loading, against the sphere, metres; NaN
        where not measured.
    P, Q : array_like, shape (nt,)
        Normal and shear force, newtons; one P may hold for all.
    E, nu : float
        Young's modulus (Pa), which the result corrects, and Poisson's ratio of the block.
    R, roughness, box, noise_box, thickness : float
        As for `analysis.inverter`, metres.
    Q_sd : float
        Noise of the shear force, newtons.
    draws : int
        Runs drawn for the uncertainties; 0: none of them.

    Raises
    ------
    ValueError
        The grid or a parameter does not allow an inversion.

    References
    ----------
    Prevost et al. 2013, section 6 and Fig. 15.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> contact = analysis.SphereContact(P=0.5, E=3.4e6, nu=0.5, R=0.13, mu=0.9, L=1e-6)
    >>> loading = analysis.AxisymmetricLoading(contact, modes=24)
    >>> states = [loading.driven(D) for D in np.linspace(2e-6, 80e-6, 40)]
    >>> x = y = np.linspace(-3.5e-3, 3.5e-3, 51)
    >>> r = np.hypot(*np.meshgrid(x, y))
    >>> ux = [state.D - state.displacement(r)[0] for state in states]
    >>> Q = [state.Q for state in states]
    >>> law = analysis.friction_law(x, y, ux, 0.5, Q, E=3e6, nu=0.5, R=0.13, draws=0)
    >>> round(law.mu, 3), round(law.L * 1e6, 2), round(law.E * 1e-6, 2)
    (0.9, 1.0, 3.4)
    """
    x, y = as_grid(x, y)
    pitch, (fields,) = grid_pitch(x, y, "friction law"), in_step("friction law", ux=ux)
    forces = floats(P)
    load = float(np.mean(forces[np.isfinite(forces)])) if np.isfinite(forces).any() else np.nan
    radius = mask_radius(load, E, nu, R, roughness, pitch)
    inversion = AxisymmetricInversion(
        *(x, y, pitch, radius, E, nu),
        edge=contact_radius(load, E, nu, R),
        box=box,
        noise_box=noise_box,
        thickness=thickness,
    )
    if fields.ndim != 3 or fields.shape[1:] != x.shape:
        raise ValueError(
            f"friction law: ux of shape {fields.shape} was given on a grid of shape {x.shape}; give"
            " one field after the other, (nt, ny, nx)"
        )
    rings = [rings_as_seen(x, y, field, pitch) for field in fields]
    each = [InvertedRings(inversion, one) for one in rings]
    law = fit_local_law(rings, P, Q, inversion, Q_sd=Q_sd, draws=draws, inverted=each)
    if bare := sum(not one.is_covered for one in each):
        note = (
            f"local law: in {bare} of {len(each)} frames the field does not cover the contact, and"
            " E and p(r) rest on a part of it; widen the field"
        )
        law = replace(law, notes=(*law.notes, note))
    return law
