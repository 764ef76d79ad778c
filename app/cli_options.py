"""Options that several commands have, and how all of them tell an error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

JsonFlag = Annotated[
    bool,
    typer.Option(
        "--json",
        help="One JSON document on standard output (SI units, named in the keys), also for errors.",
    ),
]
Headless = Annotated[
    bool,
    typer.Option(
        "--headless",
        help="No window: a progress bar in the terminal. Chosen by itself without a display.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="TABLE.KEY=VALUE",
        help="One setting, over the file's; may be repeated.",
        show_default=False,
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite", help="Replace output files that exist. Without it they are never touched."
    ),
]
SessionFile = Annotated[
    Path,
    typer.Argument(
        metavar="SESSION.h5", help="A session that `slipscope run` wrote.", show_default=False
    ),
]


asked = {"debug": False}  # what `slipscope` itself was asked; one process, one command line


@contextmanager
def plain_errors(as_json: bool = False) -> Iterator[None]:
    """Every error as one sentence and an exit code, or, where `slipscope --debug` was asked, as it
    is.
    """
    from app.commands import terminal

    with terminal.plain_errors(as_json, asked["debug"]):
        yield
