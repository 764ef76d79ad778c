"""What can be written of a session, and of a file of results."""

from __future__ import annotations

from app.session.result_tables import TABLES
from app.session.tables import SESSION

KINDS = {  # of a session: ending -> what can be written so; the first is the default
    "": ("images", "tables"),
    ".csv": ("fields", *SESSION),
    ".npz": ("arrays",),
    ".mat": ("arrays",),
    ".pvd": ("paraview",),
}
# the same of a file of results
RESULTS = {"": ("tables",), ".csv": ("summary", *TABLES), ".npz": ("arrays",), ".mat": ("arrays",)}
