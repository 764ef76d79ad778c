"""The report of an analysis of sessions: the same content as a page that needs nothing else (HTML),
and as Markdown beside its pictures.
"""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from analysis.options import UNITS
from app.records.quantities import Measurement
from app.records.study_results import StudyResults
from app.report.findings import Findings, paper_of
from app.report.paper.collection import FIGURES
from app.system.pages import page

TEMPLATE = """
{% macro kind(block) %}{% if block.header | length >= wide %} class="wide"{% endif %}{% endmacro %}
{% block head %}
<title>SlipScope: results</title>
{% endblock %}
{% block body %}
{% for block in content %}
{% if block is string %}
<p>{{ block }}</p>
{% elif block.level %}
<h{{ block.level }}{{ kind(loop.nextitem) }}>{{ block.text }}</h{{ block.level }}>
{% elif block.header %}
<table{{ kind(block) }}>
<thead><tr>{% for cell in block.header %}<th>{{ cell }}</th>{% endfor %}</tr></thead>
{% for row in block.rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</table>
{% else %}
<h3>{{ block.title }}</h3>
{% if block.png %}
<figure>
<img alt="{{ block.title }}" src="data:image/png;base64,{{ block.base64 }}">
<figcaption>{{ block.caption }} Files: {{ block.files | join(", ") }}.</figcaption>
</figure>
{% else %}
<p class="soft">Left out: {{ block.caption }}.</p>
{% endif %}
{% endif %}
{% endfor %}
{% endblock %}
"""
WIDE = 6  # columns from which a table is printed across the page


@dataclass(frozen=True)
class Heading:
    """A heading; 1 is that of the whole."""

    level: int
    text: str


@dataclass(frozen=True)
class DocumentTable:
    """A table; every row has as many cells as the header."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class DocumentPicture:
    """A figure that was drawn, or why there is none.

    Attributes
    ----------
    png : bytes
        Empty where it was left out, for the reason in `caption`.
    files : tuple of str
        Names of its files, pictures first.
    """

    name: str
    caption: str
    png: bytes = b""
    files: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Its number in the paper, if it has one, and what it shows."""
        title = FIGURES[self.name][0]
        return f"Fig. {self.name}: {title}" if self.name[0].isdigit() else title

    @property
    def base64(self) -> str:
        """Its picture as text."""
        return base64.b64encode(self.png).decode("ascii")


Block = Heading | DocumentTable | DocumentPicture | str


def blocks(
    results: StudyResults,
    found: Findings,
    practice: Sequence[tuple[str, str, str]],
    pictures: Sequence[DocumentPicture],
) -> Iterator[Block]:
    """The content of the report, in order."""
    yield Heading(1, "From sessions to results")
    yield (
        "Beside each number stand its standard uncertainty, the parts of it by the noise of images"
        " and forces and by what the operator stated of the inputs, and what Prevost et al., Eur."
        " Phys. J. E 36, 17 (2013), state. Where the value is less than twice its uncertainty u it"
        " is not resolved, and value + 2 u, rounded up, is told as its bound."
    )
    made = tuple((name, text) for name, text in sorted(results.made_with.items()))
    yield DocumentTable(("made with", ""), made)
    yield Heading(2, "All loads together")
    yield DocumentTable(("quantity", "", "result", "paper"), tuple(_rows(found.joint)))
    yield from found.notes
    yield Heading(2, "Each run")
    yield from _runs(found)
    yield Heading(2, "What the results rest on")
    yield DocumentTable(
        ("input", "", "value and its uncertainty", "paper"), tuple(_rows(found.inputs))
    )
    for key, values in found.differing.items():
        yield f"Not the same in all runs: {key} is {', '.join(values)}, in the order of the loads."
    yield Heading(2, "Figures")
    yield from pictures
    yield Heading(2, "What each input costs")
    yield (
        "Relative change of each result in per cent by one standard uncertainty of each input, with"
        " its sign; the last column has all inputs together."
    )
    yield from _budgets(found)
    yield Heading(2, "Image correlation, as the Good Practices Guide asks")
    yield (
        "Items of the International Digital Image Correlation Society's guide (2018, doi"
        " 10.32720/idics/gpg.ed1) for two-dimensional measurements."
    )
    yield DocumentTable(("part", "item", "value"), tuple(practice))


def _rows(numbers: Sequence[Measurement]) -> Iterator[tuple[str, ...]]:
    for one in numbers:
        yield one.name, one.symbol, _cell(one, one.unit), paper_text(one)


