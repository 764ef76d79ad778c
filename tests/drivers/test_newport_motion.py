"""The drivers of SMC100CC and CONEX-CC: homing, motion that fails, and the faults of the simulated
world.
"""

import re

import pytest
from newport_bench import patient, waited_time
from processes.launched import wait_until
from worlds import scenario

from drivers.clock import SampleClock
from drivers.emulators.newport import EmulatedConexCc, EmulatedSmc100
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.settings import ActuatorSettings
from drivers.sim.world import World
from drivers.stages import newport_line, newport_stage as actuator_newport


@pytest.fixture(autouse=True)
def _patient():
    with patient():
        yield


# ------------------------------------------------------------------ homing


def test_nothing_homes_by_itself_and_without_it_nothing_moves(newport_open):
    stage = newport_open(is_referenced=False)
    for ask in (lambda: stage.driver.move_to(1e-3), lambda: stage.driver.set_velocity(1e-5)):
        with pytest.raises(
            DeviceFault,
            match=r"home it with the block free to travel: `slipscope check BENCH.toml --home`",
        ):
            ask()
    assert not stage.driver.is_moving()
    assert not stage.sent("OR")
    stage.driver.home()
    assert stage.driver.is_moving()
    stage.pass_time(100.0)
    assert not stage.driver.is_moving()
    assert stage.driver.position_m() == pytest.approx(0.0, abs=1e-9)
    stage.driver.set_velocity(1e-3)
    stage.driver.move_to(2e-3)
    stage.pass_time(10.0)
    assert not stage.driver.is_moving()
    assert stage.driver.position_m() == pytest.approx(2e-3)


def test_limits_are_told_as_soon_as_it_is_homed(newport_open):
    stage = newport_open(is_referenced=False, travel=(0.0, 20e-3), max_velocity=1e-4)
    assert stage.controller.parameters["SR"] == 25.0
    stage.driver.home()
    stage.pass_time(100.0)
    stage.driver.move_to(1e-3)
    assert stage.controller.parameters["SR"] == 20.0
    assert stage.controller.parameters["VA"] == pytest.approx(0.1)


def test_homing_that_fails_is_a_fault(newport_open):
    stage = newport_open(is_referenced=False)
    stage.controller.can_home = False
    stage.driver.home()
    stage.pass_time(100.0)
    with pytest.raises(
        DeviceFault,
        match=(
            r"homing took longer than its time-out; it is now NOT REFERENCED from"
            r" HOMING; home it"
        ),
    ):
        stage.driver.is_moving()
    stage.controller.can_home = True
    stage.driver.home()
    stage.pass_time(100.0)
    assert not stage.driver.is_moving()


def test_the_end_switch_that_homing_uses_is_no_fault(newport_open):
    stage = newport_open(is_referenced=False)
    stage.driver.home()
    stage.device.answers["TS"] = ["1TS00011E", "1TS000032"]
    assert stage.driver.is_moving()
    assert not stage.driver.is_moving()


def test_homing_can_be_stopped_and_that_is_no_fault(newport_open):
    stage = newport_open(is_referenced=False)
    stage.driver.home()
    stage.driver.stop()
    assert not stage.driver.is_moving()
    assert stage.controller.state == 0x0B


def test_a_stage_that_is_homed_goes_to_its_origin_at_a_speed_of_its_own(newport_open):
    stage = newport_open(max_velocity=0.4e-3)
    stage.driver.set_velocity(5e-6)
    stage.driver.home()
    assert stage.controller.parameters["VA"] == 0.4
    assert not stage.sent("OR")
    stage.pass_time(100.0)
    assert not stage.driver.is_moving()
    assert stage.driver.position_m() == 0.0


def test_home_switches_a_motor_on_that_is_off(newport_open):
    stage = newport_open()
    stage.controller.state = 0x3D
    with pytest.raises(DeviceFault, match="its motor is off"):
        stage.driver.move_to(13e-3)
    stage.driver.home()
    assert stage.controller.parameters["VA"] == 0.5
    stage.pass_time(100.0)
    assert not stage.driver.is_moving()
    assert stage.driver.position_m() == 0.0


# ------------------------------------------------------------------ motion that fails


def test_the_end_of_the_run_is_a_fault(newport_open):
    stage = newport_open(stage={"ends": (12.0, 13.0)})
    stage.driver.move_to(20e-3)
    stage.pass_time(100.0)
    with pytest.raises(
        DeviceFault, match="positive end of run; it is now NOT REFERENCED from MOVING; home it"
    ):
        stage.driver.is_moving()
    with pytest.raises(DeviceFault, match="positive end of run"):
        stage.driver.position_m()


