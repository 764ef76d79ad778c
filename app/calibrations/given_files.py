"""Files that a calibration is evaluated from: sessions that agree, and tables in their place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.system.errors import UserError

# quantity, what its units are multiplied by, and how a header calls it; "": it may lack
Column = tuple[str, Mapping[str, float], str]


def is_session(path: Path) -> bool:
    """Whether a file is named as a session."""
    return path.suffix.lower() in (".h5", ".hdf5", ".nxs")


def same_in_all(what: str, found: Mapping[Path, Any]) -> Any:
    """What sessions say of `what`, by their paths; ValueError where they do not say the same."""
    first, *_ = found.values()
    for path, value in found.items():
        if value != first:
            raise ValueError(
                f"the sessions have different {what}: those of {path} are others than those of the"
                " first; give sessions of the same settings"
            )
    return first


def table_of(path: Path, columns: Mapping[str, Column], what: str) -> dict[str, Any]:
    """The columns of a table of `what`, each by the name under which a fit knows it.

    Raises
    ------
    UserError
        It cannot be read, or a column lacks whose name in the header is given.
    """
    from app.files.text_tables import read_table

    table = read_table(path, {quantity: units for quantity, units, _ in columns.values()})
    needed = {quantity: header for quantity, _, header in columns.values() if header}
    found = table.numbers | table.texts
    if not needed.keys() <= found.keys():
        *first, last = needed.values()
        raise UserError(
            f"{path}: the header has no {', '.join(first)} or {last}; give {what}; found"
            f" {', '.join(table.header)[:200]}"
        )
    return {name: found[quantity] for name, (quantity, *_) in columns.items() if quantity in found}
