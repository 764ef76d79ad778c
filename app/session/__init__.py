"""The session file: the only place where experiments are written to and read from disk.

`Session` reads one in a notebook.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.session.notebook import Session

__all__ = ["Session"]


def __getattr__(name: str) -> Any:
    if name == "Session":
        # with h5py, which the rest of the program takes only where it needs it
        from app.session.notebook import Session

        return Session
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
