"""Tables in the terminal, in files and pipes: of no width is anything cut."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from app.cli import analyze
from app.cli.terminal import print_rows, print_table
from app.records.study_results import Joint, Origin
from app.records.summary import Summary
from app.study.across_runs import Reduced
from app.study.analysis_plan import Plan
from app.study.analyzing import Analysed

NAN = float("nan")
NAME = "six-loads-of-the-paper-sample-B-second-repeat-1.4N.h5"
SUMMARY = Summary(
    1.3994, 3.1234e-3, 0.041e-3, 3.092e-3, 40.1, 0.03, 1.2534, 0.8956, 0.0004, 0.9, (0.89, 0.91),
    4.83e-6, law_mu=0.9312, law_mu_sd=0.0003, law_length_m=0.803e-6, law_length_sd_m=0.045e-6,
    young_modulus_pa=3.421e6, young_modulus_sd_pa=0.0321e6,
)  # fmt: skip
NOTHING = Joint()
ROWS = [["1.40", "3.12 ± 0.04 mm", "0.00036 ± 0.00012", NAME], ["0.1", "-", "", "a"]]
HEADINGS = ("P (N)", "a", "decay", "session")


def terminal(monkeypatch: pytest.MonkeyPatch, width: int) -> None:
    """From here on standard output is a terminal of that width."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", str(width))


def lines_of(text: str) -> list[str]:
    return re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines()


@pytest.mark.parametrize("width", [20, 30, 40, 57, 58, 60, 80, 99, 100, 101, 132, 400])
def test_a_terminal_of_any_width_cuts_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    terminal(monkeypatch, width)
    print_table(HEADINGS, ROWS, texts=("session",))
    lines = lines_of(capsys.readouterr().out)
    assert max(map(len, lines)) <= width
    assert "…" not in "".join(lines)
    whole = "".join("".join(lines).split())
    for heading in HEADINGS:
        assert "".join(heading.split()) in whole
    if width > 50:  # numbers stay in one line; narrower ones are wrapped
        for number in ROWS[0][:3]:
            assert any(number in line for line in lines), number
    left = NAME  # folded, with other cells between its parts
    for line in lines:
        part = line.split()[-1] if line.split() else ""
        while part and not left.startswith(part):
            part = part[1:]
        left = left[len(part) :]
    assert not left


@pytest.mark.parametrize("width", [20, 30, 40, 46, 47, 60, 80])
def test_rows_in_a_terminal_of_any_width_are_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    terminal(monkeypatch, width)
    row = ("Young's modulus of the block", "E", "3.421 ± 0.032 MPa")
    print_rows("", [row, ("state", "", "")])
    lines = lines_of(capsys.readouterr().out)
    assert max(map(len, lines)) <= width
    for text in row:
        left = "".join(text.split())
        for word in " ".join(lines).split():
            left = left.removeprefix(word)
        assert not left


def test_a_file_has_a_line_for_each_row(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(HEADINGS, [[*ROWS[0][:3], 8 * NAME]], texts=("session",))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [
        ["P", "(N)", "a", "decay", "session"],
        ["1.40", "3.12", "±", "0.04", "mm", "0.00036", "±", "0.00012", 8 * NAME],
    ]


def _printed(capsys: pytest.CaptureFixture[str], joint: Joint = NOTHING) -> list[str]:
    origin = Origin(NAME, "", "done", "", "")
    runs = [Reduced(origin, s) for s in (SUMMARY, replace(SUMMARY, law_length_m=0.02e-6))]
    found = Analysed(tuple(runs), joint)
    plan = Plan((), Path("six.h5"), {}, ())
    analyze._print(plan, found)
    return lines_of(capsys.readouterr().out)


def test_analyze_in_a_file_has_every_digit_and_unit(capsys: pytest.CaptureFixture[str]) -> None:
    joint = Joint(young_modulus_pa=3.43e6, young_modulus_sd_pa=0.03e6, decay=1e-6, decay_sd=8e-5)
    lines = _printed(capsys, joint)
    assert "1.40   3.12 ± 0.04 mm  1.2534 ± 0.0006 N  0.8956 ± 0.0004" in lines[1]
    assert lines[1].endswith(NAME)
    assert "0.80 ± 0.04 um" in "\n".join(lines)
    assert "not resolved, below 0.2 um" in "\n".join(lines)  # 0.02 + 2 x 0.045
    assert "not resolved, within ± 0.0002" in "\n".join(lines)
    assert "…" not in "\n".join(lines)


@pytest.mark.parametrize("width", [50, 70, 90, 120])
def test_analyze_in_a_terminal_is_as_wide_as_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    terminal(monkeypatch, width)
    lines = [line for line in _printed(capsys) if not line.startswith(("value ±", "results:"))]
    assert max(map(len, lines)) <= width
    for number in ("3.12 ± 0.04 mm", "1.2534 ± 0.0006 N", "0.80 ± 0.04 um", "3.421 ± 0.032 MPa"):
        assert any(number in line for line in lines), number
    assert "…" not in "".join(lines)
