"""Digital image correlation: the displacement field of the interface between a reference image and
the images of a run.
"""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.grid import Grid as Grid
    from analysis.settings import Correlation as Correlation
    from analysis.dic.correlation import (
        compile_kernels as compile_kernels,
        correlate as correlate,
        open_tracker as open_tracker,
    )
    from analysis.dic.field import Field as Field, Tracker as Tracker
    from analysis.dic.status import Status as Status
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            ".grid": "Grid",
            ".settings": "Correlation",
            "correlation": "compile_kernels correlate open_tracker",
            "field": "Field Tracker",
            "status": "Status",
        },
    )
