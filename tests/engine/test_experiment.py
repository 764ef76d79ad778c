"""The course of an experiment, block by block, with forces written by hand."""

import time

import numpy as np
import pytest

from app.experiment.course import Course, Halt
from app.experiment.decisions import Experiment, ExperimentFailed, MeasuredBlock
from app.experiment.live_findings import Seen
from app.records.record_types import Phase
from app.settings import config

BLOCK = 50


class Bench:
    """Drives an experiment with constant forces; keeps the sample count."""

    def __init__(self, *overrides):
        self.experiment = Experiment(config.load(None, ["run.reference_time=0.5", *overrides]))
        self.sample = 0
        self.travel_m = 0.0

    def go(
        self, seconds, normal=0.0, shear=0.0, *, moving=False, reference=True, speed=0.0, age_s=0.0
    ):
        for _ in range(round(seconds * 1000 / BLOCK)):
            self.sample += BLOCK
            self.travel_m += speed * BLOCK / 1000
            forces = np.tile([normal, shear], (BLOCK, 1))
            phase = self.experiment.advance(
                MeasuredBlock(self.sample, forces, self.travel_m, moving, reference, age_s=age_s)
            )
        return phase

    def to_drive(self):
        self.go(1.0)
        self.go(1.0, 0.5)
        assert self.go(0.5, 0.5) is Phase.DRIVE


def test_the_phases_follow_in_order():
    bench = Bench()
    assert bench.go(0.95) is Phase.BACKGROUND
    assert bench.go(0.05) is Phase.CONTACT
    assert bench.go(2, 0.3) is Phase.CONTACT
    assert bench.go(0.95, 0.5) is Phase.CONTACT
    assert bench.go(0.05, 0.5) is Phase.REFERENCE
    assert bench.go(0.45, 0.5) is Phase.REFERENCE
    assert bench.go(0.05, 0.5) is Phase.DRIVE
    assert bench.go(1, 0.5, 0.1, moving=True, speed=5e-6) is Phase.DRIVE
    bench.travel_m = 190e-6
    assert bench.go(0.05, 0.5, 0.4) is Phase.END


def test_a_drive_turns_back_as_often_as_asked():
    bench = Bench("run.reversals=2", "run.travel=20")
    bench.to_drive()
    way = [(20e-6, 5e-6), (0.0, -5e-6), (20e-6, 5e-6)]
    for leg, (end, speed) in enumerate(way):
        assert bench.experiment.leg == leg
        assert bench.go(3.5, 0.5, 0.1, moving=True, speed=speed) is Phase.DRIVE
        bench.travel_m = end
        phase = bench.go(0.05, 0.5, 0.4)
    assert phase is Phase.END


def test_a_stage_that_stops_on_its_way_back_is_named():
    bench = Bench("run.reversals=1", "run.travel=20")
    bench.to_drive()
    bench.travel_m = 20e-6
    assert bench.go(0.05, 0.5, 0.4) is Phase.DRIVE
    bench.go(1, 0.5, 0.1, moving=True, speed=-5e-6)
    with pytest.raises(ExperimentFailed, match=r"it stopped after 5\.0 of 20 um"):
        bench.go(0.05, 0.5, 0.1)


def test_the_force_must_stay_at_its_value_to_settle():
    bench = Bench()
    bench.go(1)
    bench.go(0.05, -0.0002)
    assert bench.experiment.advice == "press the contact to 0.5 N (P is 0.000 N)"
    bench.go(0.9, 0.5)
    bench.go(0.05, 0.52)
    assert bench.go(0.95, 0.5) is Phase.CONTACT
    assert bench.go(0.05, 0.5) is Phase.REFERENCE


def test_no_background_begins_with_the_contact():
    bench = Bench("run.background_time=0")
    assert bench.experiment.phase is Phase.CONTACT
    assert bench.go(1.0, 0.5) is Phase.REFERENCE


@pytest.mark.parametrize("shear_mn", [6.0, -6.0])
def test_an_initial_shear_force_asks_for_a_new_contact(shear_mn):
    bench = Bench("run.contact_timeout=5")
    bench.go(1)
    assert bench.go(2, 0.5, shear_mn / 1e3) is Phase.CONTACT
    assert "renew the contact" in bench.experiment.advice
    with pytest.raises(ExperimentFailed, match=rf"renew the contact: Q is {shear_mn} mN"):
        bench.go(5, 0.5, shear_mn / 1e3)


def test_a_background_in_contact_is_refused():
    with pytest.raises(ExperimentFailed, match="lift it"):
        Bench().go(0.1, 0.4)


