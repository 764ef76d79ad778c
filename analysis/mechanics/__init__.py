"""Contact mechanics of a sphere on a plane: closed forms, the surface of the block as an operator,
and loading under a law of friction. `hertz`, `jkr`, `cattaneo_mindlin` and `greenwood_tripp` are
modules of functions.
"""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.mechanics import cattaneo_mindlin as cattaneo_mindlin
    from analysis.mechanics import greenwood_tripp as greenwood_tripp
    from analysis.mechanics.half_space import SurfaceGreen as SurfaceGreen
    from analysis.mechanics import hertz as hertz
    from analysis.mechanics.interface import (
        Interface as Interface,
        elastic_length as elastic_length,
    )
    from analysis.mechanics import jkr as jkr
    from analysis.mechanics.loading import (
        AxisymmetricLoading as AxisymmetricLoading,
        LoadingState as LoadingState,
        SphereContact as SphereContact,
    )
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            "cattaneo_mindlin": "",
            "greenwood_tripp": "",
            "half_space": "SurfaceGreen",
            "hertz": "",
            "interface": "Interface elastic_length",
            "jkr": "",
            "loading": "AxisymmetricLoading LoadingState SphereContact",
        },
    )
