"""The steps of a protocol, block by block, with forces and stage written by hand."""

from __future__ import annotations

import numpy as np
import pytest

from app.calibrations.force_noise import ForceNoiseCalibration, NoiseOptions
from app.experiment.course import Go, Halt
from app.experiment.decisions import (
    Answered,
    Begin,
    Experiment,
    ExperimentFailed,
    MeasuredBlock,
    Noted,
    Zeroed,
)
from app.experiment.live_findings import Seen
from app.records.record_types import Phase
from app.settings import config

BLOCK = 50
START = '{do="background", time=0.1}, {do="approach"}, {do="reference", time=0.1}'


class Bench:
    """A stage that does what it is told at its velocity, and an experiment that tells it."""

    def __init__(self, steps: str, *overrides: str, start: str = START) -> None:
        both = ", ".join(part for part in (start, steps) if part)
        given = [f"run.steps=[{both}]", "run.settle_time=0.1", *overrides]
        self.experiment = Experiment(config.load(None, given))
        self.sample, self.travel_m, self.orders = 0, 0.0, []
        self.goal_m = self.velocity = 0.0
        self.normal, self.shear, self.seen = 0.0, 0.0, Seen()
        self.stalls = False
        self.obey()

    def obey(self) -> None:
        for order in self.experiment.orders():
            self.orders.append(order)
            if isinstance(order, Go):
                self.goal_m, self.velocity = order.target_m, order.velocity_m_s
            elif isinstance(order, Halt):
                self.goal_m = self.travel_m

    def block(self) -> Phase:
        self.sample += BLOCK
        left = self.goal_m - self.travel_m
        step = self.velocity * BLOCK / 1000
        if not self.stalls:
            self.travel_m += float(np.clip(left, -step, step))
        moves = self.stalls or abs(self.goal_m - self.travel_m) > 1e-12
        forces = np.tile([self.normal, self.shear], (BLOCK, 1))
        volts = forces + np.array([0.5, -0.25])
        now = MeasuredBlock(
            self.sample, forces, self.travel_m, moves, True, seen=lambda: self.seen, volts=volts
        )
        phase = self.experiment.advance(now)
        self.now = now
        self.obey()
        return phase

    def go(self, seconds: float) -> Phase:
        for _ in range(round(seconds * 1000 / BLOCK)):
            phase = self.block()
        return phase

    def to_drive(self) -> None:
        while self.experiment.phase is Phase.BACKGROUND:
            self.block()
        self.normal = 0.5
        for _ in range(100):
            if self.block() is Phase.DRIVE:
                return
        raise AssertionError("the drive did not begin")

    def to_step(self, number: int, most_s: float = 200.0) -> None:
        for _ in range(round(most_s * 1000 / BLOCK)):
            if self.experiment.number >= number:
                return
            self.block()
        raise AssertionError(f"step {number} did not begin: {self.experiment.text}")

    def begun(self) -> list[str]:
        return [order.text for order in self.orders if isinstance(order, Begin) and order.text]


def driving(steps: str, *overrides: str) -> Bench:
    """A bench whose drive has begun."""
    bench = Bench(steps, *overrides)
    bench.to_drive()
    return bench


def test_the_steps_follow_in_order_and_say_what_they_are() -> None:
    bench = driving('{do="drive", travel=20}, {do="hold", time=2}, {do="drive", travel=-5}')
    assert bench.go(3.9) is Phase.DRIVE
    bench.to_step(5, 0.3)
    assert bench.travel_m == pytest.approx(20e-6)
    began = bench.sample
    assert bench.go(1.9) is Phase.DRIVE
    assert bench.experiment.number == 5
    bench.to_step(6, 0.2)
    assert bench.sample - began == 2000
    assert bench.go(2) is Phase.END
    assert bench.travel_m == pytest.approx(15e-6)
    assert bench.begun() == [
        "1 of 6: background, 0.1 s",
        "2 of 6: approach to 0.5 N",
        "3 of 6: reference, 0.1 s",
        "4 of 6: drive 20 um at 5 um/s",
        "5 of 6: hold for 2 s",
        "6 of 6: drive -5 um at 5 um/s",
    ]
    assert bench.experiment.completed == "all 6 steps are complete"
    assert [order.is_turn for order in bench.orders if isinstance(order, Go)] == [False, True]


