"""What can be written of a session, and of a file of results."""

from __future__ import annotations

from typing import NamedTuple

from app.session.result_tables import TABLES
from app.session.tables import SESSION

KINDS = {  # of a session: ending -> what can be written so; the first is the default
    "": ("images", "tables"),
    ".csv": ("fields", *SESSION),
    ".npz": ("arrays",),
    ".mat": ("arrays",),
    ".pvd": ("paraview",),
    ".mp4": ("ux", "uy"),
    ".gif": ("ux", "uy"),
}
MEANINGS = {
    "images": "images (TIFF), forces, settings",
    "tables": "all tables",
    "fields": "displacement fields of every frame",
    "arrays": "everything but the images",
    "paraview": "displacement fields for ParaView",
    "ux": "film of u_x",
    "uy": "film of u_y",
}
# the same of a file of results
RESULTS = {"": ("tables",), ".csv": ("summary", *TABLES), ".npz": ("arrays",), ".mat": ("arrays",)}


class ExportKind(NamedTuple):
    """What of a session can be written: its name, the ending of the file (none: a folder), and its
    meaning for people.
    """

    what: str
    ending: str
    meaning: str


EXPORTS = tuple(
    ExportKind(what, ending, MEANINGS.get(what) or SESSION[what].meaning)
    for ending, kinds in KINDS.items()
    for what in kinds
)
