"""Makes the session of what a bench has recorded, in a process of its own: whatever HDF5 does
there, the recorded files stay as they are.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from app.processes.starting import ProcessFailed, hello_of, payload, say_hello, started
from app.session.recorder import make_session
from app.system.disk import DiskError
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.session.receipt import Receipt


def made_in_a_process(session: Path) -> tuple[Path, Receipt]:
    """As `app.session.completing.make_session`."""
    process = started("app.processes.making", session)
    try:
        answer = hello_of(process, within_s=None)  # the more there is, the longer it takes
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
        say_hello(make_session(payload()))
    except (UserError, OSError) as error:
        say_hello(error)
    sys.stderr.flush()