def test_the_end_of_a_protocol_of_one_step_has_its_own_words():
    (of_one,) = ForceNoiseCalibration().plan(config.load(None, ()), NoiseOptions())
    assert len(of_one.run.steps) == 1
    assert Experiment(of_one).completed == "the only step is complete"


@pytest.mark.parametrize("way", [1, -1])
def test_a_velocity_step_goes_on_without_a_stop(way: int) -> None:
    bench = driving(f'{{do="drive", travel={10 * way}}}, {{do="velocity", velocity=20, travel=40}},'
                  ' {do="velocity", velocity=5, travel=5}, {do="reverse"}')  # fmt: skip
    bench.to_step(5)
    first, jump = (order for order in bench.orders if isinstance(order, Go))
    # each is sent to the end of all, so that nothing stops in between
    assert first.target_m == pytest.approx(way * 55e-6)
    assert (jump.target_m, jump.velocity_m_s) == pytest.approx((way * 55e-6, 20e-6))
    assert jump.is_jump
    assert 10e-6 <= way * bench.travel_m < 10.3e-6
    bench.to_step(6)
    assert 50e-6 <= way * bench.travel_m < 51.1e-6
    bench.to_step(7)
    assert bench.travel_m == pytest.approx(way * 55e-6)
    # back to where the drive began
    assert bench.goal_m == pytest.approx(0.0)


def test_reversals_and_cycles_turn_as_often_as_asked() -> None:
    bench = driving('{do="drive", travel=10}, {do="reverse", times=3}, {do="cycle", times=2,'
                  ' travel=-5}', "run.velocity=10")  # fmt: skip
    assert bench.go(30) is Phase.END
    goals = [round(order.target_m * 1e6) for order in bench.orders if isinstance(order, Go)]
    assert goals == [10, 0, 10, 0, -5, 0, -5, 0]
    turns = [order.is_turn for order in bench.orders if isinstance(order, Go)]
    assert turns == [False, True, True, True, False, True, True, True]
    assert bench.experiment.leg == 6


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("until", "normal", "shear", "ends"),
    [
        ("until_force=0.2", 0.5, 0.21, True),
        ("until_force=0.2", 0.5, 0.19, False),
        ("until_force=0.2", 0.5, -0.3, False),
        ("until_ratio=0.5", 0.5, 0.26, True),
        ("until_ratio=0.5", 0.5, 0.24, False),
    ],
)
def test_a_force_ends_a_motion(
    until: str, normal: float, shear: float, ends: bool, way: int
) -> None:
    bench = driving(f'{{do="drive", travel={50 * way}, {until}}}, {{do="hold", time=1}}')
    bench.go(2)
    bench.normal, bench.shear = normal, way * shear
    bench.go(0.15)
    assert (bench.experiment.number == 5) is ends
    assert any(isinstance(order, Halt) for order in bench.orders) is ends


def test_a_force_along_a_way_back_is_below_zero_at_first() -> None:
    bench = driving('{do="drive", travel=20}, {do="reverse", until_ratio=0.5}')
    bench.to_step(5)
    bench.shear = 0.4
    bench.go(1)
    assert bench.experiment.number == 5
    bench.shear = -0.3
    assert bench.go(0.15) is Phase.END
    assert bench.travel_m > 10e-6


@pytest.mark.parametrize("way", [1, -1])
def test_a_drop_and_a_time_end_a_motion(way: int) -> None:
    bench = driving(f'{{do="drive", travel={100 * way}, until_drop=0.1}},'
                  f' {{do="drive", travel={50 * way}, until_time=2}}')  # fmt: skip
    for shear in (3e-4, -4e-4, 1e-3, -1e-3, *np.linspace(0.0, 0.4, 40)):  # first its noise
        bench.shear = way * float(shear)
        bench.block()
    assert bench.experiment.number == 4
    bench.shear = way * 0.37
    bench.go(0.2)
    assert bench.experiment.number == 4
    bench.shear = way * 0.355
    bench.go(0.15)
    assert bench.experiment.number == 5
    before = bench.travel_m
    assert bench.go(2.2) is Phase.END
    assert bench.travel_m - before == pytest.approx(way * 10e-6, abs=0.6e-6)


