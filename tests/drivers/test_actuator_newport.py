"""The drivers of SMC100CC and CONEX-CC on emulated controllers: the contract, what they say, and
their limits.
"""

import math

import pytest
from contracts import ActuatorContract
from newport_bench import patient
from python_program import python
from worlds import scenario

from drivers.clock import SampleClock
from drivers.emulators.newport import EmulatedConexCc, EmulatedSmc100
from drivers.errors import DeviceFault, OutOfLimits
from drivers.settings import ActuatorSettings
from drivers.sim.world import World
from drivers.stages.newport_stage import ConexCc, Smc100, find

QUERIES = (b"VE", b"ID?", b"TS", b"TP", b"TE", b"SL?", b"SR?", b"VA?")


# ------------------------------------------------------------------ the contract


class OnAController(ActuatorContract):
    """The contract on a controller with a free stage."""

    driver, over = Smc100, "pty"

    @pytest.fixture(autouse=True)
    def _far_end(self, newport):
        self.bench = newport(self.driver, self.over)

    @pytest.fixture
    def actuator(self):
        return self.bench.driver

    @pytest.fixture
    def pass_time(self):
        return self.bench.pass_time


class TestSmc100(OnAController):
    pass


class TestSmc100OnTheNetwork(OnAController):
    over = "tcp"


class TestConexCc(OnAController):
    driver = ConexCc


class TestConexCcOnTheNetwork(OnAController):
    driver, over = ConexCc, "tcp"


class InAWorld(ActuatorContract):
    """The contract on the emulated driver of a simulated world."""

    kind = EmulatedSmc100

    @pytest.fixture
    def world(self):
        return World(scenario(press_time=3600.0), pace=None)

    @pytest.fixture
    def actuator(self, world):
        stage = self.kind(ActuatorSettings(), SampleClock(1000.0), world)
        with patient():
            yield stage
            stage.close()

    @pytest.fixture
    def pass_time(self, world):
        return lambda seconds: world.advance(round(seconds * 1000))


class TestEmulatedSmc100(InAWorld):
    pass


class TestEmulatedConexCc(InAWorld):
    kind = EmulatedConexCc


# ------------------------------------------------------------------ what it says

STATES = {  # of the manuals' TS command; "|" where the two models differ, SMC100CC first
    "0A": "NOT REFERENCED from reset",
    "0B": "NOT REFERENCED from HOMING",
    "0C": "NOT REFERENCED from CONFIGURATION",
    "0D": "NOT REFERENCED from DISABLE",
    "0E": "NOT REFERENCED from READY",
    "0F": "NOT REFERENCED from MOVING",
    "10": "NOT REFERENCED, error of the ESP stage|NOT REFERENCED, no parameters in memory",
    "11": "NOT REFERENCED from JOGGING|does not name",
    "14": "CONFIGURATION",
    "1E": "HOMING",
    "1F": "HOMING, commanded by the keypad|does not name",
    "28": "MOVING",
    "32": "READY from HOMING",
    "33": "READY from MOVING",
    "34": "READY from DISABLE",
    "35": "READY from JOGGING|does not name",
    "36": "does not name|READY T from READY",
    "37": "does not name|READY T from TRACKING",
    "38": "does not name|READY T from DISABLE T",
    "3C": "DISABLE from READY",
    "3D": "DISABLE from MOVING",
    "3E": "DISABLE from JOGGING|DISABLE from TRACKING",
    "3F": "does not name|DISABLE from READY T",
    "46": "JOGGING from READY|TRACKING from READY T",
    "47": "JOGGING from DISABLE|TRACKING from TRACKING",
    "99": "does not name",
}


@pytest.mark.parametrize("model", [0, 1])
def test_every_state_is_told_in_words(newport_open, model):
    stage = newport_open((Smc100, ConexCc)[model])
    for code, words in STATES.items():
        stage.device.answers["TS"] = f"1TS0000{code}"
        assert words.split("|")[-model if "|" in words else 0] in stage.driver.describe()
        assert stage.driver.is_moving() is (
            code in ("1E", "28", "46", "47") or (code == "1F" and model == 0)
        )


