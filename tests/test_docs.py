"""The README and the pages of docs/ lead to what there is."""

from __future__ import annotations

import fnmatch
import re
from pathlib import Path
from typing import Any

import pytest
from structure import ROOT, sources
from typer.main import get_command

from app.cli.program import app
from benchmarks.__main__ import benchmarks

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
README_LINES, WIDTH = 130, 100


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def anchors(page: Path) -> set[str]:
    """The places of a page that a link can lead to, as GitHub names them."""
    headings = re.findall(r"^#+ (.*)$", text(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", text(page)):
        there = page.parent / target if target else page
        assert there.exists(), f"{page.name} leads to {target}"
        assert not anchor or anchor in anchors(there), f"{page.name} leads to {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_and_benchmark_that_is_named_exists(page: Path) -> None:
    for path in re.findall(r"`((?:analysis|app|benchmarks|drivers|tests)/[\w/.]*)`", text(page)):
        assert (ROOT / path).exists(), f"{page.name} names {path}"
    named = set(re.findall(r"python -m benchmarks (\w+)", text(page)))
    assert named <= {*benchmarks(), "NAME"}


def test_the_readme_leads_to_every_page() -> None:
    assert {f"docs/{page.name}" for page in PAGES[1:]} <= set(
        re.findall(r"\]\(([^)]*)\)", text(PAGES[0]))
    )


def test_the_site_has_every_page_once() -> None:
    docs = ROOT / "docs"
    files = [*docs.glob("*.md"), *docs.glob("*/*.md"), *docs.glob("notebooks/*.ipynb")]
    pages = [file.relative_to(docs).with_suffix("").as_posix() for file in files]
    tables = re.findall(r"^```{toctree}\n(.*?)^```", text(docs / "index.md"), re.DOTALL | re.M)
    entries = re.findall(r"^(?:\w.* <)?(\w[^\s>]*)>?$", "".join(tables), re.MULTILINE)
    listed = [page for entry in entries for page in fnmatch.filter(pages, entry) or [entry]]
    assert sorted(["index", *listed]) == sorted(pages)


def test_each_regime_of_the_extremes_names_its_test_and_each_test_its_regime() -> None:
    files = (ROOT / "tests/extremes").glob("test_*.py")
    tests = [name for file in files for name in re.findall(r"^def (test_\w+)", text(file), re.M)]
    rows = re.findall(r"^\|.*`(test_\w+)` \|$", text(ROOT / "docs/extremes.md"), re.MULTILINE)
    regimes = [
        line for line in text(ROOT / "docs/extremes.md").splitlines() if line.count(" |") == 4
    ]
    assert sorted(rows) == sorted(tests)
    assert len(regimes) == len(rows) + 5  # and the heads of the tables


def test_the_readme_is_short_and_narrow() -> None:
    lines = text(PAGES[0]).splitlines()
    assert len(lines) <= README_LINES
    assert max(map(len, lines)) <= WIDTH


def options(command: Any) -> set[str]:
    """Those of a command and of all below it."""
    own = {option for parameter in command.params for option in parameter.opts} | {"--help"}
    return own.union(*map(options, getattr(command, "commands", {}).values()))


def test_the_commands_without_json_are_those_that_the_page_lists() -> None:
    said = re.search(r"option except ([^.]*)\.", text(ROOT / "docs/commands.md"))
    assert said
    commands = get_command(app).commands  # type: ignore[attr-defined]
    without = sorted(name for name, one in commands.items() if "--json" not in options(one))
    assert re.findall(r"`([\w-]+)`", said[1]) == without


def test_every_command_and_option_that_is_named_exists() -> None:
    """In the pages, and in what the program says."""
    known = {name: options(one) for name, one in get_command(app).commands.items()}  # type: ignore[attr-defined]
    wrong = []
    for page in (*PAGES, *sources()):
        for name, given in re.findall(r"\bslipscope ([a-z]+(?:-[a-z]+)*)\b([^`\n]*)", text(page)):
            asked = re.findall(r"\s(--[a-z][a-z-]*)", re.split(r"\||&&|#", given)[0])
            missing = [option for option in asked if option not in known.get(name, ())]
            if name not in known or missing:
                wrong.append((page.name, name, missing))
    assert wrong == []
