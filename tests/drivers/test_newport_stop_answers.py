"""A stop of the real driver, on an emulated controller, answers what became of it."""

from types import SimpleNamespace

import pytest
from newport_bench import benches
from short_run import SMALL

from app.acquisition.ending import Ending
from app.acquisition.stage import Stage
from app.acquisition.stops import Stops
from app.acquisition.watchdog import Watchdog
from app.settings import config
from app.system.stopping import CUT_POWER, Stop

newport = pytest.fixture(benches)


def stops_of(driver):
    """The stops of a run on this stage, which is connected and was sent off at 5 um/s."""
    stage = Stage(config.load(None, SMALL), SimpleNamespace(actuator=driver))
    stage.velocity_m_s, stage.may_move = 5e-6, True
    driver.set_velocity(5e-6)
    driver.move_to(12.6e-3)
    ending = Ending(lambda: None)
    stops = Stops(stage, Watchdog(ending, 1.0, is_direct=False))
    ending._stop_actuator = stops.send
    stops.is_connected = True
    return stops, ending


def test_a_real_driver_is_read_at_rest(newport):
    bench = newport().opened()
    stops, ending = stops_of(bench.driver)
    ending.call("enough", failed=False)
    bench.pass_time(1.0)
    stops.confirm()
    assert stops.answer.kind is Stop.AT_REST, stops.answer
    assert "the SMC100 is at rest at 12.5000 mm" in stops.answer.sentence
    assert bench.stage.position() < 12.501


@pytest.mark.parametrize("over", ["pty", "tcp"])
def test_a_real_driver_whose_line_is_cut_has_failed(newport, over):
    bench = newport(over=over).opened()
    stops, ending = stops_of(bench.driver)
    bench.line.cut()
    ending.call("enough", failed=False)
    stops.confirm()
    assert (stops.answer.kind, stops.answer.is_final) == (Stop.FAILED, True), stops.answer
    assert stops.answer.sentence.startswith(f"{CUT_POWER}: SMC100: ")
    assert "nor could its position be read" in stops.answer.sentence


def test_a_real_driver_whose_controller_moves_on_has_failed(newport):
    bench = newport().opened()
    bench.stage.halt = lambda acceleration: None
    stops, ending = stops_of(bench.driver)
    ending.call("enough", failed=False)
    stops.confirm()
    assert stops.answer.kind is Stop.FAILED, stops.answer
    assert "says that it moves" in stops.answer.sentence
