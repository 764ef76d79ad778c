"""The page of measurements is what its command makes of the committed results, and says what they
say.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import Annotated

import msgspec
import pytest

from benchmarks import report
from benchmarks.__main__ import add_argument, benchmarks, without_json
from benchmarks.measurements import (
    OLDER,
    PAGE,
    collected,
    outdated,
    page,
    promises,
    run,
    section,
    table,
)
from benchmarks.report import UNDETERMINED, Figure, Report, Results, code_of


@pytest.fixture
def results() -> Results:
    figures = [
        Figure("fast", 0.5, "ms", "time"),
        Figure("fast", 0.05, "px", "error", at_most=0.03),
        Figure("slow", 1500, "ms", "time"),
        Figure("slow", 0.01, "px", "error", at_most=0.03),
    ]
    start = "Example", "What is measured.", "python -m benchmarks render", "a machine"
    return Results(*start, date(2026, 11, 22), "0123456", figures, ["By hand."])


def test_the_page_is_what_the_results_make() -> None:
    text = PAGE.read_text(encoding="utf-8")
    # what is older than its code is marked when the page is made, not at each change of the code
    rows = [row.split(" | ") for row in text.splitlines() if row.startswith("| ")]
    found = promises(collected())
    current = {row[4].strip("`") for row in rows[1:] if OLDER not in row[3]}
    older = {name for all_ in found.values() for name, _ in all_} - current
    assert text == page(collected(), sorted(older)), (
        "docs/measurements.md is behind benchmarks/results; run `python -m benchmarks.measurements`"
    )
    assert len(text.splitlines()) <= 120, "two pages"


def test_every_benchmark_that_is_named_exists() -> None:
    commands = [result.command.split() for result in collected().values()]
    assert all(words[:3] == ["python", "-m", "benchmarks"] for words in commands)
    named = {words[3] for words in commands}
    assert named <= set(benchmarks())
    assert len(named) > 10


def test_results_come_back_from_their_file(results: Results, tmp_path: Path) -> None:
    results.write(tmp_path / "example.json")
    assert collected(tmp_path) == {"example": results}


def test_another_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"subject": 1}')
    with pytest.raises(ValueError, match=r"other\.json: not a file of benchmark results"):
        collected(tmp_path)


def test_a_table_has_a_row_for_each_name_and_a_column_for_each_column(results: Results) -> None:
    assert table(results.figures).splitlines() == [
        "|  | time (ms) | error (px) | at most |",
        "| --- | --- | --- | --- |",
        "| fast | 0.5 | 0.05 **missed** | 0.03 px |",
        "| slow | 1,500 | 0.01 | 0.03 px |",
    ]


def test_a_result_says_how_and_when_it_was_measured(results: Results) -> None:
    text = "\n\n".join(section("example", results))
    assert text.startswith("`python -m benchmarks render`\n\n")
    assert "a machine; 2026-11-22; commit 0123456; `example`" in text
    assert text.endswith("\n\nBy hand.")


def test_the_page_has_the_worst_of_each_figure_with_a_bound(results: Results) -> None:
    better = msgspec.structs.replace(
        results, figures=[Figure("fast", -0.02, "px", "error", at_most=0.03)]
    )
    assert list(promises({"a": better, "b": results})) == [
        ("Example", "fast, error"),
        ("Example", "slow, error"),
    ]
    rows = page({"a": better, "b": results}).splitlines()
    assert [row for row in rows if row.startswith("| Example")] == [
        "| Example: fast, error | 0.05 px | 0.03 px | **missed** | `b` | a machine | 2026-11-22 |"
        " 0123456 |",
        "| Example: slow, error | 0.01 px | 0.03 px | kept | `b` | a machine | 2026-11-22 |"
        " 0123456 |",
    ]
    lost = [Figure("fast", UNDETERMINED, "px", "error", at_most=0.03)]
    worst = page({"a": msgspec.structs.replace(results, figures=lost), "b": better})
    assert "| Example: fast, error | not determined | 0.03 px | **missed** | `a`" in worst


def test_three_promises_that_are_alike_have_one_row_and_so_have_losses(results: Results) -> None:
    figures = [
        Figure(name, value, "px", "rms", at_most=bound)
        for name, value, bound in (("x", 1, 3), ("y", -2, 3), ("z", 1.5, 3), ("angle", 2.5, 4))
    ]
    figures += [Figure("frames lost", 0, at_most=2), Figure("samples lost", 1, at_most=2)]
    rows = page({"a": msgspec.structs.replace(results, figures=figures)}).splitlines()
    found = [row.split(" | ")[:3] for row in rows if row.startswith("| Example")]
    assert found == [
        ["| Example: y, rms, worst of 3", "-2 px", "3 px"],
        ["| Example: angle, rms", "2.5 px", "4 px"],
        ["| Example: samples lost, worst of 2", "1", "2"],
    ]


def test_a_result_that_is_older_than_its_code_counts_only_where_there_is_no_other(
    results: Results,
) -> None:
    better = msgspec.structs.replace(
        results, figures=[Figure("fast", -0.02, "px", "error", at_most=0.03)]
    )
    text = page({"a": better, "b": results}, ["b"])
    assert [row for row in text.splitlines() if row.startswith("| Example")] == [
        "| Example: fast, error | -0.02 px | 0.03 px | kept | `a` | a machine | 2026-11-22 |"
        " 0123456 |",
        f"| Example: slow, error | 0.01 px | 0.03 px | kept, **{OLDER}** | `b` | a machine |"
        " 2026-11-22 | 0123456 |",
    ]


def test_accuracy_speed_and_losses_are_tables_of_their_own(results: Results) -> None:
    figures = [Figure(*one, at_most=1) for one in (("L", 0.5, "%"), ("time", 0.5, "s"))]
    figures.append(Figure("frames lost", 0, at_most=0))
    command = "python -m benchmarks analyze"
    text = page({"a": msgspec.structs.replace(results, command=command, figures=figures)})
    topics = [part.splitlines() for part in text.split("\n## ")[1:]]
    assert [(lines[0], [row.split(" | ")[0] for row in lines[4:]]) for lines in topics] == [
        ("Accuracy", ["| Example: L"]),
        ("Speed", ["| Example: time"]),
        ("Robustness", ["| Example: frames lost"]),
    ]


def test_a_load_or_a_range_tells_runs_of_one_figure_apart(results: Results) -> None:
    figures = [
        Figure("0.2 to 0.3", 1.0, "px", "error", table="0.1 N", at_most=2.0),
        Figure("0.3 to 0.4", -1.5, "px", "error", table="0.5 N", at_most=2.0),
    ]
    found = promises({"a": msgspec.structs.replace(results, figures=figures)})
    assert {name: len(one) for (_, name), one in found.items()} == {"error": 2}
    row = next(r for r in page({"a": msgspec.structs.replace(results, figures=figures)}).split("\n")
               if "error" in r)  # fmt: skip
    assert "| -1.5 px | 2 px |" in row


def test_a_result_is_outdated_once_its_code_has_changed(results: Results) -> None:
    code = code_of("benchmarks.render")
    assert code != code_of("benchmarks.dic")
    current = msgspec.structs.replace(results, code=code)
    changed = msgspec.structs.replace(results, code=code[::-1])
    assert outdated({"a": current, "b": changed, "c": results}) == ["b", "c"]


@pytest.fixture
def code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., str]]:
    """The checksum of the module `app.first` once these modules were written, and others before."""
    monkeypatch.setattr(report, "ROOT", tmp_path)
    (tmp_path / "app").mkdir()

    def written(*measured: str, **files: str) -> str:
        for name, text in files.items():
            (tmp_path / "app" / f"{name}.py").write_text(text)
        report._read.cache_clear()
        return code_of("app.first", measured or ("",))

    yield written
    report._read.cache_clear()


def test_the_code_of_a_benchmark_is_all_that_it_rests_on(code: Callable[..., str]) -> None:
    first = code(
        first="from app.second import two\n", second="two = 2\n", third="x = 3\n", other="y = 1\n"
    )
    assert code(other="y = 2\n") == first
    assert code(second='"""The number two."""\ntwo = 2  # not three\n') == first
    assert code(second="two = 3\n") != first
    launched = code(second='two = ["-m", "app.third"]\n')
    assert code(third="x = 4\n") != launched


def test_only_what_a_benchmark_measures_makes_its_result_outdated(
    code: Callable[..., str],
) -> None:
    second = "from app.third import x\ntwo = 2\n"
    texts = {"first": "from app.second import two\n", "second": second}
    first = code("app.third", **texts, third='x = option(1, "The number", "m")')
    changed = {"second": second + "three = 3\n", "third": 'x = option(1, "A number", "m")'}
    assert code("app.third", **changed) == first
    assert code("app.third", third='x = option(2, "The number", "m")') != first


def test_what_could_not_be_determined_misses_its_bound(capsys: pytest.CaptureFixture[str]) -> None:
    made = Report("Example", "", "python -m benchmarks render")
    made.add("growth", float("nan"), "%", 1)
    made.row("error", digits=2, bias=(-0.12345, "px", 0.1), worst=0.2)
    growth, bias, worst = made.results.figures
    assert growth.value == UNDETERMINED
    assert growth.is_missed
    assert (bias.value, bias.is_missed) == (-0.12, True)
    assert not worst.is_missed
    assert "error, bias" in capsys.readouterr().out


def test_a_result_that_is_not_there_is_not_run() -> None:
    known = "there are analyze, calibrated-bench, calibrations, coverage, "
    with pytest.raises(ValueError, match=f"no results are named 'nothing'; {known}"):
        run("nothing")


def test_the_parameters_of_a_benchmark_are_its_command_line() -> None:
    def measure(
        report: Report,
        count: int = 3,
        parts: Annotated[Sequence[str], ("a", "b")] = (),
        *,
        set_: Sequence[str] = (),
        rate: float | None = None,
        is_fast: bool = False,
    ) -> None:
        pass

    parser = argparse.ArgumentParser(argument_default=argparse.SUPPRESS)
    for parameter in list(inspect.signature(measure, eval_str=True).parameters.values())[1:]:
        add_argument(parser, parameter)
    assert vars(parser.parse_args([])) == {"count": 3, "parts": ()}
    words = ["5", "a", "b", "--set", "x=1", "--set", "y=2", "--rate", "8", "--is-fast"]
    expected = {"count": 5, "parts": ["a", "b"], "set_": ["x=1", "y=2"], "rate": 8.0}
    assert vars(parser.parse_args(words)) == expected | {"is_fast": True}
    with pytest.raises(SystemExit):
        parser.parse_args(["5", "c"])
    assert without_json(["render", "--json", "f", "5", "--json=g"]) == ["render", "5"]
