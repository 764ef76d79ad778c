"""Make docs/measurements.md, the page of measurements, from the files in benchmarks/results.

    python -m benchmarks.measurements [--run NAME...]

Nothing is measured unless asked: ``--run NAME`` first repeats the command that stands in
benchmarks/results/NAME.json, which replaces the file. A new measurement comes to the page by
``python -m benchmarks ... --json benchmarks/results/NAME.json``.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import textwrap
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from benchmarks.report import ROOT, Figure, Results, number

RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "measurements.md"
INTRODUCTION = """\
# Measurements

How accurate and how fast SlipScope is, and what it withstands. Every table comes from a run of the
command above it, on the machine, the date and the commit that follow it. Simulated experiments are
compared with what the simulated world knows and the analysis does not. "At most" is the bound that
the magnitude of a value was held against; a value that exceeds its bound is marked as missed.

`python -m benchmarks.measurements` makes this page from the files in `benchmarks/results` and
measures nothing. `python -m benchmarks.measurements --run NAME` first repeats the measurement of
that name, which stands after its commit. Commands are given in their present form."""


def page(results: dict[str, Results]) -> str:
    """The page as Markdown, from results by name, with a section for each subject."""
    subjects = sorted({result.subject for result in results.values()})
    parts = [INTRODUCTION, "\n".join(f"- [{subject}](#{_anchor(subject)})" for subject in subjects)]
    for subject in subjects:
        chosen = {name: r for name, r in sorted(results.items()) if r.subject == subject}
        parts += [f"## {subject}", _wrapped(next(iter(chosen.values())).about)]
        for name, result in chosen.items():
            parts += section(name, result)
    return "\n\n".join(parts) + "\n"


def section(name: str, results: Results) -> list[str]:
    """The paragraphs of one run: how it was measured, its tables, its notes."""
    source = f"{results.machine}; {results.date}; commit {results.commit}; `{name}`"
    parts = [f"`{results.command}`", _wrapped(source)]
    for title, figures in groupby(results.figures, key=lambda figure: figure.table):
        parts += [_wrapped(f"*{title}*")] if title else []
        parts.append(table(list(figures)))
    return parts + [_wrapped(note) for note in results.notes]


def table(figures: Sequence[Figure]) -> str:
    """A Markdown table: a row for each name, a column for each column, and one for the bounds.

    A unit that a whole column shares stands in its heading.
    """
    columns = list(dict.fromkeys(figure.column for figure in figures))
    cells = {(figure.name, figure.column): figure for figure in figures}
    units = {column: {f.unit for f in figures if f.column == column} for column in columns}
    shared = {column: len(columns) > 1 and len(units[column]) == 1 for column in columns}
    heading = [""]
    for column in columns:
        unit = next(iter(units[column])) if shared[column] else ""
        heading.append((column or "measured") + (f" ({unit})" if unit else ""))
    has_bounds = any(figure.at_most is not None for figure in figures)
    rows = [heading + ["at most"] * has_bounds]
    rows.append(["---"] * len(rows[0]))
    for name in dict.fromkeys(figure.name for figure in figures):
        row = [cells.get((name, column)) for column in columns]
        bounds = [
            f"{number(f.at_most)} {f.unit}".strip() for f in row if f and f.at_most is not None
        ]
        texts = [f.text(unit=not shared[f.column], bound=False) if f else "" for f in row]
        rows.append([name, *texts, *[", ".join(dict.fromkeys(bounds))] * has_bounds])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _anchor(title: str) -> str:
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c == "-")


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 100, break_long_words=False, break_on_hyphens=False)


def run(name: str) -> None:
    """Repeat the measurement of that name; its results replace those that are there.

    Raises
    ------
    ValueError
        There are no results of that name, or they do not come from a benchmark.
    """
    file = RESULTS / f"{name}.json"
    if not file.exists():
        known = ", ".join(sorted(path.stem for path in RESULTS.glob("*.json")))
        raise ValueError(f"measurements: no results are named {name!r}; there are {known}")
    command = Results.read(file).command
    words = shlex.split(command)
    if words[:3] != ["python", "-m", "benchmarks"]:
        raise ValueError(
            f"measurements: {name} was not measured by a benchmark but by hand, with `{command}`;"
            f" repeat it so, and edit {file.relative_to(ROOT)}"
        )
    subprocess.run([sys.executable, *words[1:], "--json", str(file)], cwd=ROOT, check=True)


def collected(folder: Path = RESULTS) -> dict[str, Results]:
    """The results in a folder, by the names of their files."""
    return {file.stem: Results.read(file) for file in sorted(folder.glob("*.json"))}


def main() -> None:
    """Run what is asked for, then write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--run", nargs="+", default=[], metavar="NAME")
    try:
        for name in parser.parse_args().run:
            run(name)
        PAGE.write_text(page(collected()), encoding="utf-8")
    except (ValueError, subprocess.CalledProcessError) as error:
        sys.exit(str(error))
    print(PAGE.relative_to(ROOT))


if __name__ == "__main__":
    main()