@pytest.mark.parametrize("way", [1, -1])
def test_each_leg_has_a_greatest_force_of_its_own(way: int) -> None:
    bench = driving(f'{{do="cycle", times=1, travel={20 * way}, until_drop=0.1}}')
    while bench.experiment.leg == 0:
        bench.shear = way * min(0.4, bench.shear * way + 0.02)
        bench.block()
    bench.go(1.0)  # the force of the way forth is against that of the way back
    assert bench.experiment.number == 4
    for along, phase in ((0.4, Phase.DRIVE), (0.37, Phase.DRIVE), (0.355, Phase.END)):
        bench.shear = -way * along
        assert bench.go(0.15) is phase


@pytest.mark.parametrize("way", [1, -1])
def test_what_the_analysis_has_seen_ends_a_motion_and_what_it_saw_before_does_not(way: int) -> None:
    far = f'{{do="drive", travel={100 * way}'
    bench = driving(f'{{do="drive", travel={40 * way}}}, {far}, until_stick=0.5}}, {far},'
                  ' until_slid=10}')  # fmt: skip
    bench.seen = Seen(bench.sample, 0.2)
    bench.to_step(5)
    bench.go(1)
    assert bench.experiment.number == 5
    bench.seen = Seen(bench.sample - 100, float("nan"))
    bench.go(0.5)
    assert bench.experiment.number == 5
    bench.seen = Seen(bench.sample - 100, 0.45)
    bench.go(0.15)
    assert bench.experiment.number == 6
    start = bench.travel_m
    bench.go(4)
    # t_s was a second ago, at 15 um of this step: it ends at 25 um
    bench.seen = Seen(bench.sample - 100, 0.1, bench.sample - 1000.0)
    assert bench.go(0.5) is Phase.DRIVE
    assert bench.go(1.2) is Phase.END
    assert bench.travel_m - start == pytest.approx(way * 25e-6, abs=0.6e-6)


def test_the_time_of_a_step_is_that_of_all_its_legs() -> None:
    bench = driving('{do="cycle", times=3, travel=20, until_time=6}')
    bench.go(5.8)
    assert (bench.experiment.number, bench.experiment.leg) == (4, 1)
    assert bench.go(0.4) is Phase.END
    assert bench.travel_m == pytest.approx(10e-6, abs=1.1e-6)


def test_each_of_many_legs_has_its_time() -> None:
    bench = Bench('{do="cycle", times=8, travel=5}')  # of 16 s; one leg may take 6.2 s
    bench.to_drive()
    assert bench.go(17) is Phase.END


def test_a_slow_motion_has_its_time() -> None:
    bench = driving('{do="drive", travel=1, velocity=0.1}')
    assert bench.go(11) is Phase.END


def test_a_reverse_goes_back_to_where_the_last_drive_began() -> None:
    bench = driving('{do="drive", travel=10}, {do="hold", time=1}, {do="drive", travel=20},'
                  ' {do="hold", time=1}, {do="reverse"}')  # fmt: skip
    assert bench.go(20) is Phase.END
    assert bench.travel_m == pytest.approx(10e-6)


def test_a_condition_that_must_be_met_fails_without_it() -> None:
    bench = driving('{do="drive", travel=10, until_ratio=0.5, unmet="fail"}')
    with pytest.raises(ExperimentFailed, match=r"step 4 \(drive\): its travel has ended and no co"):
        bench.go(5)


def test_a_stage_that_does_not_stop_is_named() -> None:
    bench = driving('{do="drive", travel=50, until_time=1}')
    bench.go(1.0)
    bench.stalls = True
    with pytest.raises(ExperimentFailed, match="it was commanded to stop 2 s ago and still moves"):
        bench.go(3)


def test_a_stage_that_moves_in_a_hold_is_named() -> None:
    bench = driving('{do="drive", travel=20}, {do="hold", time=20}')
    bench.to_step(5)
    bench.travel_m = bench.goal_m = 14e-6
    with pytest.raises(ExperimentFailed, match=r"went 14\.0 um, but it stood at 20\.0 um when st"):
        bench.block()


def test_a_stage_that_stalls_or_strays_in_a_later_motion_is_named() -> None:
    for stray in (False, True):
        bench = driving('{do="drive", travel=20}, {do="hold", time=1}, {do="drive", travel=-30}')
        bench.to_step(6)
        bench.go(1)
        bench.stalls = True
        if stray:
            bench.travel_m = 26e-6
            with pytest.raises(ExperimentFailed, match=r"step 6 goes from 20\.0 to -10\.0 um"):
                bench.block()
        else:
            with pytest.raises(ExperimentFailed, match=r"it stands at 15\.0 um of travel while it"):
                bench.go(5)


