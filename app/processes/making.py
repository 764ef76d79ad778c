"""Makes the session of what a bench has recorded, in a process of its own: whatever HDF5 does
there, the recorded files stay as they are.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from app.processes.starting import (
    ProcessFailed,
    payload,
    report_ready,
    start_process,
    wait_until_ready,
)
from app.session.recorder import make_session
from app.system.disk import DiskError
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.session.receipt import Receipt


def make_session_in_a_process(session: Path) -> tuple[Path, Receipt]:
    """As `app.session.completing.make_session`."""
    process = start_process("app.processes.making", session)
    try:
        answer = wait_until_ready(process, within_s=None)  # the more there is, the longer it takes
    except ProcessFailed as error:
        raise DiskError(0, f"{session}: the session could not be made: {error}") from error
    finally:
        process.communicate()
    if isinstance(answer, OSError):
        raise answer
    return answer  # type: ignore[no-any-return]


def main() -> None:
    """Make it, and tell how that went."""
    try:
        report_ready(make_session(payload()))
    except (UserError, OSError) as error:
        report_ready(error)
    sys.stderr.flush()