def test_a_stalled_stage_is_a_fault_and_the_next_start_says_that_its_motor_is_off(newport_open):
    stage = newport_open(stage={"sticks_at": 12.6})
    stage.driver.set_velocity(5e-6)
    stage.driver.move_to(13e-3)
    stage.pass_time(21.0)
    assert stage.driver.is_moving()
    assert stage.driver.position_m() == pytest.approx(12.6e-3)
    stage.pass_time(10.0)
    with pytest.raises(
        DeviceFault, match=r"following error: .*it is now DISABLE from MOVING; its motor is off"
    ):
        stage.driver.is_moving()
    stage.driver.close()
    stage.driver.open()
    assert not stage.driver.is_moving()
    with pytest.raises(DeviceFault, match="DISABLE"):
        stage.driver.move_to(13e-3)


def test_a_move_of_an_earlier_program_is_seen_and_ended_by_close(newport):
    stage = newport()
    stage.controller.answer(b"1PA20")
    stage.driver.open()
    assert stage.driver.is_moving()
    stage.driver.close()
    wait_until(lambda: stage.sent("ST"))


def test_a_stage_that_does_not_stop_is_told_again_and_then_a_fault(newport_open):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["ST"] = ""
    stage.driver.stop()
    assert stage.driver.is_moving()
    assert len(stage.sent("ST")) >= 2
    stage.driver._stop_sent_at -= 2.1  # as if so many seconds had passed
    with pytest.raises(
        DeviceFault,
        match=r"was commanded to stop 2 s ago and is still MOVING; switch its motor off",
    ):
        stage.driver.is_moving()


def emulated(fault):
    """A driver in a world with one fault, and that world; open."""
    world = World(scenario(press_time=3600.0, faults=(fault,)), pace=None)
    driver = EmulatedSmc100(ActuatorSettings(), SampleClock(1000.0), world)
    driver.open()
    return driver, world


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("end-of-run 100", "positive end of run"),
        ("stall 100", "following error"),
        ("unplugged 800", "the line .* is dead"),
    ],
)
def test_faults_of_the_world_are_told_by_the_real_driver(fault, sentence):
    driver, world = emulated(fault)
    driver.set_velocity(100e-6)
    driver.move_to(12.7e-3)
    world.advance(500)
    assert driver.is_moving()

    def poll():
        for _ in range(20):
            world.advance(100)
            driver.is_moving()

    with pytest.raises(DeviceFault, match=sentence):
        poll()
    world.advance(3000)
    assert world.stage_m() == pytest.approx(200e-6 if "unplugged" in fault else 100e-6, abs=0.02e-6)
    if "unplugged" in fault:
        with pytest.raises(DeviceFault, match="ends by itself at its target"):
            driver.stop()
    driver.close()


def test_a_noisy_line_changes_nothing_but_takes_longer():
    driver, world = emulated("noisy-line 0 10")
    seen = []
    for target in (12.6e-3, 12.5e-3, 12.7e-3):
        driver.set_velocity(1e-3)
        driver.move_to(target)
        while driver.is_moving():
            world.advance(10)
        seen.append(driver.position_m())
    assert seen == pytest.approx([12.6e-3, 12.5e-3, 12.7e-3], abs=0.04e-6)
    assert driver._far_end._device._garbled == 10
    driver.close()


def test_a_refusal_is_not_lost_behind_a_late_answer(newport_open, monkeypatch):
    stage = newport_open(max_velocity=2e-3)
    monkeypatch.setattr(newport_line, "ANSWER_S", 0.2)  # the first TE is given up
    answer = stage.device.answer

    def late(command):  # two answers come late, so that the second meets the command
        stage.line.think_s = {1: 0.3, 2: 0.2}.get(len(stage.sent("TE")), 0.0)
        return answer(command)

    stage.line.arrivals.clear()
    stage.device.answer = late
    with pytest.raises(DeviceError, match="2000 um/s was requested, the controller refused"):
        stage.driver.set_velocity(2e-3)
    assert len(stage.sent("TE")) >= 3


@pytest.mark.parametrize("fault", ["slow-controller 0 60", "deaf-controller 0 60"])
def test_a_slow_or_deaf_controller_moves_as_asked(fault):
    driver, world = emulated(fault)
    driver.set_velocity(1e-3)
    driver.move_to(12.6e-3)
    while driver.is_moving():
        world.advance(10)
    assert driver.position_m() == pytest.approx(12.6e-3, abs=0.04e-6)
    if "deaf" in fault:
        assert driver._far_end.ignored
        assert driver._line.pause_s > 0.01
    else:
        assert driver._far_end.think_s == 0.06
    driver.close()


def test_a_mute_controller_is_told_from_its_sample_on(monkeypatch):
    waited_time(monkeypatch)
    driver, world = emulated("mute-controller 800")
    driver.set_velocity(100e-6)
    driver.move_to(12.7e-3)
    world.advance(700)
    assert driver.is_moving()
    world.advance(200)
    with pytest.raises(DeviceTimeout, match="gave no answer to 'TS'"):
        driver.is_moving()
    with pytest.raises(DeviceTimeout):
        driver.close()


