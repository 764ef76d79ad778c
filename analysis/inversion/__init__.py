"""Shear stress from displacement: the inverse of u_x = D - G*sigma with the displacement D of the
block far away as an unknown.
"""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.inversion.axisymmetric import AxisymmetricInversion as AxisymmetricInversion
    from analysis.inversion.coupled import CoupledProblem as CoupledProblem
    from analysis.inversion.iterative import (
        conjugate_gradient as conjugate_gradient,
        van_cittert as van_cittert,
    )
    from analysis.inversion.material import as_seen as as_seen
    from analysis.inversion.methods import invert as invert, inverter as inverter
    from analysis.inversion.problem import (
        InversionProblem as InversionProblem,
        mask_radius as mask_radius,
    )
    from analysis.inversion.regularised import RegularisedInversion as RegularisedInversion
    from analysis.inversion.result import (
        EndOfInversion as EndOfInversion,
        Inversion as Inversion,
        RadialInversion as RadialInversion,
    )
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            "axisymmetric": "AxisymmetricInversion",
            "coupled": "CoupledProblem",
            "iterative": "conjugate_gradient van_cittert",
            "material": "as_seen",
            "methods": "invert inverter",
            "problem": "InversionProblem mask_radius",
            "regularised": "RegularisedInversion",
            "result": "EndOfInversion Inversion RadialInversion",
        },
    )
