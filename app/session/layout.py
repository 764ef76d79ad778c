"""The layout of a session file: every group and dataset, with shape, type, unit and meaning.

What a record holds says itself where it is stored (`app.records.record_types`); here are the
groups, and the datasets that only the file needs. A session is one HDF5 file in NeXus style.
``/@default`` leads to the load curve: shear force against stage displacement. Row ``n`` of the
forces is sample ``n`` of the DAQ clock; missing samples are NaN and listed in `gaps`. Every trigger
has a row in `triggers`. Sessions of November 2026 and earlier lack the datasets in `OPTIONAL`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from app.records.record_types import (
    ContactResult,
    Counts,
    Event,
    Gap,
    Header,
    Position,
    Samples,
    Snapshot,
    TriggerRow,
)
from app.records.schema import Column, column, columns_of, record
from app.records.summary import Summary

FORMAT_VERSION = 9
FORMAT_ATTRIBUTE = "slipscope_format"

IMAGE = "image"  # the camera's own type
NO_ROW = -1  # row of an image or a field that does not exist
FORCES_CHUNK = 4096  # samples
CHUNK_ROWS = {1: 1024, 2: 64, 3: 1}  # rows in a chunk of other datasets, by their dimensions


@dataclass(frozen=True, slots=True)
class Group:
    """A group: its NeXus class and, for plots, its signal, its other signals and its axes ("." for
    a plain count).
    """

    path: str
    nx_class: str = "NXcollection"
    signal: str = ""
    auxiliary_signals: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()


GROUPS = (
    Group("/entry", "NXentry"),
    Group("/entry/run"),
    Group("/entry/settings"),
    Group("/entry/versions"),
    Group("/entry/sample", "NXsample"),
    Group("/entry/user", "NXuser"),
    Group("/entry/notes", "NXnote"),
    Group("/entry/source"),  # only in a further analysis of a session
    Group("/entry/clock"),
    Group("/entry/instrument", "NXinstrument"),
    Group("/entry/instrument/camera", "NXdetector"),
    Group("/entry/instrument/actuator", "NXpositioner"),
    Group("/entry/triggers"),
    Group("/entry/forces", "NXdata", "shear_force", ("normal_force",), ("time",)),
    Group("/entry/auxiliary"),  # only with further channels
    Group("/entry/gaps"),
    Group("/entry/events"),
    Group("/entry/results", "NXdata", "shear_force", ("normal_force",), ("stage_displacement",)),
    Group("/entry/rings", "NXdata", "ux", (), ("frame", ".")),
    Group("/entry/stress", "NXdata", "stress", (), ("frame", ".")),
    Group("/entry/fields", "NXdata", "ux", (), ("frame", "y", "x")),
    Group("/entry/pattern", "NXdata", "gain", ("dark",), ("y", "x")),  # only if it was calibrated
    Group("/entry/contact"),  # only where the contact was measured
    Group("/entry/profile", "NXdata", "grey", (), ("radius",)),  # comes with contact
    Group("/entry/summary"),  # only where the run reached its end
    Group("/entry/counts"),  # only where the run was finished
)
LATER = frozenset(
    f"/entry/{name}"
    for name in ("source", "auxiliary", "pattern", "contact", "profile", "summary", "counts")
)

# numbers of rows that are 0 at the beginning
_DIMENSIONS = "samples, gaps, triggers, frames, positions, events, results, rings, radii, fields"
GROWING = frozenset(_DIMENSIONS.split(", "))


@record("/entry")
class Texts:
    """What a session says of itself."""

    title: str = column("title", "", "title, for readers")
    program: str = column("program_name", "", "SlipScope; its version is in versions")
    ended: str = column(
        "end_time", "", "time of day when the run ended, ISO 8601; empty if it was not finished"
    )
    state: str = column(
        "run/state",
        "",
        "complete, imported, played, stopped, failed or unfinished; before version 8, done stands"
        " for the first four",
    )
    reason: str = column("run/reason", "", "one sentence: why it ended")
    resources: str = column(
        "run/resources", "", "memory, processor and wall time of the run, as JSON"
    )


@record("/entry/versions", shape=("programs",))
class Versions:
    """What the session was made with."""

    name: tuple[str, ...] = column(
        "name", "", "program, library, computer, processor or operating system"
    )
    version: tuple[str, ...] = column("version", "", "version or description")


@record("/entry/results", rows="results")
class ResultRow:
    """Where the arrays of a snapshot are."""

    stress_count: int = column(
        "stress_count", "1", "number of radii; the rest of the row in stress is NaN", since=3
    )
    ring_count: int = column(
        "ring_count", "1", "number of rings; the rest of the row in rings is NaN"
    )
    field: int = column("field", "1", "row of its field in fields; -1: it has none")


IMAGES = Column(
    "/entry/instrument/camera/data",
    ("frames", "rows", "columns"),
    IMAGE,
    "counts",
    "raw images, one after the other, or one chunk each",
)
IMAGE_FRAMES = Column(
    "/entry/instrument/camera/frame",
    ("frames",),
    "int64",
    "1",
    "trigger number of each image; -1: of none",
    since=9,
)
IMAGE_Y = Column(
    "/entry/instrument/camera/y", ("rows",), "float64", "px", "centres of pixels downwards", since=9
)
IMAGE_X = Column(
    "/entry/instrument/camera/x",
    ("columns",),
    "float64",
    "px",
    "centres of pixels along x",
    since=9,
)
TIME = Column(
    "/entry/forces/time", ("samples",), "float64", "s", "time of the sample, from sample 0", since=9
)
FIELD_FRAMES = Column(
    "/entry/fields/frame", ("fields",), "int64", "1", "trigger number of the frame"
)
AUXILIARY = Column(
    "/entry/auxiliary/value",
    ("samples", "channels"),
    "float64",
    "see unit",
    "readings of the further channels, row n at sample n",
    since=4,
)
COLUMNS = (
    *(column for kind in (Texts, Versions, Header) for column in columns_of(kind)),
    IMAGES,
    IMAGE_FRAMES,
    IMAGE_Y,
    IMAGE_X,
    *(column for kind in (Position, TriggerRow) for column in columns_of(kind)),
    TIME,
    *(column for kind in (Samples, Gap, Event) for column in columns_of(kind)),
    AUXILIARY,
    FIELD_FRAMES,
    *(
        column
        for kind in (Snapshot, ResultRow, ContactResult, Summary, Counts)
        for column in columns_of(kind)
    ),
)
BY_PATH = {column.path: column for column in COLUMNS}
# side of the arrays -> where its coordinates are, by which netCDF and xarray name it
COORDINATES = {
    "samples": TIME.path,
    "frames": IMAGE_FRAMES.path,
    "rows": IMAGE_Y.path,
    "columns": IMAGE_X.path,
    "fields": FIELD_FRAMES.path,
    "ny": "/entry/fields/y",
    "nx": "/entry/fields/x",
    "results": "/entry/results/frame",
    "triggers": "/entry/triggers/index",
    "positions": "/entry/instrument/actuator/sample",
    "events": "/entry/events/sample",
    "gaps": "/entry/gaps/first",
    "channels": "/entry/auxiliary/name",
    "programs": "/entry/versions/name",
    "profile": "/entry/profile/radius",
    "rim": "/entry/summary/pressure_radius",
    "slides": "/entry/summary/slide_step",
    "inputs": "/entry/summary/budget_inputs",
    "quantities": "/entry/summary/budget_quantities",
    "notes": "/entry/summary/notes",
}
# what follows from the rest of the file; the first sessions of format 9 lack it
DERIVED = frozenset({TIME.path, IMAGE_FRAMES.path, IMAGE_Y.path, IMAGE_X.path})
# columns that sessions of their format may lack
OPTIONAL = DERIVED | {f"/entry/triggers/{name}" for name in ("first", "last", "stamp")}


@cache
def columns_in(group: str) -> tuple[Column, ...]:
    """The datasets that lie directly in a group, in order."""
    return tuple(column for column in COLUMNS if column.group == group)
