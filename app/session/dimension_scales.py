"""Names of the sides of the arrays in an HDF5 file, as netCDF has them: with these xarray opens a
group with its dimensions and coordinates.

A side of a dataset is named by a dimension scale, which HDF5 attaches to it. The scale of a side is
the dataset of its coordinates; where that lies in another group, a hard link leads to it. A side
without coordinates has a scale that netCDF takes for its length alone, and that holds no bytes.
"""

from __future__ import annotations

from collections.abc import Mapping

import h5py

from app.records.schema import Shape

_LENGTH = "This is a netCDF dimension but not a netCDF variable."
_PAIR = "pair"  # a side of two


def name_sides(
    file: h5py.File, shapes: Mapping[str, Shape], coordinates: Mapping[str, str]
) -> None:
    """Name the sides of those datasets that are in the file; none of them may grow after that.

    Parameters
    ----------
    shapes : dict
        Path of each dataset -> its sides.
    coordinates : dict
        Side -> path of the dataset with its coordinates.
    """
    scales: dict[tuple[str, str, int], h5py.Dataset] = {}
    for path, shape in shapes.items():
        dataset = file.get(path) if shape else None
        if dataset is None:
            continue
        for axis, side in enumerate(shape):
            which = path.rpartition("/")[0], str(side), dataset.shape[axis]
            if which not in scales:
                scales[which] = _scale(file, *which, coordinates.get(str(side), ""))
            if scales[which] != dataset:
                dataset.dims[axis].attach_scale(scales[which])


def _scale(file: h5py.File, group: str, side: str, size: int, coordinates: str) -> h5py.Dataset:
    """The scale in a group that names a side of that length; made if it is not there."""
    said = coordinates.rpartition("/")[2]
    place = f"{group}/{said}"
    if coordinates in file and len(file[coordinates]) == size:
        if place not in file:
            file[place] = file[coordinates]
    else:
        place, said = f"{group}/{side if side.isidentifier() else _PAIR}", f"{_LENGTH}{size:10}"
        if len(file.get(place, range(size))) != size:  # what was not measured is empty
            place = f"{place}_{size}"
        if place not in file:
            file.create_dataset(place, (size,), ">f4")
            file[place].attrs["long_name"] = "names a side of other datasets; its values are none"
    scale = file[place]
    if not h5py.h5ds.is_scale(scale.id):
        scale.make_scale(said)
    return scale
