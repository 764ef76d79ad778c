"""`slipscope` as a user calls it, in this process, and the tables that it writes."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from typer.testing import CliRunner, Result

from app.cli import app


def call(*arguments: object, input: str | None = None) -> Result:
    """Run `slipscope` with these arguments."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=input)


def given(*settings: str) -> list[str]:
    """Settings as options."""
    return [word for setting in settings for word in ("--set", setting)]


def refused(result: Result, *words: str) -> None:
    """Exit code 2 and one line on standard error that holds `words`; no traceback, nothing on
    standard output.
    """
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("slipscope: ")
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a table by the names of its columns."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def columns_of(path: Path) -> dict[str, list[str]]:
    """The columns of a table that has rows."""
    rows = rows_of(path)
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(cells: list[str]) -> np.ndarray:
    """A column of numbers, NaN where its cell is empty."""
    return np.array([float(cell) if cell else math.nan for cell in cells])
