"""The command `slipscope`: names, arguments and help; what a command does is in `app.cli`.

Nothing heavy is imported here, so that `slipscope stop` stops and `slipscope --help` answers at
once.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.cli.program import app

__all__ = ["app", "main"]

INTERRUPTED = 130  # Ctrl-C before a command has begun, as typer ends then


def main() -> None:
    """Read the command line, do it, and end the program with its exit code."""
    if sys.argv[1:2] == ["stop"]:
        from app.processes.urgent import at_once

        if (code := at_once(sys.argv[1:])) is not None:
            sys.exit(code)
    from app.system.interrupting import HEARD, heed_signal_to_end, ignore_signals_to_end

    try:
        heed_signal_to_end()
        from app.cli import program

        program.main()
    except (ImportError, KeyboardInterrupt, SystemExit) as end:
        if isinstance(end, ImportError) and not HEARD:
            raise
        if not isinstance(end, SystemExit) or end.code:
            ignore_signals_to_end()
        if isinstance(end, SystemExit) and end.code != INTERRUPTED:
            raise
        reason = HEARD[-1] if HEARD else "Ctrl-C"
        print(f"slipscope: {reason}: nothing was done", file=sys.stderr)
        sys.exit(1)


def __getattr__(name: str) -> Any:
    """`app`, the tree of all commands, which takes its time to import."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from app.cli.program import app

    return app
