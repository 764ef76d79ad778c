"""What is asked of the actuator: nothing before it is ready, and one move by what was asked from
where the stage truly is.
"""

import math

import pytest

from app.acquisition.stage import Stage
from app.experiment.course import Go
from app.settings import config
from drivers.errors import DeviceFault, DeviceTimeout, OutOfLimits


class Actuator:
    """A stage that stands at 12.5 mm; `readings` are given first."""

    name = "stage X"
    travel_limits_m = (0.0, 25e-3)

    def __init__(self):
        self.place, self.readings, self.moves, self.calls = 12.5e-3, [], False, []
        self.refusal = None

    def make_ready(self):
        if self.refusal:
            raise DeviceFault(self.refusal)

    def position_m(self):
        self.calls.append("position")
        reading = self.readings.pop(0) if self.readings else self.place
        if isinstance(reading, Exception):
            raise reading
        return reading

    def is_moving(self):
        return self.moves

    def set_velocity(self, velocity_m_s):
        self.velocity = velocity_m_s

    def move_to(self, position_m):
        self.target = position_m

    def stop(self):
        self.calls.append("stop")
        if self.readings and isinstance(self.readings[0], Exception):
            raise self.readings[0]


@pytest.fixture
def actuator():
    return Actuator()


def stage(actuator, *overrides):
    return Stage(config.load(None, ["run.travel=100", *overrides]), actuator)


@pytest.mark.parametrize("travel", [100, -100])
def test_the_drive_begins_where_the_stage_is_and_not_where_it_was(actuator, travel):
    one = stage(actuator, f"run.travel={travel}")
    one.arm()
    actuator.place = 13e-3  # a jog, to renew the contact
    one.aim()
    one.go(Go(travel * 1e-6, 5e-6))
    assert actuator.target == pytest.approx(13e-3 + travel * 1e-6, abs=1e-12)
    assert one.look() == (13e-3, False)
    assert one.travel_m == 0.0


@pytest.mark.parametrize("ask", ["arm", "aim", "look", "reading"])
def test_a_position_that_is_no_number_is_told_whoever_asks(actuator, ask):
    actuator.place = None
    with pytest.raises(DeviceFault, match="stage X: its driver gave None for its position"):
        getattr(stage(actuator), ask)()


@pytest.mark.parametrize("wrong", [(12.5e-3, 15.047e-3), (15.047e-3, 12.5e-3), (math.nan, 12.5e-3)])
def test_two_readings_that_do_not_agree_begin_no_drive(actuator, wrong):
    actuator.readings = list(wrong)
    with pytest.raises(DeviceFault, match="stage X: the drive was to begin where the stage stands"):
        stage(actuator).aim()


def test_a_velocity_that_was_refused_is_asked_for_again(actuator):
    def refuse(velocity_m_s):
        raise OutOfLimits(f"stage X: not {velocity_m_s}")

    one, actuator.set_velocity = stage(actuator), refuse
    for _ in range(2):  # a stage that kept its former velocity is not sent on
        with pytest.raises(OutOfLimits, match="not 5e-06"):
            one.go(Go(100e-6, 5e-6))
    assert not hasattr(actuator, "target")


def test_the_travel_counts_along_x(actuator):
    one = stage(actuator)
    one.aim()
    actuator.place -= 20e-6
    one.look()
    assert one.travel_m == pytest.approx(-20e-6)


def test_a_stage_that_moves_is_not_driven(actuator):
    actuator.moves = True
    with pytest.raises(DeviceFault, match="mm and moves; let nothing else move it"):
        stage(actuator).aim()
    with pytest.raises(DeviceFault, match="the stage moves already; stop it"):
        stage(actuator).arm()


@pytest.mark.parametrize(("place", "travel"), [(24.95e-3, 100), (0.05e-3, -100)])
def test_a_travel_without_room_is_told_when_it_is_armed(actuator, place, travel):
    actuator.place = place
    with pytest.raises(
        OutOfLimits, match=r"run\.travel = .*100 um from .* put it where it has room"
    ):
        stage(actuator, f"run.travel={travel}").arm()


def test_what_the_actuator_would_refuse_is_told_when_it_is_armed(actuator):
    actuator.refusal = "stage X: NOT REFERENCED; home it"
    with pytest.raises(DeviceFault, match="NOT REFERENCED; home it"):
        stage(actuator).arm()


@pytest.mark.parametrize("garbled", [15.047e-3, 2.5e-3])
def test_one_garbled_reading_in_the_drive_is_read_again(actuator, garbled):
    one = stage(actuator)
    one.aim()
    actuator.readings = [garbled]
    assert one.look() == (12.5e-3, False)


def test_a_stage_that_has_fallen_silent_is_asked_nothing_but_to_stop(actuator):
    one = stage(actuator)
    actuator.readings = [DeviceTimeout("no answer"), DeviceTimeout("no answer")]
    with pytest.raises(DeviceTimeout):
        one.look()
    actuator.calls.clear()
    assert math.isnan(one.look()[0])
    with pytest.raises(DeviceTimeout):
        one.halt()
    assert actuator.calls == ["stop"]
