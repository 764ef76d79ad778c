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
from app.records.quantities import Measurement, side_by_side
from app.records.study_results import StudyResults
from app.report.findings import Findings, paper_of
from app.report.paper.collection import FIGURES
from app.report.practice import PracticeRows
from app.report.typeset import in_html, in_unicode
from app.system.pages import page

TEMPLATE = """
{% block head %}
<title>SlipScope: results</title>
{% endblock %}
{% block body %}
{% for block, is_wide in content %}
{% set kind = ' class="wide"' | safe if is_wide else "" %}
{% if block is string %}
<p{{ kind }}>{{ sym(block) }}</p>
{% elif block.level %}
{% set h = "h" ~ block.level %}
{% set place = ' id="' ~ block.anchor ~ '"' if block.level == 2 else "" %}
<{{ h }}{{ place | safe }}{{ kind }}>{{ sym(block.text) }}</{{ h }}>
{% elif block.entries %}
<nav>
<ul>
{% for entry in block.entries %}
<li class="level{{ entry.level }}"><a href="#{{ entry.anchor }}">{{ sym(entry.text) }}</a></li>
{% endfor %}
</ul>
</nav>
{% elif block.header %}
<table{{ kind }}>
<thead><tr>{% for cell in block.header %}<th>{{ sym(cell) }}</th>{% endfor %}</tr></thead>
{% for row in block.rows %}
<tr>{% for cell in row %}<td>{{ sym(cell) }}</td>{% endfor %}</tr>
{% endfor %}
</table>
{% else %}
<h3 id="{{ block.anchor }}">{{ sym(block.title) }}</h3>
{% if block.png %}
<figure>
<img class="as-printed" style="--mm: {{ block.width_mm }}" alt="{{ block.title }}"
  src="data:image/png;base64,{{ block.base64 }}">
<figcaption>{{ sym(block.caption) }} Files:
{% for file in block.files %}
<a href="{{ file }}">{{ file }}</a>{{ "." if loop.last else "," }}
{% endfor %}
</figcaption>
</figure>
{% else %}
<p class="soft">Left out: {{ sym(block.caption) }}.</p>
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

    @property
    def anchor(self) -> str:
        """What a link to it names."""
        return anchor_of(self.text)


def anchor_of(text: str) -> str:
    """A text as the name of a place in a page."""
    return re.sub(r"\W+", "-", text.lower()).strip("-")


@dataclass(frozen=True)
class ContentsLinks:
    """Links to headings and figures."""

    entries: tuple[Heading, ...]


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
    width_mm : int
        As it is printed.
    """

    name: str
    caption: str
    png: bytes = b""
    files: tuple[str, ...] = ()
    width_mm: int = 180

    @property
    def title(self) -> str:
        """Its number in the paper, if it has one, and what it shows."""
        title = FIGURES[self.name][0]
        return f"Fig. {self.name}: {title}" if self.name[0].isdigit() else title

    @property
    def anchor(self) -> str:
        """What a link to it names."""
        return anchor_of(self.title)

    @property
    def base64(self) -> str:
        """Its picture as text."""
        return base64.b64encode(self.png).decode("ascii")


Block = Heading | ContentsLinks | DocumentTable | DocumentPicture | str


def blocks(
    results: StudyResults,
    found: Findings,
    practice: PracticeRows,
    pictures: Sequence[DocumentPicture],
) -> Iterator[Block]:
    """The content of the report, in order: the results, then what they rest on."""
    chapters = list(_chapters(results, found, practice, pictures))
    yield Heading(1, "From sessions to results")
    yield (
        "Each number has its total standard uncertainty after ±, and in brackets the two parts of"
        " it, where they are known apart: from the noise of images and forces, and from the inputs"
        " that the operator stated."
        " The last column has the values of Prevost et al., Eur. Phys. J. E 36, 17 (2013). A value"
        " below twice its uncertainty u is not resolved; its bound is value + 2 u, rounded up."
    )
    yield ContentsLinks(tuple(_entries(chapters)))
    yield from chapters


