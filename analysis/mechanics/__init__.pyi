from . import (
    cattaneo_mindlin as cattaneo_mindlin,
    greenwood_tripp as greenwood_tripp,
    hertz as hertz,
    jkr as jkr,
)
from .half_space import SurfaceGreen as SurfaceGreen
from .interface import Interface as Interface, elastic_length as elastic_length
from .loading import (
    AxisymmetricLoading as AxisymmetricLoading,
    LoadingState as LoadingState,
    SphereContact as SphereContact,
)
