"""The list of deliberate breaks stays true to the program: `python -m tests.mutants` tries them."""

import ast
from functools import cache, lru_cache

from tests.mutants.__main__ import ROOT, breaks

BREAKS = sorted(breaks(), key=lambda one: one.file)


@cache
def sound(file):
    """The text of a file."""
    return (ROOT / file).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def parsed(file):
    """The syntax tree of a file; the breaks of one file follow one another."""
    return ast.parse(sound(file))


def meaning(tree, first, last):
    """The statements of a module from a line to another one; a decorator is above its own."""
    end = last + 1
    return [ast.dump(one) for one in tree.body if one.end_lineno >= first and one.lineno <= end]


def fault_of(one):
    """Why a break cannot be made or changes nothing, or nothing."""
    text = sound(one.file)
    if text.count(one.before) != 1:
        return "the text before does not occur once"
    first = 1 + text[: text.index(one.before)].count("\n")
    last = first + one.before.count("\n")
    changed = ast.parse(text.replace(one.before, one.after))
    if meaning(parsed(one.file), first, last) == meaning(changed, first, last):
        return "it changes no meaning"
    for test in one.tests:
        path, _, function = test.partition("::")
        if not (ROOT / path).exists() or function.partition("[")[0] not in sound(path):
            return f"there is no {test}"
    return ""


def test_each_break_can_be_made():
    faults = {f"{one.file}: {one.what}": fault_of(one) for one in BREAKS}
    assert {name: fault for name, fault in faults.items() if fault} == {}


def test_each_break_is_another():
    assert len({(one.file, one.before, one.after) for one in BREAKS}) == len(BREAKS) >= 150
