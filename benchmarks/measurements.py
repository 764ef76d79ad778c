"""Make docs/measurements.md, the page of measurements, from the files in benchmarks/results.

    python -m benchmarks.measurements                # make the page
    python -m benchmarks.measurements --show NAME... # print all figures of a result
    python -m benchmarks.measurements --older        # print what is older than the code it measured
    python -m benchmarks.measurements --run NAME...  # measure again, then make the page

Nothing is measured unless asked: ``--run NAME`` repeats the command that stands in
benchmarks/results/NAME.json, which replaces the file. A new measurement comes to the page by
``python -m benchmarks ... --json benchmarks/results/NAME.json``.
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
import textwrap
from collections import defaultdict
from collections.abc import Sequence
from importlib import import_module
from itertools import groupby
from pathlib import Path

from benchmarks.__main__ import measures
from benchmarks.report import ROOT, Figure, Results, code_of

RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "measurements.md"
OLDER = "older than the code"
INTRODUCTION = """\
# Measurements

This page shows how accurate and how fast SlipScope is, and which disturbances it withstands. Each
row is a figure with a promised bound, and its value is the worst of all runs. Where three figures
or more of one result share a bound and the last part of their names, or count losses, the worst of
them has the row. Simulated experiments are compared with the true values of the simulated world,
which the analysis does not see. A verdict is *older than the code* if the measured code has changed
since the commit of all results of its figure.