BITS = {
    0: "negative end of run",
    1: "positive end of run",
    2: "peak current limit",
    3: "RMS current limit",
    4: "short circuit",
    5: "following error",
    6: "homing took longer than its time-out",
    7: "wrong ESP stage",
    8: "supply voltage of the motor is too low",
    9: "80 W",
    10: "error bit 10",
    15: "error bit 15",
}


@pytest.mark.parametrize("bit", BITS)
def test_every_error_of_the_stage_ends_the_move_with_its_sentence(newport_open, bit):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["TS"] = [f"1TS{1 << bit:04X}0E", "1TS00000E"]
    for ask in (stage.driver.is_moving, stage.driver.position_m, stage.driver.is_moving):
        with pytest.raises(
            DeviceFault,
            match=f"SMC100: the motion failed: .*{BITS[bit]}.*NOT REFERENCED from READY; home it",
        ):
            ask()
    stage.driver.stop()  # nothing moves: no error


def test_an_error_of_an_earlier_day_is_no_fault_of_this_one(newport_open):
    stage = newport_open()
    stage.device.answers["TS"] = ["1TS000232", "1TS000032"]
    assert not stage.driver.is_moving()


def test_a_move_that_ends_in_another_state_has_failed_even_if_no_bit_says_so(newport_open):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.answers["TS"] = "1TS00003D"
    with pytest.raises(DeviceFault, match="it is now DISABLE from MOVING; its motor is off"):
        stage.driver.is_moving()


LETTERS = {
    "A": "unknown to it, or came damaged",
    "B": "address is not correct",
    "C": "missing or out of its range",
    "D": "not allowed",
    "E": "has already begun",
    "F": "name of the ESP stage",
    "G": "outside its soft limits",
    "H": "NOT REFERENCED; home it",
    "I": "CONFIGURATION; leave it",
    "J": "DISABLE; its motor is off",
    "K": "in the state READY",
    "L": "HOMING",
    "M": "while it moves",
    "N": "stands outside its soft limits",
    "S": "communication time-out",
    "U": "EEPROM",
    "V": r"while it was executed \(what the controller says\)",
    "W": "stepper",
    "X": "DC controller",
    "Q": r"does not name the error Q \(what the controller says\)",
}


@pytest.mark.parametrize("letter", LETTERS)
def test_every_refusal_is_told_in_words_and_nothing_moves(newport_open, letter):
    stage = newport_open()
    stage.device.answers |= {
        "TE": 3 * ["1TE@", f"1TE{letter}"],
        f"TB{letter}": f"1TB{letter} what the controller says",
        "PA13": "",
    }
    kind = OutOfLimits if letter in "CG" else DeviceFault
    with pytest.raises(
        kind, match=f"a move to 13 mm was requested, the controller refused: .*{LETTERS[letter]}"
    ):
        stage.driver.move_to(13e-3)
    assert not stage.driver.is_moving()
    assert len(stage.sent("PA13")) == (3 if letter in "AS" else 1)


def test_description(newport_open):
    text = newport_open().driver.describe()
    assert text == (
        "SMC_CC - Controller-driver version  3. 1. 2, stage EMULATED_25MM, READY from HOMING, at"
        " 12.5 mm, travel 0 to 25 mm"
    )


def test_ports_are_found_without_opening_them():
    assert all(port.device and port.description for port in find())


def test_the_module_loads_no_vendor_library():
    code = (
        "import sys, drivers.stages.newport_stage, drivers.emulators.newport;"
        " assert 'serial' not in sys.modules"
    )
    assert python("-c", code).returncode == 0


# ------------------------------------------------------------------ limits


def test_the_narrower_limits_hold_and_the_controller_is_told(newport_open):
    stage = newport_open(travel=(-1e-3, 20e-3))
    assert stage.driver.travel_limits_m == pytest.approx((-1e-3, 20e-3))
    assert (stage.controller.parameters["SL"], stage.controller.parameters["SR"]) == (-1.0, 20.0)
    with pytest.raises(
        OutOfLimits, match=r"a move to 20\.001 mm was requested; its travel is -1 to 20 mm"
    ):
        stage.driver.move_to(20.001e-3)
    assert not stage.sent("PA")


