"""What a record declares of its fields."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from app.records.schema import column, columns_of, record

T = TypeVar("T", bound=np.generic)
Aliased = TypeAliasType("Aliased", np.ndarray[Any, np.dtype[T]], type_params=(T,))


@pytest.mark.parametrize("array", [NDArray, Aliased], ids=["installed numpy", "numpy 2.5"])
def test_an_array_is_stored_in_the_type_that_its_annotation_names(array: Any) -> None:
    fields = {"image": array[np.uint16], "place": array[np.float64]}
    members = {name: column(name, "1", "an array") for name in fields}
    plain = type("One", (), {"__annotations__": fields, **members})
    stored = {one.attribute: one.dtype for one in columns_of(record("/entry/one")(plain))}
    assert stored == {"image": "uint16", "place": "float64"}
