"""A stop of the real driver, on an emulated controller, answers what became of it; so does one from
outside, while the driver has the port.
"""

import os
import pickle
import time

import pytest
from processes.launched import wait_until
from python_program import python
from short_run import SMALL

from app.acquisition.ending import Ending
from app.acquisition.stage import Stage
from app.acquisition.watchdog import Watchdog
from app.settings import config
from app.system.stopping import CUT_POWER, Stop
from drivers.errors import DeviceNotFound
from drivers.protocols import StoppedFromOutside
from drivers.stages.newport_line import OutsideStop


def stage_of(driver):
    """This stage in a run, which is connected and was sent off at 5 um/s."""
    ending = Ending(lambda: None)
    watchdog = Watchdog(ending, 1.0, is_direct=False)
    stage = Stage(config.load(None, SMALL), driver, watchdog)
    stage.velocity_m_s, stage.may_move = 5e-6, True
    driver.set_velocity(5e-6)
    driver.move_to(12.6e-3)
    ending._stop_actuator = stage.stop
    stage.is_connected = True
    return stage, ending


def test_a_real_driver_is_read_at_rest(newport):
    bench = newport().opened()
    stage, ending = stage_of(bench.driver)
    ending.call("enough", failed=False)
    bench.pass_time(1.0)
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.AT_REST, stage.stop_answer
    assert "the SMC100 is at rest at 12.5000 mm" in stage.stop_answer.sentence
    assert bench.stage.position() < 12.501


@pytest.mark.parametrize("over", ["pty", "tcp"])
def test_a_real_driver_whose_line_is_cut_has_failed(newport, over):
    bench = newport(over=over).opened()
    stage, ending = stage_of(bench.driver)
    bench.line.cut()
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.FAILED, True), (
        stage.stop_answer
    )
    assert stage.stop_answer.sentence.startswith(f"{CUT_POWER}: SMC100: ")
    assert "nor could its position be read" in stage.stop_answer.sentence


def test_a_real_driver_whose_controller_moves_on_has_failed(newport):
    bench = newport().opened()
    bench.stage.halt = lambda acceleration: None
    stage, ending = stage_of(bench.driver)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.FAILED, stage.stop_answer
    assert "says that it moves" in stage.stop_answer.sentence


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize("wire", ["pty", "tcp"] if os.name == "posix" else ["tcp"])
def test_another_process_stops_the_stage_while_the_driver_has_the_port(newport, wire, strict):
    stage = newport(over=wire, line={"deaf_s": 0.004} if strict else {}).opened()
    stage.driver.move_to(13e-3)
    assert isinstance(stage.driver, StoppedFromOutside)
    given = pickle.dumps(stage.driver.stopper()).hex()
    program = f"import pickle; pickle.loads(bytes.fromhex('{given}')).stop()"
    assert python("-c", program).returncode == 0
    wait_until(lambda: len(stage.sent("ST")) + stage.line.ignored.count(b"ST") == 3)
    assert strict or not stage.line.ignored
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


def test_a_stop_from_outside_reaches_a_controller_that_is_deaf_by_the_command_before_it(newport):
    stage = newport(line={"deaf_s": 0.1}, over="tcp", command_pause=0.15).opened()
    stage.driver.move_to(13e-3)
    stopper = stage.driver.stopper()
    stage.line._deaf_until = time.monotonic() + 0.1
    stopper.stop()
    wait_until(lambda: stage.sent("ST"))
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


def test_a_stop_from_outside_that_can_not_be_sent_says_so():
    with pytest.raises(DeviceNotFound, match="cannot be opened"):
        OutsideStop("SMC100", "socket://127.0.0.1:1", 57600, 1).stop()
