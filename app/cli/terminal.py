"""What the program writes to the terminal.

Tables and results go to standard output, progress and errors to standard error.
"""

from __future__ import annotations

import errno
import json
import queue
import sys
import threading
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from itertools import chain
from typing import Any, Literal

import typer
from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from app.system.errors import CalibrationRefused, UserError, in_full, spelled_out
from app.system.interrupting import HEARD, ending_soon, reason_of
from app.system.threads import start_thread
from drivers.errors import DeviceError, DeviceNotFound

DONE, FAILED, BAD_INPUT = 0, 1, 2
POLL_S = 0.1
# what has become of the files of a command that was cut short, by whether it only computes
LEFT = {
    True: ": left before the end; files that were there before are unchanged",
    False: ": left before the end; what was flushed to a session is safe",
}
BAD_INPUTS = (UserError, DeviceNotFound)
TOLD = (*BAD_INPUTS, CalibrationRefused, DeviceError, OSError)  # errors that say what is wrong
# errors of a system that another name or place would not have
MISPLACED = (errno.ENAMETOOLONG, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES)


def console(*, to_stderr: bool = False, wraps: bool = True) -> Console:
    """Standard output as it is now, on which every text, such as ``a:end:b.h5`` or ``[red]``, is
    shown as it is.
    """
    return Console(
        stderr=to_stderr, highlight=False, markup=False, emoji=False, soft_wrap=not wraps
    )


def print_line(text: str = "", *, style: str | None = None) -> None:
    """Write one line to standard output, which is not wrapped."""
    console(wraps=False).print(spelled_out(text), style=style)


def say(sentence: str) -> None:
    """Write one line for the person at the terminal to standard error."""
    console(to_stderr=True, wraps=False).print(f"slipscope: {spelled_out(sentence)}")


class TypedLines:
    """The lines that are typed at standard input, of which one at a time is read in the background:
    a question that was answered elsewhere leaves no second reader that takes the next answer.
    """

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._is_reading = False

    def ask(self) -> None:
        """Read the next line, unless that is waited for already; returns at once."""
        with self._lock:
            if not self._is_reading:
                self._is_reading = True
                start_thread("typed", self._read)

    def take(self) -> str | None:
        """A line that was typed, with its end; "" at the end of the input, None for none yet."""
        try:
            return self._lines.get_nowait()
        except queue.Empty:
            return None

    def wait(self) -> str:
        """The next line, with its end; "" at the end of the input."""
        self.ask()
        while True:
            with suppress(queue.Empty):
                return self._lines.get(timeout=POLL_S)  # so that Ctrl-C is heard on Windows

    def _read(self) -> None:
        line = sys.stdin.readline() if sys.stdin else ""
        with self._lock:
            self._is_reading = False
            self._lines.put(line)


TYPED = TypedLines()


def print_json(data: Any) -> None:
    """Write one JSON document to standard output, in ASCII where that has no other characters."""
    text = json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False)
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(data, indent=2, allow_nan=False)
    typer.echo(text)


GAP = 2  # columns between two columns of a table
FEWEST = 12  # columns to which a column of texts may be narrowed


def print_rows(title: str, rows: Iterable[tuple[str, str, str]]) -> None:
    """Write a table to standard output: what each row is about, its symbol, and its value, of which
    nothing is cut.
    """
    out, held = console(), [[*map(spelled_out, row)] for row in rows]
    if title:
        out.print(title, style="bold", soft_wrap=True)
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, GAP, 0, 0))
    wide = [max(map(cell_len, column)) + GAP for column in [*zip(*held, strict=True)][:2]]
    is_whole = sum(wide) + FEWEST <= out.width
    table.add_column(no_wrap=is_whole, overflow="fold")
    table.add_column(no_wrap=is_whole, overflow="fold", style="dim")
    table.add_column(overflow="fold")
    for row in held:
        table.add_row(*row)
    out.print(table)
    out.print()


