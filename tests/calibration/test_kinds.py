"""What holds for all calibrations."""

import inspect
from pathlib import Path

import pytest

from app.calibrations.kinds import KINDS

MOST_LINES = 150


@pytest.mark.parametrize("name", KINDS)
def test_a_calibration_costs_less_than_150_lines(name):
    module = Path(inspect.getfile(type(KINDS[name])))
    assert len(module.read_text(encoding="utf-8").splitlines()) < MOST_LINES, (
        "find what it shares with the others, and give that one place"
    )


def test_each_calibration_says_whether_several_files_are_one_measurement():
    several = {name for name, one in KINDS.items() if one.takes_several}
    assert {*KINDS} - several == {"actuator", "compliance", "dic-noise", "adhesion"}