def test_what_the_world_does_not_model_is_told_in_its_words():
    world = World(scenario(press_time=0.0, press_samples=10), pace=None)
    driver = EmulatedConexCc(ActuatorSettings(), SampleClock(1000.0), world)
    driver.open()
    world.advance(20)
    with pytest.raises(
        DeviceFault,
        match=re.escape("emulated CONEX-CC: a move to 12 mm was requested")
        + ".*which the law 'cattaneo-mindlin' does not know",
    ):
        driver.move_to(12e-3)
    driver.close()


# ------------------------------------------------------------------ a stop beside a move


def moving_on(newport):
    """A stage that moves, goes on whatever it is told, and takes new targets meanwhile."""
    stage = newport().opened()
    stage.driver.move_to(13e-3)
    stage.stage.halt = lambda acceleration: None
    stage.device.answers["TE"] = "1TE@"
    return stage


def renews_late(driver, monkeypatch):
    """A new target comes when the stop has begun, and has not been sent."""
    line, send = driver._line, driver._line.stop

    def stop():
        monkeypatch.setattr(line, "stop", send)
        driver.move_to(14e-3)
        send()

    monkeypatch.setattr(line, "stop", stop)
    driver.stop()


def stops_early(driver, monkeypatch):
    """The stop has been sent when the new target is still being prepared."""
    monkeypatch.setattr(driver, "_is_prepared", False)
    monkeypatch.setattr(driver, "_prepare", lambda line: driver.stop())
    driver.move_to(14e-3)


def stops_while_refused(driver, monkeypatch):
    """The stop is sent while the new target is on its way, which the controller refuses."""
    line = driver._line

    def tell(command, **_):
        driver.stop()
        return "M"

    monkeypatch.setattr(line, "tell", tell)
    with pytest.raises(DeviceFault, match="not allowed while it moves"):
        driver.move_to(14e-3)


@pytest.mark.parametrize("race", [renews_late, stops_early, stops_while_refused])
def test_a_new_target_beside_a_stop_does_not_end_the_check_that_the_stage_stops(
    newport, monkeypatch, race
):
    stage = moving_on(newport)
    race(stage.driver, monkeypatch)
    monkeypatch.setattr(actuator_newport, "STOPS_WITHIN_S", -1.0)
    with pytest.raises(DeviceFault, match=r"was commanded to stop .* and is still MOVING"):
        stage.driver.is_moving()


def test_a_move_after_a_stop_is_not_blamed_for_it(newport, monkeypatch):
    stage = newport().opened()
    stage.driver.move_to(13e-3)
    stage.driver.stop()
    stage.pass_time(1.0)
    stage.driver.move_to(14e-3)
    monkeypatch.setattr(actuator_newport, "STOPS_WITHIN_S", -1.0)
    assert stage.driver.is_moving()


def test_a_look_that_was_answered_before_a_move_began_does_not_forget_the_move(
    newport, monkeypatch
):
    stage = newport().opened()
    driver, read = stage.driver, stage.driver._read_again
    driver.move_to(13e-3)
    stage.pass_time(100.0)

    def read_before_a_move(*args):
        found = read(*args)
        driver.move_to(14e-3)
        return found

    monkeypatch.setattr(driver, "_read_again", read_before_a_move)
    assert not driver.is_moving()
    driver.close()
    wait_until(lambda: stage.sent("ST"))


# ------------------------------------------------------------------ a state that came damaged


@pytest.mark.parametrize("word", ["000428", "000014", "000033", "800028", "00013D", "00002A"])
def test_a_state_that_one_reading_names_is_not_believed(newport_open, word):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["TS"] = [f"1TS{word}", "1TS000028"]
    assert stage.driver.is_moving()
    assert stage.driver.position_m() >= 12.5e-3
    stage.device.answers.clear()
    stage.pass_time(100.0)
    assert not stage.driver.is_moving()
    assert stage.driver.position_m() == pytest.approx(13e-3)


def test_an_error_bit_that_persists_is_a_fault_while_the_stage_moves(newport_open):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["TS"] = "1TS000428"
    with pytest.raises(DeviceFault, match="peak current limit; it is now MOVING"):
        stage.driver.is_moving()


def test_a_damaged_state_before_a_true_failure_does_not_hide_it(newport_open):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["TS"] = ["1TS000014", "1TS00203D", "1TS00003D"]  # TS clears the bits
    with pytest.raises(
        DeviceFault, match=r"following error: .*; it is now DISABLE from MOVING; its motor is off"
    ):
        stage.driver.is_moving()
