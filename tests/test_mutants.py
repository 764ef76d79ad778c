"""The list of deliberate breaks stays true to the program: `python -m tests.mutants` tries them."""

import ast
from functools import cache
from types import CodeType

from tests.mutants.__main__ import ROOT, breaks

BREAKS = breaks()


@cache
def sound(file):
    """The text of a file."""
    return (ROOT / file).read_text(encoding="utf-8")


@cache
def statements(file):
    """First and last line of each statement of a module, with its decorators."""
    found = ast.parse(sound(file)).body
    first = [min([one.lineno, *(by.lineno for by in getattr(one, "decorator_list", ()))])
             for one in found]  # fmt: skip
    return [(line, one.end_lineno) for line, one in zip(first, found, strict=True)]


def meaning(part):
    """What Python makes of some statements, wherever they stand."""

    def of(code):
        held = [of(one) if isinstance(one, CodeType) else repr(one) for one in code.co_consts]
        return code.co_code, code.co_names, code.co_varnames, held

    return of(compile(part, "", "exec", dont_inherit=True))


def fault_of(one):
    """Why a break cannot be made or changes nothing, or nothing."""
    text = sound(one.file)
    if text.count(one.before) != 1:
        return "the text before does not occur once"
    first = text[: text.index(one.before)].count("\n") + 1
    last = first + one.before.count("\n")
    touched = [lines for lines in statements(one.file) if lines[0] <= last and lines[1] >= first]
    if not touched:
        return "it changes no statement"
    lines = text.splitlines(keepends=True)
    part = "".join(lines[min(first, touched[0][0]) - 1 : max(last, touched[-1][1])])
    if meaning(part) == meaning(part.replace(one.before, one.after)):
        return "it changes no meaning"
    for test in one.tests:
        path, _, function = test.partition("::")
        named = sound(path) if function and (ROOT / path).exists() else ""
        if not (ROOT / path).exists() or function.partition("[")[0] not in named:
            return f"there is no {test}"
    return ""


def test_each_break_can_be_made():
    faults = {f"{one.file}: {one.what}": fault_of(one) for one in BREAKS}
    assert {name: fault for name, fault in faults.items() if fault} == {}


def test_each_break_is_another():
    assert len({(one.file, one.before, one.after) for one in BREAKS}) == len(BREAKS) >= 150