def test_a_stage_that_arrives_early_or_late_is_named() -> None:
    early = Bench('{do="drive", travel=20}, {do="hold", time=1}, {do="drive", travel=-30}')
    early.to_drive()
    early.to_step(6)
    early.goal_m = -5e-6
    with pytest.raises(ExperimentFailed, match=r"actuator: it stopped after 25\.0 of 30 um"):
        early.go(10)
    late = Bench('{do="drive", travel=20}, {do="velocity", velocity=10, travel=300}')
    late.to_drive()
    late.to_step(5)
    late.velocity = 5e-6
    with pytest.raises(ExperimentFailed, match=r"of 300 um after 41 s, 30 s were expected"):
        late.go(60)


def test_a_reference_that_can_not_be_taken_is_named() -> None:
    bench = Bench('{do="drive", travel=20}')
    forces = np.tile([0.5, 0.0], (BLOCK, 1))
    while bench.experiment.number < 3:
        bench.normal = 0.5 if bench.experiment.number > 1 else 0.0
        bench.block()
    late = bench.sample + 31_000
    with pytest.raises(ExperimentFailed, match="no image could be taken as reference in 3"):
        bench.experiment.advance(MeasuredBlock(late, forces, 0.0, False, False))


def test_a_saturated_sensor_ends_a_hold() -> None:
    bench = driving('{do="drive", travel=5}, {do="hold", time=20}')
    bench.to_step(5)
    forces = np.tile([0.5, 0.1], (BLOCK, 1))
    now = MeasuredBlock(bench.sample + BLOCK, forces, bench.travel_m, False, True, (0.2, 1.0))
    with pytest.raises(ExperimentFailed, match="the shear sensor is at the end of its range"):
        bench.experiment.advance(now)


def test_a_question_waits_for_its_answer() -> None:
    ask = '{do="ask", question="Is it dry?", timeout=5}'
    bench = Bench('{do="drive", travel=5}', start=f"{ask}, {START}")
    bench.experiment.answer("too early")
    bench.go(2)
    assert bench.experiment.question == "Is it dry?"
    assert "Is it dry?" in bench.experiment.advice
    bench.experiment.answer("quite")
    bench.block()
    assert Answered("quite") in bench.orders
    assert bench.experiment.question == ""
    assert bench.experiment.number == 2
    twice = Bench('{do="drive", travel=5}', start=f"{ask}, {ask}, {START}")
    twice.block()
    twice.experiment.answer("quite")
    twice.go(2)
    assert twice.experiment.number == 2
    assert twice.experiment.question  # the answer was to the first one
    start = f"{ask}, {ask.replace('dry', 'clean')}, {START}"
    both = Bench('{do="drive", travel=5}', start=start)
    both.block()
    for question in ("dry", "dry", "clean"):  # a key was pressed twice
        both.experiment.answer("yes", f"Is it {question}?")
        both.go(2)
        assert (both.experiment.number == 2) == (question == "dry")
    silent = Bench('{do="drive", travel=5}', start=f"{ask}, {START}")
    with pytest.raises(ExperimentFailed, match=r"step 1 \(ask\): nobody has answered in 5 s: Is"):
        silent.go(6)
    patient = Bench('{do="drive", travel=5}', start=f'{ask[:-1]}, unanswered="go on"}}, {START}')
    patient.go(5.05)
    assert patient.experiment.number == 2
    assert Answered("") in patient.orders


def test_the_sensors_are_zeroed_by_their_mean() -> None:
    zero = '{do="zero", time=0.5}'
    bench = Bench('{do="drive", travel=5}', start=f"{zero}, {zero}, {START}")
    bench.go(0.5)
    assert bench.experiment.number == 2
    bench.shear = 0.02
    bench.go(0.25)
    bench.shear = 0.04
    bench.go(0.25)
    zeros = [order.volts for order in bench.orders if isinstance(order, Zeroed)]
    assert zeros == [(0.5, -0.25), pytest.approx((0.5, -0.22))]


