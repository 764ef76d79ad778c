from .axisymmetric import AxisymmetricInversion as AxisymmetricInversion
from .coupled import CoupledProblem as CoupledProblem
from .iterative import conjugate_gradient as conjugate_gradient, van_cittert as van_cittert
from .material import as_seen as as_seen
from .methods import invert as invert, inverter as inverter
from .problem import InversionProblem as InversionProblem, mask_radius as mask_radius
from .regularised import RegularisedInversion as RegularisedInversion
from .result import (
    EndOfInversion as EndOfInversion,
    Inversion as Inversion,
    RadialInversion as RadialInversion,
)
