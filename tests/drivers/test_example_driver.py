"""The example of the documentation is a driver: it passes the contract, on a real serial port of
the operating system.
"""

import importlib.util
from pathlib import Path

import pytest
import serial
from contracts import ActuatorContract
from free_stage import FreeStage
from processes.launched import wait_until

from drivers.clock import SampleClock
from drivers.emulators.serial_line import SerialLine
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.settings import ActuatorSettings

EXAMPLE = Path(__file__).parents[2] / "docs" / "example_driver.py"


@pytest.fixture
def text_stage():
    spec = importlib.util.spec_from_file_location("example_driver", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.TextStage


class Microcontroller:
    """The far end of the line; millimetres inside, as the stage counts."""

    def __init__(self, clock):
        self.stage = FreeStage(clock)

    def answer(self, command):
        match command.decode().split():
            case ["M", target, speed]:
                self.stage.move(float(target) * 1e-3, float(speed) * 1e-3, 1e3)
            case ["S"]:
                self.stage.halt(1e3)
            case ["P"]:
                return f"{self.stage.position() * 1e3:.3f}".encode()
            case ["B"]:
                return b"1" if self.stage.is_moving() else b"0"
        return b""


@pytest.fixture
def time():
    return [0.0]


@pytest.fixture
def line(time):
    line = SerialLine(Microcontroller(lambda: time[0]))
    line.start()
    yield line
    line.cut()


@pytest.fixture
def actuator(text_stage, line):
    return text_stage(ActuatorSettings(port=line.url, travel=(0.0, 25e-3)), SampleClock(1000.0))


class TestTextStage(ActuatorContract):
    @pytest.fixture
    def actuator(self, actuator):
        return actuator

    @pytest.fixture
    def pass_time(self, time, line):
        def wait(seconds):
            with serial.Serial(line.url, timeout=20.0) as port:
                port.write(b"B\n")
                port.readline()  # comes when all commands before it have arrived
            time[0] += seconds

        return wait


def test_it_is_as_short_as_the_documentation_says():
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) < 100


def test_what_is_not_there_is_told(text_stage, actuator, line):
    with pytest.raises(DeviceNotFound, match=r"check actuator\.port"):
        text_stage(ActuatorSettings(port="/dev/nothing"), SampleClock(1000.0)).open()
    actuator.open()
    line.is_mute = True
    with pytest.raises(DeviceTimeout, match="no answer"):
        actuator.position_m()
    line.cut()
    with pytest.raises((DeviceFault, DeviceTimeout)):
        actuator.position_m()


def test_a_port_whose_line_is_dead_is_let_go(actuator, line):
    actuator.open()
    port = actuator._line
    line.cut()
    with pytest.raises(DeviceFault, match="its line is dead"):
        actuator.close()
    assert not port.is_open
    actuator.close()


@pytest.mark.parametrize("came", [b"1250", b"1?500.000\r\n", b"1\r\n", b""])
def test_an_answer_of_another_form_or_a_piece_of_one_is_no_position(actuator, line, came):
    actuator.open()
    send, rest = line._wire.send, []
    line._wire.send = lambda answer: (rest.append(answer), send(came))
    with pytest.raises(DeviceTimeout, match="no answer to 'P'"):
        actuator.position_m()
    line._wire.send = send
    send(rest[0])  # late: it answers nothing that is asked now
    wait_until(lambda: actuator._line.in_waiting)
    assert not actuator.is_moving()
    actuator.close()
