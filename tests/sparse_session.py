"""Sessions of runs whose analysis skipped frames, and whose camera lost some."""

from app.session.reader import SessionReader
from app.session.writer import SessionWriter
from drivers.protocols import Frame, LostFrame


def sparse_copy(session, path, skipped, lost=()):
    """The same run with frames that were recorded and not analysed, and frames without an image."""
    with SessionReader(session) as whole:
        writer = SessionWriter.create(path, whole.header)
        for record in whole.records():
            is_lost = isinstance(record, Frame) and record.index in lost
            writer.append(
                LostFrame(record.index, record.sample, "no image came") if is_lost else record
            )
        for snapshot in whole.snapshots():
            if snapshot.frame not in (*skipped, *lost):
                writer.append(snapshot)
        writer.append(whole.contact())
        writer.append(whole.outcome)
        writer.close()
    return path
