"""What the window says of a protocol."""

from __future__ import annotations

from dataclasses import replace

from app.gui.cells import operator_sentence
from app.records.bench_view import Health
from app.records.record_types import Counts
from app.settings import config

STEPS = '{do="approach"}, {do="reference"}, {do="drive"}, {do="hold", time=9}'
HEALTH = Health("running", "", "drive", Counts(), 0.0, 4.0, 1 << 40, 0, 0.5)


def sentence(steps: str = STEPS, **health: object) -> str:
    settings = config.load(None, [f"run.steps=[{steps}]"] if steps else [])
    return operator_sentence(replace(HEALTH, **health), None, 0.5, 20e-6, settings)


def test_the_step_and_the_time_left_are_shown() -> None:
    now = sentence(step="4 of 5: hold for 9 s", left_s=4.2, all_left_s=44.0)
    assert now == "Step 4 of 5: hold for 9 s; 4 s left, 44 s of all."
    assert sentence(step="1 of 5: approach to 0.5 N") == "Step 1 of 5: approach to 0.5 N."
    assert sentence(step="4 of 5: drive -20 um at 5 um/s").endswith("drive −20 µm at 5 µm/s.")
    # without steps it says what it always said
    assert "The actuator pulls at" in sentence("", step="4 of 4: drive", left_s=3.0)


def test_a_question_comes_first() -> None:
    now = sentence(step="2 of 5: ask: Dry?", question="Dry?", reason="Dry? (answer to go on)")
    assert now.startswith("Dry? (F8 answers yes")
    paused = "the run is paused before step 5: drive 9 um at 5 um/s; answer to go on"
    assert sentence(step="4 of 5: drive 100 um at 5 um/s", question=paused) == (
        "The run is paused before step 5: drive 9 µm at 5 µm/s; answer to go on"
        " (F8 answers yes; step 4 of 5)"
    )
