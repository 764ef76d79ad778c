"""What the program says on the terminal: tables and results on standard output, progress and errors
on standard error.
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
    """Standard output as it is now, never wrapped or coloured by what is in the text."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def say(sentence: str) -> None:
    """One line for the person at the terminal, on standard error."""
    Console(stderr=True, highlight=False, markup=False, soft_wrap=True).print(
        f"slipscope: {sentence}"
    )


def print_json(data: Any) -> None:
    """One JSON document on standard output."""
    typer.echo(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False))


def print_rows(title: str, rows: Sequence[RowLike]) -> None:
    """A three-column table without frame lines."""
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
    """Every error as one sentence and an exit code: 2 what the user can mend in what was asked, 1 a
    failure. Never a traceback.

    With `as_json` the sentence comes as ``{"error": ...}`` on standard output; with `debug` the
    exception goes through.
    """
    try:
        yield
    except (UserError, ConfigError, DeviceNotFound) as error:
        _end(str(error), BAD_INPUT, error, as_json, debug)
    except (DeviceError, OSError) as error:
        _end(str(error), FAILED, error, as_json, debug)
    except KeyboardInterrupt as error:
        _end(
            "Ctrl-C: left before the end; what was flushed to a session is safe",
            FAILED,
            error,
            as_json,
            debug,
        )
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:
        sentence = (
            f"unexpected {type(error).__name__}: {error}; `slipscope --debug ...` shows where it"
            " came from"
        )
        _end(sentence, FAILED, error, as_json, debug)


def _end(sentence: str, code: int, error: BaseException, as_json: bool, debug: bool) -> None:
    if debug:
        raise error
    sentence = " ".join(sentence.split())
    if as_json:
        print_json({"error": sentence})
    else:
        say(sentence)
    raise typer.Exit(code) from None


class Bar:
    """A progress bar on standard error, gone when it is done; a line per tenth where that is no
    terminal; nothing where `quiet`.
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
        """Set the text and the share done, 0 to 1."""
        self._progress.update(self._task, description=description, completed=share)
        if self._lines_left and share >= self._lines_left[0]:
            self._lines_left = [tenth for tenth in self._lines_left if tenth > share]
            say(f"{share:4.0%} {description}")
