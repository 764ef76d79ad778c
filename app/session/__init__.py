"""The files of experiments: the only place where they are written to and read from disk.

In a notebook `Session` reads a recorded experiment, `Results` what was made of several.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.session.notebook import Session
    from app.session.results_notebook import Results

__all__ = ["Results", "Session"]


def __getattr__(name: str) -> Any:
    # with h5py, which the rest of the program takes only where it needs it
    if name == "Session":
        from app.session.notebook import Session

        return Session
    if name == "Results":
        from app.session.results_notebook import Results

        return Results
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