def print_table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    texts: Collection[str],
    widest: int | None = None,
    numbers: Literal["left", "right"] = "right",
) -> None:
    """Write a table to standard output, of which nothing is cut: the columns of these headings are
    texts, which are at most so wide and are folded, all others are numbers, which stay whole.

    In a file or a pipe each row is one line. In a terminal that is too narrow each row is a list of
    lines, ``heading  value``.
    """
    out, held = console(), [[*map(spelled_out, row)] for row in rows]
    columns = list(zip(headings, *held, strict=True))
    wide = [
        max(map(cell_len, chain(*map(str.splitlines, column))), default=0) for column in columns
    ]
    least = [
        min(width, FEWEST) if heading in texts else width
        for heading, width in zip(headings, wide, strict=True)
    ]
    gaps = GAP * max(len(wide) - 1, 0)
    if not out.is_terminal:
        out.width = max(out.width, sum(wide) + gaps + 1)  # a file has no edge to wrap at
    elif sum(least) + gaps > out.width:
        for row in held:
            print_rows(
                "",
                [
                    (heading.replace("\n", " "), "", cell)
                    for heading, cell in zip(headings, row, strict=True)
                    if cell
                ],
            )
        return
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), header_style="bold")
    for heading in headings:
        if heading in texts:
            table.add_column(heading, max_width=widest, overflow="fold")
        else:
            table.add_column(heading, justify=numbers, no_wrap=True)
    for row in held:
        table.add_row(*row)
    out.print(table)


@contextmanager
def plain_errors(as_json: bool, debug: bool, computes: bool) -> Iterator[None]:
    """Turn every error into one sentence and an exit code, never a traceback.

    With `as_json` the sentence is printed as ``{"error": ...}`` on standard output; with `debug`
    the exception is raised as it is. What only `computes` may be cut short by Ctrl-C.
    """
    heard = len(HEARD)

    def tell(sentence: str) -> None:
        if as_json:
            print_json({"error": sentence})
        else:
            say(sentence)

    with ending_soon(lambda reason: tell(f"{reason}{LEFT[True]}")) if computes else nullcontext():
        try:
            yield
        except (typer.Exit, typer.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            if debug:
                raise
            if HEARD[heard:] and not isinstance(error, TOLD):
                error = KeyboardInterrupt(HEARD[-1])  # which compiled code has lost
            tell(" ".join(_sentence_of(error, computes).split()))
            raise typer.Exit(BAD_INPUT if _is_bad_input(error) else FAILED) from None


def _is_bad_input(error: BaseException) -> bool:
    too_long = isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG
    return too_long or isinstance(error, BAD_INPUTS)


def _sentence_of(error: BaseException, computes: bool) -> str:
    if isinstance(error, KeyboardInterrupt):
        return f"{reason_of(error)}{LEFT[computes]}"
    if isinstance(error, OSError) and type(error).__str__ is OSError.__str__ and error.filename:
        advice = "; check the name and the place" if error.errno in MISPLACED else ""
        return f"{error.filename}: {error.strerror}{advice}"
    if isinstance(error, TOLD):
        return str(error)
    return f"unexpected {in_full(error)}; `slipscope --debug ...` shows where it came from"


class Bar:
    """A progress bar on standard error that disappears when it is done.

    Where standard error is not a terminal it writes a line at each tenth of the way instead, and
    nothing at all where `quiet`.
    """

    def __init__(self, description: str, *, quiet: bool) -> None:
        out = console(to_stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            console=out,
            transient=True,
            disable=quiet or not out.is_terminal,
        )
        has_lines = not (quiet or out.is_terminal)
        self._lines_left = [tenth / 10 for tenth in range(1, 11)] if has_lines else []
        self._task = self._progress.add_task(description, total=1.0)

    def __enter__(self) -> Bar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, description: str, share: float) -> None:
        """Set the text, and the share that is done, 0 to 1."""
        self._progress.update(self._task, description=description, completed=share)
        if self._lines_left and share >= self._lines_left[0]:
            self._lines_left = [tenth for tenth in self._lines_left if tenth > share]
            say(f"{share:4.0%} {description}")
