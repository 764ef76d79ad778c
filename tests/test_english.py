"""The pages and the help texts are plain technical English: constructions that read as translated,
each with a better wording.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest
import typer

import slipscope
from analysis.options import options
from app.cli.program import app
from app.settings.config import tables
from app.settings.plain_values import title
from app.settings.protocol_steps import KINDS
from docs import reference

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")]
PAGES += [
    page
    for folder in ("*", "decisions/*", "site/*")
    for page in sorted((ROOT / "docs").glob(f"{folder}.md"))
]

BANNED = {  # construction -> the wording to use
    r"\bcan\s+not\b": "cannot",
    r"\btold\b": "reported, commanded, distinguished",
    r"\bheld\s+against\b": "compared with",
    r"\b(?:an)?other\s+than\b": "different from, not the one of",
    r"\bsuch\s+an?\b": "a ... of this kind, or a name for it",
    r"\bis\s+it\s+not\b": "otherwise",
    r"\bthereby\b": "a sentence of its own",
    r"\bof\s+which\b": "whose, or two sentences",
    r"\bwhat [\w' ]+ does\s+not\s+know": "name the unknown thing",
    r"(?-i:(?:^|[.:|]\s|^- |\*\*)What\b)": "name the thing instead of `What ...`",
    r"\bwho\s+(?:drives|knows|wants)\b|\bwhoever\b": "you, the operator, to do so",
    r"\b(?:nobody|no one)\s+(?:knows|grabs|asks)\b": "unknown, not requested",
    r"\blet(?:s|ting)?\s+go\s+of\b": "close, release",
    r"\bin\s+good\s+order\b": "properly, regularly",
    r"\bunder\s+way\s+on\b": "the current run",
    r"\bby\s+so\s+much\b|\bso\s+much\s+a\b": "by this amount",
    r"\b(?:dear|dearest|costly)\b": "large, largest, expensive",
    r"\bis\s+given\s+up\b": "times out, fails",
    r"\b(?:is|are)\s+looked\s+for\b": "is searched",
    r"\bit\s+seems\s+that\b|\bby\s+then\b": "state the fact, or the time",
    r"; else\b": "; default:, or otherwise",
    r"\bthe\s+way\s+of\s+the\b": "the travel, the distance",
    r"\bwitness(?:es)?\b": "source",
    r"\b(?:as|than)\s+it\s+is\s+(?:told|asked)\b": "as commanded",
    r"\bgoes\s+on\s+with\s+it\b|\b(?:is|are)\s+gone\s+through\b": "continues, is checked",
}
# literal: what docs/reference.py copies from docstrings, code, headings
LITERAL = re.compile(
    r"^\| (?:`/|section |Figs?\. ).*$|```[\s\S]*?```|`[^`]*`|^#.*$|'go on'", re.MULTILINE
)


def help_texts() -> Iterator[tuple[str, str]]:
    """Name and text of everything that --help and docs/settings.md explain."""
    waiting: list[tuple[str, Any]] = [("slipscope", typer.main.get_command(app))]
    for name, command in waiting:
        yield name, command.help or ""
        for parameter in command.params:
            yield f"{name} {parameter.name}", getattr(parameter, "help", None) or ""
        families: dict[str, Any] = getattr(command, "commands", {})
        waiting += [(f"{name} {word}", one) for word, one in families.items()]
    for kind in (*tables().values(), *KINDS.values()):
        yield kind.__name__, title(kind)
        for key, declared in options(kind).items():
            yield f"{kind.__name__}.{key}", declared.meaning


EXPLAINED = (FunctionType, classmethod, property, cached_property)


def docstrings() -> Iterator[tuple[str, str]]:
    """Name and docstring of everything that docs/site explains to a reader."""
    names = [(f"slipscope.{name}", getattr(slipscope, name)) for name in slipscope.__all__]
    for name, one in [*names, *reference.exported()]:
        yield name, inspect.getdoc(one) or ""
        if inspect.isclass(one):
            own = [(key, held) for key, held in vars(one).items() if isinstance(held, EXPLAINED)]
            yield from ((f"{name}.{key}", held.__doc__ or "") for key, held in own)


def found_in(text: str) -> list[str]:
    prose = LITERAL.sub(" ", text)
    return [
        f"{match.group().strip()!r}: write {better}"
        for banned, better in BANNED.items()
        for match in re.finditer(banned, prose, re.MULTILINE | re.IGNORECASE)
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_is_plain_english(page: Path) -> None:
    assert not found_in(page.read_text(encoding="utf-8"))


def test_every_help_text_is_plain_english() -> None:
    texts = dict(help_texts())
    assert len(texts) > 400
    assert not {name: found for name, text in texts.items() if (found := found_in(text))}


def test_every_docstring_of_the_api_is_plain_english() -> None:
    texts = {
        name: re.sub(r"^(?:>>>|\.\.\.) .*$", "", text, flags=re.M) for name, text in docstrings()
    }
    assert len(texts) > 200
    assert not {name: found for name, text in texts.items() if (found := found_in(text))}


def messages() -> Iterator[tuple[str, str]]:
    """Place and text of every sentence in the code that is no docstring: it is for a user, or for
    the log.
    """
    for path in sorted(
        path for name in ("analysis", "app") for path in (ROOT / name).rglob("*.py")
    ):
        nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
        bodies = [getattr(node, "body", None) for node in nodes]
        first = [body[0] for body in bodies if isinstance(body, list) and body]
        left_out = {id(one.value) for one in first if isinstance(one, ast.Expr)}  # docstrings
        for node in nodes:
            if isinstance(node, ast.JoinedStr):
                left_out |= {id(part) for part in node.values}
                parts = (getattr(part, "value", "") for part in node.values)
                text = "".join(part if isinstance(part, str) else "1" for part in parts)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = node.value if id(node) not in left_out else ""
            else:
                continue
            if " " in text:
                yield f"{path.relative_to(ROOT)}:{node.lineno}", text


IN_MESSAGES = re.compile(r"\b(?:told|tell(?:s|ing)?|held\s+against|can\s+not)\b", re.IGNORECASE)


def test_every_message_is_plain_english() -> None:
    texts = [*messages()]
    assert len(texts) > 1500
    assert not [one for one in texts if IN_MESSAGES.search(one[1])]


@pytest.mark.parametrize(
    "text",
    [
        "It is told in the log.",
        "They can not.",
        "| a | What it is |",
        "other than before",
        "; else 1",
    ],
)
def test_a_banned_construction_is_found(text: str) -> None:
    assert found_in(text)
    assert not found_in(f"`{text}`")
