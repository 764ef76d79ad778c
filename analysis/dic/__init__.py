"""Digital image correlation: the displacement field of the interface between a reference image and the images of a run.

================================  ============================================================
paper, section 2.3.2 and Fig. 4   `DirectTracker`: direct correlation, 2D Gaussian, warm start
================================  ============================================================
"""

from analysis.dic.grid import Grid
from analysis.dic.status import Status
from analysis.dic.tracker import DirectTracker, Field, compile_kernels

__all__ = ["DirectTracker", "Field", "Grid", "Status", "compile_kernels"]
