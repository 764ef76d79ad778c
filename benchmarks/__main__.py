"""Run a benchmark: measure, print, and with --json keep the figures.

    python -m benchmarks NAME [ARGUMENT...] [--json FILE]
    python -m benchmarks NAME --help

A benchmark is a module with a SUBJECT and a function ``measure(report, ...)``. The parameters of
the function by position are arguments of the command, those by keyword its options. The first
paragraph of the module's docstring describes it. The function returns the exit code, None being 0.
MEASURES names the packages whose change makes its results outdated; without it, all that it uses.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, get_args, get_origin

# as the command does: other threads of the linear algebra would wait on the processor's time
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benchmarks.report import Report, Results, code_of


def main(words: Sequence[str]) -> int:
    """Run the benchmark that the first word names; its exit code."""
    return measured(words)[1]


def measured(words: Sequence[str]) -> tuple[Results, int]:
    """The figures of the benchmark that the first word names, and its exit code."""
    chooser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    chooser.add_argument("name", choices=benchmarks(), metavar="NAME", help=", ".join(benchmarks()))
    name = chooser.parse_args(words[:1]).name
    module = importlib.import_module(f"benchmarks.{name}")
    parameters = inspect.signature(module.measure, eval_str=True).parameters
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
        allow_abbrev=False,
    )
    for parameter in list(parameters.values())[1:]:
        add_argument(parser, parameter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep the figures there")
    given = vars(parser.parse_args(words[1:]))
    file = given.pop("json", None)
    about = " ".join((module.__doc__ or "").split("\n\n")[0].split())
    command = shlex.join(["python", "-m", "benchmarks", *without_json(words)])
    report = Report(module.SUBJECT, about, command, code_of(module.__name__, measures(module)))
    code = module.measure(report, **given)
    if file:
        report.results.write(file)
    return report.results, code or 0


def measures(module: ModuleType) -> Sequence[str]:
    """The packages whose change makes the results of a benchmark outdated."""
    return getattr(module, "MEASURES", ("",))


def benchmarks() -> list[str]:
    """The names of all benchmarks."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return [file.stem for file in files if "\ndef measure(" in file.read_text(encoding="utf-8")]


def without_json(words: Sequence[str]) -> list[str]:
    """The words but for ``--json FILE``: where figures go says nothing about a measurement."""
    return [
        word
        for n, word in enumerate(words)
        if not word.startswith("--json") and words[n - 1 : n] != ["--json"]
    ]


def add_argument(parser: argparse.ArgumentParser, parameter: inspect.Parameter) -> None:
    """Add a parameter of a benchmark; ``Annotated[type, choices]`` limits it to some words."""
    kind, choices = parameter.annotation, None
    if get_origin(kind) is Annotated:
        kind, choices = get_args(kind)
    one = (get_args(kind) or (kind,))[0]

    def converted(text: str) -> Any:
        if choices is not None and text not in choices:
            raise argparse.ArgumentTypeError(f"{text!r} is none of {', '.join(choices)}")
        return one(text)

    converted.__name__ = one.__name__  # argparse names it in its errors
    how: dict[str, Any] = {"action": "store_true"} if kind is bool else {"type": converted}
    is_option = parameter.kind is parameter.KEYWORD_ONLY
    is_many = get_origin(kind) is Sequence
    if is_option and is_many:
        how |= {"nargs": "+", "action": "extend"}
    elif not is_option and parameter.default is not parameter.empty:
        how |= {"nargs": "*" if is_many else "?", "default": parameter.default}
    if is_option:
        option = "--" + parameter.name.rstrip("_").replace("_", "-")
        parser.add_argument(option, dest=parameter.name, **how)
    else:
        parser.add_argument(parameter.name, **how)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
