"""Makes the pages and tables of the documentation that list declarations.

    python docs/reference.py

It writes docs/settings.md anew, and the tables of all datasets in docs/format.md (a session) and
docs/results.md (a file of results). Tests compare the pages with the declarations.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

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
    "The steps of a run, one table each; [protocols.md](protocols.md) explains them. Without any,"
    " the other keys of [run] are the protocol: background, approach, reference, drive, reverse."
)
MADE_WITH = {"name": "what made the results", "value": "its version, or what it is"}
TABLE = re.compile(r"^\| dataset \|.*\n(\|.*\n)*", re.MULTILINE)


def settings() -> str:
    """docs/settings.md: every setting, by table of the settings file."""
    lines = [
        "# Settings",
        "",
        "Every setting of the program, by table of the settings file. `slipscope config` prints the"
        " same as a file to begin with.",
        f"This page is made from the declarations: `{COMMAND}`.",
    ]
    for table, kind in tables().items():
        lines += ["", f"## [{table}]", "", title(kind), "", *_options(kind)]
        if kind is RunSettings:
            lines += ["", f"### [[run.{STEPS}]]", "", STEPS_ARE]
            for name, step in KINDS.items():
                lines += ["", f'`{DO} = "{name}"`: {title(step)}', "", *_options(step)]
        if issubclass(kind, DeviceSettings):
            own = f"Options of a driver's own follow in the table `[{table}.{OWN}]`"
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
    is_number = f"/{results_layout.FRAMES}/" in place  # of every frame
    shape = ("frames",) if is_number else column.shape
    sides = " x ".join(map(str, shape)) or "one value"
    return f"| `{place}` | {sides} | {column.dtype} | {column.unit} | {meaning} |"


def main() -> None:
    """Write the pages."""
    (DOCS / "settings.md").write_text(settings(), encoding="utf-8")
    for name, table in (("format.md", session_datasets()), ("results.md", results_datasets())):
        page = (DOCS / name).read_text(encoding="utf-8")
        new = TABLE.sub(lambda _, table=table: table, page, count=1)
        (DOCS / name).write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
