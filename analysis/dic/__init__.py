"""Digital image correlation: the displacement field of the interface between a reference image and
the images of a run.

===============================  ===================================================================
Paper, section 2.3.2 and Fig. 4  `open_tracker` with the method ``direct``: direct correlation, 2D
                                 Gaussian, search from the last field
Beyond the paper                 `open_tracker` with the methods ``shared`` and ``icgn``; `strain`
===============================  ===================================================================
"""

from analysis.dic.correlation import compile_kernels, is_compiled, open_tracker
from analysis.dic.field import Field, Tracker
from analysis.dic.status import Status
from analysis.dic.strain import Strain, strain
from analysis.grid import Grid
from analysis.settings import INTERPOLANTS, METHODS, Correlation

__all__ = [
    "INTERPOLANTS",
    "METHODS",
    "Correlation",
    "Field",
    "Grid",
    "Status",
    "Strain",
    "Tracker",
    "compile_kernels",
    "is_compiled",
    "open_tracker",
    "strain",
]
