"""The list of deliberate breaks stays true to the program: `python -m tests.mutants` tries them."""

import ast
from functools import cache

import pytest

from tests.mutants.__main__ import ROOT, breaks

BREAKS = breaks()


@cache
def sound(file):
    """The text of a file, and what Python makes of it."""
    text = (ROOT / file).read_text(encoding="utf-8")
    return text, ast.dump(ast.parse(text))


@pytest.mark.parametrize("one", BREAKS, ids=lambda one: f"{one.file}: {one.what}")
def test_a_break_can_be_made(one):
    text, meaning = sound(one.file)
    assert text.count(one.before) == 1
    assert ast.dump(ast.parse(text.replace(one.before, one.after))) != meaning
    for test in one.tests:
        path, _, function = test.partition("::")
        assert (ROOT / path).exists()
        assert function.partition("[")[0] in (ROOT / path).read_text("utf-8") if function else True


def test_each_break_is_another():
    assert len({(one.file, one.before, one.after) for one in BREAKS}) == len(BREAKS) >= 150
