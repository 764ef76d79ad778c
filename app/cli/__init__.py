"""The command `slipscope`: names, arguments and help; what a command does is in `app.commands`.

Nothing heavy is imported here, so that `slipscope --help` answers at once.
"""

from app.cli.program import app, main

__all__ = ["app", "main"]
