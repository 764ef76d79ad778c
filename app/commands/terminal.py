"""Output on the terminal: tables and results on standard output, progress and errors on standard
error.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

from app.config import ConfigError
from app.errors import UserError
from drivers.errors import DeviceError, DeviceNotFound

DONE, FAILED, BAD_INPUT = 0, 1, 2


class RowLike(Protocol):
    """A line of a table: a label, a symbol, a value."""

    @property
    def label(self) -> str: ...
    @property
    def symbol(self) -> str: ...
    @property
    def value(self) -> str: ...


def output() -> Console:
    """Standard output, without wrapping, and without markup in the text."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def say(sentence: str) -> None:
    """Print one line for the person at the terminal, on standard error."""
    Console(stderr=True, highlight=False, markup=False, soft_wrap=True).print(
        f"slipscope: {sentence}"
    )


def print_json(data: Any) -> None:
    """Print one JSON document on standard output."""
    typer.echo(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False))


def print_rows(title: str, rows: Sequence[RowLike]) -> None:
    """Print a table of three columns without frame lines."""
    console = Console(highlight=False, markup=False)
    console.print(title, style="bold", soft_wrap=True)
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True, style="dim")
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(row.label, row.symbol, row.value)
    console.print(table)
    console.print()


@contextmanager
def plain_errors(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn every error into one sentence and an exit code: 2 for an argument, file or setting that
    can not be used, 1 for a failure. There is never a traceback.

    With `as_json` the sentence is printed as ``{"error": ...}`` on standard output; with `debug` the
    exception is raised as it is.
    """
    try:
        yield
    except (typer.Exit, typer.Abort):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            raise
        sentence = " ".join(_sentence(error).split())
        if as_json:
            print_json({"error": sentence})
        else:
            say(sentence)
        is_mendable = isinstance(error, UserError | ConfigError | DeviceNotFound)
        raise typer.Exit(BAD_INPUT if is_mendable else FAILED) from None


def _sentence(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "Ctrl-C: stopped before the end; what was flushed to a session is safe"
    if isinstance(error, UserError | ConfigError | DeviceError | OSError):
        return str(error)
    return (
        f"unexpected {type(error).__name__}: {error}; `slipscope --debug ...` shows where it came"
        " from"
    )


class Bar:
    """A progress bar on standard error that disappears at the end; without a terminal, a line for
    every tenth; if `quiet`, nothing.
    """

    def __init__(self, description: str, *, quiet: bool) -> None:
        console = Console(stderr=True, highlight=False)
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=quiet or not console.is_terminal,
        )
        self._lines_left = (
            [] if quiet or console.is_terminal else [tenth / 10 for tenth in range(1, 11)]
        )
        self._task: TaskID = self._progress.add_task(description, total=1.0)

    def __enter__(self) -> Bar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, description: str, share: float) -> None:
        """Set the text and the share that is done, 0 to 1."""
        self._progress.update(self._task, description=description, completed=share)
        if self._lines_left and share >= self._lines_left[0]:
            self._lines_left = [tenth for tenth in self._lines_left if tenth > share]
            say(f"{share:4.0%} {description}")