def test_a_block_hangs_free_as_judged_by_the_load_that_the_steps_say():
    steps = '{do="background", time=1}, {do="approach", normal_force=0.1}, {do="reference"}'
    bench = Bench(f'run.steps=[{steps}, {{do="drive", travel=5}}]')
    bench.go(0.05, 4e-3)
    with pytest.raises(ExperimentFailed, match="while the block should hang free"):
        bench.go(0.05, 6e-3)  # 5 % of 0.1 N are less, and of the 0.5 N of [run] more


def test_the_drive_waits_for_the_reference_and_not_for_ever():
    bench = Bench()
    bench.go(1.0)
    bench.go(1.0, 0.5)
    assert bench.go(25, 0.5, reference=False) is Phase.REFERENCE
    with pytest.raises(ExperimentFailed, match="no image"):
        bench.go(30, 0.5, reference=False)


def test_the_first_of_slow_frames_is_waited_for():
    """A frame in 20 s: the camera was blamed after 30 s."""
    bench = Bench("camera.divisor=20000")
    bench.go(1.0)
    bench.go(1.0, 0.5)
    assert bench.go(60, 0.5, reference=False) is Phase.REFERENCE
    with pytest.raises(ExperimentFailed, match="reference: no image could be taken"):
        bench.go(1, 0.5, reference=False)


@pytest.mark.parametrize(
    ("normal", "shear", "words"),
    [
        (1.95, 0.0, "normal force reached 1.950 N"),
        (0.5, -1.95, "shear force reached 1.950 N"),
        (0.5, float("nan"), "not a number"),
    ],
)
def test_limits_end_the_run_by_name_in_any_phase(normal, shear, words):
    for prepare in (lambda b: None, Bench.to_drive):
        bench = Bench()
        prepare(bench)
        with pytest.raises(ExperimentFailed, match=words):
            bench.go(0.05, normal, shear, moving=True)


def test_too_much_travel_is_a_limit():
    bench = Bench("limits.travel=200")
    bench.to_drive()
    bench.travel_m = 201e-6
    with pytest.raises(ExperimentFailed, match=r"limits\.travel is 200 um"):
        bench.go(0.05, 0.5, moving=True)


def test_a_stage_that_stops_early_or_never_arrives_is_a_stall():
    bench = Bench()
    bench.to_drive()
    bench.go(1, 0.5, moving=True, speed=5e-6)
    with pytest.raises(ExperimentFailed, match=r"stopped after 5\.0 of 190 um"):
        bench.go(0.05, 0.5, moving=False)
    bench = Bench()
    bench.to_drive()
    with pytest.raises(ExperimentFailed, match="stall"):
        bench.go(60, 0.5, moving=True)


@pytest.mark.parametrize(("gone_um", "arrives"), [(97.8, False), (98.1, True)])
def test_a_stage_has_arrived_close_to_its_end_only(gone_um, arrives):
    bench = Bench("run.travel=100")
    bench.to_drive()
    bench.travel_m = gone_um * 1e-6
    if arrives:
        assert bench.go(0.05, 0.5) is Phase.END
    else:
        with pytest.raises(ExperimentFailed, match=r"stopped after 97\.8 of 100 um"):
            bench.go(0.05, 0.5)


def waited(bench, asked_sample, travel_m, shear=0.1):
    """2.5 s of blocks that had to wait for the program, which then asks the stage at once."""
    for _ in range(50):
        bench.sample += BLOCK
        forces = np.tile([0.5, shear], (BLOCK, 1))
        now = MeasuredBlock(bench.sample, forces, travel_m, True, True, asked_sample=asked_sample)
        phase = bench.experiment.advance(now)
    return phase


def test_a_program_that_was_held_up_does_not_blame_the_stage():
    """The motion was sent after 2.5 s without a turn, whose blocks come all at once."""
    bench = Bench()
    bench.to_drive()
    assert waited(bench, bench.sample + 2500, 0.2e-6) is Phase.DRIVE
    bench.travel_m = 0.2e-6
    assert bench.go(1, 0.5, 0.1, moving=True, speed=5e-6) is Phase.DRIVE
    with pytest.raises(ExperimentFailed, match=r"it stands at 5\.2 um"):
        bench.go(2.2, 0.5, 0.1, moving=True)


def test_a_program_that_was_held_up_does_not_blame_a_stage_that_stops():
    steps = "{do='background'}, {do='approach'}, {do='reference'}"
    bench = Bench(f"run.steps=[{steps}, {{do='drive', travel=100, until_force=0.2}}]")
    bench.to_drive()
    assert bench.go(1, 0.5, 0.1, moving=True, speed=5e-6) is Phase.DRIVE
    assert waited(bench, bench.sample + 2500, bench.travel_m, shear=0.3) is Phase.DRIVE
    with pytest.raises(ExperimentFailed, match="commanded to stop 2 s ago and still moves"):
        bench.go(2.2, 0.5, 0.1, moving=True)