`python -m benchmarks.measurements --show NAME` prints all figures of a result with its complete
command; `--run NAME` measures it again."""
TOPICS = {  # benchmark -> topic; `topic_of` sorts out single figures
    "Accuracy": (
        "analyze",
        "calibrations",
        "coverage",
        "dic",
        "estimators",
        "front",
        "inversion",
        "loading_experiment",
        "onset",
    ),
    "Speed": (
        "demand",
        "evening",
        "live_rate",
        "paper_figures",
        "pipeline",
        "recorder",
        "window_cost",
    ),
    "Robustness": (),  # all others
}
LOSSES = re.compile(r"\b(?:lost|losses|without a frame|not analysed|not whole|by themselves)\b")
COSTS = ("s", "ms", "MiB", "% of a core")
Promises = dict[tuple[str, str], list[tuple[str, Figure]]]  # by subject and name: result, figure


def topic_of(benchmark: str, name: str, figure: Figure) -> str:
    """The table in which a figure of a benchmark stands."""
    topic = next((topic for topic, names in TOPICS.items() if benchmark in names), "Robustness")
    if LOSSES.search(name):
        return "Robustness"
    return "Speed" if topic == "Accuracy" and figure.unit in COSTS else topic


def benchmark_of(results: Results) -> str:
    """The name of the benchmark that made the results."""
    return results.command.split()[3]


def page(results: dict[str, Results], older: Sequence[str] = ()) -> str:
    """The page as Markdown, from results by name and the names of those that are outdated."""
    rows: dict[str, list[str]] = {topic: [] for topic in TOPICS}
    for (subject, name), found in merged(promises(results, older)).items():
        result, worst = max(found, key=lambda one: _excess(one[1]))
        source = results[result]
        verdict = "**missed**" if worst.is_missed else "kept"
        verdict += f", **{OLDER}**" * (result in older)
        cells = [f"{subject}: {name}", worst.text(bound=False, mark=False), worst.bound(), verdict]
        cells += [f"`{result}`", ", ".join(source.machine.split(", ")[:2])]
        cells += [str(source.date), source.commit]
        topic = topic_of(benchmark_of(source), name, worst)
        rows[topic].append("| " + " | ".join(cells) + " |")
    heads = ("promise", "value", "at most", "verdict", "NAME", "machine", "date", "commit")
    parts = [INTRODUCTION]
    for topic, lines in rows.items():
        head = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        parts += [f"## {topic}", "\n".join([*head, *lines])]
    return "\n\n".join(parts) + "\n"


def promises(results: dict[str, Results], older: Sequence[str] = ()) -> Promises:
    """The figures with a bound, by subject and name, each with the result that it is from; those of
    results that are `older` where there are no others.
    """
    found = defaultdict(list)
    for result in sorted(results, key=lambda name: (results[name].subject, name)):
        for figure in results[result].figures:
            if figure.at_most is not None:
                # a load or a range, which begins with a digit, tells runs of one figure apart
                words = [figure.table, figure.name, figure.column]
                name = ", ".join(word for word in words if word and not word[0].isdigit())
                found[results[result].subject, name].append((result, figure))
    return {name: [one for one in all_ if one[0] not in older] or all_
            for name, all_ in found.items()}  # fmt: skip


def merged(found: Promises) -> Promises:
    """Three promises or more of one result, with one bound and the same last part of their names,
    as one that names the worst; and so all losses of one result.
    """
    alike = defaultdict(list)
    for (subject, name), figures in found.items():
        result, figure = figures[0]
        kind = LOSSES if LOSSES.search(name) else name.rpartition(", ")[2]
        alike[subject, result, figure.bound(), kind].append((subject, name))
    rows: Promises = {}
    for (*_, kind), names in alike.items():
        if len(names) < (2 if kind is LOSSES else 3):
            rows |= {name: found[name] for name in names}
            continue
        worst = max(names, key=lambda name: max(_excess(figure) for _, figure in found[name]))
        rows[worst[0], f"{worst[1]}, worst of {len(names)}"] = found[worst]
    return rows


def _excess(figure: Figure) -> tuple[bool, float]:
    """Orders figures of one name: those that missed their bound last, then by their share of it."""
    size = abs(figure.value) if not isinstance(figure.value, str) else 0.0
    return figure.is_missed, size / figure.at_most if figure.at_most else size


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
        bounds = [f.bound() for f in row if f and f.bound()]
        texts = [f.text(unit=not shared[f.column], bound=False) if f else "" for f in row]
        rows.append([name, *texts, *[", ".join(dict.fromkeys(bounds))] * has_bounds])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 100, break_long_words=False, break_on_hyphens=False)


def run(name: str) -> None:
    """Repeat the measurement of that name; its results replace those that are there.

    Raises
    ------
    ValueError
        There are no results of that name.
    """
    file = RESULTS / f"{name}.json"
    words = shlex.split(chosen_of(collected(), name).command)
    subprocess.run([sys.executable, *words[1:], "--json", str(file)], cwd=ROOT, check=True)


def chosen_of(results: dict[str, Results], name: str) -> Results:
    """The result of a name; a ValueError says which there are."""
    if name not in results:
        raise ValueError(
            f"measurements: no results are named {name!r}; there are {', '.join(sorted(results))}"
        )
    return results[name]


def collected(folder: Path | None = None) -> dict[str, Results]:
    """The results in a folder, by the names of their files."""
    return {file.stem: Results.read(file) for file in sorted((folder or RESULTS).glob("*.json"))}


def outdated(results: dict[str, Results]) -> list[str]:
    """The names of results whose code was changed since, or is not known."""
    modules = {name: f"benchmarks.{benchmark_of(one)}" for name, one in results.items()}
    return [
        name
        for name, one in results.items()
        if not one.code
        or one.code != code_of(modules[name], measures(import_module(modules[name])))
    ]


def main() -> int:
    """Do what is asked for; without a wish, make the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--show", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--run", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--older", action="store_true")
    chosen = parser.parse_args()
    try:
        results = collected()
        for name in chosen.show:
            print(*section(name, chosen_of(results, name)), sep="\n\n")
        if chosen.older:
            print(*(older := outdated(results)), sep="\n")
            return int(bool(older))
        for name in chosen.run:
            run(name)
        if not chosen.show:
            results = collected()
            PAGE.write_text(page(results, outdated(results)), encoding="utf-8")
            print(PAGE.relative_to(ROOT))
    except (ValueError, subprocess.CalledProcessError) as error:
        sys.exit(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
