"""A study can be left and taken up again, and continues no results but its own; its front is what
no other variant beats.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from app.system.errors import UserError
from app.tradeoff import study
from app.tradeoff.study import Study, Variant


class Counter:
    """Measures by counting; stops at the variant `fails` as Ctrl-C does."""

    def __init__(self, fails: str = "") -> None:
        self.measured: list[str] = []
        self.fails = fails

    def measure(self, variant: Variant) -> dict[str, float]:
        if variant.name == self.fails:
            raise KeyboardInterrupt
        self.measured.append(variant.name)
        return {"cost": float(len(variant.name)), "error": math.nan if variant.name == "b" else 2.5}


def made(counter: Counter, **about: object) -> Study:
    variants = tuple(Variant(name, "all", {"box": 20}) for name in "abcd")
    columns = {"cost": "cost", "error": "error"}
    return Study("things", about, columns, "cost", ("error",), variants, counter.measure)


def test_an_interrupted_study_goes_on_where_it_was_left(tmp_path: Path) -> None:
    file = tmp_path / "trade.json"
    first, second = Counter(fails="c"), Counter()
    with pytest.raises(KeyboardInterrupt):
        study.run(made(first), file, overwrite=False)
    shares: list[float] = []
    found = study.run(made(second), file, False, lambda text, share: shares.append(share))
    assert (first.measured, second.measured) == (["a", "b"], ["c", "d"])
    assert list(found) == ["a", "b", "c", "d"]
    assert math.isnan(found["b"]["error"])
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["trade.json"]
    held = json.loads(file.read_text())
    assert [row["name"] for row in held["variants"]] == ["a", "b", "c", "d"]
    assert held["variants"][1]["error"] is None


def test_another_choice_of_variants_keeps_those_that_were_measured_before(tmp_path: Path) -> None:
    file, counter = tmp_path / "trade.json", Counter()
    whole = made(counter)
    for first, last in ((0, 3), (3, 4), (0, 1)):
        chosen = replace(whole, variants=whole.variants[first:last])
        assert list(study.run(chosen, file, False)) == [*"abcd"][first:last]
    assert counter.measured == [*"abcd"]
    rows = json.loads(file.read_text())["variants"]
    assert [row["name"] for row in rows] == [*"abcd"]
    assert all(row["settings"] == {"box": 20} for row in rows)


def test_results_of_another_texture_or_computer_are_refused(tmp_path: Path) -> None:
    file, counter = tmp_path / "trade.json", Counter()
    study.run(made(counter, texture="coarse"), file, overwrite=False)
    before = file.read_bytes()
    with pytest.raises(UserError, match=r"another texture \(coarse, now fine\).*--overwrite"):
        study.run(made(counter, texture="fine"), file, overwrite=False)
    held = json.loads(before)
    held["about"]["processor"] = "abacus"
    file.write_text(json.dumps(held))
    with pytest.raises(UserError, match=r"another processor \(abacus"):
        study.run(made(counter, texture="coarse"), file, overwrite=False)
    again = Counter()
    study.run(made(again, texture="coarse"), file, overwrite=True)
    assert again.measured == list("abcd")
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[1]", '{"about": 3, "variants": []}', '{"about": {}, "variants": [{"name": "a"}]}'],
)
def test_a_file_of_something_else_is_left_alone(tmp_path: Path, text: str) -> None:
    file = tmp_path / "trade.json"
    file.write_text(text)
    with pytest.raises(UserError, match="not the results of"):
        study.run(made(Counter()), file, overwrite=False)
    assert file.read_text() == text


def test_the_front_is_what_no_other_beats() -> None:
    rng = np.random.default_rng(4)
    found = {
        f"{n}": dict(zip("abc", map(float, values), strict=True))
        for n, values in enumerate(rng.integers(0, 6, (60, 3)))
    }
    found["0"]["a"] = math.nan
    best = set(study.front(found, ("a", "b", "c")))
    beaten = set()
    for (name, f), g in product(found.items(), found.values()):
        one, other = ([x["abc"[k]] for k in range(3)] for x in (f, g))
        one, other = ([math.inf if math.isnan(x) else x for x in p] for p in (one, other))
        if all(o <= p for o, p in zip(other, one, strict=True)) and other != one:
            beaten.add(name)
    assert best == set(found) - beaten
    assert best


def test_a_better_variant_is_no_variant_of_the_same_study() -> None:
    a, b = (made(Counter(), texture="x"), made(Counter(), texture="x"))
    assert a.identity() == replace(b, variants=()).identity()