def test_what_the_controller_can_not_be_told_the_driver_keeps(newport_open):
    stage = newport_open(travel=(5e-3, 20e-3))  # SL may not be above 0
    assert stage.controller.parameters["SL"] == 0.0
    assert stage.driver.travel_limits_m == pytest.approx((5e-3, 20e-3))
    with pytest.raises(OutOfLimits):
        stage.driver.move_to(4e-3)


def test_limits_of_the_controller_that_are_narrower_hold(newport):
    stage = newport(travel=(-5e-3, 25e-3))
    stage.device.answers |= {"SL?": "1SL-2", "SR?": "1SR20"}
    stage.driver.open()
    stage.driver.make_ready()
    assert stage.driver.travel_limits_m == pytest.approx((-2e-3, 20e-3))
    for target in (-2.001e-3, 20.001e-3):
        with pytest.raises(OutOfLimits, match=r"its travel is -2 to 20 mm"):
            stage.driver.move_to(target)
    assert not stage.sent("PA")


def test_limits_that_the_settings_do_not_have_are_those_of_the_controller(newport):
    stage = newport(travel=(-math.inf, math.inf))
    stage.controller.parameters |= {"SL": -2.0, "SR": 20.0}
    stage.driver.open()
    assert stage.driver.travel_limits_m == pytest.approx((-2e-3, 20e-3))
    stage.driver.make_ready()
    assert stage.driver.travel_limits_m == pytest.approx((-2e-3, 20e-3))
    with pytest.raises(OutOfLimits, match=r"its travel is -2 to 20 mm"):
        stage.driver.move_to(20.001e-3)


def test_limits_that_leave_nothing_are_refused(newport):
    stage = newport(travel=(-2e-3, -1e-3))
    stage.device.answers["SL?"] = "1SL0"
    stage.driver.open()
    with pytest.raises(OutOfLimits, match="nothing in common"):
        stage.driver.make_ready()


def test_opening_reads_and_sets_nothing(newport):
    stage = newport(travel=(0.0, 20e-3), max_velocity=50e-6)
    stage.driver.open()
    stage.driver.describe()
    stage.driver.is_moving()
    stage.driver.position_m()
    assert all(command[1:] in QUERIES for _, command in stage.line.arrivals), stage.line.arrivals
    stage.driver.close()


@pytest.mark.parametrize(
    ("state", "remedy"),
    [
        (0x0A, r"NOT REFERENCED from reset; home it with the block free"),
        (0x3D, r"DISABLE from MOVING; its motor is off"),
        (0x14, r"CONFIGURATION; leave it"),
    ],
)
def test_a_stage_that_would_refuse_a_move_says_so_before(newport, state, remedy):
    stage = newport()
    stage.controller.state = state
    stage.driver.open()
    with pytest.raises(DeviceFault, match=f"SMC100: a move is to be made and it is {remedy}"):
        stage.driver.make_ready()
    assert not stage.sent("SR")


def test_a_velocity_left_by_another_program_is_limited(newport_open):
    stage = newport_open(max_velocity=50e-6)
    assert stage.controller.parameters["VA"] == pytest.approx(0.05)
    with pytest.raises(
        OutOfLimits, match=r"60 um/s was requested; use one above 0 and up to 50 um/s"
    ):
        stage.driver.set_velocity(60e-6)


def test_a_velocity_above_that_of_the_controller_is_out_of_limits(newport_open):
    stage = newport_open(max_velocity=2e-3)
    with pytest.raises(OutOfLimits, match="1500 um/s was requested, the controller refused"):
        stage.driver.set_velocity(1.5e-3)
    assert stage.controller.parameters["VA"] == 1.0


@pytest.mark.parametrize("velocity_m_s", [5e-6, 1e-8, 1e-3])
def test_slow_velocities_are_told_exactly(newport_open, velocity_m_s):
    stage = newport_open()
    stage.driver.set_velocity(velocity_m_s)
    assert stage.controller.parameters["VA"] == pytest.approx(velocity_m_s * 1e3, rel=1e-9)
