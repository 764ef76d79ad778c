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
from app.session.columns import say

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
    held: dict[str, h5py.Dataset | None] = {}

    def of(path: str) -> h5py.Dataset | None:
        """What lies there, which HDF5 is asked for once."""
        if path not in held:
            held[path] = file.get(path)
        return held[path]

    def scale_of(group: str, side: str, size: int, coordinates: str) -> h5py.Dataset:
        """The scale in a group that names a side of that length; made if it is not there."""
        said, known = coordinates.rpartition("/")[2], of(coordinates) if coordinates else None
        if known is not None and len(known) == size:
            place = f"{group}/{said}"
            if of(place) is None:
                file[place] = held[place] = known
        else:
            place = f"{group}/{side if side.isidentifier() else _PAIR}"
            said, there = f"{_LENGTH}{size:10}", of(place)
            if there is not None and len(there) != size:  # what was not measured is empty
                place = f"{place}_{size}"
            if of(place) is None:
                held[place] = made = file.create_dataset(place, (size,), ">f4")
                say(made, "long_name", "names a side of other datasets; its values are none")
        scale = of(place)
        assert scale is not None
        if not h5py.h5ds.is_scale(scale.id):
            scale.make_scale(said)
        return scale

    scales: dict[tuple[str, str, int], h5py.Dataset] = {}
    for path, shape in shapes.items():
        dataset = of(path) if shape else None
        if dataset is None:
            continue
        group, sizes = path.rpartition("/")[0], dataset.shape
        for axis, side in enumerate(map(str, shape)):
            which = group, side, sizes[axis]
            if which not in scales:
                scales[which] = scale_of(*which, coordinates.get(side, ""))
            if scales[which] != dataset:
                h5py.h5ds.attach_scale(dataset.id, scales[which].id, axis)
