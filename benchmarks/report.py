"""The figures of a benchmark: reported as they come, printed, and kept as JSON."""

from __future__ import annotations

import ast
import datetime
import hashlib
import json
import math
import os
import platform
import re
import subprocess
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
UNDETERMINED = "not determined"


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One measured value: a number, or a text where a number does not say it.

    `table`, `name` and `column` are its place on the page of measurements. `at_most` bounds its
    magnitude, in the same unit.
    """

    name: str
    value: float | str
    unit: str = ""
    column: str = ""
    table: str = ""
    at_most: float | None = None

    @property
    def is_missed(self) -> bool:
        """Whether the value exceeds its bound, or could not be determined."""
        if self.at_most is None or isinstance(self.value, str):
            return self.at_most is not None and self.value == UNDETERMINED
        return abs(self.value) > self.at_most

    def text(self, *, unit: bool = True, bound: bool = True, mark: bool = True) -> str:
        """The value for a reader, with its unit and its bound: '0.0071 px (at most 0.033)'."""
        text = number(self.value)
        if unit and self.unit and self.value != UNDETERMINED:
            text += f" {self.unit}"
        if bound and self.at_most is not None:
            text += f" (at most {number(self.at_most)})"
        return text + (" **missed**" if mark and self.is_missed else "")

    def bound(self) -> str:
        """The bound with its unit; nothing where there is none."""
        return "" if self.at_most is None else f"{number(self.at_most)} {self.unit}".strip()


class Results(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The figures of one run of a benchmark, and what is needed to repeat it.

    `code` is the checksum of the code that was measured, see `code_of`; `notes` are sentences below
    the tables, added by hand.
    """

    subject: str
    about: str
    command: str
    machine: str
    date: datetime.date
    commit: str
    figures: list[Figure]
    notes: list[str] = []
    code: str = ""

    @classmethod
    def read(cls, file: Path) -> Results:
        """Read a file; a ValueError names it if it holds something else."""
        try:
            return msgspec.json.decode(file.read_bytes(), type=cls)
        except msgspec.DecodeError as error:
            raise ValueError(f"{file}: not a file of benchmark results: {error}") from error

    def write(self, file: Path) -> None:
        """Write a file, with a line for each figure."""
        content = msgspec.to_builtins(self)
        figures = ",\n".join(f"  {json.dumps(figure)}" for figure in content.pop("figures"))
        head = json.dumps(content, indent=1).removesuffix("\n}")
        file.write_text(f'{head},\n "figures": [\n{figures}\n ]\n}}\n', encoding="utf-8")


class Report:
    """The figures of a run, each printed on a line as it comes.

    Parameters
    ----------
    subject, about : str
        Heading and first paragraph of its section on the page of measurements.
    command : str
        The command that repeats the run.
    code : str
        The checksum of the code that is measured.
    """

    def __init__(self, subject: str, about: str, command: str, code: str = "") -> None:
        start = machine(), datetime.date.today(), commit()
        self.results = Results(subject, about, command, *start, figures=[], code=code)
        self._table = ""
        print(command, "{}; {}; commit {}".format(*start), sep="\n", flush=True)

    def table(self, title: str) -> None:
        """Put the figures that follow in a table of their own."""
        self._table = title
        print(f"\n{title}", flush=True)

    def add(
        self,
        name: str,
        value: float | np.number[Any] | str,
        unit: str = "",
        at_most: float | None = None,
        *,
        column: str = "",
        digits: int = 3,
    ) -> None:
        """Report a figure; a number that is no integer is rounded to so many significant digits."""
        kept: float | str
        if isinstance(value, str):
            kept = value
        elif isinstance(value, int | np.integer):
            kept = int(value)
        else:
            kept = float(f"{value:.{digits}g}") if math.isfinite(value) else UNDETERMINED
        figure = Figure(name, kept, unit, column, self._table, at_most)
        self.results.figures.append(figure)
        print(f"  {f'{name}, {column}' if column else name:58s} {figure.text()}", flush=True)

    def row(self, name: str, *, digits: int = 3, **columns: Any) -> None:
        """Report a row of a table: for each column a value, or its value, unit and bound."""
        for column, figure in columns.items():
            parts = figure if isinstance(figure, tuple) else (figure,)
            self.add(name, *parts, column=column.replace("_", " "), digits=digits)

    def times(self, name: str, seconds: Sequence[float], at_most: float | None = None) -> None:
        """Report the median and the longest of some times; the bound of the longest is in ms."""
        milliseconds = 1e3 * np.asarray(seconds)
        longest = milliseconds.max(), "ms", at_most
        self.row(name, median=(np.median(milliseconds), "ms"), longest=longest)


def number(value: float | str) -> str:
    """A number with its thousands apart; a text as it is."""
    return value if isinstance(value, str) else f"{value:,.10g}"


def machine() -> str:
    """Processor, number of cores, system and Python of this computer."""
    processor, information = platform.processor(), Path("/proc/cpuinfo")
    if information.exists():
        lines = information.read_text(encoding="utf-8").splitlines()
        names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
        processor = next(names, processor)
    try:
        system = platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        system = f"{platform.system()} {platform.release()}"
    python = f"Python {platform.python_version()}"
    return f"{processor or platform.machine()}, {os.cpu_count()} cores, {system}, {python}"


def code_of(module: str, measured: Sequence[str] = ("",)) -> str:
    """A checksum of a module, and of all `measured` packages and modules of ours that it names,
    that these name, and so on: comments, docstrings and meanings of settings aside, the code that a
    benchmark measures.
    """
    found, waiting = {}, [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name], named = _read(name)
            waiting += named
    parts = (
        f"{name}\n{code}\n"
        for name, code in sorted(found.items())
        if code and (name == module or name.startswith(tuple(measured)))
    )
    return hashlib.sha256("".join(parts).encode()).hexdigest()[:16]


NAMED = re.compile(r"\b(?:analysis|app|benchmarks|drivers|tests)(?:\.\w+)+")
IMPORTED = re.compile(r"^\s*from ([\w.]+) import (.*)$", re.MULTILINE)


@cache
def _read(module: str) -> tuple[str, list[str]]:
    """The code of a module, and the modules that its source names; nothing if there is none."""
    path = ROOT.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if not file.is_file():
        return "", []
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:] or [ast.Pass()]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "option":
            node.args[1:2] = []  # the meaning of a setting
    code = ast.unparse(tree)
    named = {name for text in NAMED.findall(code) for name in _with_parents(text)}
    for package, names in IMPORTED.findall(code):
        named |= {f"{package}.{name}" for name in re.findall(r"\w+", names)}
    return code, sorted(named)


def _with_parents(name: str) -> Iterator[str]:
    """`a.b.c`, `a.b` and `a`."""
    while name:
        yield name
        name = name.rpartition(".")[0]


def commit() -> str:
    """The commit that is measured, followed by 'with changes' if its code was changed since."""
    try:
        name, changes = (
            subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
            for words in (["rev-parse", "--short=7", "HEAD"], ["status", "--porcelain", "*.py"])
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return name.stdout.strip() + (" with changes" if changes.stdout else "")