def test_phases_go_with_what_was_done() -> None:
    bench = Bench(
        '{do="ask", question="?"}, {do="drive", travel=5}',
        start='{do="zero", time=0.1}, {do="background", time=0.1}, {do="ask", question="on?"},'
        ' {do="approach"}, {do="hold", time=0.1}, {do="reference", time=0.1}',
    )
    phases = []
    for _ in range(200):
        bench.experiment.answer("yes")
        bench.normal = 0.5 if bench.experiment.number > 2 else 0.0
        phase = bench.block()
        if not phases or phases[-1] is not phase:
            phases.append(phase)
    assert phases == list(Phase)
    began = [order.phase for order in bench.orders if isinstance(order, Begin)]
    assert began == [
        Phase.BACKGROUND, None, Phase.CONTACT, None, None, Phase.REFERENCE, None, Phase.DRIVE,
        Phase.END,
    ]  # fmt: skip


def test_the_time_left_is_that_of_the_plan() -> None:
    bench = driving('{do="drive", travel=50}, {do="hold", time=10}, {do="reverse"}')
    bench.go(4)
    here, every = bench.experiment.left_s(bench.now)
    assert here == pytest.approx(6.0, abs=0.06)
    assert every == pytest.approx(26.0, abs=0.06)
    assert bench.experiment.progress(bench.now) == pytest.approx(0.1 + 0.9 * 4 / 30, abs=2e-3)
    bench.to_step(5)
    bench.go(3)
    assert bench.experiment.left_s(bench.now) == pytest.approx((7.0, 17.0), abs=0.06)
    cycling = Bench('{do="cycle", times=2, travel=20}')
    cycling.to_drive()
    cycling.go(5)
    assert cycling.experiment.left_s(cycling.now) == pytest.approx((11.0, 11.0), abs=0.06)
    waiting = Bench('{do="drive", travel=50}')
    waiting.go(1)
    here, every = waiting.experiment.left_s(waiting.now)
    assert np.isnan(here)
    assert every == pytest.approx(10.1)


def test_a_pause_waits_at_the_end_of_a_step_while_the_stage_stands_and_limits_are_watched() -> None:
    bench = driving('{do="drive", travel=10}, {do="hold", time=1}, {do="drive", travel=10}')
    bench.experiment.pause()
    while not bench.experiment.question:
        assert bench.block() is Phase.DRIVE
    assert bench.travel_m == pytest.approx(10e-6)
    assert bench.experiment.question == (
        "the run is paused before step 5: hold for 1 s; answer to go on"
    )
    bench.go(5.0)  # longer than the hold
    assert (bench.experiment.number, bench.experiment.is_moving) == (4, False)
    bench.experiment.answer("yes")
    bench.go(0.5)
    assert (bench.experiment.number, bench.experiment.question) == (5, "")
    bench.go(5.0)
    assert bench.travel_m == pytest.approx(20e-6)  # it does not pause again
    assert bench.experiment.phase is Phase.END
    notes = [order.text for order in bench.orders if isinstance(order, Noted)]
    assert notes == ["the run is paused before step 5", "the run goes on with step 5"]


def test_a_pause_can_be_withdrawn_until_it_has_begun() -> None:
    bench = driving('{do="drive", travel=10}, {do="hold", time=1}, {do="drive", travel=10}')
    bench.experiment.pause()
    bench.go(0.5)
    assert bench.experiment.is_pause_asked
    bench.experiment.cancel_pause()
    while bench.experiment.number == 4:
        bench.block()
    assert (bench.experiment.number, bench.experiment.question) == (5, "")
    bench.experiment.pause()
    while not bench.experiment.question:
        bench.block()
    bench.experiment.cancel_pause()  # too late: it waits for its answer
    bench.go(2.0)
    assert (bench.experiment.is_paused, bench.experiment.number) == (True, 5)


def test_limits_hold_while_a_run_is_paused() -> None:
    bench = driving('{do="drive", travel=10}, {do="hold", time=1}')
    bench.experiment.pause()
    bench.go(4.0)
    assert bench.experiment.question
    bench.shear = 50.0
    with pytest.raises(ExperimentFailed, match="shear force"):
        bench.block()


def test_a_pause_waits_for_a_stage_that_stands_and_for_a_step_that_follows() -> None:
    bench = driving('{do="drive", travel=10}, {do="velocity", velocity=2, travel=5}')
    bench.experiment.pause()
    bench.go(10.0)
    assert bench.experiment.phase is Phase.END
    assert not [order for order in bench.orders if isinstance(order, Noted)]
