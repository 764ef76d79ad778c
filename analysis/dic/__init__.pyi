from .correlation import (
    Correlation as Correlation,
    compile_kernels as compile_kernels,
    correlate as correlate,
    open_tracker as open_tracker,
)
from .deformation import strain as strain
from .field import Field as Field, Grid as Grid, Tracker as Tracker
from .status import Status as Status