def paper_text(one: Measurement, at: float = math.nan) -> str:
    """What the paper states of a number, under a load; empty where it says nothing."""
    told = paper_of(one, at)
    if told is None:
        return ""
    value, sd = (f"{v / UNITS[one.unit]:.4g}" for v in (told.value, told.sd))
    stated = f"{value} ± {sd} {one.unit}" if math.isfinite(told.sd) else f"{value} {one.unit}"
    load = f", at {told.load:g} N" if math.isfinite(told.load) else ""
    return f"{stated.rstrip()} ({told.where}{load})"


def _runs(found: Findings) -> Iterator[Block]:
    """All runs side by side, and what their analyses noted."""
    if not found.runs:
        return
    keys = dict.fromkeys(n.key for run in found.runs for n in run.numbers)
    by_key = [{n.key: n for n in run.numbers} for run in found.runs]
    sessions = tuple(run.session for run in found.runs)
    rows = []
    for key in keys:
        here = [held.get(key) for held in by_key]
        first = next(filter(None, here))
        label = f"{first.name} {first.symbol}".strip() + (f" ({first.unit})" if first.unit else "")
        told = (paper_text(n, run.load) for n, run in zip(here, found.runs, strict=True) if n)
        rows.append((label, *map(_cell, here), "; ".join(dict.fromkeys(filter(None, told)))))
    yield DocumentTable(("quantity", *sessions, "paper"), tuple(rows))
    for run in found.runs:
        yield Heading(3, run.session)
        told = (f"{name}: {text}" for name, text in run.about.items() if text)
        yield "; ".join(told) + "."
        yield from run.notes


def _cell(one: Measurement | None, unit: str = "") -> str:
    """A value with its total uncertainty, and both parts of it; empty where it was not measured."""
    if one is None:
        return ""
    value, spread = one.rounded
    noise, inputs = one.parts[1:]
    if "to" in spread:
        return f"{value} ({spread}) {unit}".rstrip()
    parts = [f"{what} {sd}" for what, sd in (("noise", noise), ("inputs", inputs)) if sd]
    told = f"({', '.join(parts)})" if parts and spread else ""
    # a value is not torn from its uncertainty and unit
    number = "\N{NO-BREAK SPACE}".join(filter(None, (value, *spread.split(), value and unit)))
    return f"{number} {told}".rstrip()


def percent(share: float) -> str:
    """A relative share as a signed number of per cent, 0 below 0.0005 %."""
    if not math.isfinite(share):
        return ""
    return f"{100 * share:+.3f}" if abs(share) >= 5e-6 else "0"


def _budgets(found: Findings) -> Iterator[Block]:
    for run in found.runs:
        spent = [n for n in run.numbers if n.budget]
        if not spent:
            continue
        inputs = tuple(spent[0].budget)
        yield Heading(3, run.session)
        yield DocumentTable(
            ("", *inputs, "all"),
            tuple(
                (
                    one.symbol,
                    *(percent(share) for share in one.budget.values()),
                    percent(math.hypot(*one.budget.values())).lstrip("+"),
                )
                for one in spent
            ),
        )


# ------------------------------------------------------------------------------ as HTML


def as_html(content: Sequence[Block]) -> str:
    """The whole page; pictures are in it, and wide tables are printed across it, as is a heading
    before one.
    """
    return page(TEMPLATE, content=content, wide=WIDE)


# -------------------------------------------------------------------------- as Markdown


def as_markdown(content: Sequence[Block]) -> str:
    """The same with links to the pictures beside it."""
    return "\n\n".join(_markdown(block) for block in content) + "\n"


def _markdown(block: Block) -> str:
    if isinstance(block, str):
        return _plain(block)
    if isinstance(block, Heading):
        return f"{'#' * block.level} {_plain(block.text)}"
    if isinstance(block, DocumentTable):
        lines = [block.header, tuple("---" for _ in block.header), *block.rows]
        return "\n".join("| " + " | ".join(map(_plain, line)) + " |" for line in lines)
    title = f"### {_plain(block.title)}"
    if not block.png:
        return f"{title}\n\nLeft out: {_plain(block.caption)}."
    picture = block.files[0]
    shown = f"![{_plain(block.title)}]({picture})\n\n" if picture[-4:] in (".png", ".svg") else ""
    return f"{title}\n\n{shown}{_plain(block.caption)} Files: {', '.join(block.files)}."


_MARKUP = re.compile(r"([\\`*_|<>#\[\]])")


def _plain(text: str) -> str:
    """A text that Markdown shows as it is, in one line."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split())) if text != "---" else text
