"""Whether two snapshots are the same to the bit."""

from app.records.record_types import Snapshot
from app.replay.comparison import unlike
from app.session.layout import FORMAT_VERSION


def difference(a: Snapshot, b: Snapshot, version: int = FORMAT_VERSION) -> str:
    """The first dataset in which two snapshots differ by a bit, of those that a session of that
    version of the format has; empty where there is none.
    """
    return next((column.path.removeprefix("/entry/") for column, *_ in unlike(a, b, version)), "")
