"""Makes the pages and tables of the documentation that list declarations.

    python docs/reference.py

It writes docs/settings.md anew, and the tables of all datasets in docs/format.md (a session) and
docs/results.md (a file of results), and the functions of the analysis by section of the paper in
docs/analysis.md. Tests compare the pages with the declarations.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import analysis
from analysis.options import Section, options
from app.records.schema import Column, columns_of
from app.records.study_results import Joint
from app.session import layout, results_layout
from app.settings.config import OWN, tables
from app.settings.plain_values import STEPS, title, toml_text
from app.settings.protocol_steps import DO, KINDS
from app.settings.sections import RunSettings
from drivers.settings import DeviceSettings

DOCS = Path(__file__).parent
COMMAND = "python docs/reference.py"
STEPS_ARE = (
    "The steps of a run, one table each; [protocols.md](protocols.md) explains them. Without steps,"
    " the other keys of [run] define the protocol: background, approach, reference, drive, reverse."
)
MADE_WITH = {"name": "what made the results", "value": "its version, or what it is"}
TABLE = re.compile(r"^\| dataset \|.*\n(\|.*\n)*", re.MULTILINE)


def settings() -> str:
    """docs/settings.md: every setting, by table of the settings file."""
    lines = [
        "# Settings",
        "",
        "Every setting of the program, by table of the settings file. `slipscope config` prints",
        "the same content as a settings file to start from. This page is generated from the",
        f"declarations by `{COMMAND}`.",
    ]
    for table, kind in tables().items():
        lines += ["", f"## [{table}]", "", title(kind), "", *_options(kind)]
        if kind is RunSettings:
            lines += ["", f"### [[run.{STEPS}]]", "", STEPS_ARE]
            for name, step in KINDS.items():
                lines += ["", f'`{DO} = "{name}"`: {title(step)}', "", *_options(step)]
        if issubclass(kind, DeviceSettings):
            own = f"A driver's own options go in the table `[{table}.{OWN}]`"
            lines += ["", f"{own}; `slipscope config --set {table}.source=...` shows them."]
    return "\n".join(lines) + "\n"


def _options(kind: type[Section]) -> list[str]:
    lines = ["| key | default | unit | allowed | meaning |", "|---|---|---|---|---|"]
    needs = getattr(kind, "needs", ())
    for key, declared in options(kind).items():
        default = "needed" if key in needs else f"`{toml_text(declared.default)}`"
        cells = (f"`{key}`", default, declared.unit, declared.limits, declared.meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def session_datasets() -> str:
    """The table of docs/format.md."""
    return _datasets(
        _dataset(
            column.path,
            column,
            column.meaning + (f" (version {column.since} on)" if column.since > 1 else ""),
        )
        for column in layout.COLUMNS
    )


def results_datasets() -> str:
    """The table of docs/results.md."""
    lines = [
        _dataset(results_layout.place_of(column, run), column, column.meaning)
        for run, columns in (
            ("/run_...", results_layout.run_columns()),
            ("", columns_of(Joint)),
        )
        for column in columns
    ]
    lines += [
        f"| `/made_with/{name}` | made_with | text |  | {meaning} |"
        for name, meaning in MADE_WITH.items()
    ]
    return _datasets(lines)


def _datasets(lines: Iterable[str]) -> str:
    head = ["| dataset | shape | type | unit | meaning |", "|---|---|---|---|---|"]
    return "\n".join([*head, *lines]) + "\n"


def _dataset(place: str, column: Column, meaning: str) -> str:
    sides = " x ".join(map(str, column.shape)) or "one value"
    return f"| `{place}` | {sides} | {column.dtype} | {column.unit} | {meaning} |"


FUNCTIONS = re.compile(
    r"(?<=^## The functions, by section of the paper\n\n).*?(?=^## )", re.MULTILINE | re.DOTALL
)
PLACE = r"(?:section \d(?:\.\d)*|Figs?\.? \d+\w?(?:(?:, | to | and )\d+\w?)*)"
PAPER = re.compile(rf"Prevost et al\. 2013, ({PLACE}(?:(?:, | and ){PLACE})*)")


def functions() -> str:
    """The table of docs/analysis.md: where the docstrings of what `analysis` exports name the
    paper.
    """
    rows, others = [], []
    for name, one in exported():
        text = inspect.getdoc(one) or ""
        first = " ".join(text.split("\n\n")[0].split()).partition(": ")[0].rstrip(".")
        places = PAPER.findall(" ".join(text.split()))
        rows += [f"| {place} | `analysis.{name}` | {first} |" for place in places[:1]]
        others += [] if places else [f"`{name}`"]
    rows.sort(key=lambda row: [int(number) for number in re.findall(r"\d+", row.split("|")[1])])
    head = [
        f"Made from the docstrings: `{COMMAND}`. Equations and figures are those of the paper.",
        "",
        "| paper | function | what comes out |",
        "|---|---|---|",
    ]
    return "\n".join([*head, *rows, "", f"Also: {', '.join(others)}.", "", ""])


def exported() -> Iterator[tuple[str, Any]]:
    """Functions and classes that `analysis` exports, and those of the modules that it does."""
    for name in dir(analysis):
        one = getattr(analysis, name)
        if not isinstance(one, ModuleType):
            yield name, one
        elif name not in ("calibration", "contact", "dic", "friction", "inversion", "mechanics"):
            for own, what in inspect.getmembers(one, inspect.isfunction):
                if what.__module__ == one.__name__ and not own.startswith("_"):
                    yield f"{name}.{own}", what


def main() -> None:
    """Write the pages."""
    (DOCS / "settings.md").write_text(settings(), encoding="utf-8")
    for name, table in (("format.md", session_datasets()), ("results.md", results_datasets())):
        page = (DOCS / name).read_text(encoding="utf-8")
        new = TABLE.sub(lambda _, table=table: table, page, count=1)
        (DOCS / name).write_text(new, encoding="utf-8")
    page = (DOCS / "analysis.md").read_text(encoding="utf-8")
    page = FUNCTIONS.sub(lambda _: functions(), page, count=1)
    (DOCS / "analysis.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
