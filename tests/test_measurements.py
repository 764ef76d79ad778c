"""The page of measurements is what its command makes of the committed results, and says what they
say.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Annotated

import pytest

from benchmarks.__main__ import add_argument, benchmarks, without_json
from benchmarks.measurements import PAGE, collected, page, run, table
from benchmarks.report import UNDETERMINED, Figure, Report, Results


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
    assert PAGE.read_text(encoding="utf-8") == page(collected()), (
        "docs/measurements.md is behind benchmarks/results; run `python -m benchmarks.measurements`"
    )


def test_every_benchmark_that_is_named_exists() -> None:
    commands = [result.command.split() for result in collected().values()]
    named = {words[3] for words in commands if words[:3] == ["python", "-m", "benchmarks"]}
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


def test_the_page_says_how_and_when_it_was_measured(results: Results) -> None:
    text = page({"example": results})
    assert "## Example\n\nWhat is measured.\n\n`python -m benchmarks render`\n" in text
    assert "a machine; 2026-11-22; commit 0123456; `example`" in text
    assert text.endswith("\n\nBy hand.\n")


def test_what_could_not_be_determined_misses_its_bound(capsys: pytest.CaptureFixture[str]) -> None:
    report = Report("Example", "", "python -m benchmarks render")
    report.add("growth", float("nan"), "%", 1)
    report.row("error", digits=2, bias=(-0.12345, "px", 0.1), worst=0.2)
    growth, bias, worst = report.results.figures
    assert growth.value == UNDETERMINED
    assert growth.is_missed
    assert (bias.value, bias.is_missed) == (-0.12, True)
    assert not worst.is_missed
    assert "error, bias" in capsys.readouterr().out


def test_what_was_measured_by_hand_is_not_run() -> None:
    with pytest.raises(ValueError, match="was not measured by a benchmark but by hand"):
        run("replay")
    with pytest.raises(
        ValueError, match="no results are named 'nothing'; there are analyze, coverage, crash, "
    ):
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
