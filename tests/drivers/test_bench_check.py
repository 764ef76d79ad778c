"""`slipscope check` on the emulated bench: it sets nothing while nothing moves, and moves the stage
within the limits of a run only.
"""

from pathlib import Path

import pytest
from newport_bench import wait_until
from short_run import SMALL

from app import config, live
from app.commands.bench_check import check
from drivers.protocols import SampleBlock

FREE = "sim.press_time=600"  # nothing is pressed meanwhile


@pytest.fixture
def checked():
    def run(move_um=0.0, *overrides, sabotage=None):
        settings = config.load(
            Path("hil-emulated"), [*SMALL, FREE, "limits.age=5", "run.velocity=50", *overrides]
        )
        bench = live.make_bench(settings, 1.0)
        open_, lines = bench.actuator.open, []

        def opened():
            open_()
            lines.append(bench.actuator._far_end)
            if sabotage:
                sabotage(bench)

        bench.actuator.open = opened
        findings = {f.label: f for f in check(settings, bench, home=False, move_um=move_um)}
        return findings, [command.decode() for _, command in lines[0].arrivals], bench

    return run


def test_it_sets_nothing_and_moves_nothing_unless_it_may(checked):
    findings, sent, _ = checked()
    assert all(f.is_fine or not f.needed for f in findings.values()), findings
    assert findings["limits"].value == (
        "before it moves, the controller is told to stay within 0 to 25 mm and below 1000 um/s"
    )
    assert {command[1:3] for command in sent} <= {"VE", "ID", "TS", "TP", "TE"}, sent


def test_a_move_goes_there_and_back(checked):
    findings, sent, bench = checked(20.0)
    assert findings["move"].is_fine, findings["move"]
    assert findings["move"].value.startswith("20 um requested, ")
    assert len([command for command in sent if command[1:3] == "PA"]) == 2
    assert bench.world.stage_m() == pytest.approx(0.0, abs=0.1e-6)


@pytest.mark.parametrize(
    ("move_um", "overrides", "reason"),
    [
        (2000.0, (), "--move: 2000 um was asked, limits.travel is 500 um"),
        (200.0, ("actuator.travel=[12.45, 12.55]",), "put it where it has room"),
        (-200.0, ("actuator.travel=[12.45, 12.55]",), "put it where it has room"),
    ],
)
def test_a_move_beyond_the_limits_is_refused_and_nothing_moves(checked, move_um, overrides, reason):
    findings, sent, _ = checked(move_um, *overrides)
    assert not findings["move"].is_fine
    assert reason in findings["move"].value
    assert not [command for command in sent if command[1:3] == "PA"]


@pytest.mark.parametrize("column", [0, 1])
def test_a_force_at_its_limit_stops_the_move(checked, column):
    def loaded(bench):
        read = bench.forces.device.read

        def pulled(timeout_s):
            block = read(timeout_s)
            if isinstance(block, SampleBlock) and bench.world.stage_m() > 20e-6:
                block.volts[:, column] = 9.0
            return block

        bench.forces.device.read = pulled

    findings, sent, bench = checked(
        400.0, "limits.normal_force=1", "limits.shear_force=1", sabotage=loaded
    )
    limit = ("normal_force", "shear_force")[column]
    assert f"limits.{limit} is" in findings["move"].value
    assert "1ST" in sent
    assert bench.world.stage_m() < 300e-6
    wait_until(lambda: not bench.world.is_moving())
