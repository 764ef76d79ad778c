"""Record types that say, for each of their fields, which dataset of a session file holds it.

`record` makes a class a frozen dataclass that is stored in one group of the file; `column` declares
a field with the name of its dataset, its unit and its meaning. The layout of the file, its writer,
its reader and its documentation follow from these declarations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields
from enum import Enum
from typing import (
    Annotated,
    Any,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
import numpy as np

T = TypeVar("T")
Shape = tuple[str | int, ...]

TEXT = "text"  # variable-length UTF-8
LARGEST = 1e30  # largest magnitude of a number in a session, in any unit


@dataclass(frozen=True, slots=True)
class Column:
    """A dataset of a session file, and the field of a record that it holds.

    Attributes
    ----------
    path : str
        Of the dataset.
    shape : tuple of int or str
        Sides of the dataset; a named side differs from file to file. The first side of a table's
        column is the number of its rows.
    dtype : str
        Of numpy, `TEXT`, or "image" for the camera's own type.
    since : int
        Version of the format that introduced the dataset.
    attribute : str
        The record's field; empty for a dataset that only the file itself needs.
    kind : type
        Annotation of the field.
    default : object
        Value of the field in a session that is too old to have the dataset.
    half : int or None
        Which column of an (n, 2) array, where the array is stored as two datasets.
    """

    path: str
    shape: Shape
    dtype: str
    unit: str
    meaning: str
    since: int = 1
    attribute: str = ""
    kind: Any = None
    default: Any = math.nan
    half: int | None = None

    @property
    def name(self) -> str:
        """Last part of the path."""
        return self.path.rpartition("/")[2]

    @property
    def group(self) -> str:
        """Path of the group that holds the dataset."""
        return self.path.rpartition("/")[0]

    def stored(self, value: Any) -> Any:
        """A field's value as the dataset holds it: the place of a member of an enumeration; for
        None an empty row of arrays, or NaN.
        """
        if isinstance(value, Enum):
            return list(type(value)).index(value)
        if value is None:
            return () if len(self.shape) > 1 else math.nan
        return value

    def check(self, values: Any) -> None:
        """Refuse values of the dataset that the field cannot have: beyond its limits, or an
        uncertainty below 0; ValueError.
        """
        found = np.asarray(values)
        if not found.size or found.dtype.kind not in "iuf":
            return
        is_uncertainty = self.name.endswith("_errors") and len(self.shape) < 2
        # NaN, which is "not measured", does not count
        for end in (np.fmin.reduce(found, axis=None), np.fmax.reduce(found, axis=None)):
            if found.dtype.kind != "f":
                if get_origin(self.kind) is Annotated:
                    self.restored(end)
            elif abs(end) > LARGEST or (end < 0 and is_uncertainty):
                raise ValueError(f"it is {end:g}")

    def restored(self, value: Any) -> Any:
        """A dataset's value as the field holds it.

        Raises
        ------
        ValueError
            The field cannot have this value.
        """
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, np.ndarray):
            return tuple(value.tolist()) if get_origin(self.kind) is tuple else value
        if isinstance(self.kind, type) and issubclass(self.kind, Enum):
            if not 0 <= value < len(self.kind):
                raise ValueError(f"{value} is no {self.attribute}")
            return list(self.kind)[int(value)]
        try:
            return msgspec.convert(value, self.kind)
        except msgspec.ValidationError:
            raise ValueError(f"it is {value:g}") from None


def column(
    name: str,
    unit: str,
    meaning: str,
    *,
    shape: Shape = (),
    dtype: str = "",
    since: int = 0,
    default: Any = MISSING,
) -> Any:
    """Declare a field that is stored in the dataset `name` of the record's group.

    `shape` is that of one value; `dtype` is that of the annotation, `shape` and `since` are those
    of the record, where they are not given.
    """
    about = {"named": ((name, unit, meaning),), "how": (shape, dtype, since)}
    return field(default=default, metadata=about)


def columns(*named: tuple[str, str, str]) -> Any:
    """Declare an array of shape (n, 2), each column of which is a dataset: (name, unit,
    meaning).
    """
    return field(metadata={"named": named, "how": ((), "float64", 0)})


def uncertainty(name: str, **how: Any) -> Any:
    """Declare the standard uncertainty of the quantity in the dataset `name`, which is declared
    before it: the unit is that of the quantity and, where they are not given, `shape` and `since`.
    """
    return column(f"{name}_errors", "", "its standard uncertainty", **how)


# record type -> the columns of its own fields, and the types of the fields that are records
_SCHEMAS: dict[type, tuple[list[Column], dict[str, type]]] = {}


@dataclass_transform(frozen_default=True, field_specifiers=(column, columns, uncertainty))
def record(
    group: str, *, rows: str = "", shape: Shape = (), since: int = 1
) -> Callable[[type[T]], type[T]]:
    """Make a class a frozen dataclass that is stored in a group of a session file.

    Parameters
    ----------
    rows : str
        What the file calls the number of such records; empty where it holds one at most.
    shape : tuple
        Of each value, where its column does not say another.
    since : int
        Version of the format that introduced it.
    """

    def made(plain: type[T]) -> type[T]:
        cls: Any = dataclass(frozen=True, slots=True)(plain)
        hints = get_type_hints(cls, include_extras=True)
        own: dict[str, Column] = {}
        parts: dict[str, type] = {}
        for one in fields(cls):
            kind = hints[one.name]
            for part in (kind, *get_args(kind)):
                if is_record(part):
                    parts[one.name] = part
            named = one.metadata.get("named", ())
            for half, (name, unit, meaning) in enumerate(named):
                side, dtype, later = one.metadata["how"]
                of = own.get(name.removesuffix("_errors"))  # the quantity of an uncertainty
                alone = (2,) if kind == tuple[float, float] else shape
                own_shape = ((rows,) if rows else ()) + (side or alone)
                own[name] = Column(
                    f"{group}/{name}",
                    of.shape if of and not side else own_shape,
                    dtype or _dtype(kind),
                    of.unit if of else unit,
                    meaning,
                    later or (of.since if of else since),
                    one.name,
                    kind,
                    math.nan if one.default is MISSING else one.default,
                    half if len(named) > 1 else None,
                )
        _SCHEMAS[cls] = [*own.values()], parts
        return cls  # type: ignore[no-any-return]

    return made


def _dtype(kind: Any) -> str:
    """Type of the dataset that holds a field of that annotation."""
    stored = {int: "int64", float: "float64", str: TEXT}
    for plain in (kind, *get_args(kind)):
        if plain in stored:
            return stored[plain]
    return str(np.dtype(_element(kind)))


def _element(kind: Any) -> Any:
    """Type of the elements of an annotation `NDArray[...]`; numpy 2.5 made that a type alias, whose
    one argument is that type itself.
    """
    expanded = getattr(get_origin(kind), "__value__", None)
    if expanded is not None:
        return get_args(kind)[0]
    return get_args(get_args(kind)[1])[0]


def is_record(kind: Any) -> bool:
    """Whether it is a class that `record` made."""
    return isinstance(kind, type) and kind in _SCHEMAS


def columns_of(kind: type) -> list[Column]:
    """Where the fields of a record type and of its parts are stored."""
    own, parts = _SCHEMAS[kind]
    return own + [column for part in parts.values() for column in columns_of(part)]


def values(record: Any) -> Iterator[tuple[Column, Any]]:
    """Each column of a record and of its parts with its value; None in those of a part that is not
    there.
    """
    own, parts = _SCHEMAS[type(record)]
    for column in own:
        value = getattr(record, column.attribute)
        yield column, value if column.half is None else value[:, column.half]
    for name, kind in parts.items():
        part = getattr(record, name)
        yield from ((c, None) for c in columns_of(kind)) if part is None else values(part)


def build(kind: type[T], value_of: Callable[[Column], Any], **others: Any) -> T:
    """A record from the values of its columns, None for those that are missing; `others` are fields
    that have no column.
    """
    held = dict(others)
    for column in _SCHEMAS[kind][0]:
        value = value_of(column)
        held[column.attribute] = column.default if value is None else value
    return kind(**held)
