"""The list of deliberate breaks stays true to the program: `python -m tests.mutants` tries them."""

import ast
from functools import cache, lru_cache
from textwrap import dedent

from tests.mutants.__main__ import ROOT, breaks


@cache
def sound(file):
    """The text of a file."""
    return (ROOT / file).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def parts(file):
    """First and last line of each function and class of a file, and of the whole."""
    text = sound(file)
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    found = [one for one in ast.walk(ast.parse(text)) if isinstance(one, kinds)]
    tops = [min([one.lineno, *(each.lineno for each in one.decorator_list)]) for one in found]
    ends = [one.end_lineno for one in found]
    return [*zip(tops, ends, strict=True), (1, text.count("\n"))]


def meaning(text):
    """The syntax of some lines, wherever they stand."""
    return ast.dump(ast.parse(dedent(text)))


def fault_of(one):
    """Why a break cannot be made or changes nothing, or nothing."""
    text = sound(one.file)
    if text.count(one.before) != 1:
        return "the text before does not occur once"
    first = 1 + text[: text.index(one.before)].count("\n")
    last = first + one.before.count("\n")
    holds = [(top, end) for top, end in parts(one.file) if top <= first and last <= end]
    top, end = min(holds, key=lambda part: part[1] - part[0])
    part = "".join(text.splitlines(keepends=True)[top - 1 : end])
    if meaning(part) == meaning(part.replace(one.before, one.after)):
        return "it changes no meaning"
    for test in one.tests:
        path, _, function = test.partition("::")
        if not (ROOT / path).exists() or function.partition("[")[0] not in sound(path):
            return f"there is no {test}"
    return ""


def test_each_break_can_be_made():
    in_order = sorted(breaks(), key=lambda one: one.file)  # `parts` keeps one file
    faults = {f"{one.file}: {one.what}": fault_of(one) for one in in_order}
    assert {name: fault for name, fault in faults.items() if fault} == {}


def test_each_break_is_another():
    found = breaks()
    assert len({(one.file, one.before, one.after) for one in found}) == len(found) >= 150