def _entries(chapters: Sequence[Block]) -> Iterator[Heading]:
    """Chapters, and the figures that were drawn below theirs."""
    for block in chapters:
        if isinstance(block, Heading) and block.level == 2:
            yield block
        elif isinstance(block, DocumentPicture) and block.png:
            yield Heading(3, block.title)


def _chapters(
    results: StudyResults,
    found: Findings,
    practice: PracticeRows,
    pictures: Sequence[DocumentPicture],
) -> Iterator[Block]:
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
    yield Heading(2, "Made with")
    made = tuple((name, text) for name, text in sorted(results.made_with.items()) if text)
    yield DocumentTable(("part", "version or value"), made)


def _rows(numbers: Sequence[Measurement]) -> Iterator[tuple[str, ...]]:
    for one in numbers:
        if cell := _cell(one, one.unit):
            yield one.name, one.symbol, cell, paper_text(one)


def paper_text(one: Measurement, at: float = math.nan) -> str:
    """What the paper states of a number, under a load; empty where it says nothing."""
    published = paper_of(one, at)
    if published is None:
        return ""
    value, sd = (f"{v / UNITS[one.unit]:.4g}" for v in (published.value, published.sd))
    stated = f"{value} ± {sd} {one.unit}" if math.isfinite(published.sd) else f"{value} {one.unit}"
    load = f", at {published.load:g} N" if math.isfinite(published.load) else ""
    return f"{stated.rstrip()} ({published.where}{load})"


def _runs(found: Findings) -> Iterator[Block]:
    """All runs side by side, and what their analyses noted."""
    if not found.runs:
        return
    sessions = tuple(run.session for run in found.runs)
    rows = []
    for first, here in side_by_side(run.numbers for run in found.runs):
        label = f"{first.name} {first.symbol}".strip() + (f" ({first.unit})" if first.unit else "")
        texts = (paper_text(n, run.load) for n, run in zip(here, found.runs, strict=True) if n)
        if any(cells := tuple(map(_cell, here))):
            rows.append((label, *cells, "; ".join(dict.fromkeys(filter(None, texts)))))
    yield DocumentTable(("quantity", *sessions, "paper"), tuple(rows))
    yield (
        "E_w is the modulus with which Hertz's contact is as wide as the measured pressure p(r),"
        " and E is that of the balance with Q: where both are right, E/E_w is 1."
    )
    for run in found.runs:
        yield Heading(3, run.session)
        texts = (f"{name}: {text}" for name, text in run.about.items() if text)
        yield "; ".join(texts) + "."
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
    spread_text = f"({', '.join(parts)})" if parts and spread else ""
    # a value is not torn from its uncertainty and unit
    number = "\N{NO-BREAK SPACE}".join(filter(None, (value, *spread.split(), value and unit)))
    return f"{number} {spread_text}".rstrip()


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
    """The whole page with its pictures; wide tables, and the headings and text before them, are
    printed in landscape.
    """
    marked: list[tuple[Block, bool]] = []
    is_wide = False
    for block in reversed(content):
        if isinstance(block, DocumentTable):
            is_wide = len(block.header) >= WIDE
        elif not isinstance(block, str | Heading):
            is_wide = False
        marked.append((block, is_wide))
        is_wide &= not (isinstance(block, Heading) and block.level == 2)
    return page(TEMPLATE, content=marked[::-1], sym=in_html)


# -------------------------------------------------------------------------- as Markdown


def as_markdown(content: Sequence[Block]) -> str:
    """The same with links to the pictures beside it."""
    return "\n\n".join(_markdown(block) for block in content) + "\n"


def _markdown(block: Block) -> str:
    if isinstance(block, str):
        return _plain(block)
    if isinstance(block, Heading):
        return f"{'#' * block.level} {_plain(block.text)}"
    if isinstance(block, ContentsLinks):
        chapters = (one for one in block.entries if one.level == 2)
        return "\n".join(f"- [{_plain(one.text)}](#{one.anchor})" for one in chapters)
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
    plain = in_unicode(" ".join(text.split()))
    return _MARKUP.sub(r"\\\1", plain) if text != "---" else text
