"""What NeXus programs (silx, NeXpy, h5web) look for in a file of results: the class of each group,
its plots, and over all runs the numbers of their summaries against the normal force, with which
such a program opens the file.
"""

from __future__ import annotations

import h5py
import numpy as np

from app.records.schema import columns_of
from app.records.study_results import Joint
from app.records.summary import Summary
from app.session.columns import mark
from app.session.dimension_scales import name_sides
from app.session.layout import Group
from app.session.results_layout import (
    FRAMES,
    MADE_WITH,
    RUN,
    coordinates_of,
    place_of,
    run_columns,
)

COMMON, LOADS = "/joint", "/joint/loads"
IN_RUN = (  # what is not here is an NXcollection
    Group(FRAMES, "NXdata", "shear_force", ("normal_force",), ("stage_displacement",)),
    Group("rings", "NXdata", "ux", (), ("frame", ".")),
    Group("law", "NXdata", "ratio", (), ("frame", ".")),
    Group("instants", "NXdata", "ux", ("uy",), ("frame", "y", "x")),
    Group("noise", "NXdata", "sigma", ("floor",), ("box",)),
    Group("search", "NXdata", "correlation", (), ("tau_y", "tau_x")),
    Group("pictures", "NXdata", "reference", (), (".", ".")),
    Group("profile", "NXdata", "grey", (), ("radius",)),
)
OVER_RUNS = Group(LOADS, "NXdata", "apparent_radius", ("hertz_radius",), ("normal_force",))


def describe(file: h5py.File) -> None:
    """Make the groups of a complete file of results known to such programs, and to xarray."""
    runs = [f"/{name}" for name in file if RUN.fullmatch(name)]
    for run in runs:
        shapes = {place_of(column, run): column.shape for column in run_columns()}
        name_sides(file, shapes, coordinates_of(run))
    shapes = {place_of(column): column.shape for column in columns_of(Joint)}
    name_sides(file, shapes | dict.fromkeys(MADE_WITH, ("made_with",)), coordinates_of(""))
    plots = {group.path: group for group in IN_RUN}
    for name, group in file.items():
        is_run = RUN.fullmatch(name)
        group.attrs["NX_class"] = "NXentry"  # a root has nothing else
        for part, inner in group.items() if is_run else ():
            plot = plots.get(part)
            mark(inner, plot if plot and inner[plot.signal].size else Group(part))
        if is_run:
            group.attrs["default"] = FRAMES
    if runs:
        _over_runs(file, [file[run] for run in runs])


def _over_runs(file: h5py.File, runs: list[h5py.Group]) -> None:
    loads = file.create_group(LOADS)
    mark(loads, OVER_RUNS)
    axis = OVER_RUNS.axes[0]
    for column in columns_of(Summary):
        if column.shape or column.dtype != "float64":
            continue
        held = [run[f"summary/{column.name}"] for run in runs]
        dataset = loads.create_dataset(column.name, data=np.array([one[()] for one in held]))
        dataset.attrs.update(held[0].attrs)
    sides = {f"{LOADS}/{name}": ("loads",) for name in loads}
    name_sides(file, sides, {"loads": f"{LOADS}/{axis}"})
    file[COMMON].attrs["default"] = "loads"
    file.attrs["default"] = COMMON.lstrip("/")