def test_a_stage_that_creeps_within_the_jitter_of_its_encoder_stands():
    bench = Bench()
    bench.to_drive()
    bench.go(1, 0.5, moving=True, speed=5e-6)
    with pytest.raises(ExperimentFailed, match=r"it stands at 5\.0 um"):
        bench.go(3, 0.5, moving=True, speed=10e-9)


def test_a_drive_the_other_way_ends_at_its_travel():
    bench = Bench("run.travel=-100")
    bench.to_drive()
    assert bench.go(10, 0.5, -0.1, moving=True, speed=-5e-6) is Phase.DRIVE
    assert (
        0.4
        < bench.experiment.progress(MeasuredBlock(0, np.zeros((1, 2)), -50e-6, True, True))
        < 0.6
    )
    bench.travel_m = -100e-6
    assert bench.go(0.05, 0.5, -0.4) is Phase.END


@pytest.mark.parametrize("travel", [100, -100])
@pytest.mark.parametrize("share", [-0.1, 1.1])
def test_a_stage_that_goes_the_wrong_way_or_too_far_ends_the_run(travel, share):
    bench = Bench(f"run.travel={travel}")
    bench.to_drive()
    bench.travel_m = share * travel * 1e-6
    with pytest.raises(ExperimentFailed, match=f"run.travel is {travel} um; let nothing else move"):
        bench.go(0.05, 0.5, moving=True)


def test_the_limit_of_the_travel_holds_both_ways_and_only_in_the_drive():
    bench = Bench()
    bench.travel_m = -900e-6
    bench.to_drive()
    for travel_m in (-501e-6, 501e-6):
        bench.travel_m = travel_m
        with pytest.raises(ExperimentFailed, match=r"501.0 um, limits.travel is 500 um"):
            bench.go(0.05, 0.5, moving=True)


def test_the_drive_waits_for_forces_that_are_new_and_is_refused_without_them():
    bench = Bench()
    bench.go(1.0)
    bench.go(1.0, 0.5)
    assert bench.go(2.0, 0.5, age_s=2.0) is Phase.REFERENCE
    assert "the drive waits: the newest force that was read was 2 s old" in bench.experiment.advice
    assert bench.go(0.05, 0.5) is Phase.DRIVE
    with pytest.raises(ExperimentFailed, match=r"was 0.9 s old, limits.age is 0.8 s"):
        bench.go(0.05, 0.5, moving=True, age_s=0.9)
    behind = Bench()
    behind.go(1.0)
    behind.go(1.0, 0.5)
    with pytest.raises(ExperimentFailed, match=r"forces: the drive was not begun, .* 7 s old"):
        behind.go(10.0, 0.5, age_s=7.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_limit_of_the_normal_force_holds_for_either_sign(sign):
    """With the wrong forces.sign the operator presses, and P falls without end."""
    bench = Bench("limits.normal_force=1")
    bench.go(1.0)
    bench.go(1.0, sign * 0.99)
    with pytest.raises(ExperimentFailed, match=rf"reached {sign * 1.01:.3f} N") as told:
        bench.go(0.05, sign * 1.01)
    assert ("forces.sign" in str(told.value)) == (sign < 0)


def test_a_drive_of_days_is_judged_as_fast_as_one_of_a_minute():
    """Each block took longer than the one before, and half a day made it longer than a block."""
    drive = '{do="drive", travel=90, velocity=0.01, until_slid=5}'
    settings = config.load(None, [f'run.steps=[{{do="approach"}}, {{do="reference"}}, {drive}]'])
    course = Course(settings, 3, settings.run.protocol[2], [90e-6], 0.0, 0.0, 0)
    end = 10**6
    course._path = [(sample, sample * 1e-11) for sample in range(end)]
    began = time.process_time()
    for travel_m, is_over in ((10.4e-6, False), (10.6e-6, True)):
        for _ in range(10):
            end += BLOCK
            seen = Seen(end, 0.1, 550_000.5)  # t_s was at 5.5 um
            course.advance(
                MeasuredBlock(
                    end, np.zeros((BLOCK, 2)), travel_m, True, True, seen=lambda now=seen: now
                )
            )
            if is_over:
                break
        assert isinstance(course.order, Halt) == is_over
    assert time.process_time() - began < 1.0
