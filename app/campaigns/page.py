"""How far a campaign is: as a table for the terminal, and as a page for a browser, which holds all
that it shows but the pictures of the runs beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from textwrap import shorten
from typing import Any

from app.campaigns.plan import Campaign, settings_as_planned
from app.campaigns.state import FoundSession, RunState
from app.records.quantities import OF_A_RUN, counted, summary_quantities
from app.records.summary import Summary
from app.session.files import picture_of
from app.system.errors import UserError
from app.system.outputs import new_file
from app.system.pages import page

PAGE = "index.html"
MARK = '<meta name="generator" content="slipscope campaign">'
LONGEST = 60  # characters of a setting
EVERY_S = 10  # the page of a campaign that goes on is loaded again
SHOWN = ("a", "Q_s", "mu_s", "mu_d", "E", "mu", "L")
TEXTS = ("session", "state", "", "about.sample")  # headings of columns of texts
COLUMNS = {"run.normal_force": "P (N)", "run.velocity": "v (um/s)"}  # of every table
TEMPLATE = """
{% block head %}
{{ mark | safe }}
{% if progress.left %}
<meta http-equiv="refresh" content="{{ every_s }}">
{% endif %}
<title>{{ progress.campaign.name }}</title>
{% endblock %}
{% block of_body %} class="numbers"{% endblock %}
{% block body %}
<h1>{{ progress.campaign.name }}</h1>
<p>{{ progress.sentence() }}<br><span class="soft">as of {{ now }}</span></p>
<table><thead><tr>
{% for heading in headings %}
<th{% if heading in texts %} class="text"{% endif %}>{{ heading }}</th>
{% endfor %}
<th></th><th>picture</th></tr></thead><tbody>
{% for run, found, row, session, picture in rows %}
<tr class="{{ found.state.name | lower }}">
{% for heading, text in zip(headings, row) %}
<td class="{% if heading in texts %}text{% endif %}{% if heading == "state" %} state{% endif %}">
{%- if heading == "session" and session %}<a href="{{ session | urlencode }}">{{ text }}</a>
{%- else %}{{ text }}{% endif %}</td>
{% endfor %}
<td class="text note">{% if found.state.name != "DONE" %}{{ found.reason }}{% endif %}</td>
<td>{% if picture %}<a href="{{ picture | urlencode }}"><img src="{{ picture | urlencode }}"
 alt="{{ run.name }}"></a>{% endif %}</td></tr>
{% endfor %}
</tbody></table>
<p class="soft">Settings as in the settings file; each result with its standard uncertainty, by
noise and inputs together. The sessions lie beside this page, those whose runs were repeated in the
folder <i>kept</i>.</p>
{% endblock %}
"""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a campaign is.

    Attributes
    ----------
    found : mapping
        Number of a run -> what has become of it.
    left : str
        How much time is left, in words; empty where it is over.
    """

    campaign: Campaign
    found: Mapping[int, FoundSession]
    left: str = ""

    @property
    def done(self) -> int:
        """How many runs are done."""
        return sum(found.state is RunState.DONE for found in self.found.values())

    def sentence(self) -> str:
        """How far it is."""
        failed = sum(found.state is RunState.FAILED for found in self.found.values())
        done = f"{self.done} of {counted(len(self.campaign.runs), 'run')} done"
        return ", ".join(filter(None, (done, f"{failed} failed" * bool(failed), self.left)))


def table(progress: Progress) -> tuple[list[str], list[list[str]]]:
    """Headings, and a row of texts for each run: number, name, settings, state, results."""
    runs = progress.campaign.runs
    varied = [key for key in runs[0].varied if key not in COLUMNS]
    units = {symbol: unit for _, _, symbol, unit in OF_A_RUN}
    results = [f"{symbol} ({units[symbol]})" if units[symbol] else symbol for symbol in SHOWN]
    rows = []
    for run in runs:
        found, values = progress.found[run.number], settings_as_planned(run.config)
        settings = [_text(values.get(key, "")) for key in (*COLUMNS, *varied)]
        numbers = _numbers(found.summary) if found.summary else [""] * len(SHOWN)
        rows.append([str(run.number), run.name, *settings, str(found.state), *numbers])
    return ["", "session", *COLUMNS.values(), *varied, "state", *results], rows


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else shorten(str(value), LONGEST)


def _numbers(summary: Summary) -> list[str]:
    """Values with their uncertainties."""
    held = {q.symbol: q for q in summary_quantities(summary)}
    return [" ".join(held[s].rounded).strip() for s in SHOWN]


# ---------------------------------------------------------------------- as a page


def check_page(folder: Path) -> None:
    """Refuse to write a page over one of somebody else; UserError."""
    path = folder / PAGE
    if path.exists() and MARK not in path.read_text(encoding="utf-8", errors="replace")[:2000]:
        raise UserError(f"{path}: not written by `slipscope campaign`; give another folder with -o")


def write_page(progress: Progress) -> None:
    """Write the page of a campaign, or replace it; it is whole at any time."""
    with new_file(progress.campaign.folder / PAGE, overwrite=True) as unfinished:
        unfinished.write_text(html(progress, datetime.now()), encoding="utf-8")


def html(progress: Progress, now: datetime) -> str:
    """The page, complete."""
    headings, texts = table(progress)
    rows = [
        (run, progress.found[run.number], row, *map(_there, (run.session, picture_of(run.session))))
        for run, row in zip(progress.campaign.runs, texts, strict=True)
    ]
    return page(
        TEMPLATE,
        progress=progress,
        now=f"{now:%Y-%m-%d %H:%M:%S}",
        mark=MARK,
        every_s=EVERY_S,
        headings=headings,
        texts=TEXTS,
        rows=rows,
        zip=zip,
    )


def _there(path: Path) -> str:
    """The name of a file that there is; else nothing."""
    return path.name if path.exists() else ""
