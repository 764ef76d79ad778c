"""How far a campaign is: as a table for the terminal, and as a page for a browser, which holds all
that it shows but the pictures of the runs beside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from textwrap import shorten
from typing import Any
from urllib.parse import quote

from app.campaigns.plan import Campaign, PlannedRun
from app.campaigns.state import FoundSession, RunState
from app.records.quantities import OF_A_RUN, summary_quantities
from app.records.summary import Summary
from app.session.files import picture_of
from app.settings.config import values_of
from app.system.errors import UserError
from app.system.outputs import new_file

PAGE = "index.html"
MARK = '<meta name="generator" content="slipscope campaign">'
LONGEST = 60  # characters of a setting
EVERY_S = 10  # the page of a campaign that goes on is loaded again
SHOWN = ("a", "Q_s", "mu_s", "mu_d", "E", "mu", "L")
COLUMNS = {"run.normal_force": "P (N)", "run.velocity": "v (um/s)"}  # of every table
STYLE = """
body { font: 15px/1.4 system-ui, sans-serif; margin: 2em; color: #222; background: #fff }
table { border-collapse: collapse; margin: 1em 0 }
th, td { padding: .35em .8em; border-bottom: 1px solid #ddd; text-align: right }
th, td { white-space: nowrap }
th { border-bottom: 2px solid #888; font-weight: 600; vertical-align: bottom }
td.text, th.text { text-align: left; white-space: normal }
td.note { max-width: 28em }
tr.done td.state { color: #15703a } tr.running td.state { color: #1d4fa0; font-weight: 600 }
tr.failed td.state, tr.cut td.state, tr.stopped td.state { color: #a33218 }
img { width: 150px; display: block } .dim { color: #666 }
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
        count = len(self.campaign.runs)
        return f"{self.done} of {count} runs done{', ' if self.left else ''}{self.left}"


def table(progress: Progress) -> tuple[list[str], list[list[str]]]:
    """Headings, and a row of texts for each run: number, name, settings, state, results."""
    runs = progress.campaign.runs
    varied = [key for key in runs[0].varied if key not in COLUMNS]
    units = {symbol: unit for _, _, symbol, unit in OF_A_RUN}
    results = [f"{symbol} ({units[symbol]})" if units[symbol] else symbol for symbol in SHOWN]
    rows = []
    for run in runs:
        found, values = progress.found[run.number], values_of(run.config)
        settings = [_value(values, key) for key in (*COLUMNS, *varied)]
        numbers = _numbers(found.summary) if found.summary else [""] * len(SHOWN)
        rows.append([str(run.number), run.name, *settings, str(found.state), *numbers])
    return ["", "session", *COLUMNS.values(), *varied, "state", *results], rows


def _value(values: Mapping[str, Mapping[str, Any]], name: str) -> str:
    table_name, _, key = name.partition(".")
    value = values[table_name].get(key, "")
    return f"{value:g}" if isinstance(value, float) else shorten(str(value), LONGEST)


def _numbers(summary: Summary) -> list[str]:
    """Values with their uncertainties."""
    held = {q.symbol: q for q in summary_quantities(summary)}
    return [" ".join(held[s].rounded).strip() for s in SHOWN]


# ---------------------------------------------------------------------- as a page


def check_page(folder: Path) -> None:
    """Refuse to write a page over one of somebody else; UserError."""
    page = folder / PAGE
    if page.exists() and MARK not in page.read_text(encoding="utf-8", errors="replace")[:2000]:
        raise UserError(f"{page}: not written by `slipscope campaign`; give another folder with -o")


def write_page(progress: Progress) -> None:
    """Write the page of a campaign, or replace it; it is whole at any time."""
    with new_file(progress.campaign.folder / PAGE, overwrite=True) as unfinished:
        unfinished.write_text(html(progress, datetime.now()), encoding="utf-8")


def html(progress: Progress, now: datetime) -> str:
    """The page, complete."""
    campaign = progress.campaign
    headings, rows = table(progress)
    refresh = f'<meta http-equiv="refresh" content="{EVERY_S}">' if progress.left else ""
    head = "".join(f'<th class="{_kind(h)}">{escape(h)}</th>' for h in [*headings, "", "picture"])
    body = "\n".join(
        _row(run, progress.found[run.number], headings, row)
        for run, row in zip(campaign.runs, rows, strict=True)
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">{MARK}{refresh}
<title>{escape(campaign.name)}</title><style>{STYLE}</style></head><body>
<h1>{escape(campaign.name)}</h1>
<p>{escape(progress.sentence())}<br><span class="dim">as of {now:%Y-%m-%d %H:%M:%S}</span></p>
<table><thead><tr>{head}</tr></thead><tbody>
{body}
</tbody></table>
<p class="dim">Settings as in the settings file; each result with its standard uncertainty, by noise
and inputs together. The sessions lie beside this page, those whose runs were repeated in the folder
<i>kept</i>.</p>
</body></html>
"""


def _kind(heading: str) -> str:
    return "text" if heading in ("session", "state", "", "about.sample") else ""


def _row(run: PlannedRun, found: FoundSession, headings: list[str], texts: list[str]) -> str:
    cells = ""
    for heading, text in zip(headings, texts, strict=True):
        shown = escape(text)
        if heading == "session" and run.session.exists():
            shown = f'<a href="{quote(run.session.name)}">{shown}</a>'
        state = " state" if heading == "state" else ""
        cells += f'<td class="{_kind(heading)}{state}">{shown}</td>'
    reason = found.reason if found.state is not RunState.DONE else ""
    cells += f'<td class="text note">{escape(reason)}</td>'
    picture = quote(picture_of(run.session).name)
    is_there = picture_of(run.session).exists()
    image = f'<a href="{picture}"><img src="{picture}" alt="{escape(run.name)}"></a>'
    cells += f"<td>{image if is_there else ''}</td>"
    return f'<tr class="{found.state.name.lower()}">{cells}</tr>'
