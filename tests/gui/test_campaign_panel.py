"""The campaign in the window: its runs, the next one, what is kept, and the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from short_run import SMALL
from window_hands import click, shown

from app.campaigns.page import PAGE
from app.campaigns.plan import Campaign
from app.campaigns.state import FoundSession
from app.gui import campaign_lines
from app.gui.campaign_panel import FRICTION, NUMBER, STATE, CampaignPanel
from app.gui.run_factory import RunFactory
from app.gui.window_model import WindowModel
from app.session.reader import SessionReader
from app.settings import config
from app.settings.config import settings_of
from app.settings.sections import AboutSettings, Config
from app.system.durations import duration


def as_toml(setting: str) -> str:
    """A setting as the command line takes it, as a line of a campaign: its words are quoted."""
    name, _, value = setting.partition("=")
    return setting if value[0].isdigit() else f'{name} = "{value}"'


THREE = f"""
name = "loads"
sessions = "{{name}}-{{load:.2f}}N"

[settings]
{chr(10).join(as_toml(one) for one in SMALL if "normal" not in one)}
recording.results = "forces"
run.velocity = 30

[[runs]]
run.normal_force = 0.1
[[runs]]
run.normal_force = 0.11
limits.shear_force = 0.01
[[runs]]
run.normal_force = 0.12
"""


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WindowModel:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loads.toml").write_text(THREE)
    return WindowModel(RunFactory(lambda _: None, pace=None), Config())


@pytest.fixture
def panel(qtbot: QtBot, model: WindowModel) -> CampaignPanel:
    return shown(qtbot, CampaignPanel(model), 340, 500)


def opened(qtbot: QtBot, panel: CampaignPanel) -> CampaignPanel:
    panel.open(Path("loads.toml"))
    qtbot.waitUntil(lambda: panel.lines is not None)
    return panel


def column(panel: CampaignPanel, at: int) -> list[str]:
    items = (panel.list.topLevelItem(n) for n in range(panel.list.topLevelItemCount()))
    return [item.text(at) for item in items]


def test_a_campaign_that_is_only_open_writes_nothing_after_another_run(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path
) -> None:
    before = opened(qtbot, panel).lines
    model.set_busy(True, is_live=True)
    model.set_busy(False)
    model.ended.emit(None)
    qtbot.waitUntil(lambda: panel.lines is not before)
    assert column(panel, STATE) == ["waiting"] * 3
    assert [one.name for one in tmp_path.iterdir()] == ["loads.toml"]


def test_the_runs_of_a_campaign_and_the_next_one(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path, said: list[str]
) -> None:
    assert not panel.next.isEnabled()
    opened(qtbot, panel)
    assert column(panel, STATE) == ["waiting"] * 3
    assert panel.sentence.text().startswith("0 of 3 runs done, about ")
    assert not (tmp_path / "loads").exists()  # to look writes nothing
    assert panel.next.text() == "Next: run 1, loads-0.10N"
    click(qtbot, panel.next)
    qtbot.waitUntil(lambda: model.session is not None)
    assert model.session == Path("loads") / "loads-0.10N.h5"
    assert (model.config.run.normal_force, model.config.run.travel) == pytest.approx((0.1, 60e-6))
    assert column(panel, NUMBER) == ["▶ 1", "2", "3"]
    assert panel.next.text() == "run 1, loads-0.10N is what Start (F5) begins"
    assert not panel.next.isEnabled()  # Start is in one place only
    assert column(panel, STATE) == ["waiting"] * 3
    model.set_busy(True, is_live=True)
    assert column(panel, STATE) == ["under way", "waiting", "waiting"]
    assert panel.next.text() == "run 1, loads-0.10N is under way"
    assert not panel.next.isEnabled()
    assert said == ["Start (F5) begins run 1 of 3, loads-0.10N: P = 0.1 N, 30 µm/s."]
    assert (tmp_path / "loads" / PAGE).exists()
    assert (tmp_path / "loads" / "campaign.toml").exists()


def test_the_copy_beside_the_sessions_goes_on_with_them(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    opened(qtbot, panel)
    panel.take(panel.lines.runs[2])
    qtbot.waitUntil(lambda: model.session is not None)
    panel.lines = None
    panel.open(Path("loads") / "campaign.toml")
    qtbot.waitUntil(lambda: panel.lines is not None)
    assert panel.lines.runs[2].planned.session == Path("loads") / "loads-0.12N.h5"


def test_a_replay_is_no_run_of_the_campaign(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    opened(qtbot, panel)
    click(qtbot, panel.next)
    qtbot.waitUntil(lambda: column(panel, NUMBER)[0] == "▶ 1")
    panel.unattended.setChecked(True)
    model.set_busy(True)
    assert column(panel, STATE) == ["waiting"] * 3
    assert panel.next.text() == "run 1, loads-0.10N is what Start (F5) begins"
    before = panel.lines
    model.ended.emit(None)
    model.set_busy(False)
    qtbot.waitUntil(lambda: panel.lines is not before)
    assert panel.unattended.isChecked()  # nothing of the campaign has ended


def run_it(model: WindowModel) -> None:
    """Make the next run, as the window does: the own settings are back once it is made."""
    source: Any = model.factory.run(model.config, model.session)
    model.set_busy(True, is_live=True)
    source.start()
    assert source.wait(60) is not None
    model.ended.emit(source)
    model.set_busy(False)


def begins_when_asked(model: WindowModel) -> list[str]:
    """Let the model run what it is asked to, as the window does; the names of what was run."""
    run: list[str] = []

    def begin() -> None:
        run.append(model.session.stem)
        run_it(model)

    model.begin_asked.connect(begin)
    return run


def taken_unattended(qtbot: QtBot, panel: CampaignPanel, model: WindowModel) -> list[str]:
    """Take the first run of a campaign that is to go on by itself; what is run from then on."""
    opened(qtbot, panel)
    run = begins_when_asked(model)
    panel.unattended.setChecked(True)
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: model.session is not None)
    return run


@pytest.mark.slow
def test_unattended_all_runs_are_done_and_friction_is_drawn_against_the_load(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path
) -> None:
    text = THREE.replace("limits.shear_force = 0.01\n", "").replace('= "forces"', '= "fields"')
    text = text.replace("velocity = 30", "velocity = 5")  # slow enough for the onset to be seen
    for whole, part in (("width=480", 320), ("height=360", 240), ("pixel=16", 24)):
        text = text.replace(whole, f"{whole.partition('=')[0]}={part}")
    (tmp_path / "loads.toml").write_text(text)
    opened(qtbot, panel)
    run = begins_when_asked(model)
    click(qtbot, panel.unattended)
    assert panel.unattended.isChecked()
    click(qtbot, panel.next)
    qtbot.waitUntil(lambda: column(panel, NUMBER)[0] == "▶ 1")
    assert not run  # the first one is begun by hand
    model.begin_asked.emit()
    qtbot.waitUntil(lambda: column(panel, STATE) == ["done"] * 3, timeout=120_000)
    assert run == ["loads-0.10N", "loads-0.11N", "loads-0.12N"]
    assert panel.next.text() == "All is done"
    assert not panel.unattended.isChecked()  # the next run is none of them
    static = panel.lines.friction.lines[0]
    np.testing.assert_allclose(static.x, [0.1, 0.11, 0.12], rtol=0.1)
    summaries = [one.found.summary for one in panel.lines.runs]
    np.testing.assert_allclose(static.y, [one.mu_s for one in summaries])
    assert all(
        text.split()[0] == f"{y:.3f}"[: len(text.split()[0])]
        for text, y in zip(column(panel, FRICTION), static.y, strict=True)
    )


def test_stop_ends_a_campaign_that_goes_on_by_itself(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    run = taken_unattended(qtbot, panel, model)
    model.begin_asked.emit()
    model.stop_pressed.emit()  # while the next one is taken
    assert not panel.unattended.isChecked()
    qtbot.waitUntil(lambda: column(panel, STATE)[0] == "done")
    qtbot.wait(500)
    assert run == ["loads-0.10N"]


def test_a_run_that_was_not_brought_to_its_end_ends_it_as_well(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, said: list[str]
) -> None:
    opened(qtbot, panel)
    panel.unattended.setChecked(True)
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: model.session is not None)
    said.clear()
    model.set_busy(True, is_live=True)
    model.ended.emit(None)  # without a session
    model.set_busy(False)
    qtbot.waitUntil(lambda: not panel.unattended.isChecked())
    assert said == ["Campaign: the campaign waits: run 1 was not brought to its end."]


def test_a_campaign_that_waits_for_the_operator_does_not_go_on_by_itself(
    qtbot: QtBot, panel: CampaignPanel, tmp_path: Path
) -> None:
    (tmp_path / "loads.toml").write_text("pauses = true\n" + THREE)
    opened(qtbot, panel)
    assert not panel.unattended.isEnabled()
    assert "pauses = true" in panel.unattended.toolTip()
    assert "and the operator's time" in panel.sentence.text()


def test_a_campaign_is_planned_in_the_window(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path
) -> None:
    model.set_config(config.load(None, ["run.travel=70", "about.operator=Ann", "sim.seed=7"]))
    click(qtbot, panel.new)
    form = panel.form
    qtbot.keyClicks(form.loads, "0,1 0.3; 0.5")
    qtbot.keyClicks(form.samples, "A; B 2")
    form.repeats.setValue(2)
    panel.make(tmp_path / "mine.toml")
    qtbot.waitUntil(lambda: panel.lines is not None)
    assert not form.isVisible()
    plan = panel.lines.plan
    assert (plan.name, len(plan.runs), plan.pauses) == ("mine", 12, False)
    first, last = plan.runs[0], plan.runs[-1]
    assert [run.config.run.normal_force for run in plan.runs[:5]] == [0.1, 0.1, 0.3, 0.3, 0.5]
    assert (first.config.about.sample, last.config.about.sample) == ("A", "B 2")
    assert first.config.run.travel == pytest.approx(70e-6)
    assert first.config.about.operator == "Ann"
    assert [run.config.sim.seed for run in plan.runs[:2]] == [7, 8]
    assert first.session == Path("mine") / "mine-1-0.1N.h5"


def test_a_campaign_has_the_protocol_of_the_set_up(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path
) -> None:
    model.set_config(config.load(Path("cyclic-shear")))
    panel.form.loads.setText("0.4 0.5")
    panel.make(tmp_path / "cycles.toml")
    qtbot.waitUntil(lambda: panel.lines is not None)
    steps = [run.config.run.steps for run in panel.lines.plan.runs]
    assert steps == [model.config.run.steps] * 2
    assert len(steps[0]) > 4


@pytest.mark.parametrize(
    ("loads", "told"), [("0.1 x", "Loads: 'x' is no number"), ("0.1 90", "run.normal_force")]
)
def test_a_plan_that_can_not_be_run_is_no_file(
    qtbot: QtBot,
    panel: CampaignPanel,
    model: WindowModel,
    tmp_path: Path,
    loads: str,
    told: str,
    said: list[str],
) -> None:
    panel.form.loads.setText(loads)
    panel.make(tmp_path / "mine.toml")
    qtbot.waitUntil(lambda: bool(said))
    assert told in said[0]
    assert sorted(path.name for path in tmp_path.glob("*.toml")) == ["loads.toml"]


def test_runs_are_told_by_their_sessions_and_a_failed_one_is_repeated(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path, said: list[str]
) -> None:
    opened(qtbot, panel)
    for number, state in ((1, "done"), (2, "failed")):
        click(qtbot, panel.next)
        qtbot.waitUntil(lambda n=number: column(panel, NUMBER)[n - 1] == f"▶ {n}")
        run_it(model)
        qtbot.waitUntil(lambda n=number, s=state: column(panel, STATE)[n - 1] == s)
    assert panel.sentence.text().startswith("1 of 3 runs done, 1 failed, about ")
    assert panel.next.text() == "Next: run 3, loads-0.12N"
    assert '<tr class="failed">' in (tmp_path / "loads" / PAGE).read_text(encoding="utf-8")

    panel.list.setFocus()
    panel.list.setCurrentItem(panel.list.topLevelItem(1))
    assert "run 2 of 3, loads-0.11N: P = 0.11 N" in panel.about.text()
    assert "limits.shear_force is 0.01 N" in panel.about.text()
    qtbot.keyClick(panel.list, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: column(panel, NUMBER)[1] == "▶ 2")
    assert column(panel, STATE) == ["done", "waiting", "waiting"]
    assert model.session == Path("loads") / "loads-0.11N.h5"
    assert not model.session.exists()
    assert (tmp_path / "loads" / "kept" / "loads-0.11N.h5").exists()

    said.clear()
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: bool(said))
    assert said == ["Campaign: run 1, loads-0.10N: it is done; choose another run"]


def test_a_campaign_that_can_not_be_read_gives_a_sentence(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, tmp_path: Path, said: list[str]
) -> None:
    opened(qtbot, panel)
    (tmp_path / "loads.toml").write_text("[vary]\nrun.normal_force = [50]")
    panel.open(Path("loads.toml"))
    qtbot.waitUntil(lambda: bool(said))
    assert said[0].startswith("Campaign: loads.toml, run 1: run.normal_force must be")
    assert column(panel, STATE) == ["waiting"] * 3
    panel.open_button.menu().aboutToShow.emit()
    assert "Campaign six-loads" in [act.text() for act in panel.open_button.menu().actions()]


@pytest.mark.parametrize(
    ("seconds", "words"), [(42.4, "42 s"), (720.0, "12 min"), (9000.0, "2.5 h")]
)
def test_times_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_a_run_of_the_campaign_leaves_the_set_up_of_the_operator(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    mine = replace(Config(), about=AboutSettings(sample="mine", operator="Ada", note="dry"))
    model.set_config(mine)
    model.set_session(Path("mine.h5"))
    opened(qtbot, panel)
    click(qtbot, panel.next)
    qtbot.waitUntil(lambda: model.is_lent)
    assert model.config.run.normal_force == pytest.approx(0.1)
    assert model.config.about == AboutSettings(operator="Ada")  # in the session of the run, too
    assert panel.next.text() == "run 1, loads-0.10N is what Start (F5) begins"
    model.set_busy(True, is_live=True)
    assert (model.config, model.session) == (mine, Path("mine.h5"))
    assert panel.next.text() == "run 1, loads-0.10N is under way"
    model.set_busy(False)
    assert panel.next.text() == "Next: run 1, loads-0.10N"


def test_no_run_begins_by_itself_while_a_session_is_played(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    opened(qtbot, panel)
    run, said = begins_when_asked(model), []
    model.said.connect(lambda text, _: said.append(text))
    panel.unattended.setChecked(True)
    model.set_busy(True)
    panel.take(panel.lines.runs[0], begins=True)
    qtbot.waitUntil(lambda: bool(said))
    assert said[0].startswith("Start (F5) begins")
    assert run == []


def test_a_run_that_could_not_be_made_ends_it_and_is_not_taken_for_the_next(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, said: list[str]
) -> None:
    opened(qtbot, panel)
    panel.unattended.setChecked(True)
    model.not_begun.emit()  # the form was not in order: it is begun later
    assert panel.unattended.isChecked()
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: model.session is not None)
    said.clear()
    model.set_busy(True, is_live=True)
    model.set_busy(False)
    model.not_begun.emit()
    assert not panel.unattended.isChecked()
    panel.unattended.setChecked(True)
    model.set_busy(True, is_live=True)  # another run, which is none of them
    assert not [one for one in column(panel, NUMBER) if "▶" in one]
    model.set_busy(False)
    lines = panel.lines
    model.ended.emit(None)
    qtbot.waitUntil(lambda: panel.lines is not lines)
    assert panel.unattended.isChecked()
    assert said == []


def test_a_zero_that_is_taken_for_a_run_leaves_it_one_of_the_campaign_and_holds_for_the_next(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel
) -> None:
    run = taken_unattended(qtbot, panel, model)
    typed = replace(model.config, forces=replace(model.config.forces, zero=(0.3, 0.3)))
    model.set_config(typed)
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: model.config.forces.zero == (0.0, 0.0))  # which nobody has measured
    zero = (0.002, -0.001)
    model.zeros.add(zero)
    model.set_config(replace(model.config, forces=replace(model.config.forces, zero=zero)))
    assert panel.next.text() == "run 1, loads-0.10N is what Start (F5) begins"
    model.begin_asked.emit()
    qtbot.waitUntil(lambda: len(run) == 3, timeout=60_000)
    with SessionReader(Path("loads") / "loads-0.12N.h5") as session:
        assert settings_of(session).forces.zero == zero


def test_other_settings_than_those_of_the_run_do_not_get_its_file(
    qtbot: QtBot, panel: CampaignPanel, model: WindowModel, said: list[str]
) -> None:
    model.set_session(Path("mine.h5"))
    opened(qtbot, panel)
    panel.take(panel.lines.runs[0])
    qtbot.waitUntil(lambda: model.is_lent)
    said.clear()
    model.set_config(replace(model.config, run=replace(model.config.run, travel=70e-6)))
    assert said == [
        "Campaign: run.travel not as in run 1: Start begins no run of the campaign, and records"
        " your own file. Next run takes it anew."
    ]
    assert (model.session, panel.next.text()) == (Path("mine.h5"), "Next: run 1, loads-0.10N")
    before = panel.lines
    run_it(model)
    assert Path("mine.h5").exists()
    qtbot.waitUntil(lambda: panel.lines is not before)
    click(qtbot, panel.next)
    qtbot.waitUntil(lambda: model.session == Path("loads") / "loads-0.10N.h5")


def test_a_run_is_taken_while_the_last_one_is_looked_at(
    qtbot: QtBot,
    panel: CampaignPanel,
    model: WindowModel,
    monkeypatch: pytest.MonkeyPatch,
    said: list[str],
) -> None:
    opened(qtbot, panel)
    may_go_on, is_looking, find = Event(), Event(), campaign_lines.find_sessions

    def slowly(plan: Campaign) -> dict[int, FoundSession]:
        if not is_looking.is_set():
            is_looking.set()
            may_go_on.wait(10)
        return find(plan)

    monkeypatch.setattr(campaign_lines, "find_sessions", slowly)
    panel._begun = 1  # whose state is written
    model.ended.emit(None)
    assert is_looking.wait(10)
    panel.take(panel.lines.runs[0])
    qtbot.wait(200)
    may_go_on.set()
    qtbot.waitUntil(lambda: bool(said))
    assert said == ["Start (F5) begins run 1 of 3, loads-0.10N: P = 0.1 N, 30 µm/s."]
