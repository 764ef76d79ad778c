"""The experiment panel: the steps of the protocol as they stand, the bands, and the key that goes
on.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from scripted_run import BACKGROUND, REFERENCE, P, ScriptedRun
from window_hands import click, look, shown

from app.gui.cells import Tone
from app.gui.experiment_panel import ExperimentPanel
from app.gui.run_steps import RunSteps, StepStatus, band_gauge, planned, run_steps
from app.gui.source import setup_of
from app.gui.view_state import ViewState
from app.gui.window_model import WindowModel
from app.records.bench_view import Health
from app.records.record_types import Conditions, Counts, End, Outcome, Phase
from app.settings.config import load
from app.settings.protocol_steps import Approach
from app.settings.sections import Config

DONE, NOW, COMES = StepStatus.DONE, StepStatus.UNDER_WAY, StepStatus.TO_COME
HEALTH = Health("running", "", "contact", Counts(), 0.0, 4.0, 1 << 40, 0, 0.5)
ASKS = (
    'run.steps=[{do="background"}, {do="ask", question="Is it dry?"}, {do="approach"},'
    ' {do="reference"}, {do="drive"}]'
)


def steps_of(
    config: Config, outcome: Outcome | None = None, before: RunSteps | None = None, **health: object
) -> RunSteps:
    number = int(str(health.get("step", 0))[0])
    state = replace(HEALTH, step_number=number, **health)
    return run_steps(config, state, outcome, None, (0.31, 0.002), before)


def test_the_steps_stand_as_the_run_says() -> None:
    config = load(None, (ASKS,))
    assert [line.standing for line in planned(config).lines] == [COMES] * 5
    now = steps_of(config, step="3 of 5: approach to 0.5 N", left_s=math.nan, all_left_s=44.0,
                   reason="press the contact to 0.5 N (P is 0.310 N)")  # fmt: skip
    assert [line.standing for line in now.lines] == [DONE, DONE, NOW, COMES, COMES]
    assert now.lines[2].note == "press the contact to 0.5 N (P is 0.310 N)"
    assert now.lines[4].text == "drive 190 um at 5 um/s"
    assert (now.waits, now.acts, now.left) == (True, "Waits for the load", "44 s left")
    hold = steps_of(config, step="5 of 5: drive", phase="drive", left_s=12.4, all_left_s=12.4)
    assert hold.lines[4].note == "12 s left"
    ends = steps_of(config, step="5 of 5: drive", state="stopping", left_s=12.4, all_left_s=20.0)
    assert (ends.lines[4].note, ends.left) == ("", "")
    assert ends.acts == "The run comes to its end"


@pytest.mark.parametrize(
    ("end", "reason", "standings"),
    [
        (End.COMPLETE, "the drive of 190 um is complete", [DONE] * 4),
        (End.STOPPED, "the operator ended the run", [DONE, StepStatus.STOPPED, COMES, COMES]),
        (End.FAILED, "contact: not ready", [DONE, StepStatus.FAILED, COMES, COMES]),
    ],
)
def test_the_end_of_a_run_stands_at_its_step(
    end: End, reason: str, standings: list[StepStatus]
) -> None:
    before = steps_of(Config(), step="2 of 4: approach to 0.5 N")
    outcome = Outcome(end, reason, Counts(), None)
    ended = steps_of(Config(), outcome, before, state=outcome.state)
    assert [line.standing for line in ended.lines] == standings
    assert reason.replace("um", "µm") in (ended.lines[1].note, ended.lines[3].note)
    assert not ended.waits


def test_the_bands_are_those_of_the_settings() -> None:
    config = load(None, ("run.settle_tolerance=0.04", "run.shear_tolerance=0.01"))
    load_band, shear = steps_of(config, step="2 of 4: approach to 0.5 N").bands
    assert load_band.band == pytest.approx((0.48, 0.52))
    assert load_band.tone is Tone.WARN
    assert shear.band == pytest.approx((-0.0031, 0.0031))
    assert shear.tone is Tone.GOOD
    (free,) = steps_of(config, step="1 of 4: background, 1 s").bands
    assert free.band[1] == pytest.approx(0.05 * 0.5)
    assert not steps_of(config, step="4 of 4: drive 190 um at 5 um/s").bands
    other = load(None, ('run.steps=[{do="approach", normal_force=1.2}, {do="reference"},'
                        ' {do="drive"}]',))  # fmt: skip
    assert isinstance(other.run.steps[0], Approach)
    assert steps_of(other, step="1 of 3: approach to 1.2 N").bands[0].band[1] > 1.2


@pytest.mark.parametrize("value", [-1.0, 0.0, 0.5, 9.0])
def test_a_band_is_drawn_whole(value: float) -> None:
    gauge = band_gauge("P", "normal", value, 0.49, 0.51)
    assert gauge.low <= 0 < gauge.band[0] < gauge.band[1] < gauge.high


class Asking(ScriptedRun):
    """Its steps and its question as the protocol has them."""

    def __init__(self) -> None:
        super().__init__(320, 240, frames=60)
        self.config = load(None, (ASKS,))
        self.answers: list[str] = []

    def answer(self, text: str, question: str = "") -> None:
        assert question == "Is it dry?"
        self.answers.append(text)

    def health(self) -> Health:
        health, steps = super().health(), self.config.run.protocol
        if not self.started:
            return health
        asks = self.frame >= BACKGROUND and not self.answers
        number = (
            1 if self.frame < BACKGROUND else 2 if asks else 3 if self.frame < REFERENCE - 4
            else 4 if self.frame < REFERENCE else 5
        )  # fmt: skip
        return replace(
            health,
            step=f"{number} of 5: {steps[number - 1]}",
            step_number=number,
            question="Is it dry?" if asks else "",
            all_left_s=(60 - self.frame) / 8,
        )


@pytest.fixture
def model() -> WindowModel:
    return WindowModel(None, load(None, (ASKS,)))  # type: ignore[arg-type]


@pytest.fixture
def panel(qtbot: QtBot, model: WindowModel) -> ExperimentPanel:
    return shown(qtbot, ExperimentPanel(model), 360, 640)


def standings(panel: ExperimentPanel) -> str:
    return "".join(row.mark.text() for row in panel.rows if row.text.isVisible())


def test_a_run_from_start_to_end(qtbot: QtBot, panel: ExperimentPanel, model: WindowModel) -> None:
    run = Asking()
    view: list[ViewState | None] = [None]

    def show(frame: int) -> None:
        view.append(look(run.at(frame), view[-1]))
        panel.show_view(view[-1])

    model.begin_asked.connect(run.start)
    model.begin_asked.connect(lambda: model.set_busy(True))
    model.ordered.connect(lambda _, act: act(run))

    assert standings(panel) == "○○○○○"
    assert panel.button.text() == "Start (F5) begins it"
    click(qtbot, panel.button)
    assert not run.started  # Start is in one place, above all panels
    model.begin_asked.emit()
    assert run.started
    panel.show_setup(setup_of(run))
    assert not panel.button.isEnabled()

    show(4)
    assert standings(panel) == "▶○○○○"
    assert panel.button.text() == "The block hangs free …"
    assert [band.isVisible() for band in panel.bands] == [True, False]

    show(BACKGROUND)
    assert standings(panel) == "✓▶○○○"
    assert panel.question.text() == "Is it dry?"
    assert panel.button.text() == "Answer and go on  F8 or Enter"
    assert "Is it dry? (F8 answers yes" in panel.sentence.text()
    assert panel.answer.hasFocus()
    qtbot.keyClicks(panel.answer, "quite")
    qtbot.keyClick(panel.answer, Qt.Key.Key_Return)
    assert run.answers == ["quite"]

    show(BACKGROUND + 4)
    assert standings(panel) == "✓✓▶○○"
    assert not panel.answer.isVisible()
    assert [band.isVisible() for band in panel.bands] == [True, True]
    assert panel.bands[0].text.text() == "0.200 N"  # on its way from 0 to P
    assert panel.bands[0].gauge.tone is Tone.WARN
    show(BACKGROUND + 10)
    assert panel.bands[0].gauge.value == pytest.approx(P, abs=0.003)
    assert panel.bands[0].gauge.tone is Tone.GOOD
    assert panel.bands[1].text.text().endswith(" mN")

    show(50)
    assert standings(panel) == "✓✓✓✓▶"
    assert not panel.bands[0].isVisible()
    assert panel.left.text().startswith("1 s left")

    show(60)
    model.set_busy(False)
    assert standings(panel) == "✓✓✓✓✓"
    assert panel.button.text() == "Start (F5) begins the next run"
    assert not panel.button.isEnabled()


def test_the_button_answers_yes(qtbot: QtBot, panel: ExperimentPanel, model: WindowModel) -> None:
    run = Asking()
    run.start()
    model.ordered.connect(lambda _, act: act(run))
    panel.show_view(look(run.at(BACKGROUND)))
    click(qtbot, panel.button)
    assert run.answers == ["yes"]


def test_what_is_typed_is_no_answer_to_the_next_question(
    qtbot: QtBot, panel: ExperimentPanel, model: WindowModel
) -> None:
    run = Asking()
    run.start()
    view = look(run.at(BACKGROUND))
    panel.show_view(view)
    qtbot.keyClicks(panel.answer, "dusty")
    answered_elsewhere = replace(view, steps=replace(view.steps, question="Is it clean?"))
    panel.show_view(answered_elsewhere)
    assert panel.answer.isVisible()
    assert panel.answer.text() == ""


def test_steps_of_the_next_run_follow_the_settings(
    panel: ExperimentPanel, model: WindowModel
) -> None:
    model.set_config(load(Path("cyclic-shear")))
    assert panel.rows[4].text.text() == "5  reverse 6 times at 10 µm/s"
    model.set_config(Config())
    assert standings(panel) == "○○○○"


def test_a_replay_of_an_older_session_goes_by_its_phases() -> None:
    run = ScriptedRun(320, 240, frames=60)
    run.start()
    assert [look(run.at(n)).steps.number for n in (3, 12, 22, 50)] == [1, 2, 3, 4]


def test_a_replay_goes_by_the_steps_of_its_frames() -> None:
    frame = Conditions(Phase.CONTACT, math.nan, 0.3, 0.0, 0.0, step=3)
    now = run_steps(load(None, (ASKS,)), HEALTH, None, frame, (0.3, 0.0), None)
    assert now.number == 3  # by its phase alone it would be step 2
    assert now.acts == "Waits for the load"
